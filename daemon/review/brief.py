"""A run read without its scenes: what runs are compared by, of hundreds of them, in seconds.

A look's record is nine tenths corners; whoever compares runs wants none. The lines are the same, read by fields.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec

from daemon.review.digest import Digest, digest
from daemon.store.files import being_written
from daemon.store.records import Record
from daemon.store.runs import RunError


class _Part(msgspec.Struct, omit_defaults=True):
    label: str | None = None
    cause: str | None = None
    cyclopean_from_part: Any = None


class _Scene(msgspec.Struct, omit_defaults=True):
    ms: float | None = None
    notes: list[str] = []
    parts: list[_Part] = []


class _Line(msgspec.Struct, omit_defaults=True):
    kind: str
    mono_s: float
    t: str = ""
    seq: int = 0
    cycle: int | None = None
    stop: int | None = None
    purpose: str | None = None
    outcome: str | None = None
    label: str | None = None
    event: str | None = None
    to: str | None = None
    code: str | None = None
    rule: str | None = None
    text: str | None = None
    why: str | None = None
    door: str | None = None
    who: str | None = None
    file: str | None = None
    action: str | None = None
    model: str | None = None
    calibration: str | None = None
    config: str | None = None
    cell: str | None = None
    name: str | None = None
    utc_offset_s: int | None = None
    version: Any = None
    limits: Any = None
    predicted: Any = None
    predicted_mm: float | None = None
    chi2: float | None = None
    error_mm: float | None = None
    error_deg: float | None = None
    world_from_part: Any = None
    world_from_cyclopean: Any = None
    health: dict[str, Any] | None = None
    skipped: list[dict[str, Any]] | None = None
    scene: _Scene | None = None


_DECODER = msgspec.json.Decoder(_Line)


def read_brief(folder: Path) -> Digest:
    """The run in `folder` without its scenes; lines that cannot be read are left out. Raises RunError."""
    path, records = folder / "run.jsonl", list[Record]()
    try:
        with path.open("rb") as file:
            for line in file:
                try:
                    records.append(msgspec.to_builtins(_DECODER.decode(line)))
                except msgspec.MsgspecError:
                    continue
    except OSError as error:
        raise RunError(f"{path}: {error.strerror}") from None
    return digest(folder.name, records, going=being_written(path))
