"""Schema of a run's records: one structure a kind, each field with its type, unit and meaning.

Writers, readers, checks and pages use it; tests/manuals/records.py makes the table of deploy/RUNS.md from it. Every
field may be absent or null: older releases did not have it. A kind or a field that is not listed belongs to a newer
release and passes unchanged. Bytes in, records out; no file.
"""

from collections.abc import Mapping
from datetime import datetime
from typing import Annotated, Any, Literal, Required, TypedDict

import msgspec
from msgspec import Meta

from daemon.events.upgrade import upgraded

Json = dict[str, Any]
"""An object of JSON."""
Record = Json
LONGEST_LINE = 1_000_000

Finite = Annotated[float, Meta(ge=-1e15, le=1e15)]
"""Bounded so that sums and means stay finite."""
Number = Finite | None
Count = Annotated[int, Meta(ge=-(2**53), le=2**53)] | None
Text = str | None
Flag = bool | None
Row4 = Annotated[list[Finite], Meta(min_length=4, max_length=4)]
Matrix = Annotated[list[Row4], Meta(min_length=4, max_length=4)]
Pose = Matrix | None
Row6 = Annotated[list[Finite], Meta(min_length=6, max_length=6)]
Covariance = Annotated[list[Row6], Meta(min_length=6, max_length=6)] | None
Point = Annotated[list[Finite], Meta(min_length=2, max_length=2)]
Vector = Annotated[list[Finite], Meta(min_length=3, max_length=3)]
Edge = Annotated[list[Finite], Meta(min_length=4, max_length=4)]
Points = list[Point] | None


class FacetRecord(TypedDict, total=False):
    corners_mm: Required[list[Vector]]
    type: Text
    left_px: Points
    right_px: Points


class PartRecord(TypedDict, total=False):
    label: Required[str]
    confidence: Required[Finite]
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
    left: Matrix
    right: Matrix
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


def meaning(description: str, unit: str | None = None) -> Meta:
    """What a field means, and its unit, for the table of deploy/RUNS.md."""
    return Meta(description=description, extra={"unit": unit})


class EventRecord(msgspec.Struct, kw_only=True):
    """Fields of every record, besides its kind, which is the tag of its structure."""

    seq: Annotated[int, Meta(ge=0, le=2**53, description="counts from 0")]
    t: Annotated[datetime, meaning("when, UTC")]
    mono_s: Annotated[Finite, meaning("monotonic clock; starts anew with the daemon", "s")]
    v: Annotated[Count, meaning("version of the record format")] = None


class CycleRecord(EventRecord, kw_only=True):
    """Fields of every record of a pick."""

    cycle: Annotated[Count, meaning("number of the pick in its run; null or 0: none")] = None


class RunStart(EventRecord, tag_field="kind", tag="run_start"):
    """A run begins, or what it works with has changed."""

    version: Annotated[Text, meaning("of facetd")] = None
    cell: Annotated[Text, meaning("real, recorded or simulated")] = None
    name: Annotated[Text, meaning("of its computer")] = None
    utc_offset_s: Annotated[Annotated[int, Meta(ge=-86_400, le=86_400)] | None, meaning("of its clock", "s")] = None
    config: Annotated[Text, meaning("file in kept/")] = None
    arm: Annotated[Text, meaning("arm.yaml, where the configuration names one: file in kept/")] = None
    calibration: Annotated[Text, meaning("file in kept/")] = None
    model: Annotated[Text, meaning("file in kept/")] = None
    gripper: Annotated[
        Text, meaning("the mounted gripper: its name, or its kind where only one is configured; null: not reported yet")
    ] = None
    limits: Annotated[
        dict[str, Number] | None,
        meaning("grasp_mm and arrival_mm: the largest errors allowed at a grasp and at an arrival", "mm"),
    ] = None
    seed: Annotated[Count, meaning("of a simulated cell")] = None
    continues: Annotated[Text, meaning("the previous run, which this one continues")] = None
    reloaded: Annotated[Flag, meaning("the run continues with other settings or another calibration")] = None
    times_life: Annotated[Number, meaning("speed of a simulated cell, as a multiple of real time")] = None


