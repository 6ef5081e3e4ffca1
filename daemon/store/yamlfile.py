"""Read YAML files into typed structures. An error names file, line, key path, what was expected and what was found."""

from __future__ import annotations

import dataclasses
import difflib
import re
import types
import typing
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Annotated, Any, TypeVar

import msgspec
import yaml

from daemon.store.outside import FileError, read_file

T = TypeVar("T")
Key = str | int
PLAIN = {
    "int": "a whole number",
    "float": "a number",
    "str": "text",
    "bool": "true or false",
    "array": "a list",
    "object": "keys and values",
}
"""Names of the types for people."""
UNIONS = (typing.Union, types.UnionType)
KIND = "kind"
"""The key that says which kind a section is of, where it may be of several."""
ODD_NUMBER = re.compile(r"[-+]?(0[0-7_]+|[0-9_.]+(:[0-9_.]+)+)")
"""Pattern of what YAML 1.1 reads as octal or in base 60, where a person means a number with zeros, or a time."""
BASE_LOADER: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
"""libyaml's where available (PyYAML's own packages have it): ten times as fast."""
FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)[eE][-+]?[0-9]+$")
"""Numbers of YAML 1.2 (10.3.2) that YAML 1.1, and so PyYAML, reads as text: 4e-04, 7.5e1."""


class LOADER(BASE_LOADER):  # type: ignore[misc]
    """The loader for every YAML file."""


LOADER.add_implicit_resolver("tag:yaml.org,2002:float", FLOAT, list("-+.0123456789"))
LARGEST_BYTES = 1_000_000
MAX_VALUES, DEEPEST = 50_000, 40
"""Largest number of values of a file with its aliases expanded, and its deepest nesting."""


class ConfigError(FileError):
    """A file that people write cannot be used: one line, file:line: key: expected, found."""


@dataclass(frozen=True)
class Document:
    """One parsed file: its path, its plain values, and the YAML nodes with their line numbers."""

    path: Path
    data: Any
    root: yaml.Node | None

    def error(self, keys: tuple[Key, ...], problem: str) -> ConfigError:
        """The error for the value at `keys`, ready to raise."""
        node = _find(self.root, keys)
        line = f":{node.start_mark.line + 1}" if node else ""
        where = f" {dotted(keys)}:" if keys else ""
        return ConfigError(f"{self.path}{line}:{where} {problem}")

    def has(self, keys: tuple[Key, ...]) -> bool:
        return _value(self.data, keys) is not None

    def convert(self, kind: type[T], at: tuple[Key, ...] = ()) -> T:
        """Convert to `kind`: a struct, a dataclass, or lists and mappings of them; unknown keys are errors. at: only
        this section; an absent one counts as empty. Raises ConfigError."""
        data = _value(self.data, at) or {} if at else self.data
        if data is None:
            expected = PLAIN["object"] if _field_types(kind) else getattr(kind, "__name__", str(kind))
            raise ConfigError(f"{self.path}: expected {expected}, found an empty file")
        data = _without_empty_sections(data, kind)
        for keys, known in _unknown_keys(data, kind, ()):
            raise self.error((*at, *keys), f"unknown key{_suggestion(str(keys[-1]), known)}")
        try:
            return msgspec.convert(data, kind)
        except msgspec.ValidationError as error:
            raise self._explain(error, kind, data, at) from None

    def without(self, obsolete: Mapping[str, str]) -> tuple[Document, list[str]]:
        """Remove obsolete keys, dotted; returns the document, and a line of text with the reason for each."""
        data, notes = self.data, []
        for name, why in obsolete.items():
            keys: tuple[Key, ...] = tuple(name.split("."))
            section = _value(data, keys[:-1])
            if isinstance(section, dict) and keys[-1] in section:
                data = _put(data, keys[:-1], {key: section[key] for key in section if key != keys[-1]})
                notes.append(str(self.error(keys, f"no longer a key, and ignored: {why}")))
        return dataclasses.replace(self, data=data), notes

    def _explain(self, error: msgspec.ValidationError, kind: type[Any], data: Any, at: tuple[Key, ...]) -> ConfigError:
        """msgspec's error in the words of the person who wrote the file."""
        problem, keys = _split(str(error))
        keys = _resolve_wildcards(keys, data, problem, kind)
        where, found, expected_kind = (*at, *keys), _short(_value(data, keys)), _kind_at(kind, keys, data)
        missing = re.match(r"Object missing required field `(.*)`", problem)
        if missing:
            return self.error(where, f"the key `{missing[1]}` is missing")
        if not problem.startswith(("Expected", "Invalid")):
            return self.error(where, problem)
        bounds = _bounds(expected_kind)
        if bounds and re.match(r"Expected `(int|float)` [<>]", problem):
            return self.error(where, f"expected {bounds}, found {found}")
        if "Invalid enum value" in problem:
            choices = ", ".join(str(choice) for choice in typing.get_args(_bare(expected_kind)))
            return self.error(where, f"expected one of {choices}, found {found}")
        if (kinds := kinds_of(_kind_at(kind, keys[:-1], data))) and keys[-1] == KIND:
            return self.error(where, f"expected one of {', '.join(kinds)}, found {found}")
        expected = re.sub(r", got .*", "", problem).replace("`", "")
        expected = re.sub(r"\b\w+\b", lambda word: PLAIN.get(word[0], word[0]), expected)
        return self.error(where, f"{expected[:1].lower()}{expected[1:]}, found {found}")


