"""Catalogue of cause codes: what stopped a pick, where in the cell the cause lies, what to do about it. Values only.

The code that detects a cause sets its code (an exception's `code`, a field of a record); codes stay the same in every
release. Only this catalogue holds the texts: commands in backticks, keys of facetd.yaml as the file has them.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Self


class CauseCode(StrEnum):
    """Cause of a fault or of the end of a pick: code in records, name on pages, place in the cell, remedy."""

    summary: str
    stage: str
    remedy: str

    def __new__(cls, code: str, summary: str = "", stage: str = "", remedy: str = "") -> Self:
        member = str.__new__(cls, code)
        member._value_, member.summary, member.stage, member.remedy = code, summary, stage, remedy
        return member

    # fmt: off
    OPERATOR_STOP = ("operator_stop", "operator's stop", "operator",
        "find out who stopped it, and why (the journal names person and frontend); if they agree: `resume`")
    OPERATOR_ABORT = ("operator_abort", "operator's abort", "operator",
        "an operator gave up the part; `pick` tries it again")
    OPERATOR_NO = ("operator_no", "operator refused a move", "operator",
        "somebody refused the move in step mode; `step off` ends the questions")
    EMERGENCY_STOP = ("emergency_stop", "emergency stop", "arm",
        "find out why it was pressed, unlatch it, switch arm power on, then `resume`, `enable`; if `where` answers "
        "that the arm is not calibrated: `robot cal`")
    ARM_POWER = ("arm_power", "arm power", "arm",
        "find out what cut it, switch arm power on at the controller, then `resume`")
    ENVELOPE_ERROR = ("envelope_error", "envelope error", "arm",
        "a joint did not follow: see what it struck or what blocks it, switch arm power on, then `resume`")
    NOT_CALIBRATED = ("not_calibrated", "arm not calibrated", "arm",
        "the arm has not found its zero: `resume`, `enable`, then `robot cal`")
    CONTROLLER_RESTARTED = ("controller_restarted", "controller restarted", "arm",
        "its power failed: `robot power-up`, `resume` if there is a fault, `enable`, then `robot cal`")
    CONTROLLER_SILENT = ("controller_silent", "controller silent", "line",
        "check that the controller is on, the serial cable plugged in at both ends, arm.port right; then `resume`")
    CONTROLLER_REFUSED = ("controller_refused", "controller refused", "arm",
        "read the controller's message, remove the cause, then `resume`")
    CONVERTER_ECHOES = ("converter_echoes", "converter echoes", "line",
        "switch off the echo of the serial converter (a switch or a jumper on it); then `resume`")
    LINE_NOISE = ("line_noise", "noise on the line", "line",
        "check the serial cable, its shield and earth, and arm.dialect.baud; then `resume`")
    ARM_NOT_THERE = ("arm_not_there", "arm not where it was sent", "arm",
        "see whether arm power is on, and what the controller says (`robot monitor STATUS`); then check brakes, "
        "encoders and load: move it with `go home`, compare `where`; then `robot cal`")
    OUT_OF_REACH = ("out_of_reach", "out of the arm's reach", "arm",
        "move the part nearer, or turn it so that the arm can grasp it from another side")
    NOT_ENABLED = "not_enabled", "arm not enabled", "operator", "`enable`, once the cell is clear"
    BELOW_TABLE = ("below_table", "below the table", "guard",
        "check pick.limits.table_z_mm against the table's height; try `calibrate touch`")
    OUTSIDE_WORKSPACE = ("outside_workspace", "outside the workspace", "guard",
        "move the part, or widen pick.limits.box_low_mm and box_high_mm with care")
    KEPT_OUT = ("kept_out", "keep-out box or room limit in the way", "guard",
        "move the part; or compare pick.limits.keep_out, room_low_mm and room_high_mm with the cell, and correct them")
    MOVE_REFUSED = ("move_refused", "a move the guard refused", "guard",
        "the rule and its limit are in pick.limits; change them with care")
    BLOCKED = "blocked", "blocked by a neighbour", "table", "move the parts apart"
    NO_GRASP = ("no_grasp", "no grasp fits it", "grasp",
        "turn the part, or compare pick.gripper.opening_mm with its size")
    NO_WAY_TO_PLACE = ("no_way_to_place", "no way to its place", "grasp",
        "lay the part on the side that is down at its place, or move the place (`place show` says where it is)")
    PLACES_FULL = ("places_full", "no free place", "table",
        "empty the places and say so with `place clear`, or look at them with `place check`")
    OFF_PLACE = ("off_place", "set down off its place", "table",
        "correct the part's position, then `place check`; if this recurs, teach the place again: `place teach`")
    NOT_AT_PLACE = ("not_at_place", "not seen at its place", "table",
        "find the part; then `place check`, or `place clear` where nothing lies there")
    NOT_WHERE_LAID = ("not_where_laid", "not seen where it was laid down", "table",
        "find the part, lay it on the table alone; it slid or toppled when the gripper opened: see the run's page")
    CAMERA_LOST = ("camera_lost", "camera not connected", "camera",
        "plug it in at both ends and fasten it; `facetctl cameras` lists the cameras present; then `resume`")
    LENS_COVERED = "lens_covered", "lens covered", "camera", "take off what covers the lens; then `resume`"
    LIGHT_OFF = "light_off", "light off", "light", "switch the light on; then `resume`"
    HALF_FRAME = ("half_frame", "half a frame", "camera",
        "check camera cable and USB bandwidth; put MJPEG first in cameras.formats, which needs the least")
    TORN_FRAME = "torn_frame", "torn frame", "camera", "lower cameras.fps, or use another USB controller"
    CAMERA_FROZEN = ("camera_frozen", "camera frozen", "camera",
        "the camera repeats its last frame: unplug it, plug it in, then `resume`")
    CAMERA_DOUBLED = ("camera_doubled", "one camera used twice", "camera",
        "in facetd.yaml cameras.left and cameras.right name the same device: name two devices")
    CAMERAS_SWAPPED = ("cameras_swapped", "cameras swapped", "camera",
        "exchange the two USB plugs at the computer, or the two paths in /etc/udev/rules.d/60-facetd.rules; not both")
    CAMERA_KNOCKED = ("camera_knocked", "camera knocked", "calibration",
        "fasten it, then `calibrate verify`; if that fails, `calibrate stereo`")
    HAND_EYE = ("hand_eye", "hand-eye calibration off", "calibration",
        "the cameras have moved on the gripper: fasten them, `calibrate verify`, then `calibrate hand-eye`")
    LOOKS_DISAGREE = ("looks_disagree", "looks disagree", "calibration",
        "the part moved, or the cameras did: `calibrate verify` shows which")
    OUT_OF_FOCUS = ("out_of_focus", "lens out of focus or dirty", "camera",
        "clean the lens; then focus it at the working distance (`facetctl stream` shows it)")
    MOTION_BLUR = ("motion_blur", "blurred by motion", "camera",
        "check whether the mount swings or a machine near it shakes; fasten it, or shorten exposure_us")
    TOO_DARK = "too_dark", "too dark", "light", "add light, or lengthen exposure_us"
    OVEREXPOSED = "overexposed", "overexposed", "light", "reduce the light, or shorten exposure_us"
    PART_MOVED = ("part_moved", "part moved", "table",
        "somebody or something moved it after the look: keep the table clear during picks")
    AT_BORDER = "at_border", "too near the border", "table", "move it, or the arm, so that both cameras see all of it"
    HIDDEN = "hidden", "hidden", "table", "move what covers it, or turn it"
    ALIKE = ("alike", "looks like another", "model",
        "turn it, or teach the side that distinguishes it (`try` names what it fits)")
    PATTERNED_TABLE = "patterned_table", "table too patterned", "table", "put it on a plain surface, or light it better"
    NOT_TAUGHT = ("not_taught", "not taught", "model",
        "`teach` it, or this side of it, then `train`; or take it off the table")
    UNCERTAIN = ("uncertain", "estimate too uncertain", "estimate",
        "set a nearer last stand-off in pick.stops.stand_offs_mm, improve the light, or `calibrate verify`")
    RELEASE_UNCONFIRMED = ("release_unconfirmed", "release not confirmed", "grasp",
        "look into the bin for the part; if this recurs, move pick.bin to a place with a plain background")
    PART_SLIPPED = ("part_slipped", "part slipped", "grasp",
        "clean part and pads; or lower pick.gripper.friction: facetd then chooses grasps in which the fingers press "
        "more squarely on the part")
    GRIPPER = ("gripper", "gripper does not open or close", "grasp",
        "check that the fingers open to pick.gripper.opening_mm and close (air, valve); then `calibrate touch`")
    SENSOR_DISAGREES = ("sensor_disagrees", "gripper's sensor disagrees", "grasp",
        "look into the gripper, type what it holds (`holding`), then `resume`; test the sensor with `signal`")
    LOOK_AFTER_LIFT = ("look_after_lift", "the look after the lift was wrong", "images",
        "count the parts in the bin; the image after the lift shows what facetd took for the part")
    CUT_OFF = ("cut_off", "interrupted by a crash or power cut", "computer",
        "power cut, kill or crash: see the journal of that minute; then type what the gripper holds: `holding`")
    COMPUTATION = ("computation", "a computation failed", "computer",
        "a process that computes was killed, ran out of memory or took too long: see what else takes memory and "
        "processor, then `resume`; if it recurs, send a `bundle`")
    INTERNAL = "internal", "a fault in facetd", "computer", "please send a `bundle`"
    NOT_CONFIRMED = ("not_confirmed", "move not confirmed", "operator",
        "confirm each move while its look is valid (pick.limits.max_look_age_s), or `step off`")
    STALE_LOOK = ("stale_look", "a look too old", "computer",
        "the computer was too slow, or the pick was paused: see pick.limits.max_look_age_s")
    NOT_FOUND_AGAIN = ("not_found_again", "not found again", "images",
        "check light and focus; the run's page shows which outlines of the look facetd refused")
    OTHER_TERMINAL = ("other_terminal", "somebody else on the line", "line",
        "another program or terminal types on the arm's line: close it, then `resume` and `enable`")
    MOVED_BY_OTHERS = ("moved_by_others", "arm moved by somebody else", "operator",
        "keep hands and pendant off during picks; then `resume`")
    RESTARTED = ("restarted", "daemon restarted", "computer",
        "see the journal for why it ended; type what the gripper holds (`holding`), then `resume`")
    COMPUTER_SLEPT = ("computer_slept", "computer slept", "computer",
        "keep the computer from suspending or halting; then `resume`")
    UNMATCHED_OUTLINES = ("unmatched_outlines", "outlines without a facet", "images",
        "both cameras see outlines that do not match: check light and focus, then `calibrate verify`")
    NOT_KNOWN = ("not_known", "unknown cause", "pick",
        "no record shows a cause: read the pick's decisions and looks on the run's page")
    # fmt: on


BY_SUMMARY: Mapping[str, CauseCode] = {cause.summary: cause for cause in CauseCode}
EARLIER_SUMMARIES: Mapping[str, CauseCode] = {
    "operator's no": CauseCode.OPERATOR_NO, "kept out": CauseCode.KEPT_OUT, "camera cable": CauseCode.CAMERA_LOST,
    "hand-eye": CauseCode.HAND_EYE, "gripper": CauseCode.GRIPPER, "look after the lift": CauseCode.LOOK_AFTER_LIFT,
    "cut off": CauseCode.CUT_OFF, "calculation without an answer": CauseCode.COMPUTATION,
}  # fmt: skip
"""Summaries of earlier releases, which tables of several cells (daemon/fleet) hold."""


def cause_code(code: object) -> CauseCode:
    """The cause that a record's code names; CauseCode.INTERNAL for a code that this catalogue does not have."""
    try:
        return CauseCode(str(code))
    except ValueError:
        return CauseCode.INTERNAL


