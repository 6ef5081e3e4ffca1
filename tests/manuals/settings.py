"""docs/SETTINGS.md, made from the settings structures: key, default, allowed values, unit and meaning of each.

The meaning is the docstring below a field, the unit the end of its name, the bounds its type: nothing is written twice.
"""

from __future__ import annotations

import ast
import dataclasses
import inspect
import json
import textwrap
import typing
from collections.abc import Iterator
from functools import cache
from typing import Any

import msgspec

from daemon import config
from daemon.cell.linuxcnc_arm import LinuxcncSettings
from daemon.store.yamlfile import KIND, PLAIN, UNIONS, kinds_of
from drivers.camera.settings import CameraSettings
from drivers.val2.dialect import Dialect

TYPED_BY_DRIVERS: dict[str, type] = {"cameras": CameraSettings, "arm.dialect": Dialect, "backend": LinuxcncSettings}
UNITS = {
    "area_px": "px²",
    "mm_s": "mm/s", "deg_s": "degrees/s", "mm": "mm", "deg": "degrees", "px": "px", "pct": "%", "ms": "ms", "s": "s",
    "mb": "MB", "days": "days", "grey": "grey levels", "sigmas": "sigmas", "fps": "frames/s", "baud": "bits/s",
}  # fmt: skip
"""By the end of a name."""
LONGEST_DEFAULT = 60
BELOW = "below the table"
"""Where a longer default is."""
HEAD = """# Settings: reference of facetd.yaml

Every key of `/etc/facetd/facetd.yaml` (in a checkout: `etc/facetd.yaml`): its default, the values that facetd accepts,
its unit and its meaning. This page is made from the code: `make docs` writes it, a test keeps it true.

- A dot separates a section from its key: `log.quota_mb` is the key `quota_mb` in the section `log`.
- A key that is absent has its default. *required*: the key must be there. *unset*: nothing applies.
- facetd refuses an unknown key or a value outside the bounds, and names file, line and key: `facetd --check`.
- After a change: `facetctl reload`. It says which changes need `sudo systemctl restart facetd` instead.
- `[]` marks a list: each entry has the keys of that table. `NAME` stands for a name of your choice.
- Lengths are in mm, angles in degrees. *world* is VAL II's world frame.
"""
TAIL = """## Keys of earlier versions

facetd passes over these keys and says so with file and line; `facetctl doctor` repeats it.

| key | what became of it |
| --- | --- |
{rows}
"""


@dataclasses.dataclass(frozen=True)
class Setting:
    """One row of the reference."""

    name: str
    kind: Any
    default: str
    meaning: str


@cache
def meanings(kind: type) -> dict[str, str]:
    """Field -> the docstring below it, on one line."""
    body = ast.parse(textwrap.dedent(inspect.getsource(kind))).body[0]
    assert isinstance(body, ast.ClassDef)
    found = {}
    for field, below in zip(body.body, body.body[1:], strict=False):
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name) and isinstance(below, ast.Expr):
            found[field.target.id] = " ".join(str(ast.literal_eval(below.value)).split())
    return found


def bare(kind: Any) -> Any:
    """A type without its bounds and without None."""
    if typing.get_origin(kind) is typing.Annotated:
        return bare(typing.get_args(kind)[0])
    if typing.get_origin(kind) in UNIONS:
        options = [option for option in typing.get_args(kind) if option is not type(None)]
        return bare(options[0]) if len(options) == 1 else kind
    return kind


def entries(kind: Any) -> type | None:
    """The structure that a list or a mapping of names is of, or the structure itself."""
    kind = bare(kind)
    inner = bare(typing.get_args(kind)[0]) if typing.get_origin(kind) is tuple else kind
    inner = bare(typing.get_args(kind)[1]) if typing.get_origin(kind) is dict else inner
    structure = dataclasses.is_dataclass(inner) or (isinstance(inner, type) and issubclass(inner, msgspec.Struct))
    return inner if structure and isinstance(inner, type) else None


def fields_of(kind: type) -> dict[str, Any]:
    """Field -> its default, as a value; MISSING where it has none."""
    if dataclasses.is_dataclass(kind):
        return {field.name: value_of(field) for field in dataclasses.fields(kind)}
    return {field.name: field.default for field in msgspec.structs.fields(kind)}