class ModelInUse(EventRecord, tag_field="kind", tag="model"):
    """A model was taken into use."""

    action: Annotated[Text, meaning("start, accepted, rolled back")] = None
    version: Annotated[Count, meaning("its number in the cell")] = None
    labels: Annotated[list[str] | None, meaning("parts that it knows")] = None
    file: Annotated[Text, meaning("in kept/")] = None


class CommandGiven(EventRecord, tag_field="kind", tag="command"):
    """A command that a person gave."""

    who: Annotated[Text, meaning("the person")] = None
    door: Annotated[Text, meaning("the frontend: console, terminal, socket, control-C")] = None
    text: Annotated[Text, meaning("the line")] = None


class NoteTaken(EventRecord, tag_field="kind", tag="note"):
    """A person's comment."""

    who: Annotated[Text, meaning("the person")] = None
    text: Annotated[Text, meaning("the comment")] = None


class OperatorNamed(EventRecord, tag_field="kind", tag="operator"):
    """Who works at a terminal from now on."""

    who: Annotated[Text, meaning("the person, and the account or terminal")] = None
    before: Annotated[Text, meaning("who it was before")] = None


class AutoSet(EventRecord, tag_field="kind", tag="auto"):
    """`auto` was switched on or off."""

    on: Annotated[Flag, meaning("false: done, or given up")] = None
    count: Annotated[Count, meaning("parts still to pick; null: until the table is empty")] = None
    every_s: Annotated[Number, meaning("pause before the next look at an empty table", "s")] = None
    order: Annotated[dict[str, Any] | None, meaning("of a job: its name, and the steps that are left")] = None


class LeftBehind(EventRecord, tag_field="kind", tag="left"):
    """Where the previous daemon was interrupted; valid until `resume`."""

    run: Annotated[Text, meaning("its run")] = None
    cycle: Annotated[Count, meaning("the interrupted pick")] = None
    state: Annotated[Text, meaning("of that pick")] = None
    hand_closed: Annotated[Flag, meaning("whether a part may be in the gripper")] = None
    label: Annotated[Text, meaning("the part")] = None
    auto: Annotated[dict[str, Any] | None, meaning("what is still to be picked, as `order` of `auto`")] = None
    fault: Annotated[Text, meaning("the active fault")] = None


class HoldingSeen(EventRecord, tag_field="kind", tag="holding"):
    """Whether a part is in the gripper."""

    held: Annotated[Flag, meaning("what an operator saw; null: unknown")] = None


class CycleStart(CycleRecord, tag_field="kind", tag="cycle_start"):
    """A pick begins."""

    target: Annotated[Text, meaning("the requested part; null: any")] = None


class StateChanged(CycleRecord, tag_field="kind", tag="state"):
    """The pick changed its state."""

    from_: Annotated[Text, meaning("the state before")] = msgspec.field(default=None, name="from")
    event: Annotated[Text, meaning("the event that caused the change")] = None
    to: Annotated[Text, meaning("the state now")] = None


class LookTaken(CycleRecord, tag_field="kind", tag="look"):
    """A pair of images, and what the recogniser found in it."""

    stop: Annotated[Count, meaning("number of the look at the chosen part")] = None
    purpose: Annotated[Text, meaning("survey, approach, verify, teach, ...")] = None
    images: Annotated[dict[str, str] | None, meaning("files, by camera")] = None
    scene: Annotated[
        SceneRecord | None,
        meaning("parts, facets, refusals, as `facetctl recognise` prints them; unmatched, nothing: no part"),
    ] = None
    seconds: Annotated[dict[str, Number] | None, meaning("by stage", "s")] = None
    health: Annotated[HealthRecord | None, meaning("measures of the images, and findings beyond a limit")] = None
    where: Annotated[Pose, meaning("world_from_tool", "mm")] = None
    world_from_cyclopean: Annotated[Pose, meaning("of the cameras", "mm")] = None
    table: Annotated[TableRecord | None, meaning("the support plane")] = None
    whole: Annotated[bool | None, meaning("false: only the expected part was looked for, by its edges")] = None
    moved: Annotated[MovedPairRecord | None, meaning("with one camera: from where it took the two pictures")] = None


