"""What a line of run.jsonl may be: the types of all that is read again, by kind of record. Bytes in, a record out.

store/runlog.py lists the kinds and writes them. A field that is absent, or null, is allowed everywhere: older releases
did not have it. A kind or a field that is not listed is a newer release's, and passed on unlooked at.
"""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime
from typing import Annotated, Any, Literal, TypedDict

import msgspec
from msgspec import Meta

from daemon.events.upgrade import upgraded

Record = dict[str, Any]
LONGEST_LINE = 1_000_000

Finite = Annotated[float, Meta(ge=-1e15, le=1e15)]
"""So that sums and means of them are numbers, too."""
Number = Finite | None
Count = Annotated[int, Meta(ge=-(2**53), le=2**53)] | None
Text = str | None
Flag = bool | None
Row4 = Annotated[list[Finite], Meta(min_length=4, max_length=4)]
Pose = Annotated[list[Row4], Meta(min_length=4, max_length=4)] | None
Row6 = Annotated[list[Finite], Meta(min_length=6, max_length=6)]
Covariance = Annotated[list[Row6], Meta(min_length=6, max_length=6)] | None
Point = Annotated[list[Finite], Meta(min_length=2, max_length=2)]
Vector = Annotated[list[Finite], Meta(min_length=3, max_length=3)]
Edge = Annotated[list[Finite], Meta(min_length=4, max_length=4)]
Points = list[Point] | None


class _Corners(TypedDict):
    corners_mm: list[Vector]


class _Facet(_Corners, total=False):
    type: Text
    left_px: Points
    right_px: Points


class _Named(TypedDict):
    label: str
    confidence: Finite


class _Part(_Named, total=False):
    match_ratio: Number
    activation: Number
    runner_up: Text
    ambiguous: Flag
    candidates: list[str] | None
    reason: Text
    cause: Text
    cyclopean_from_part: Pose
    covariance: Covariance
    equivalents: list[Pose] | None
    residual_mm: Number
    facets: list[_Facet] | None


class _Rejected(TypedDict, total=False):
    eye: Text
    reason: Text
    corners_px: Points


class _Guess(TypedDict, total=False):
    label: Text
    share: Number
    left_px: list[Edge] | None
    right_px: list[Edge] | None
    left_shows: list[bool] | None
    right_shows: list[bool] | None


class _Scene(TypedDict, total=False):
    ms: Number
    stages_ms: dict[str, Number] | None
    parts: list[_Part] | None
    rejected: list[_Rejected] | None
    guesses: list[_Guess] | None
    notes: list[str] | None


class _Table(TypedDict):
    up: Vector
    level_mm: Finite


class _Moved(TypedDict):
    eye: Literal["left", "right"]
    left: Pose
    right: Pose
    arm_mm: Finite
    arm_deg: Finite


class _Health(TypedDict, total=False):
    findings: dict[str, Any] | None
    epipolar_px: Number
    noise: Number


class _Any(TypedDict):
    """What every line has."""

    kind: str
    seq: Annotated[int, Meta(ge=0, le=2**53)]
    t: datetime
    mono_s: Finite


class _Start(_Any, total=False):
    version: Text
    config: Text
    calibration: Text
    model: Text
    seed: Count
    continues: Text
    cell: Text
    name: Text
    utc_offset_s: Annotated[int, Meta(ge=-86_400, le=86_400)] | None
    limits: dict[str, Number] | None
    times_life: Number


class _Model(_Any, total=False):
    action: Text
    version: Count
    labels: list[str] | None
    file: Text


class _Look(_Any, total=False):
    cycle: Count
    stop: Count
    purpose: Text
    images: dict[str, str] | None
    scene: _Scene | None
    seconds: dict[str, Number] | None
    health: _Health | None
    where: Pose
    world_from_cyclopean: Pose
    table: _Table | None
    whole: bool
    moved: _Moved | None


class _Estimate(_Any, total=False):
    cycle: Count
    stop: Count
    label: Text
    world_from_part: Pose
    covariance: Covariance
    predicted_mm: Number
    predicted_deg: Number
    chi2: Number


class _Predicted(TypedDict, total=False):
    mm: Number
    deg: Number


class _Move(_Any, total=False):
    cycle: Count
    how: Text
    target: Pose
    speed_pct: Number
    purpose: Text
    sent: Flag
    where: Pose
    error_mm: Number
    error_deg: Number
    seconds: Number


class _Skipped(TypedDict, total=False):
    label: Text
    outcome: Text
    why: Text


class _Cycle(_Any, total=False):
    cycle: Count
    target: Text
    outcome: Text
    label: Text
    stops: Count
    why: Text
    grasp: Pose
    predicted: _Predicted | None
    skipped: list[_Skipped] | None


class _Words(_Any, total=False):
    """Records that are told, each field as it is."""

    cycle: Count
    code: Text
    rule: Text
    text: Text
    why: Text
    who: Text
    door: Text
    to: Text
    alone: Text
    event: Text
    run: Text
    label: Text
    state: Text
    closed: Flag
    held: Flag
    holding: Flag
    hand_closed: Flag
    on: Flag
    count: Count
    every_s: Number
    lost: Count
    jump_s: Number
    error_mm: Number
    error_deg: Number


SHAPES: Mapping[str, Any] = {
    "run_start": _Start,
    "model": _Model,
    "look": _Look,
    "estimate": _Estimate,
    **dict.fromkeys(("move", "moved"), _Move),
    **dict.fromkeys(("cycle_start", "cycle_end"), _Cycle),
}
"""Kinds whose fields are more than words."""
for _shape in (*SHAPES.values(), _Words):
    msgspec.json.Decoder(_shape)  # looked up now: done at the first record of a kind, it swallows a control-C of then


def record_of(line: bytes) -> Record:
    """One line as a record. Raises ValueError, in a few words: it is none, or a field is not what it must be."""
    if len(line) > LONGEST_LINE:
        raise ValueError("too long")
    try:
        found: object = msgspec.json.decode(line)
        msgspec.convert(found, SHAPES.get(_kind(found), _Words))
    except (msgspec.MsgspecError, RecursionError, UnicodeDecodeError) as error:
        raise ValueError(str(error)) from None
    assert isinstance(found, dict)
    return upgraded(found)


def _kind(found: object) -> str:
    kind = found.get("kind") if isinstance(found, dict) else None
    if not isinstance(kind, str):
        raise ValueError("not a record")
    return kind