def allowed(kind: Any) -> str:
    """The values that a type takes, in words."""
    plain = bare(kind)
    if typing.get_origin(plain) is typing.Literal:
        return " or ".join(f"`{choice}`" for choice in typing.get_args(plain))
    if typing.get_origin(plain) is tuple:
        inner = typing.get_args(plain)
        if typing.get_origin(bare(inner[0])) is tuple:
            return f"{len(inner)} lists of {allowed(inner[0])}" if inner[-1] is not Ellipsis else "a list of lists"
        return f"{'list' if inner[-1] is Ellipsis else len(inner)} of: {allowed(inner[0])}"
    for option in (kind, *typing.get_args(kind)):
        for meta in getattr(option, "__metadata__", ()):
            if plain is str or plain is bytes:
                return f"{PLAIN['str']}, {meta.min_length or 0} to {meta.max_length} characters"
            low = f"above {meta.gt:.10g}" if meta.gt is not None else f"{meta.ge:.10g}"
            return f"{'whole number, ' if plain is int else ''}{low} to {meta.le:.16g}"
    return PLAIN.get(getattr(plain, "__name__", ""), "keys and values")


def value_of(field: dataclasses.Field[Any]) -> Any:
    """A field's default; MISSING where it has none."""
    return field.default if field.default_factory is dataclasses.MISSING else field.default_factory()


def default_of(value: Any) -> str:
    """A default as a person writes it into the file."""
    if value in (dataclasses.MISSING, None):
        return "*unset*" if value is None else "*required*"
    if isinstance(value, bytes):
        return f"`{json.dumps(value.decode('latin-1'))}`"
    plain = _short(msgspec.to_builtins(value))
    if isinstance(plain, str):
        return f"`{plain}`"
    return f"`{json.dumps(plain)}`" if len(json.dumps(plain)) <= LONGEST_DEFAULT else BELOW


def _written_out(kind: type, name: str) -> str:
    """A long default as a block of the file, an entry a line."""
    lines = [f"  - {json.dumps(_short(entry))}" for entry in msgspec.to_builtins(fields_of(kind)[name])]
    return "\n".join(["```yaml", f"{name}:", *lines, "```", ""])


def _short(value: Any) -> Any:
    """450.0 -> 450."""
    if isinstance(value, list | tuple):
        return [_short(one) for one in value]
    if isinstance(value, dict):
        return {key: _short(one) for key, one in value.items()}
    return int(value) if isinstance(value, float) and value.is_integer() else value


def unit_of(name: str) -> str:
    """By the end of its name."""
    return next((unit for end, unit in UNITS.items() if name == end or name.endswith(f"_{end}")), "")


def sections(kind: type, path: str) -> Iterator[tuple[str, type, list[Setting]]]:
    """(path, structure, its rows) of a section and all below it, depth first."""
    hints = typing.get_type_hints(kind, include_extras=True)
    rows, below = [], []
    for name, default in fields_of(kind).items():
        full = f"{path}.{name}".lstrip(".")
        if full.replace("[]", "") in config.OBSOLETE:
            continue
        hint = TYPED_BY_DRIVERS.get(full, hints[name])
        if kinds := kinds_of(hint):
            below += [(f"{full}, {KIND}: {word}", each) for word, each in kinds.items()]
            continue
        inner = entries(hint)
        listed, named = (typing.get_origin(bare(hint)) is each for each in (tuple, dict))
        if inner is not None:
            below.append((f"{full}{'[]' if listed else '.NAME' if named else ''}", inner))
        if inner is None or listed:
            rows.append(Setting(name, hint, default_of(default), meanings(kind).get(name, "")))
    yield path, kind, rows
    for inner_path, inner in below:
        yield from sections(inner, inner_path)


def document() -> str:
    """The page as text."""
    grouped: dict[type, tuple[list[str], list[Setting]]] = {}
    for path, kind, rows in sections(config.ConfigFile, ""):
        grouped.setdefault(kind, ([], rows))[0].append(path)
    parts = [HEAD]
    for kind, (paths, rows) in grouped.items():
        if rows:
            title = ", ".join(f"`{path}`" for path in paths if path) or "The top of the file"
            parts.append(f"## {title}\n\n{' '.join((inspect.getdoc(kind) or '').split())}\n")
            parts.append("| key | default | allowed | unit | meaning |\n| --- | --- | --- | --- | --- |")
            parts.append("\n".join(map(_line, rows)) + "\n")
            parts += [_written_out(kind, row.name) for row in rows if row.default == BELOW]
    parts.append(TAIL.format(rows="\n".join(f"| `{key}` | {what} |" for key, what in sorted(config.OBSOLETE.items()))))
    return "\n".join(parts)


def _line(row: Setting) -> str:
    inner = entries(row.kind)
    values = "a list of entries, below" if inner is not None else allowed(row.kind)
    return f"| `{row.name}` | {row.default} | {values} | {unit_of(row.name)} | {row.meaning} |"