@dataclass(frozen=True)
class FaultCause:
    """The cause of a fault. findings: measures of the images beyond their limits, each `name camera`; source: what
    found it, the device that the watchdog watches or the class of the error."""

    code: CauseCode
    findings: tuple[str, ...] = ()
    source: str = field(default="", compare=False)


BY_OPERATOR = FaultCause(CauseCode.OPERATOR_STOP)


def cause_of(error: BaseException) -> FaultCause:
    """The cause that an exception carries as `code` and `findings`; CauseCode.INTERNAL where it has no code."""
    code, findings = cause_code(getattr(error, "code", None)), tuple(getattr(error, "findings", ()))
    return FaultCause(code, findings, type(error).__name__)


BY_MEASURE: Mapping[str, CauseCode] = {
    "covered": CauseCode.LENS_COVERED, "half": CauseCode.HALF_FRAME, "torn": CauseCode.TORN_FRAME,
    "frozen": CauseCode.CAMERA_FROZEN, "doubled": CauseCode.CAMERA_DOUBLED, "swapped": CauseCode.CAMERAS_SWAPPED,
    "knocked": CauseCode.CAMERA_KNOCKED, "epipolar": CauseCode.CAMERA_KNOCKED, "focus": CauseCode.OUT_OF_FOCUS,
    "motion": CauseCode.MOTION_BLUR, "darkness": CauseCode.TOO_DARK, "saturation": CauseCode.OVEREXPOSED,
}  # fmt: skip
"""Measures of the images (vision/health/examination.py) by the cause that each indicates."""
BY_UNNAMED: Mapping[str, CauseCode] = {
    "border": CauseCode.AT_BORDER, "dark": CauseCode.TOO_DARK, "burnt": CauseCode.OVEREXPOSED,
    "hidden": CauseCode.HIDDEN, "alike": CauseCode.ALIKE, "patterned": CauseCode.PATTERNED_TABLE,
    "strange": CauseCode.NOT_TAUGHT,
}  # fmt: skip
"""Why a part has no name (vision/values.py: Cause) by the cause that each indicates."""
BY_RULE: Mapping[str, CauseCode] = {
    "below_table": CauseCode.BELOW_TABLE, "outside_workspace": CauseCode.OUTSIDE_WORKSPACE,
    "kept_out": CauseCode.KEPT_OUT, "outside_room": CauseCode.KEPT_OUT, "no_way": CauseCode.KEPT_OUT,
    "not_enabled": CauseCode.NOT_ENABLED, "stale_look": CauseCode.STALE_LOOK,
    "moved_by_others": CauseCode.MOVED_BY_OTHERS, "not_confirmed": CauseCode.NOT_CONFIRMED,
}  # fmt: skip
"""Rules of the guard by the cause that a refusal indicates; any other rule: CauseCode.MOVE_REFUSED."""


class DecisionCode(StrEnum):
    """What a pick decided, or the reason of the decision."""

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
    NOT_MEASURED = "not_measured"
    LAID_DOWN = "laid_down"
    MISSED = "missed"
    STILL_THERE = "still_there"
    KNOCKED_AWAY = "knocked_away"
    CAME_BACK_EMPTY = "came_back_empty"
    GIVEN_UP = "given_up"
    LOOKED_AGAIN = "looked_again"


SUSPECTS: Mapping[str, DecisionCode] = {
    "part": DecisionCode.SUSPECT_PART, "camera": DecisionCode.SUSPECT_CAMERA,
    "hand-eye": DecisionCode.SUSPECT_HAND_EYE,
}  # fmt: skip


def suspected(who: str) -> DecisionCode:
    """The decision code for the suspect that pick/pose_fusion.py names where two looks disagree."""
    return SUSPECTS.get(who, DecisionCode.SUSPECT_UNCLEAR)


MISSED_BY = frozenset(
    {DecisionCode.MISSED, DecisionCode.STILL_THERE, DecisionCode.KNOCKED_AWAY, DecisionCode.CAME_BACK_EMPTY}
)
"""Decisions of the look after the lift that the gripper does not hold the part."""
