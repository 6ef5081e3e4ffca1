"""YAML on disk <-> typed structures. An error names file, line, key path, what was found and what was expected.

In: paths and msgspec types. Out: values, or one ConfigError. What the keys mean is said where the types are.
"""

from __future__ import annotations

import dataclasses
import difflib
import re
import types
import typing
from collections.abc import Callable, Iterator, Mapping
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
"""What people call the types of the structures."""
UNIONS = (typing.Union, types.UnionType)
ODD_NUMBER = re.compile(r"[-+]?(0[0-7_]+|[0-9_.]+(:[0-9_.]+)+)")
"""What YAML 1.1 takes for octal or for minutes and seconds, where a person means a number with zeros, or a time."""
BASE_LOADER: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
"""libyaml's where there is one (PyYAML's own packages have it): a tenth of the time."""
FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)[eE][-+]?[0-9]+$")
"""Numbers of YAML 1.2 (10.3.2) that YAML 1.1, which PyYAML reads, takes for text: 4e-04, 7.5e1."""


class LOADER(BASE_LOADER):  # type: ignore[misc]
    """What reads every YAML file of facetd's."""


LOADER.add_implicit_resolver("tag:yaml.org,2002:float", FLOAT, list("-+.0123456789"))
LARGEST_BYTES = 1_000_000
MOST_VALUES, DEEPEST = 50_000, 40
"""Values that a file may come to with its aliases written out, and lists within lists."""


class ConfigError(FileError):
    """A file that people write cannot be used. The message is one line: file:line: key: expected, found."""


@dataclass(frozen=True)
class Document:
    """One parsed file: where it is, the plain values in it, and the nodes that know their line numbers."""

    path: Path
    data: Any
    root: yaml.Node | None

    def error(self, keys: tuple[Key, ...], problem: str) -> ConfigError:
        """The error for the value at `keys`, ready to raise."""
        node = _find(self.root, keys)
        line = f":{node.start_mark.line + 1}" if node else ""
        where = f" {dotted(keys)}:" if keys else ""
        return ConfigError(f"{self.path}{line}:{where} {problem}")

    def convert(self, kind: type[T], at: tuple[Key, ...] = ()) -> T:
        """The document as `kind`: a struct, a dataclass, or lists and mappings of them. Unknown keys are refused.

        at: only the section there; an absent one is an empty one. Raises ConfigError.
        """
        data = _value(self.data, at) or {} if at else self.data
        if data is None:
            raise ConfigError(f"{self.path}: expected {_plain_name(kind)}, found an empty file")
        for keys, known in _unknown_keys(data, kind, ()):
            raise self.error((*at, *keys), f"unknown key{_suggestion(str(keys[-1]), known)}")
        try:
            return msgspec.convert(_without_empty_sections(data, kind), kind)
        except msgspec.ValidationError as error:
            raise self._explain(error, kind, data, at) from None

    def without(self, gone: Mapping[str, str]) -> tuple[Document, list[str]]:
        """The document without keys that are no longer any, and a line for each that was there.

        gone: dotted key -> what replaced it, or why there is no such key any more.
        """
        data, notes = self.data, []
        for name, why in gone.items():
            keys: tuple[Key, ...] = tuple(name.split("."))
            section = _value(data, keys[:-1])
            if isinstance(section, dict) and keys[-1] in section:
                data = _put(data, keys[:-1], {key: section[key] for key in section if key != keys[-1]})
                notes.append(str(self.error(keys, f"no longer a key, and not looked at: {why}")))
        return dataclasses.replace(self, data=data), notes

    def _explain(self, error: msgspec.ValidationError, kind: type[Any], data: Any, at: tuple[Key, ...]) -> ConfigError:
        """msgspec's complaint of the data at a place, for the person who wrote the file."""
        problem, keys = _split(str(error))
        keys = _settle_wildcards(keys, data, problem, lambda changed: msgspec.convert(changed, kind))
        where, found, expected_kind = (*at, *keys), _short(_value(data, keys)), _kind_at(kind, keys)
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
        expected = re.sub(r", got .*", "", problem).replace("`", "")
        expected = re.sub(r"\b\w+\b", lambda word: PLAIN.get(word[0], word[0]), expected)
        return self.error(where, f"{expected[:1].lower()}{expected[1:]}, found {found}")


def read(path: Path) -> Document:
    """Parse one file. Raises FileError where it cannot be read, and as parse does."""
    return parse(path, read_file(path, LARGEST_BYTES))