def read(path: Path) -> Document:
    """Parse one file. Raises FileError where it cannot be read, and ConfigError as parse does."""
    return parse(path, read_file(path, LARGEST_BYTES))


def parse(path: Path, content: bytes) -> Document:
    """Parse a file. Raises ConfigError: no YAML, too large or deep, a repeated key, an ambiguous number."""
    try:
        text = content.decode()
    except UnicodeDecodeError:
        raise ConfigError(f"{path}: not a text file (UTF-8 expected)") from None
    try:
        _refuse_bombs(path, text)
        loader = LOADER(text)
        try:
            root = loader.get_single_node()
            _refuse_ambiguous(path, root, ())
            return Document(path, None if root is None else loader.construct_document(root), root)
        finally:
            loader.dispose()
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = f":{mark.line + 1}" if mark else ""
        raise ConfigError(f"{path}{line}: not valid YAML: {error.problem or error.context}") from None
    except (yaml.YAMLError, ValueError) as error:
        raise ConfigError(f"{path}: not valid YAML: {' '.join(str(error).split())}") from None


def dotted(keys: tuple[Key, ...]) -> str:
    """('cameras', 0, 'device') -> 'cameras[0].device'."""
    return "".join(f"[{k}]" if isinstance(k, int) else f".{k}" for k in keys).lstrip(".")


def _field_types(kind: Any) -> Mapping[str, Any]:
    """Field -> type of a struct or dataclass; empty for anything else."""
    return _fields_of(kind) if isinstance(kind, type) else {}


@cache
def _fields_of(kind: type[Any]) -> Mapping[str, Any]:
    if issubclass(kind, msgspec.Struct):
        return {f.encode_name: f.type for f in msgspec.structs.fields(kind)}
    return typing.get_type_hints(kind, include_extras=True) if dataclasses.is_dataclass(kind) else {}


def kinds_of(kind: Any) -> dict[str, type]:
    """The structures of a section of several kinds, by the word under its key `kind`, the default first; else empty."""
    options = typing.get_args(kind) if typing.get_origin(kind) in UNIONS else ()
    tagged = [one for one in options if isinstance(one, type) and issubclass(one, msgspec.Struct)]
    return {str(one.__struct_config__.tag): one for one in tagged if one.__struct_config__.tag_field == KIND}


def _of_its_kind(kind: Any, data: Any) -> Any:
    """The structure of a section that may be of several kinds, by its data; any other kind as it is."""
    kinds = kinds_of(kind)
    if not kinds:
        return kind
    word = data.get(KIND) if isinstance(data, dict) else None
    return kinds.get(str(word)) or next(iter(kinds.values()))


