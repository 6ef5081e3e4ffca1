"""The catalogue of codes: what stopped a pick, where in the cell it lies, and what to do about it. Values only.

A code is made where the cause arises (an exception's `code`, a field of a record) and stays the same in every release;
the words belong to this catalogue alone. Commands stand in backticks, keys of facetd.yaml as they are written there.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple


class CauseCode(StrEnum):
    """What a fault or the end of a pick is caused by."""

    OPERATOR_STOP = "operator_stop"
    OPERATOR_ABORT = "operator_abort"
    OPERATOR_NO = "operator_no"
    EMERGENCY_STOP = "emergency_stop"
    ARM_POWER = "arm_power"
    ENVELOPE_ERROR = "envelope_error"
    CONTROLLER_RESTARTED = "controller_restarted"
    CONTROLLER_SILENT = "controller_silent"
    CONTROLLER_REFUSED = "controller_refused"
    CONVERTER_ECHOES = "converter_echoes"
    LINE_NOISE = "line_noise"
    ARM_NOT_THERE = "arm_not_there"
    OUT_OF_REACH = "out_of_reach"
    NOT_ENABLED = "not_enabled"
    BELOW_TABLE = "below_table"
    OUTSIDE_WORKSPACE = "outside_workspace"
    KEPT_OUT = "kept_out"
    MOVE_REFUSED = "move_refused"
    BLOCKED = "blocked"
    NO_GRASP = "no_grasp"
    CAMERA_LOST = "camera_lost"
    LENS_COVERED = "lens_covered"
    LIGHT_OFF = "light_off"
    HALF_FRAME = "half_frame"
    TORN_FRAME = "torn_frame"
    CAMERA_FROZEN = "camera_frozen"
    CAMERA_DOUBLED = "camera_doubled"
    CAMERAS_SWAPPED = "cameras_swapped"
    CAMERA_KNOCKED = "camera_knocked"
    HAND_EYE = "hand_eye"
    LOOKS_DISAGREE = "looks_disagree"
    OUT_OF_FOCUS = "out_of_focus"
    MOTION_BLUR = "motion_blur"
    TOO_DARK = "too_dark"
    OVEREXPOSED = "overexposed"
    PART_MOVED = "part_moved"
    AT_BORDER = "at_border"
    HIDDEN = "hidden"
    ALIKE = "alike"
    PATTERNED_TABLE = "patterned_table"
    NOT_TAUGHT = "not_taught"
    UNCERTAIN = "uncertain"
    RELEASE_UNCONFIRMED = "release_unconfirmed"
    PART_SLIPPED = "part_slipped"
    GRIPPER = "gripper"
    LOOK_AFTER_LIFT = "look_after_lift"
    CUT_OFF = "cut_off"
    INTERNAL = "internal"
    STALE_LOOK = "stale_look"
    NOT_FOUND_AGAIN = "not_found_again"
    OTHER_TERMINAL = "other_terminal"
    MOVED_BY_OTHERS = "moved_by_others"
    RESTARTED = "restarted"
    COMPUTER_SLEPT = "computer_slept"
    UNMATCHED_OUTLINES = "unmatched_outlines"
    NOT_KNOWN = "not_known"


class CatalogueEntry(NamedTuple):
    """A code in words: the name that pages show, where in the cell the cause lies, and what to do about it."""

    title: str
    stage: str
    remedy: str


CATALOGUE: Mapping[CauseCode, CatalogueEntry] = {
    CauseCode.OPERATOR_STOP: CatalogueEntry(
        "operator's stop",
        "operator",
        "`resume` once whoever stopped it is content; the journal says who, and at which frontend",
    ),
    CauseCode.OPERATOR_ABORT: CatalogueEntry(
        "operator's abort", "operator", "the part was given up; `pick` takes it up again"
    ),
    CauseCode.OPERATOR_NO: CatalogueEntry(
        "operator's no", "operator", "the move asked about in step mode was refused; `step off` ends asking"
    ),
    CauseCode.EMERGENCY_STOP: CatalogueEntry(
        "emergency stop", "arm", "see why it was pressed, unlatch it, switch arm power on, then `resume`"
    ),
    CauseCode.ARM_POWER: CatalogueEntry(
        "arm power", "arm", "switch arm power on at the controller, see what cut it, then `resume`"
    ),
    CauseCode.ENVELOPE_ERROR: CatalogueEntry(
        "envelope error",
        "arm",
        "a joint did not follow: see what it struck or what holds it, arm power on, then `resume`",
    ),
    CauseCode.CONTROLLER_RESTARTED: CatalogueEntry(
        "controller restarted", "arm", "its power failed: `robot power-up`, `robot cal`, then `enable`"
    ),
    CauseCode.CONTROLLER_SILENT: CatalogueEntry(
        "controller silent",
        "line",
        "is the controller on, the serial cable in at both ends, arm.port the right one? Then `resume`",
    ),
    CauseCode.CONTROLLER_REFUSED: CatalogueEntry(
        "controller refused", "arm", "the controller says why in its own words: mend that, then `resume`"
    ),
    CauseCode.CONVERTER_ECHOES: CatalogueEntry(
        "converter echoes", "line", "the switch or jumper of the converter on the line for its echo: off; then `resume`"
    ),
    CauseCode.LINE_NOISE: CatalogueEntry(
        "noise on the line", "line", "serial cable, its shield and earth, arm.dialect.baud; then `resume`"
    ),
    CauseCode.ARM_NOT_THERE: CatalogueEntry(
        "arm not where it was sent",
        "arm",
        "brakes, encoders, a load too heavy: move it with `go home` and compare `where`; then `robot cal`",
    ),
    CauseCode.OUT_OF_REACH: CatalogueEntry(
        "out of the arm's reach", "arm", "move the part nearer, or give the pick another side to come from"
    ),
    CauseCode.NOT_ENABLED: CatalogueEntry("arm not enabled", "operator", "`enable`, once the cell is clear"),
    CauseCode.BELOW_TABLE: CatalogueEntry(
        "below the table", "guard", "is pick.limits.table_z_mm the table's height? Try `calibrate touch`"
    ),
    CauseCode.OUTSIDE_WORKSPACE: CatalogueEntry(
        "outside the workspace", "guard", "move the part, or widen pick.limits.box_low_mm and box_high_mm with care"
    ),
    CauseCode.KEPT_OUT: CatalogueEntry(
        "kept out", "guard", "a box that nothing enters is in the way: move the part, or mend pick.limits.keep_out"
    ),
    CauseCode.MOVE_REFUSED: CatalogueEntry(
        "a move the guard refused", "guard", "the rule and its limit are in pick.limits; change them with care"
    ),
    CauseCode.BLOCKED: CatalogueEntry("blocked by a neighbour", "table", "move the parts apart"),
    CauseCode.NO_GRASP: CatalogueEntry(
        "no grasp holds it", "grasp", "turn the part, or see pick.gripper.opening_mm against its size"
    ),
    CauseCode.CAMERA_LOST: CatalogueEntry(
        "camera cable",
        "camera",
        "plug it in at both ends and fasten it; `facetctl cameras` lists who is there; then `resume`",
    ),
    CauseCode.LENS_COVERED: CatalogueEntry("lens covered", "camera", "take off what covers the lens; then `resume`"),
    CauseCode.LIGHT_OFF: CatalogueEntry("light off", "light", "switch the light on; then `resume`"),
    CauseCode.HALF_FRAME: CatalogueEntry(
        "half a frame", "camera", "camera cable and USB bandwidth: MJPEG first in cameras.formats needs least"
    ),
    CauseCode.TORN_FRAME: CatalogueEntry("torn frame", "camera", "a lower cameras.fps, or another USB controller"),
    CauseCode.CAMERA_FROZEN: CatalogueEntry(
        "camera frozen", "camera", "it repeats its last frame: unplug it and plug it in; then `resume`"
    ),
    CauseCode.CAMERA_DOUBLED: CatalogueEntry(
        "one camera for both eyes", "camera", "cameras.left and cameras.right name one device: name two"
    ),
    CauseCode.CAMERAS_SWAPPED: CatalogueEntry("eyes swapped", "camera", "exchange cameras.left and cameras.right"),
    CauseCode.CAMERA_KNOCKED: CatalogueEntry("camera knocked", "calibration", "fasten it, then `calibrate stereo`"),
    CauseCode.HAND_EYE: CatalogueEntry(
        "hand-eye",
        "calibration",
        "the cameras no longer sit on the hand as calibrated: fasten them, `calibrate verify`, then "
        "`calibrate hand-eye`",
    ),
    CauseCode.LOOKS_DISAGREE: CatalogueEntry(
        "looks disagree", "calibration", "the part was moved, or the cameras were: `calibrate verify` tells which"
    ),
    CauseCode.OUT_OF_FOCUS: CatalogueEntry(
        "lens out of focus or dirty",
        "camera",
        "clean the lens; then focus it at the working distance (`facetctl stream` shows it)",
    ),
    CauseCode.MOTION_BLUR: CatalogueEntry(
        "blurred by motion",
        "camera",
        "does the mount swing, or a machine beside it shake? Fasten it; a shorter exposure_us helps",
    ),
    CauseCode.TOO_DARK: CatalogueEntry("too dark", "light", "add light, or a longer exposure_us"),
    CauseCode.OVEREXPOSED: CatalogueEntry("burnt out", "light", "take light away, or a shorter exposure_us"),
    CauseCode.PART_MOVED: CatalogueEntry(
        "part moved", "table", "somebody or something moved it after it was seen: keep the table clear while it picks"
    ),
    CauseCode.AT_BORDER: CatalogueEntry(
        "too near the border", "table", "move it, or the arm, so that both eyes see it whole"
    ),
    CauseCode.HIDDEN: CatalogueEntry("hidden", "table", "move what lies before it, or turn it"),
    CauseCode.ALIKE: CatalogueEntry(
        "looks like another", "model", "turn it, or teach the side that tells it apart (`try` names what it fits)"
    ),
    CauseCode.PATTERNED_TABLE: CatalogueEntry(
        "ground too patterned", "table", "put it on a plain ground, or light it better"
    ),
    CauseCode.NOT_TAUGHT: CatalogueEntry(
        "not taught", "model", "`teach` it, or this side of it, then `train`; or take it off the table"
    ),
    CauseCode.UNCERTAIN: CatalogueEntry(
        "estimate too uncertain",
        "estimate",
        "a nearer last stand-off in pick.stops.stand_offs_mm, better light, or `calibrate verify`",
    ),
    CauseCode.RELEASE_UNCONFIRMED: CatalogueEntry(
        "release not confirmed",
        "grasp",
        "look into the bin: the part may lie in it; if this recurs, move pick.bin so that the part in the gripper "
        "shows there against something plain",
    ),
    CauseCode.PART_SLIPPED: CatalogueEntry(
        "part slipped", "grasp", "clean part and pads; pick.gripper.friction lower makes it choose squarer grasps"
    ),
    CauseCode.GRIPPER: CatalogueEntry(
        "gripper",
        "grasp",
        "do the fingers open to pick.gripper.opening_mm, and close (air, valve)? Then `calibrate touch`",
    ),
    CauseCode.LOOK_AFTER_LIFT: CatalogueEntry(
        "look after the lift",
        "images",
        "count what is in the bin; the picture of the look after the lift shows what was taken for the part",
    ),
    CauseCode.CUT_OFF: CatalogueEntry(
        "cut off",
        "computer",
        "power cut, kill or crash: the journal of that minute; `holding` says what is in the hand",
    ),
    CauseCode.INTERNAL: CatalogueEntry("a fault in facetd", "computer", "please send a `bundle`"),
    CauseCode.STALE_LOOK: CatalogueEntry(
        "a look too old", "computer", "the computer was too slow, or the pick was paused: pick.limits.max_look_age_s"
    ),
    CauseCode.NOT_FOUND_AGAIN: CatalogueEntry(
        "not found again", "images", "light and focus; see the refused outlines of the look"
    ),
    CauseCode.OTHER_TERMINAL: CatalogueEntry(
        "somebody else on the line",
        "line",
        "another program or terminal types on the arm's line: close it, then `resume` and `enable`",
    ),
    CauseCode.MOVED_BY_OTHERS: CatalogueEntry(
        "arm moved by somebody else", "operator", "keep hands and pendant off while it picks; then `resume`"
    ),
    CauseCode.RESTARTED: CatalogueEntry(
        "daemon restarted", "computer", "see `holding`, then `resume`; the journal says why it ended"
    ),
    CauseCode.COMPUTER_SLEPT: CatalogueEntry(
        "computer slept", "computer", "keep the computer from sleeping or standing still; then `resume`"
    ),
    CauseCode.UNMATCHED_OUTLINES: CatalogueEntry(
        "outlines without a facet",
        "images",
        "both cameras see outlines that do not match: see to light and focus, then `calibrate verify`",
    ),
    CauseCode.NOT_KNOWN: CatalogueEntry(
        "cause not known", "pick", "see its decisions and looks; nothing in the records stands out"
    ),
}
BY_TITLE: Mapping[str, CatalogueEntry] = {entry.title: entry for entry in CATALOGUE.values()}


def cause_code(code: object) -> CauseCode:
    """A record's code; `internal` where it is none of this catalogue."""
    try:
        return CauseCode(str(code))
    except ValueError:
        return CauseCode.INTERNAL


