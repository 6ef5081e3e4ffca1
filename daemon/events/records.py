"""The schema of a run's records: one structure a kind, each field with its type, unit and meaning.

Records are written, checked, read and shown by it, and `document` makes the table of deploy/RUNS.md of it. A field that
is absent, or null, is allowed everywhere: older releases did not have it. A kind or a field that is not listed is a
newer release's, and passed on as it is. Bytes in, records out; no file.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from datetime import datetime
from typing import Annotated, Any, Literal, TypedDict, get_args, get_type_hints

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


class CornersRecord(TypedDict):
    corners_mm: list[Vector]


class FacetRecord(CornersRecord, total=False):
    type: Text
    left_px: Points
    right_px: Points


class NamedRecord(TypedDict):
    label: str
    confidence: Finite


class PartRecord(NamedRecord, total=False):
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
    facets: list[FacetRecord] | None


class RejectedRecord(TypedDict, total=False):
    eye: Text
    reason: Text
    corners_px: Points


class GuessRecord(TypedDict, total=False):
    label: Text
    share: Number
    left_px: list[Edge] | None
    right_px: list[Edge] | None
    left_shows: list[bool] | None
    right_shows: list[bool] | None


class SceneRecord(TypedDict, total=False):
    ms: Number
    unmatched: list[int] | None
    nothing: Text
    stages_ms: dict[str, Number] | None
    parts: list[PartRecord] | None
    rejected: list[RejectedRecord] | None
    guesses: list[GuessRecord] | None
    notes: list[str] | None


class TableRecord(TypedDict):
    up: Vector
    level_mm: Finite


class MovedPairRecord(TypedDict):
    eye: Literal["left", "right"]
    left: Pose
    right: Pose
    arm_mm: Finite
    arm_deg: Finite


class HealthRecord(TypedDict, total=False):
    findings: dict[str, Any] | None
    epipolar_px: Number
    noise: Number


class PredictedRecord(TypedDict, total=False):
    mm: Number
    deg: Number


class SkippedRecord(TypedDict, total=False):
    label: Text
    outcome: Text
    why: Text


class EventRecord(msgspec.Struct, kw_only=True):
    """What every record has."""

    kind: str
    seq: Annotated[int, Meta(ge=0, le=2**53, description="counts from 0")]
    t: Annotated[datetime, Meta(description="when, UTC")]
    mono_s: Annotated[Finite, Meta(description="monotonic clock; starts anew with the daemon", extra={"unit": "s"})]
    v: Annotated[Count, Meta(description="version of the record format")] = None


class RunStart(EventRecord, kw_only=True):
    """A run begins, or what it works with has changed."""

    version: Annotated[Text, Meta(description="of facetd")] = None
    cell: Annotated[Text, Meta(description="real, recorded or simulated")] = None
    name: Annotated[Text, Meta(description="of its computer")] = None
    utc_offset_s: Annotated[
        Annotated[int, Meta(ge=-86_400, le=86_400)] | None, Meta(description="of its clock", extra={"unit": "s"})
    ] = None
    config: Annotated[Text, Meta(description="file in kept/")] = None
    calibration: Annotated[Text, Meta(description="file in kept/")] = None
    model: Annotated[Text, Meta(description="file in kept/")] = None
    limits: Annotated[
        dict[str, Number] | None, Meta(description="grasp_mm and arrival_mm that it works to", extra={"unit": "mm"})
    ] = None
    seed: Annotated[Count, Meta(description="of a simulated cell")] = None
    continues: Annotated[Text, Meta(description="the run before, of which this one is the rest")] = None
    reloaded: Annotated[Flag, Meta(description="the same run goes on, with other settings or another calibration")] = (
        None
    )
    times_life: Annotated[Number, Meta(description="how many times as fast as life a simulated cell runs")] = None


class ModelInUse(EventRecord, kw_only=True):
    """A model was taken into use."""

    action: Annotated[Text, Meta(description="start, accepted, rolled back")] = None
    version: Annotated[Count, Meta(description="its number in the cell")] = None
    labels: Annotated[list[str] | None, Meta(description="parts that it knows")] = None
    file: Annotated[Text, Meta(description="in kept/")] = None


class CommandGiven(EventRecord, kw_only=True):
    """What a person asked for."""

    who: Annotated[Text, Meta(description="the person")] = None
    door: Annotated[Text, Meta(description="the frontend: console, terminal, socket, control-C")] = None
    text: Annotated[Text, Meta(description="the line")] = None


class AutoSet(EventRecord, kw_only=True):
    """What is to be picked from now on."""

    on: Annotated[Flag, Meta(description="false: done, or given up")] = None
    count: Annotated[Count, Meta(description="parts still to pick; null: until the table is empty")] = None
    every_s: Annotated[
        Number, Meta(description="an empty table is looked at again after so long", extra={"unit": "s"})
    ] = None


class LeftBehind(EventRecord, kw_only=True):
    """How the daemon before was cut off; stands until `resume`."""

    run: Annotated[Text, Meta(description="its run")] = None
    cycle: Annotated[Count, Meta(description="the pick that was cut off")] = None
    state: Annotated[Text, Meta(description="of that pick")] = None
    hand_closed: Annotated[Flag, Meta(description="whether a part may be in the gripper")] = None
    label: Annotated[Text, Meta(description="the part")] = None
    auto: Annotated[dict[str, Any] | None, Meta(description="count and every_s still to be picked")] = None
    fault: Annotated[Text, Meta(description="that stood")] = None


class HoldingSeen(EventRecord, kw_only=True):
    """Whether a part is in the gripper."""

    held: Annotated[Flag, Meta(description="what an operator saw; null: not known")] = None


class CycleStart(EventRecord, kw_only=True):
    """A pick begins."""

    cycle: Annotated[Count, Meta(description="number of the pick in its run; null or 0: none")] = None
    target: Annotated[Text, Meta(description="the part asked for; null: any")] = None


class StateChanged(EventRecord, kw_only=True):
    """The pick went on to another state."""

    cycle: Annotated[Count, Meta(description="number of the pick in its run; null or 0: none")] = None
    from_: Annotated[Text, Meta(description="the state before")] = msgspec.field(default=None, name="from")
    event: Annotated[Text, Meta(description="what left it")] = None
    to: Annotated[Text, Meta(description="the state now")] = None


class LookTaken(EventRecord, kw_only=True):
    """A pair of images, and what was seen in it."""

    cycle: Annotated[Count, Meta(description="number of the pick in its run; null or 0: none")] = None
    stop: Annotated[Count, Meta(description="number of the look at the part it went for")] = None
    purpose: Annotated[Text, Meta(description="survey, approach, verify, teach, ...")] = None
    images: Annotated[dict[str, str] | None, Meta(description="files, by camera")] = None
    scene: Annotated[
        SceneRecord | None,
        Meta(description="parts, facets, refusals, as `facetctl recognise` prints them; unmatched, nothing: no part"),
    ] = None
    seconds: Annotated[dict[str, Number] | None, Meta(description="by stage", extra={"unit": "s"})] = None
    health: Annotated[HealthRecord | None, Meta(description="measures of the images, and findings beyond a limit")] = (
        None
    )
    where: Annotated[Pose, Meta(description="world_from_tool", extra={"unit": "mm"})] = None
    world_from_cyclopean: Annotated[Pose, Meta(description="of the cameras", extra={"unit": "mm"})] = None
    table: Annotated[TableRecord | None, Meta(description="the support plane")] = None
    whole: Annotated[bool | None, Meta(description="false: only the expected part was looked for, by its edges")] = None
    moved: Annotated[MovedPairRecord | None, Meta(description="places of a pair that one camera took")] = None


class CamerasInUse(EventRecord, kw_only=True):
    """Which cameras are looked with from now on."""

    alone: Annotated[Text, Meta(description="the one camera; null: both")] = None
    why: Annotated[Text, Meta(description="in words")] = None


class PoseEstimate(EventRecord, kw_only=True):
    """Where the part is, from the looks so far."""

    cycle: Annotated[Count, Meta(description="number of the pick in its run; null or 0: none")] = None
    stop: Annotated[Count, Meta(description="number of the look")] = None
    label: Annotated[Text, Meta(description="the part")] = None
    world_from_part: Annotated[Pose, Meta(description="its pose", extra={"unit": "mm"})] = None
    covariance: Annotated[
        Covariance, Meta(description="6 x 6, translation and rotation", extra={"unit": "mm, rad"})
    ] = None
    predicted_mm: Annotated[Number, Meta(description="error expected at the grasp", extra={"unit": "mm"})] = None
    predicted_deg: Annotated[Number, Meta(description="the same in angle", extra={"unit": "degrees"})] = None
    chi2: Annotated[Number, Meta(description="disagreement with the looks before, 6 degrees of freedom")] = None


class DecisionMade(EventRecord, kw_only=True):
    """What the pick decided, and why."""

    cycle: Annotated[Count, Meta(description="number of the pick in its run; null or 0: none")] = None
    code: Annotated[
        Text, Meta(description="of daemon/events/codes.py: DecisionCode, or the CauseCode of a skipped part")
    ] = None
    text: Annotated[Text, Meta(description="in words")] = None
    why: Annotated[Text, Meta(description="in words")] = None
    label: Annotated[Text, Meta(description="the part it is about")] = None
    slip_deg: Annotated[
        Number, Meta(description="of the chosen grasp: how far off square its contacts are", extra={"unit": "degrees"})
    ] = None
    chi2: Annotated[Number, Meta(description="of two looks that disagree")] = None


class LookGained(EventRecord, kw_only=True):
    """What one more look has brought."""

    cycle: Annotated[Count, Meta(description="number of the pick in its run; null or 0: none")] = None
    look: Annotated[Count, Meta(description="number of the look at the table")] = None
    about: Annotated[Text, Meta(description="what was looked at")] = None
    before: Annotated[Text, Meta(description="what it was thought to be")] = None
    after: Annotated[Text, Meta(description="the same after the look")] = None
    bits_before: Annotated[Number, Meta(description="uncertainty before", extra={"unit": "bits"})] = None
    bits_after: Annotated[Number, Meta(description="uncertainty after", extra={"unit": "bits"})] = None
    expected: Annotated[Number, Meta(description="what the look was to settle", extra={"unit": "bits"})] = None
    seconds: Annotated[Number, Meta(description="what way and look were to take", extra={"unit": "s"})] = None


class MoveSent(EventRecord, kw_only=True):
    """A move of the arm is sent."""

    cycle: Annotated[Count, Meta(description="number of the pick in its run; null or 0: none")] = None
    how: Annotated[Text, Meta(description="joint or straight")] = None
    target: Annotated[Pose, Meta(description="world_from_tool", extra={"unit": "mm"})] = None
    speed_pct: Annotated[Number, Meta(description="of full speed", extra={"unit": "%"})] = None
    purpose: Annotated[Text, Meta(description="where to")] = None
    sent: Annotated[Flag, Meta(description="false: dry")] = None


class MoveEnded(EventRecord, kw_only=True):
    """The arm is at rest after a move."""

    cycle: Annotated[Count, Meta(description="number of the pick in its run; null or 0: none")] = None
    where: Annotated[Pose, Meta(description="world_from_tool", extra={"unit": "mm"})] = None
    joints: Annotated[list[Finite] | None, Meta(description="the six joints", extra={"unit": "rad"})] = None
    error_mm: Annotated[Number, Meta(description="WHERE against the target", extra={"unit": "mm"})] = None
    error_deg: Annotated[Number, Meta(description="the same in angle", extra={"unit": "degrees"})] = None
    seconds: Annotated[Number, Meta(description="since it was sent", extra={"unit": "s"})] = None


class MoveTakenBack(EventRecord, kw_only=True):
    """The last move or gripper command was taken back as its line was typed: nothing has left."""

    cycle: Annotated[Count, Meta(description="number of the pick in its run; null or 0: none")] = None
    what: Annotated[Text, Meta(description="move or hand")] = None


class GripperSet(EventRecord, kw_only=True):
    """The gripper closes, or has opened."""

    cycle: Annotated[Count, Meta(description="number of the pick in its run; null or 0: none")] = None
    closed: Annotated[Flag, Meta(description="closes")] = None
    sent: Annotated[Flag, Meta(description="false: dry")] = None


class MoveRefused(EventRecord, kw_only=True):
    """The guard kept a move from the arm."""

    cycle: Annotated[Count, Meta(description="number of the pick in its run; null or 0: none")] = None
    rule: Annotated[Text, Meta(description="the guard's")] = None
    text: Annotated[Text, Meta(description="in words")] = None


class FaultRaised(EventRecord, kw_only=True):
    """The arm was stopped; nothing moves until `resume`."""

    cycle: Annotated[Count, Meta(description="number of the pick in its run; null or 0: none")] = None
    code: Annotated[Text, Meta(description="of daemon/events/codes.py: CauseCode")] = None
    findings: Annotated[
        list[str] | None, Meta(description="measures of the images beyond their limit, each `name camera`")
    ] = None
    text: Annotated[Text, Meta(description="in words")] = None
    while_: Annotated[Text, Meta(description="what was being done")] = msgspec.field(default=None, name="while")


class ArmAtRest(EventRecord, kw_only=True):
    """After an alarm that a stop was not confirmed, the arm was seen at rest."""

    text: Annotated[Text, Meta(description="in words")] = None


class CycleEnded(EventRecord, kw_only=True):
    """A pick has ended."""

    cycle: Annotated[Count, Meta(description="number of the pick in its run; null or 0: none")] = None
    outcome: Annotated[Text, Meta(description="of daemon/events/outcomes.py")] = None
    code: Annotated[Text, Meta(description="of its cause: CauseCode or DecisionCode of daemon/events/codes.py")] = None
    label: Annotated[Text, Meta(description="the part it went for")] = None
    stops: Annotated[Count, Meta(description="looks at it")] = None
    why: Annotated[Text, Meta(description="in words")] = None
    grasp: Annotated[Pose, Meta(description="world_from_tool", extra={"unit": "mm"})] = None
    predicted: Annotated[PredictedRecord | None, Meta(description="error expected at the grasp: mm and deg")] = None
    skipped: Annotated[
        list[SkippedRecord] | None, Meta(description="parts left where they lie, each with its outcome")
    ] = None


class TouchTest(EventRecord, kw_only=True):
    """Where the operator saw the finger tips."""

    off_mm: Annotated[list[Finite] | None, Meta(description="along world x and y", extra={"unit": "mm"})] = None
    distance_mm: Annotated[Number, Meta(description="from the corner", extra={"unit": "mm"})] = None
    corner: Annotated[list[Finite] | None, Meta(description="where it was thought to be", extra={"unit": "mm"})] = None


class TrueGrasp(EventRecord, kw_only=True):
    """What the simulated cell's witness saw; never on a real cell."""

    cycle: Annotated[Count, Meta(description="number of the pick in its run; null or 0: none")] = None
    error_mm: Annotated[Number, Meta(description="at the grasp", extra={"unit": "mm"})] = None
    error_deg: Annotated[Number, Meta(description="the same in angle", extra={"unit": "degrees"})] = None
    held: Annotated[Flag, Meta(description="whether the part is held")] = None