def _without_empty_sections(data: Any, kind: Any) -> Any:
    """Replace empty sections (every key commented out) by {}, and add the default `kind` of a section of several."""
    if kinds := kinds_of(kind):
        if data is None or (isinstance(data, dict) and KIND not in data):
            data = {KIND: next(iter(kinds)), **(data or {})}
        kind = _of_its_kind(kind, data)
    fields = _field_types(kind)
    if data is None and fields:
        return {}
    if not isinstance(data, dict):
        return data
    each = typing.get_args(kind)[1] if typing.get_origin(kind) is dict else None
    return {key: _without_empty_sections(value, fields.get(key, each)) for key, value in data.items()}


def _kind_at(kind: Any, keys: tuple[Key, ...], data: Any) -> Any:
    """The type at a key path of the data, with its bounds."""
    if not keys:
        return kind
    kind = _of_its_kind(_bare(kind), data)
    options = [o for o in typing.get_args(kind) if o is not ...]
    fields = _field_types(kind)
    inner = fields.get(str(keys[0])) if fields else options[-1] if options else None
    return _kind_at(inner, keys[1:], _value(data, keys[:1]))


def _bare(kind: Any) -> Any:
    """A type without its bounds and without `| None`."""
    if typing.get_origin(kind) is Annotated:
        return _bare(typing.get_args(kind)[0])
    options = [o for o in typing.get_args(kind) if o is not type(None)]
    return _bare(options[0]) if typing.get_origin(kind) in UNIONS and len(options) == 1 else kind


def _bounds(kind: Any) -> str | None:
    """`from 0.1 to 100` for a number with two ends, `a whole number from ...` for an int; None for any other type."""
    if typing.get_origin(kind) in UNIONS:
        return next(filter(None, map(_bounds, typing.get_args(kind))), None)
    for meta in getattr(kind, "__metadata__", ()):
        low = f"above {meta.gt:.10g}" if meta.gt is not None else f"from {meta.ge:.10g}" if meta.ge is not None else ""
        if low and meta.le is not None:
            whole = f"{PLAIN['int']} " if _bare(kind) is int else ""
            return f"{whole}{low} to {meta.le:.10g}"
    return None


def _unknown_keys(data: Any, kind: Any, keys: tuple[Key, ...]) -> Iterator[tuple[tuple[Key, ...], list[str]]]:
    """Yield the keys that no field takes (msgspec ignores them in dataclasses), each with the valid keys there."""
    kind = _bare(kind)
    its_kind = {KIND: str} if kinds_of(kind) else {}
    kind = _of_its_kind(kind, data)
    options = [o for o in typing.get_args(kind) or (kind,) if o is not type(None)]
    if isinstance(data, dict):
        free = typing.get_origin(kind) is dict
        known = {} if free else {name: field for option in options for name, field in _field_types(option).items()}
        known = its_kind | known
        for key, value in data.items():
            if not known:
                yield from _unknown_keys(value, options[-1], (*keys, key))
            elif key in known:
                yield from _unknown_keys(value, known[key], (*keys, key))
            else:
                yield (*keys, key), list(known)
    elif isinstance(data, list):
        for index, value in enumerate(data):
            yield from _unknown_keys(value, options[0], (*keys, index))


def _suggestion(word: str, known: list[str]) -> str:
    close = difflib.get_close_matches(word, known, 1)
    if close:
        return f"; did you mean `{close[0]}`?"
    return f" (valid here: {', '.join(known)})" if known else ""


def _split(message: str) -> tuple[str, tuple[Key, ...]]:
    """'Expected `int`, got `str` - at `$.a[0].b`' -> the problem, ('a', 0, 'b'); a mapping's key is '*'."""
    problem, _, path = message.partition(" - at `")
    steps = re.findall(r"\.([^.\[\]`]+)|\[(\d+|\.\.\.)\]", path)
    return problem, tuple(name or ("*" if index == "..." else int(index)) for name, index in steps)


