"""The lists of records in deploy/RUNS.md, made from their schema."""

from __future__ import annotations

from collections.abc import Iterator
from typing import get_args, get_type_hints

import msgspec

from daemon.events.records import SCHEMA, CycleRecord


def document() -> str:
    """Every kind of record, its fields, units and meanings; `cycle` is explained there, once."""
    return "\n".join(f"**`{kind}`**: {text}\n" for kind, text in _sections())


def _sections() -> Iterator[tuple[str, str]]:
    for kind, shape in SCHEMA.items():
        hints = get_type_hints(shape, include_extras=True)
        of_pick = issubclass(shape, CycleRecord)
        lines = [f"{(shape.__doc__ or '').strip()}{' (of a pick)' if of_pick else ''}", ""]
        for field in msgspec.structs.fields(shape):
            if field.name not in CycleRecord.__struct_fields__:
                meta = get_args(hints[field.name])[1]
                unit = (meta.extra or {}).get("unit")
                lines.append(f"- `{field.encode_name}`{f' ({unit})' if unit else ''}: {meta.description}")
        yield kind, "\n".join(lines).strip()
