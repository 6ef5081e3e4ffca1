"""YAML on disk <-> typed structures. An error names file, line, key path, what was found and what was expected.

In: paths and msgspec types. Out: values, or one ConfigError. What the keys mean is said where the types are.
"""

from __future__ import annotations

import dataclasses
import difflib
import re
import types
import typing
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import msgspec
import yaml

from daemon.errors import FacetdError

T = TypeVar("T")
Key = str | int


class ConfigError(FacetdError):
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

    def convert(self, kind: type[T]) -> T:
        """The document as `kind`: a struct, a dataclass, or lists and mappings of them. Unknown keys are refused.

        Raises ConfigError.
        """
        if self.data is None:
            raise ConfigError(f"{self.path}: expected {_plain_name(kind)}, found an empty file")
        try:
            value: T = msgspec.convert(_without_empty_sections(self.data, kind), kind)
        except msgspec.ValidationError as error:
            raise self._explain(error, kind) from None
        for keys, known in _unknown_keys(self.data, kind, ()):
            raise self.error(keys, f"unknown key{_suggestion(str(keys[-1]), known)}")
        return value

    def section(self, keys: tuple[Key, ...], kind: type[T]) -> T:
        """The part of the document below `keys` as `kind`; an absent part is an empty one. Raises ConfigError."""
        data: Any = _value(self.data, keys) or {}
        for key in reversed(keys):
            data = {key: data}
        whole = Document(self.path, data, self.root)
        nested: Any = kind
        for key in reversed(keys):
            nested = msgspec.defstruct(str(key), [(str(key), nested)])
        value: Any = whole.convert(nested)
        for key in keys:
            value = getattr(value, str(key))
        section: T = value
        return section

    def _explain(self, error: msgspec.ValidationError, kind: type[Any]) -> ConfigError:
        problem, keys = _split(str(error))
        keys = _settle_wildcards(keys, self.data, problem, lambda data: msgspec.convert(data, kind))
        unknown = re.match(r"Object contains unknown field `(.*)`", problem)
        if unknown:
            known = next((k for where, k in _unknown_keys(self.data, kind, ()) if where == (*keys, unknown[1])), [])
            return self.error((*keys, unknown[1]), f"unknown key{_suggestion(unknown[1], known)}")
        missing = re.match(r"Object missing required field `(.*)`", problem)
        if missing:
            return self.error(keys, f"the key `{missing[1]}` is missing")
        if not problem.startswith(("Expected", "Invalid")):
            return self.error(keys, problem)
        found = _value(self.data, keys)
        if "Invalid enum value" in problem:
            choices = ", ".join(str(choice) for choice in typing.get_args(_kind_at(kind, keys)))
            return self.error(keys, f"expected one of {choices}, found {_short(found)}")
        expected = re.sub(r", got .*", "", problem).replace("`", "").replace("object", "keys and values")
        return self.error(keys, f"{expected[:1].lower()}{expected[1:]}, found {_short(found)}")


def read(path: Path) -> Document:
    """Parse one file. Raises ConfigError where it cannot be read, is not YAML, or says a key twice."""
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise ConfigError(f"{path}: not a text file (UTF-8 expected)") from None
    try:
        root = yaml.compose(text, Loader=yaml.SafeLoader)
        _refuse_doubles(path, root)
        return Document(path, yaml.safe_load(text), root)
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


def _is_struct(kind: Any) -> bool:
    return isinstance(kind, type) and issubclass(kind, msgspec.Struct)


def _field_types(kind: Any) -> dict[str, Any]:
    """Field -> type of a struct or dataclass; empty for anything else."""
    if _is_struct(kind):
        return {f.encode_name: f.type for f in msgspec.structs.fields(kind)}
    return typing.get_type_hints(kind) if dataclasses.is_dataclass(kind) else {}


def _without_empty_sections(data: Any, kind: Any) -> Any:
    """A section in which every key is commented out is an empty one, and means its defaults."""
    fields = _field_types(kind)
    if data is None and fields:
        return {}
    if not isinstance(data, dict):
        return data
    return {key: _without_empty_sections(value, fields.get(key)) for key, value in data.items()}


def _kind_at(kind: Any, keys: tuple[Key, ...]) -> Any:
    """The type that holds at a key path, with `| None` taken off."""
    options = [o for o in typing.get_args(kind) if o is not type(None)]
    if typing.get_origin(kind) in (typing.Union, types.UnionType) and len(options) == 1:
        return _kind_at(options[0], keys)
    if not keys:
        return kind
    fields = _field_types(kind)
    return _kind_at(fields[str(keys[0])] if fields else options[-1] if options else None, keys[1:])


def _unknown_keys(data: Any, kind: Any, keys: tuple[Key, ...]) -> Iterator[tuple[tuple[Key, ...], list[str]]]:
    """Keys that no field takes (msgspec passes over them in dataclasses), each with the keys known at its place."""
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
    for key in _value(data, keys[:place]) or {}:
        try:
            convert(_only(data, keys[:place], key))
        except msgspec.ValidationError as error:
            if _split(str(error))[0] == problem:
                return _settle_wildcards((*keys[:place], key, *keys[place + 1 :]), data, problem, convert)
    return keys


def _only(data: Any, keys: tuple[Key, ...], key: Key) -> Any:
    """A copy of data in which the mapping at `keys` holds `key` alone."""
    if not keys:
        return {key: data[key]}
    if isinstance(data, list):
        return [_only(v, keys[1:], key) if i == keys[0] else v for i, v in enumerate(data)]
    return {**data, keys[0]: _only(data[keys[0]], keys[1:], key)}


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


def _refuse_doubles(path: Path, node: yaml.Node | None, above: tuple[yaml.Node, ...] = ()) -> None:
    """Raise ConfigError for a key said twice, a key that is not a word, or a file that contains itself."""
    if node is None or isinstance(node, yaml.ScalarNode):
        return
    if node in above:
        raise ConfigError(f"{path}:{node.start_mark.line + 1}: an anchor that contains itself")
    seen: set[str] = set()
    for item in node.value:
        key, value = item if isinstance(node, yaml.MappingNode) else (None, item)
        if key is not None:
            where = f"{path}:{key.start_mark.line + 1}"
            if not isinstance(key, yaml.ScalarNode):
                raise ConfigError(f"{where}: expected a word as key, found a list or mapping")
            if key.value in seen:
                raise ConfigError(f"{where}: {key.value}: said twice")
            seen.add(key.value)
        _refuse_doubles(path, value, (*above, node))