def parse(path: Path, content: bytes) -> Document:
    """The content of a file. Raises ConfigError where it is not YAML, is too large or too deep, says a key twice, or
    has a number that YAML reads otherwise than people do."""
    try:
        text = content.decode()
    except UnicodeDecodeError:
        raise ConfigError(f"{path}: not a text file (UTF-8 expected)") from None
    try:
        _refuse_bombs(path, text)
        loader = LOADER(text)
        try:
            root = loader.get_single_node()
            _refuse_pitfalls(path, root, ())
            return Document(path, None if root is None else loader.construct_document(root), root)
        finally:
            loader.dispose()
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = f":{mark.line + 1}" if mark else ""
        raise ConfigError(f"{path}{line}: not valid YAML: {error.problem or error.context}") from None
    except (yaml.YAMLError, ValueError) as error:
        raise ConfigError(f"{path}: not valid YAML: {' '.join(str(error).split())}") from None


def load(path: Path, kind: type[T]) -> T:
    """Read and convert in one go."""
    return read(path).convert(kind)


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


def _without_empty_sections(data: Any, kind: Any) -> Any:
    """A section in which every key is commented out is an empty one, and means its defaults."""
    fields = _field_types(kind)
    if data is None and fields:
        return {}
    if not isinstance(data, dict):
        return data
    each = typing.get_args(kind)[1] if typing.get_origin(kind) is dict else None
    return {key: _without_empty_sections(value, fields.get(key, each)) for key, value in data.items()}


def _kind_at(kind: Any, keys: tuple[Key, ...]) -> Any:
    """The type that holds at a key path, bounds and all."""
    if not keys:
        return kind
    kind = _bare(kind)
    options = [o for o in typing.get_args(kind) if o is not ...]
    fields = _field_types(kind)
    return _kind_at(fields[str(keys[0])] if fields else options[-1] if options else None, keys[1:])


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
    """Keys that no field takes (msgspec passes over them in dataclasses), each with the keys known at its place."""
    kind = _bare(kind)
    options = [o for o in typing.get_args(kind) or (kind,) if o is not type(None)]
    if isinstance(data, dict):
        free = typing.get_origin(kind) is dict
        known = {} if free else {name: field for option in options for name, field in _field_types(option).items()}
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


def _plain_name(kind: Any) -> str:
    return "keys and values" if _field_types(kind) else getattr(kind, "__name__", str(kind))


def _suggestion(word: str, known: list[str]) -> str:
    close = difflib.get_close_matches(word, known, 1)
    if close:
        return f"; did you mean `{close[0]}`?"
    return f" (known here: {', '.join(known)})" if known else ""


def _split(message: str) -> tuple[str, tuple[Key, ...]]:
    """'Expected `int`, got `str` - at `$.a[0].b`' -> the problem, ('a', 0, 'b'); a mapping's key is '*'."""
    problem, _, path = message.partition(" - at `")
    steps = re.findall(r"\.([^.\[\]`]+)|\[(\d+|\.\.\.)\]", path)
    return problem, tuple(name or ("*" if index == "..." else int(index)) for name, index in steps)


def _settle_wildcards(
    keys: tuple[Key, ...], data: Any, problem: str, convert: Callable[[Any], object]
) -> tuple[Key, ...]:
    """msgspec does not say which key of a mapping failed: try them one at a time until the same problem comes back."""
    if "*" not in keys:
        return keys
    place = keys.index("*")
    mapping = _value(data, keys[:place]) or {}
    for key in mapping:
        try:
            convert(_put(data, keys[:place], {key: mapping[key]}))
        except msgspec.ValidationError as error:
            if _split(str(error))[0] == problem:
                return _settle_wildcards((*keys[:place], key, *keys[place + 1 :]), data, problem, convert)
    return keys


def _put(data: Any, keys: tuple[Key, ...], value: Any) -> Any:
    """A copy of data in which this value is at `keys`."""
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
    """Raise ConfigError for a file that says little and comes to much: aliases of aliases, lists within lists. Looked
    through as it is parsed, before anything is made of it."""
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
        if count > MOST_VALUES or len(open_from) > DEEPEST:
            what = f"more than {MOST_VALUES} values" if count > MOST_VALUES else f"lists or keys {DEEPEST} deep"
            line = f":{event.start_mark.line + 1}" if event.start_mark else ""
            raise ConfigError(f"{path}{line}: {what}: no file of facetd's is like that")


def _refuse_pitfalls(
    path: Path, node: yaml.Node | None, keys: tuple[Key, ...], above: tuple[yaml.Node, ...] = ()
) -> None:
    """Raise ConfigError for a key said twice, a key that is not a word, a file that contains itself, and numbers that
    old YAML reads in another base."""
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
                raise ConfigError(f"{where}: {key.value}: said twice")
            seen.add(key.value)
        _refuse_pitfalls(path, value, (*keys, place if key is None else key.value), (*above, node))