class CamerasInUse(EventRecord, tag_field="kind", tag="eyes"):
    """Which cameras facetd uses from now on."""

    alone: Annotated[Text, meaning("the one camera; null: both")] = None
    why: Annotated[Text, meaning("in words")] = None


class PoseEstimate(CycleRecord, tag_field="kind", tag="estimate"):
    """Where the part is, from the looks so far."""

    stop: Annotated[Count, meaning("number of the look")] = None
    label: Annotated[Text, meaning("the part")] = None
    world_from_part: Annotated[Pose, meaning("its pose", "mm")] = None
    covariance: Annotated[Covariance, meaning("6 x 6, translation and rotation", "mm, rad")] = None
    predicted_mm: Annotated[Number, meaning("error expected at the grasp", "mm")] = None
    predicted_deg: Annotated[Number, meaning("the same in angle", "degrees")] = None
    chi2: Annotated[Number, meaning("disagreement with the looks before, 6 degrees of freedom")] = None


class DecisionMade(CycleRecord, tag_field="kind", tag="decision"):
    """What the pick decided, and why."""

    code: Annotated[Text, meaning("of daemon/events/codes.py: DecisionCode, or the CauseCode of a skipped part")] = None
    text: Annotated[Text, meaning("in words")] = None
    why: Annotated[Text, meaning("in words")] = None
    label: Annotated[Text, meaning("the part it is about")] = None
    grasps: Annotated[Count, meaning("number of grasps that the plan needs to bring the part to its goal")] = None
    slip_deg: Annotated[
        Number, meaning("of the chosen grasp: how far off perpendicular its contacts are", "degrees")
    ] = None
    facet: Annotated[Count, meaning("of the chosen grasp by suction: the part's facet, from 1")] = None
    room_mm: Annotated[Number, meaning("from the cup's axis to the nearest edge or hole of that facet", "mm")] = None
    load: Annotated[Number, meaning("the part's load as a share of what the cup can hold")] = None
    chi2: Annotated[Number, meaning("of two looks that disagree")] = None


class LookGained(CycleRecord, tag_field="kind", tag="gained"):
    """How much one more look reduced the uncertainty."""

    look: Annotated[Count, meaning("number of the look at the table")] = None
    about: Annotated[Text, meaning("position of the object that the look was for, as text")] = None
    before: Annotated[Text, meaning("what it could be, before the look")] = None
    after: Annotated[Text, meaning("what it could be, after the look")] = None
    bits_before: Annotated[Number, meaning("uncertainty before", "bits")] = None
    bits_after: Annotated[Number, meaning("uncertainty after", "bits")] = None
    expected: Annotated[Number, meaning("reduction expected of the look", "bits")] = None
    seconds: Annotated[Number, meaning("expected time of the way and the look", "s")] = None


class MoveSent(CycleRecord, tag_field="kind", tag="move"):
    """A move of the arm is sent."""

    how: Annotated[Text, meaning("joint or straight")] = None
    target: Annotated[Pose, meaning("world_from_tool", "mm")] = None
    speed_pct: Annotated[Number, meaning("of full speed", "%")] = None
    purpose: Annotated[Text, meaning("where to")] = None
    sent: Annotated[Flag, meaning("false: dry")] = None


class MoveEnded(CycleRecord, tag_field="kind", tag="moved"):
    """The arm is at rest after a move."""

    where: Annotated[Pose, meaning("world_from_tool", "mm")] = None
    joints: Annotated[list[Finite] | None, meaning("the six joints", "rad")] = None
    error_mm: Annotated[Number, meaning("WHERE against the target", "mm")] = None
    error_deg: Annotated[Number, meaning("the same in angle", "degrees")] = None
    seconds: Annotated[Number, meaning("since it was sent", "s")] = None


class MoveTakenBack(CycleRecord, tag_field="kind", tag="held_back"):
    """The last move or gripper command was withdrawn while its line was typed: the controller did not get it."""

    what: Annotated[Text, meaning("move or hand")] = None