@dataclass(frozen=True)
class FaultCause:
    """What a fault is caused by. findings: measures of the images that were beyond their limits, each `name camera`."""

    code: CauseCode
    findings: tuple[str, ...] = ()


BY_OPERATOR = FaultCause(CauseCode.OPERATOR_STOP)


def cause_of(error: BaseException) -> FaultCause:
    """What an exception says of its cause: `code` and `findings`, of its class or its own. One without a code is a
    fault of the program."""
    return FaultCause(cause_code(getattr(error, "code", None)), tuple(getattr(error, "findings", ())))


BY_MEASURE: Mapping[str, CauseCode] = {
    "covered": CauseCode.LENS_COVERED, "half": CauseCode.HALF_FRAME, "torn": CauseCode.TORN_FRAME,
    "frozen": CauseCode.CAMERA_FROZEN, "doubled": CauseCode.CAMERA_DOUBLED, "swapped": CauseCode.CAMERAS_SWAPPED,
    "knocked": CauseCode.CAMERA_KNOCKED, "epipolar": CauseCode.CAMERA_KNOCKED, "focus": CauseCode.OUT_OF_FOCUS,
    "motion": CauseCode.MOTION_BLUR, "darkness": CauseCode.TOO_DARK, "saturation": CauseCode.OVEREXPOSED,
}  # fmt: skip
"""Measures of the images (vision/health/examination.py) by the cause that they are signs of."""
BY_UNNAMED: Mapping[str, CauseCode] = {
    "border": CauseCode.AT_BORDER, "dark": CauseCode.TOO_DARK, "burnt": CauseCode.OVEREXPOSED,
    "hidden": CauseCode.HIDDEN, "alike": CauseCode.ALIKE, "patterned": CauseCode.PATTERNED_TABLE,
    "strange": CauseCode.NOT_TAUGHT,
}  # fmt: skip
"""Why a part has no name (vision/values.py: Cause) by the cause that it is a sign of."""
BY_RULE: Mapping[str, CauseCode] = {
    "below_table": CauseCode.BELOW_TABLE, "outside_workspace": CauseCode.OUTSIDE_WORKSPACE,
    "kept_out": CauseCode.KEPT_OUT, "outside_room": CauseCode.KEPT_OUT, "no_way": CauseCode.KEPT_OUT,
    "not_enabled": CauseCode.NOT_ENABLED, "stale_look": CauseCode.STALE_LOOK,
    "moved_by_others": CauseCode.MOVED_BY_OTHERS,
}  # fmt: skip
"""Rules of the guard by the cause that a refusal is a sign of; another rule is CauseCode.MOVE_REFUSED."""


