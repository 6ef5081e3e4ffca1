"""Read a run without its scenes' corners, nine tenths of a look's record, so that hundreds of runs take seconds."""

import contextlib
from collections.abc import Iterable, Mapping
from datetime import datetime
from pathlib import Path
from typing import Annotated, Any, get_args, get_type_hints

import msgspec
from msgspec import Meta

from daemon.events.records import SCHEMA, Finite, Number, Pose, Record, Text
from daemon.events.upgrade import upgraded
from daemon.review.digest import Digest, digest
from daemon.store.files import being_written
from daemon.store.outside import JSON_ERRORS, FileError, open_below
from daemon.store.runs import RUN, lines_of


class BriefPart(msgspec.Struct, omit_defaults=True):
    label: Text = None
    cause: Text = None
    cyclopean_from_part: Pose = None


class BriefRefusal(msgspec.Struct):
    """A refused outline, without its fields: only the number of them matters."""


class BriefScene(msgspec.Struct, omit_defaults=True):
    ms: Number = None
    rejected: list[BriefRefusal] | None = None
    notes: list[str] | None = None
    unmatched: list[int] | None = None
    nothing: Text = None
    parts: list[BriefPart] | None = None


BULKY = frozenset({"scene", "health", "images", "target", "joints", "covariance", "grasp", "where", "table"})
"""Fields that a comparison of runs does not need, or that have a brief structure above."""


def _line() -> Any:
    """Define one structure with the fields of every kind; fields that a line does not have stay out of its record."""
    types: dict[str, Any] = {}
    for shape in SCHEMA.values():
        hints = get_type_hints(shape, include_extras=True)
        for field in msgspec.structs.fields(shape):
            if field.encode_name not in (*HEAD, *BULKY):
                kind = get_args(hints[field.name])[0]
                types[field.name] = types.get(field.name, kind) | kind
    renamed = {"from_": "from", "while_": "while"}
    fields = [(name, kind, msgspec.field(default=None, name=renamed.get(name, name))) for name, kind in types.items()]
    more = [("scene", BriefScene | None, None), ("health", dict[str, Any] | None, None)]
    return msgspec.defstruct("BriefLine", [*HEAD.items(), *fields, *more], omit_defaults=True)


HEAD: Mapping[str, Any] = {"kind": str, "seq": Annotated[int, Meta(ge=0, le=2**53)], "t": str, "mono_s": Finite}
_DECODER: msgspec.json.Decoder[Any] = msgspec.json.Decoder(_line())


def read_brief(folder: Path) -> Digest:
    """Read the run in `folder` without its scenes' corners and without unreadable lines. Raises FileError."""
    records = list[Record]()
    with open_below(folder, RUN) as file:
        for _, line, _ in lines_of(file):
            try:
                read = _DECODER.decode(line)
                msgspec.convert(read.t, datetime)
                records.append(upgraded(msgspec.to_builtins(read)))
            except JSON_ERRORS:
                continue
    return digest(folder.name, records, going=being_written(folder / RUN))


def read_runs_with_picks(folders: Iterable[Path]) -> dict[Path, Digest]:
    """Read the runs that have a cycle, in brief; unreadable and removed ones are left out."""
    found = {}
    for folder in folders:
        with contextlib.suppress(FileError):
            run = read_brief(folder)
            if run.cycles:
                found[folder] = run
    return found