class GripperSet(CycleRecord, tag_field="kind", tag="hand"):
    """The gripper closes, or has opened."""

    closed: Annotated[Flag, meaning("closes")] = None
    sent: Annotated[Flag, meaning("false: dry")] = None


class SensorRead(CycleRecord, tag_field="kind", tag="sensor"):
    """The reading of the gripper's own sensor."""

    when: Annotated[Text, meaning("at which step of the pick")] = None
    held: Annotated[Flag, meaning("a part is in the gripper")] = None


class MoveRefused(CycleRecord, tag_field="kind", tag="refusal"):
    """The guard refused a move."""

    rule: Annotated[Text, meaning("the rule that refused it")] = None
    text: Annotated[Text, meaning("in words")] = None


class FaultRaised(CycleRecord, tag_field="kind", tag="fault"):
    """The arm was stopped; nothing moves until `resume`."""

    code: Annotated[Text, meaning("of daemon/events/codes.py: CauseCode")] = None
    findings: Annotated[list[str] | None, meaning("measures of the images beyond their limit, each `name camera`")] = (
        None
    )
    text: Annotated[Text, meaning("in words")] = None
    while_: Annotated[Text, meaning("what facetd was doing")] = msgspec.field(default=None, name="while")


class ArmAtRest(EventRecord, tag_field="kind", tag="rest"):
    """The arm is at rest, after a stop that the controller had not confirmed."""

    text: Annotated[Text, meaning("in words")] = None


class CycleEnded(CycleRecord, tag_field="kind", tag="cycle_end"):
    """A pick has ended."""

    outcome: Annotated[Text, meaning("of daemon/events/outcomes.py")] = None
    code: Annotated[Text, meaning("of its cause: CauseCode or DecisionCode of daemon/events/codes.py")] = None
    label: Annotated[Text, meaning("the chosen part")] = None
    stops: Annotated[Count, meaning("looks at it")] = None
    why: Annotated[Text, meaning("in words")] = None
    stopped: Annotated[
        Text,
        meaning(
            "if the arm was stopped after that outcome, on the way home or when the gripper opened: code of the cause"
        ),
    ] = None
    grasp: Annotated[Pose, meaning("world_from_tool", "mm")] = None
    predicted: Annotated[PredictedRecord | None, meaning("error expected at the grasp: mm and deg")] = None
    skipped: Annotated[list[SkippedRecord] | None, meaning("parts left where they lie, each with its outcome")] = None


class TouchTest(EventRecord, tag_field="kind", tag="touch"):
    """Where the operator saw the fingertips, in a touch test."""

    off_mm: Annotated[list[Finite] | None, meaning("along world x and y", "mm")] = None
    distance_mm: Annotated[Number, meaning("from the corner", "mm")] = None
    corner: Annotated[list[Finite] | None, meaning("its estimated position", "mm")] = None


class TrueGrasp(CycleRecord, tag_field="kind", tag="truth"):
    """The true error of a grasp, and of a set-down; only a simulated cell can write it."""

    error_mm: Annotated[Number, meaning("at the grasp", "mm")] = None
    error_deg: Annotated[Number, meaning("the same in angle", "degrees")] = None
    held: Annotated[Flag, meaning("whether the gripper holds the part")] = None
    place_mm: Annotated[Number, meaning("of a part set down at its place: distance from that place", "mm")] = None
    place_deg: Annotated[Number, meaning("the same in angle", "degrees")] = None


class PartReleased(CycleRecord, tag_field="kind", tag="release"):
    """The gripper opened above the bin; the outcome is picked only where a part showed before and not after."""

    label: Annotated[Text, meaning("the part")] = None
    above: Annotated[Text, meaning("part, empty or unclear: what the gripper showed before it opened")] = None
    opened: Annotated[Text, meaning("the same after it had opened")] = None


class PartMeasured(CycleRecord, tag_field="kind", tag="in_gripper"):
    """The part was measured in the gripper after the lift; the set-down is corrected by it."""

    label: Annotated[Text, meaning("the part")] = None
    tool_from_part: Annotated[Pose, meaning("how it is held", "mm")] = None
    shift_mm: Annotated[Number, meaning("difference of the seen pose in the gripper from the planned one", "mm")] = None
    shift_deg: Annotated[Number, meaning("the same in angle", "degrees")] = None
    chi2: Annotated[Number, meaning("how far apart they are, 6 degrees of freedom")] = None