class PartReleased(EventRecord, kw_only=True):
    """The gripper opened above the bin; the outcome is picked only where a part showed before and not after."""

    cycle: Annotated[Count, Meta(description="number of the pick in its run; null or 0: none")] = None
    label: Annotated[Text, Meta(description="the part")] = None
    above: Annotated[Text, Meta(description="part, empty or unclear: what the gripper showed before it opened")] = None
    opened: Annotated[Text, Meta(description="the same after it had opened")] = None


class RecordsLost(EventRecord, kw_only=True):
    """Lines or images that the disk did not take."""

    lost: Annotated[Count, Meta(description="how many")] = None
    why: Annotated[Text, Meta(description="in words")] = None


class ClockSet(EventRecord, kw_only=True):
    """Somebody set the machine's clock."""

    jump_s: Annotated[Number, Meta(description="by how much", extra={"unit": "s"})] = None


class RunEnded(EventRecord, kw_only=True):
    """The run ends; one without it is being written, or was cut off."""

    why: Annotated[Text, Meta(description="in words")] = None
    holding: Annotated[Flag, Meta(description="whether a part is in the gripper; null: not known")] = None


SCHEMA: Mapping[str, type[EventRecord]] = {
    "run_start": RunStart,
    "model": ModelInUse,
    "command": CommandGiven,
    "auto": AutoSet,
    "left": LeftBehind,
    "holding": HoldingSeen,
    "cycle_start": CycleStart,
    "state": StateChanged,
    "look": LookTaken,
    "eyes": CamerasInUse,
    "estimate": PoseEstimate,
    "decision": DecisionMade,
    "gained": LookGained,
    "move": MoveSent,
    "moved": MoveEnded,
    "held_back": MoveTakenBack,
    "hand": GripperSet,
    "refusal": MoveRefused,
    "fault": FaultRaised,
    "rest": ArmAtRest,
    "cycle_end": CycleEnded,
    "touch": TouchTest,
    "truth": TrueGrasp,
    "release": PartReleased,
    "gap": RecordsLost,
    "clock": ClockSet,
    "run_end": RunEnded,
}
"""Every kind of record by its name."""
for _shape in (*SCHEMA.values(), EventRecord):
    msgspec.json.Decoder(_shape)  # looked up now: done at the first record of a kind, it swallows a control-C of then
