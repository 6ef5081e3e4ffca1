"""A run read without its scenes' corners: what runs are compared by, of hundreds of them, in seconds.

A look's record is nine tenths corners; whoever compares runs wants none. The lines are the same, read by fields.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterable
from datetime import datetime
from pathlib import Path
from typing import Annotated, Any

import msgspec
from msgspec import Meta

from daemon.events.upgrade import upgraded
from daemon.review.digest import Digest, digest
from daemon.store.files import being_written
from daemon.store.outside import FileError, open_below
from daemon.store.records import Count, Finite, Flag, Number, Pose, Record, Text
from daemon.store.runs import RUN, lines_of


class _Part(msgspec.Struct, omit_defaults=True):
    label: Text = None
    cause: Text = None
    cyclopean_from_part: Pose = None


class _Refused(msgspec.Struct):
    """An outline that was refused: that there is one is all that is asked."""


class _Scene(msgspec.Struct, omit_defaults=True):
    ms: Number = None
    rejected: list[_Refused] | None = None
    notes: list[str] | None = None
    unmatched: list[int] | None = None
    nothing: Text = None
    parts: list[_Part] | None = None


class _Line(msgspec.Struct, omit_defaults=True, kw_only=True):
    """Of every kind at once; what a kind does not have is left out again, what every kind has is asked for."""

    v: Count = None
    kind: str
    seq: Annotated[int, Meta(ge=0, le=2**53)]
    t: str
    mono_s: Finite
    cycle: Count = None
    stop: Count = None
    purpose: Text = None
    outcome: Text = None
    label: Text = None
    event: Text = None
    to: Text = None
    before: Text = msgspec.field(default=None, name="from")
    closed: Flag = None
    on: Flag = None
    auto: dict[str, Any] | None = None
    reloaded: Flag = None
    times_life: Number = None
    above: Text = None
    opened: Text = None
    what: Text = None
    code: Text = None
    findings: list[str] | None = None
    slip_deg: Number = None
    rule: Text = None
    text: Text = None
    why: Text = None
    door: Text = None
    who: Text = None
    file: Text = None
    action: Text = None
    model: Text = None
    calibration: Text = None
    config: Text = None
    cell: Text = None
    name: Text = None
    utc_offset_s: Annotated[int, Meta(ge=-86_400, le=86_400)] | None = None
    version: Text | Count = None
    limits: dict[str, Number] | None = None
    predicted: dict[str, Number] | None = None
    predicted_mm: Number = None
    chi2: Number = None
    error_mm: Number = None
    error_deg: Number = None
    world_from_part: Pose = None
    world_from_cyclopean: Pose = None
    health: dict[str, Any] | None = None
    skipped: list[dict[str, Any]] | None = None
    scene: _Scene | None = None


_DECODER = msgspec.json.Decoder(_Line)


def read_brief(folder: Path) -> Digest:
    """The run in `folder` without its scenes' corners; lines that cannot be read are left out. Raises FileError."""
    records = list[Record]()
    with open_below(folder, RUN) as file:
        for _, line, _ in lines_of(file):
            try:
                read = _DECODER.decode(line)
                msgspec.convert(read.t, datetime)
                records.append(upgraded(msgspec.to_builtins(read)))
            except (msgspec.MsgspecError, RecursionError, UnicodeDecodeError):
                continue
    return digest(folder.name, records, going=being_written(folder / RUN))


def that_picked(folders: Iterable[Path]) -> dict[Path, Digest]:
    """The runs in some folders that have a cycle, in brief; one that cannot be read, or has just gone, is none."""
    found = {}
    for folder in folders:
        with contextlib.suppress(FileError):
            run = read_brief(folder)
            if run.cycles:
                found[folder] = run
    return found