class PlaceChanged(CycleRecord, tag_field="kind", tag="place"):
    """The status of a place changed; it was on the disk before."""

    place: Annotated[Text, meaning("its name")] = None
    label: Annotated[Text, meaning("the part that belongs there")] = None
    status: Annotated[Text, meaning("one of those of daemon/store/place_status.py")] = None
    off_mm: Annotated[Number, meaning("how far off the part was seen, along its support", "mm")] = None
    off_deg: Annotated[Number, meaning("the same in angle", "degrees")] = None
    height_mm: Annotated[Number, meaning("height above its resting pose", "mm")] = None
    tolerance_mm: Annotated[Number, meaning("the place's tolerance", "mm")] = None
    tolerance_deg: Annotated[Number, meaning("the same in angle", "degrees")] = None
    why: Annotated[Text, meaning("in words")] = None
    outline: Annotated[Points, meaning("the part's corners at the place from above, anticlockwise, world", "mm")] = None


class PartLaidDown(CycleRecord, tag_field="kind", tag="laid_down"):
    """A part on the table between two grasps: the gripper opens there; then what the look showed."""

    label: Annotated[Text, meaning("the part")] = None
    status: Annotated[Text, meaning("set: the gripper opens; seen right, off or missing: as at a place")] = None
    times: Annotated[Count, meaning("how often it was laid down in this pick, this time counted")] = None
    off_mm: Annotated[Number, meaning("how far off it was seen, along the table", "mm")] = None
    off_deg: Annotated[Number, meaning("the same in angle", "degrees")] = None
    why: Annotated[Text, meaning("in words")] = None
    world_from_part: Annotated[Pose, meaning("its goal, or its pose as seen", "mm")] = None
    outline: Annotated[Points, meaning("its corners there from above, anticlockwise, world", "mm")] = None


class SignalChanged(EventRecord, tag_field="kind", tag="signal"):
    """A signal of the line changed, as it was read or set."""

    name: Annotated[Text, meaning("its name in facetd.yaml")] = None
    role: Annotated[Text, meaning("its role there")] = None
    on: Annotated[Flag, meaning("whether it is on")] = None


class RecordsLost(EventRecord, tag_field="kind", tag="gap"):
    """Lines or images that could not be written."""

    lost: Annotated[Count, meaning("how many")] = None
    why: Annotated[Text, meaning("in words")] = None


class ClockSet(EventRecord, tag_field="kind", tag="clock"):
    """Somebody set the machine's clock."""

    jump_s: Annotated[Number, meaning("by how much", "s")] = None


class RunEnded(EventRecord, tag_field="kind", tag="run_end"):
    """The run ends. A run without this record is being written, or was cut off."""

    why: Annotated[Text, meaning("in words")] = None
    holding: Annotated[Flag, meaning("whether a part is in the gripper; null: unknown")] = None


SCHEMA: Mapping[str, type[EventRecord]] = {
    str(shape.__struct_config__.tag): shape
    for shape in tuple(globals().values())
    if isinstance(shape, type) and issubclass(shape, EventRecord) and shape.__struct_config__.tag
}
"""Every kind of record by its name."""
for _shape in (*SCHEMA.values(), EventRecord):
    msgspec.json.Decoder(_shape)  # built now: built at the first record of a kind, it would swallow a control-C


def record_of(line: bytes) -> Record:
    """Read one line as a record of today's version. Raises ValueError: no record, or a field of the wrong type."""
    if len(line) > LONGEST_LINE:
        raise ValueError("too long")
    try:
        found: object = msgspec.json.decode(line)
        if not isinstance(found, dict) or not isinstance(found.get("kind"), str):
            raise ValueError("not a record")
        msgspec.convert(found, SCHEMA.get(found["kind"], EventRecord))
    except (msgspec.MsgspecError, RecursionError, UnicodeDecodeError) as error:
        raise ValueError(str(error)) from None
    return upgraded(found)