FIELDS: Mapping[str, frozenset[str]] = {
    kind: frozenset(field.encode_name for field in msgspec.structs.fields(shape)) for kind, shape in SCHEMA.items()
}
"""The names that a kind's fields have in a line."""


def record_of(line: bytes) -> Record:
    """One line as a record of today's version. Raises ValueError, in a few words: it is none, or a field is not what it
    must be."""
    if len(line) > LONGEST_LINE:
        raise ValueError("too long")
    try:
        found: object = msgspec.json.decode(line)
        msgspec.convert(found, SCHEMA.get(_kind(found), EventRecord))
    except (msgspec.MsgspecError, RecursionError, UnicodeDecodeError) as error:
        raise ValueError(str(error)) from None
    assert isinstance(found, dict)
    return upgraded(found)


def _kind(found: object) -> str:
    kind = found.get("kind") if isinstance(found, dict) else None
    if not isinstance(kind, str):
        raise ValueError("not a record")
    return kind


def document() -> str:
    """The table of deploy/RUNS.md: every kind, its fields, their units and meanings."""
    return "| kind | fields |\n| --- | --- |\n" + "".join(f"| `{kind}` | {text} |\n" for kind, text in _rows())


def _rows() -> Iterator[tuple[str, str]]:
    for kind, shape in SCHEMA.items():
        hints = get_type_hints(shape, include_extras=True)
        told = []
        for field in msgspec.structs.fields(shape):
            if field.name not in EventRecord.__struct_fields__:
                meta = get_args(hints[field.name])[1]
                unit = (meta.extra or {}).get("unit")
                told.append(f"`{field.encode_name}`{f' ({unit})' if unit else ''}: {meta.description}")
        yield kind, f"{(shape.__doc__ or '').strip()} {'; '.join(told)}"


if __name__ == "__main__":
    print(document(), end="")