def _resolve_wildcards(keys: tuple[Key, ...], data: Any, problem: str, kind: type[Any]) -> tuple[Key, ...]:
    """Find which key of a mapping failed, which msgspec does not report: convert one at a time."""
    if "*" not in keys:
        return keys
    place = keys.index("*")
    mapping = _value(data, keys[:place]) or {}
    for key in mapping:
        try:
            msgspec.convert(_without_empty_sections(_put(data, keys[:place], {key: mapping[key]}), kind), kind)
        except msgspec.ValidationError as error:
            if _split(str(error))[0] == problem:
                return _resolve_wildcards((*keys[:place], key, *keys[place + 1 :]), data, problem, kind)
    return keys


def _put(data: Any, keys: tuple[Key, ...], value: Any) -> Any:
    if not keys:
        return value
    if isinstance(data, list):
        return [_put(v, keys[1:], value) if i == keys[0] else v for i, v in enumerate(data)]
    return {**data, keys[0]: _put(data[keys[0]], keys[1:], value)}


def _value(data: Any, keys: tuple[Key, ...]) -> Any:
    for key in keys:
        try:
            data = data[key]
        except (KeyError, IndexError, TypeError):
            return None
    return data


def _short(value: Any) -> str:
    text = "nothing" if value is None else repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _find(node: yaml.Node | None, keys: tuple[Key, ...]) -> yaml.Node | None:
    """The node at a key path, or the deepest one above it that exists (its key's own node, for the line)."""
    place = node
    for key in keys:
        if isinstance(node, yaml.MappingNode):
            pairs = [(k, v) for k, v in node.value if k.value == str(key)]
            if not pairs:
                return place
            place, node = pairs[0]
        elif isinstance(node, yaml.SequenceNode) and isinstance(key, int) and key < len(node.value):
            place = node = node.value[key]
        else:
            return place
    return place


def _refuse_bombs(path: Path, text: str) -> None:
    """Refuse a file that expands to too many values or nests too deep, before any is made. Raises ConfigError."""
    weights: dict[str, int] = {}
    open_from: list[tuple[str | None, int]] = []
    count = 0
    for event in yaml.parse(text, LOADER):
        if isinstance(event, yaml.CollectionEndEvent):
            name, begun = open_from.pop()
            if name is not None:
                weights[name] = count - begun
        elif isinstance(event, yaml.NodeEvent):
            count += weights.get(str(event.anchor), 1) if isinstance(event, yaml.AliasEvent) else 1
            if isinstance(event, yaml.CollectionStartEvent):
                open_from.append((event.anchor, count))
        if count > MAX_VALUES or len(open_from) > DEEPEST:
            what = f"more than {MAX_VALUES} values" if count > MAX_VALUES else f"lists or keys {DEEPEST} deep"
            line = f":{event.start_mark.line + 1}" if event.start_mark else ""
            raise ConfigError(f"{path}{line}: {what}, more than any file of facetd needs")


def _refuse_ambiguous(
    path: Path, node: yaml.Node | None, keys: tuple[Key, ...], above: tuple[yaml.Node, ...] = ()
) -> None:
    """Refuse repeated keys, keys that are no words, and numbers in another base. Raises ConfigError."""
    if node is None:
        return
    if isinstance(node, yaml.ScalarNode):
        if not node.style and node.tag.endswith((":int", ":float")) and ODD_NUMBER.fullmatch(node.value):
            read_as = f"{node.value} is read as {yaml.safe_load(node.value):g} (base {60 if ':' in node.value else 8})"
            where = f"{path}:{node.start_mark.line + 1}: {dotted(keys)}"
            raise ConfigError(f"{where}: {read_as}; write the number in plain digits, or in quotes if it is none")
        return
    if node in above:
        raise ConfigError(f"{path}:{node.start_mark.line + 1}: an anchor that contains itself")
    seen: set[str] = set()
    for place, item in enumerate(node.value):
        key, value = item if isinstance(node, yaml.MappingNode) else (None, item)
        if key is not None:
            where = f"{path}:{key.start_mark.line + 1}"
            if not isinstance(key, yaml.ScalarNode):
                raise ConfigError(f"{where}: expected a word as key, found a list or mapping")
            if key.value in seen:
                raise ConfigError(f"{where}: {key.value}: the key occurs twice")
            seen.add(key.value)
        _refuse_ambiguous(path, value, (*keys, place if key is None else key.value), (*above, node))
