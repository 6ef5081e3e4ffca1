"""YAML on disk <-> typed structures. An error names file, line, key path, what was found and what was expected.

In: paths and msgspec types. Out: values, or one ConfigError. What the keys mean is said where the types are.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import msgspec
import yaml

T = TypeVar("T")
Key = str | int


class ConfigError(Exception):
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
        """The document as `kind`. Raises ConfigError; unknown keys are refused where the type forbids them."""
        if self.data is None:
            raise ConfigError(f"{self.path}: expected {_plain_name(kind)}, found an empty file")
        try:
            return msgspec.convert(self.data, kind)
        except msgspec.ValidationError as error:
            raise self._explain(error, kind) from None

    def _explain(self, error: msgspec.ValidationError, kind: type[Any]) -> ConfigError:
        problem, keys = _split(str(error))
        keys = _settle_wildcards(keys, self.data, problem, lambda data: msgspec.convert(data, kind))
        unknown = re.match(r"Object contains unknown field `(.*)`", problem)
        if unknown:
            return self.error((*keys, unknown[1]), f"unknown key{_suggestion(unknown[1], problem_fields(kind, keys))}")
        missing = re.match(r"Object missing required field `(.*)`", problem)
        if missing:
            return self.error(keys, f"the key `{missing[1]}` is missing")
        found = _value(self.data, keys)
        expected = re.sub(r", got .*", "", problem).replace("`", "")
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


def problem_fields(kind: Any, keys: tuple[Key, ...]) -> list[str]:
    """The keys a struct type knows at a key path; empty where the path leads through something else."""
    for key in keys:
        options = getattr(kind, "__args__", (kind,))
        for option in options:
            fields = {f.encode_name: f.type for f in msgspec.structs.fields(option)} if _is_struct(option) else {}
            if key in fields:
                kind = fields[str(key)]
                break
    options = [o for o in getattr(kind, "__args__", (kind,)) if _is_struct(o)]
    return [f.encode_name for o in options for f in msgspec.structs.fields(o)]


def _is_struct(kind: Any) -> bool:
    return isinstance(kind, type) and issubclass(kind, msgspec.Struct)


def _plain_name(kind: Any) -> str:
    return "keys and values" if _is_struct(kind) else getattr(kind, "__name__", str(kind))


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


def _refuse_doubles(path: Path, node: yaml.Node | None) -> None:
    if isinstance(node, yaml.MappingNode):
        seen: set[str] = set()
        for key, value in node.value:
            if key.value in seen:
                raise ConfigError(f"{path}:{key.start_mark.line + 1}: {key.value}: said twice")
            seen.add(key.value)
            _refuse_doubles(path, value)
    elif isinstance(node, yaml.SequenceNode):
        for item in node.value:
            _refuse_doubles(path, item)