class DecisionCode(StrEnum):
    """What a pick decided, or what it was decided by."""

    CHOSEN = "chosen"
    SKIPPED = "skipped"
    ANOTHER_VIEW = "another_view"
    RELIT = "relit"
    MOVED_BETWEEN_LOOKS = "moved_between_looks"
    NOT_SEEN_AGAIN = "not_seen_again"
    PLANNED_AGAIN = "planned_again"
    SUSPECT_PART = "suspect_part"
    SUSPECT_CAMERA = "suspect_camera"
    SUSPECT_HAND_EYE = "suspect_hand_eye"
    SUSPECT_UNCLEAR = "suspect_unclear"
    IN_GRIPPER = "in_gripper"
    PICKED = "picked"
    MISSED = "missed"
    STILL_THERE = "still_there"
    KNOCKED_AWAY = "knocked_away"
    CAME_BACK_EMPTY = "came_back_empty"
    GIVEN_UP = "given_up"


SUSPECTS: Mapping[str, DecisionCode] = {
    "part": DecisionCode.SUSPECT_PART, "camera": DecisionCode.SUSPECT_CAMERA,
    "hand-eye": DecisionCode.SUSPECT_HAND_EYE,
}  # fmt: skip


def suspected(who: str) -> DecisionCode:
    """Of two looks that disagree: who is suspect, in pick/pose_fusion.py's words."""
    return SUSPECTS.get(who, DecisionCode.SUSPECT_UNCLEAR)


MISSED_BY = frozenset(
    {DecisionCode.MISSED, DecisionCode.STILL_THERE, DecisionCode.KNOCKED_AWAY, DecisionCode.CAME_BACK_EMPTY}
)
"""What the look after the lift says against a part's being in the gripper."""
