"""Every cause that the review knows: where in the cell it is, and what to do about it. Values only."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple


class Known(NamedTuple):
    """Where in the cell a cause is, and what to do about it."""

    stage: str
    remedy: str


KNOWN: Mapping[str, Known] = {
    "operator's stop": Known(
        "operator",
        "`resume` once whoever stopped it is content; the journal says who, and at which frontend",
    ),
    "operator's abort": Known("operator", "the part was given up; `pick` takes it up again"),
    "operator's no": Known("operator", "the move asked about in step mode was refused; `step off` ends asking"),
    "emergency stop": Known("arm", "see why it was pressed, unlatch it, switch arm power on, then `resume`"),
    "arm power": Known("arm", "switch arm power on at the controller, see what cut it, then `resume`"),
    "envelope error": Known(
        "arm",
        "a joint did not follow: see what it struck or what holds it, arm power on, then `resume`",
    ),
    "controller restarted": Known("arm", "its power failed: `robot power-up`, `robot cal`, then `enable`"),
    "controller silent": Known(
        "line",
        "is the controller on, the serial cable in at both ends, arm.port the right one? Then `resume`",
    ),
    "converter echoes": Known(
        "line", "the switch or jumper of the converter on the line for its echo: off; then `resume`"
    ),
    "noise on the line": Known("line", "serial cable, its shield and earth, arm.dialect.baud; then `resume`"),
    "arm not where it was sent": Known(
        "arm",
        "brakes, encoders, a load too heavy: move it with `go home` and compare `where`; then `robot cal`",
    ),
    "out of the arm's reach": Known("arm", "move the part nearer, or give the pick another side to come from"),
    "arm not enabled": Known("operator", "`enable`, once the cell is clear"),
    "below the table": Known("guard", "is pick.limits.table_z_mm the table's height? Try `calibrate touch`"),
    "outside the workspace": Known("guard", "move the part, or widen pick.limits.box_low_mm and box_high_mm with care"),
    "kept out": Known("guard", "a box that nothing enters is in the way: move the part, or mend pick.limits.keep_out"),
    "a move the guard refused": Known("guard", "the rule and its limit are in pick.limits; change them with care"),
    "blocked by a neighbour": Known("table", "move the parts apart"),
    "no grasp holds it": Known("grasp", "turn the part, or see pick.gripper.opening_mm against its size"),
    "camera cable": Known(
        "camera",
        "plug it in at both ends and fasten it; `facetctl cameras` lists who is there; then `resume`",
    ),
    "lens covered": Known("camera", "take off what covers the lens; then `resume`"),
    "light off": Known("light", "switch the light on; then `resume`"),
    "half a frame": Known("camera", "camera cable and USB bandwidth: MJPEG first in cameras.formats needs least"),
    "torn frame": Known("camera", "a lower cameras.fps, or another USB controller"),
    "camera frozen": Known("camera", "it repeats its last frame: unplug it and plug it in; then `resume`"),
    "one camera for both eyes": Known("camera", "cameras.left and cameras.right name one device: name two"),
    "eyes swapped": Known("camera", "exchange cameras.left and cameras.right"),
    "camera knocked": Known("calibration", "fasten it, then `calibrate stereo`"),
    "hand-eye": Known(
        "calibration",
        "the cameras no longer sit on the hand as calibrated: fasten them, `calibrate verify`, then "
        "`calibrate hand-eye`",
    ),
    "looks disagree": Known("calibration", "the part was moved, or the cameras were: `calibrate verify` tells which"),
    "lens out of focus or dirty": Known(
        "camera",
        "clean the lens; then focus it at the working distance (`facetctl stream` shows it)",
    ),
    "blurred by motion": Known(
        "camera",
        "does the mount swing, or a machine beside it shake? Fasten it; a shorter exposure_us helps",
    ),
    "too dark": Known("light", "add light, or a longer exposure_us"),
    "burnt out": Known("light", "take light away, or a shorter exposure_us"),
    "part moved": Known(
        "table",
        "somebody or something moved it after it was seen: keep the table clear while it picks",
    ),
    "too near the border": Known("table", "move it, or the arm, so that both eyes see it whole"),
    "hidden": Known("table", "move what lies before it, or turn it"),
    "looks like another": Known("model", "turn it, or teach the side that tells it apart (`try` names what it fits)"),
    "ground too patterned": Known("table", "put it on a plain ground, or light it better"),
    "not taught": Known("model", "`teach` it, or this side of it, then `train`; or take it off the table"),
    "estimate too uncertain": Known(
        "estimate",
        "a nearer last stand-off in pick.stops.stand_offs_mm, better light, or `calibrate verify`",
    ),
    "release not confirmed": Known(
        "grasp",
        "look into the bin: the part may lie in it; if this recurs, move pick.bin so that the part in the gripper "
        "shows there against something plain",
    ),
    "part slipped": Known("grasp", "clean part and pads; pick.gripper.friction lower makes it choose squarer grasps"),
    "gripper": Known(
        "grasp",
        "do the fingers open to pick.gripper.opening_mm, and close (air, valve)? Then `calibrate touch`",
    ),
    "look after the lift": Known(
        "images",
        "count what is in the bin; the picture of the look after the lift shows what was taken for the part",
    ),
    "cut off": Known(
        "computer",
        "power cut, kill or crash: the journal of that minute; `holding` says what is in the hand",
    ),
    "a fault in facetd": Known("computer", "please send a `bundle`"),
    "a look too old": Known(
        "computer",
        "the computer was too slow, or the pick was paused: pick.limits.max_look_age_s",
    ),
    "not found again": Known("images", "light and focus; see the refused outlines of the look"),
    "cause not known": Known("pick", "see its decisions and looks; nothing in the records stands out"),
}
"""Commands stand in backticks, keys of facetd.yaml as they are written there."""
