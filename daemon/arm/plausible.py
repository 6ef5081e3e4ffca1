"""Check configured and calibrated geometry for implausible values: units, handedness, consistency. Pure.

In: values of the configuration and the calibration. Out: each implausible value, as its keys and one line that says
what was expected, what was found and what to do. The reader of the file adds its name and line number.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from daemon import frames
from daemon.arm.guard import Limits
from daemon.arrays import Array

Keys = tuple[str | int, ...]

ORIGIN = np.zeros(3)
METRES_MM = 2.0
"""A total length below this was written in metres: the shortest plausible one is about 50 mm."""
LONGEST_HAND_MM = 500.0
"""The greatest distance of tool or cameras from the wrist, on an arm that carries a few kilograms."""
SMALLEST_BOX_MM = 50.0
FROM_TABLE_MM = 250.0
"""The greatest plausible distance of the workspace box's lowest side from the table, above or below."""
LOOKS_ALONG = 0.2
"""Least cosine between the cameras' axis and the gripper's direction of approach."""
LOWEST_MM = 100.0
"""Fixed cameras are at least this far above the table."""
LIMITS: Keys = ("pick", "limits")
DIGITS_MM = 0.1
AS_METRES = "metres? write them times 1000"
AS_DEFAULT = "without them no rule would guard it; delete the key to get the default"


@dataclass(frozen=True)
class Implausible:
    """An implausible value. keys: its place in the file; problem: one line for the author of the file."""

    keys: Keys
    problem: str


def _found(keys: Keys, expected: str, found: str, remedy: str) -> Implausible:
    return Implausible(keys, f"expected {expected}, found {found}: {remedy}")


def rigid(matrix: Array, keys: Keys) -> Implausible | None:
    """Check a (4, 4) transform, mm, between two bodies mounted on the arm's flange."""
    wrong = frames.not_rigid(matrix)
    if wrong is not None:
        return Implausible(keys, wrong)
    away_mm = float(np.linalg.norm(matrix[:3, 3]))
    if 0.0 < away_mm < METRES_MM:
        return _found(keys, "millimetres", f"a translation of {away_mm:g} altogether", AS_METRES)
    if away_mm > LONGEST_HAND_MM:
        return _found(
            keys, f"at most {LONGEST_HAND_MM:g} mm on a hand", f"{away_mm:.0f} mm", "measure or calibrate again"
        )
    return None


def tool(flange_from_tool: Array) -> Iterator[Implausible]:
    """Check arm.flange_from_tool (4, 4): the tool centre point in the wrist centre's frame."""
    keys: Keys = ("arm", "flange_from_tool")
    wrong = rigid(flange_from_tool, keys)
    if wrong is not None:
        yield wrong
    elif flange_from_tool[2, 3] < 0:
        yield _found(keys, "the tool before the wrist (z > 0)", f"z = {flange_from_tool[2, 3]:g}", "invert the matrix?")


def hand_eye(tool_from_cyclopean: Array, reach_mm: float) -> Iterator[Implausible]:
    """Check hand_eye.tool_from_cyclopean (4, 4) of cameras mounted on an arm that reaches reach_mm."""
    keys: Keys = ("hand_eye", "tool_from_cyclopean")
    wrong = rigid(tool_from_cyclopean, keys)
    away_mm, before_mm = float(np.linalg.norm(tool_from_cyclopean[:3, 3])), float(tool_from_cyclopean[2, 3])
    if wrong is not None:
        yield wrong
    elif away_mm > reach_mm / 2:
        found = f"them {away_mm:.0f} mm off, the arm's reach is {reach_mm:.0f}"
        yield _found(keys, "cameras on the hand", found, "calibrate hand-eye again")
    elif tool_from_cyclopean[2, 2] < LOOKS_ALONG:
        yield _found(keys, "cameras that look where the gripper goes", "another way", "swapped axes? calibrate again")
    elif before_mm > 0:
        found = f"them {before_mm:.0f} mm before"
        yield _found(keys, "cameras behind the tool centre point (z < 0)", found, "invert the matrix?")


def fixed_cameras(world_from_cyclopean: Array, guard: Limits, reach_mm: float) -> Iterator[Implausible]:
    """Check hand_eye.world_from_cyclopean (4, 4) of cameras fixed above the table of an arm that reaches reach_mm."""
    keys: Keys = ("hand_eye", "world_from_cyclopean")
    above_mm, down = float(world_from_cyclopean[2, 3]) - guard.table_z_mm, -float(world_from_cyclopean[2, 2])
    if 0.0 < float(np.linalg.norm(world_from_cyclopean[:3, 3])) < METRES_MM:
        found = f"a translation of {np.linalg.norm(world_from_cyclopean[:3, 3]):g} altogether"
        yield _found(keys, "millimetres", found, AS_METRES)
    elif above_mm < LOWEST_MM:
        yield _found(keys, "cameras above the table", f"them {above_mm:.0f} mm above it", "invert the matrix?")
    elif down < LOOKS_ALONG:
        yield _found(keys, "cameras that look down at the table", "another way", "swapped axes? calibrate again")
    elif (off_mm := float(np.linalg.norm(on_table(world_from_cyclopean, guard.table_z_mm)))) > 1.5 * reach_mm:
        found = f"them to look at a place {off_mm:.0f} mm off, the arm's reach is {reach_mm:.0f}"
        yield _found(keys, "cameras that look at where the arm reaches", found, "calibrate hand-eye again")


def on_table(world_from_cyclopean: Array, table_z_mm: float) -> Array:
    """(3,) world mm: where the axis of cameras that look down meets the table."""
    along = (table_z_mm - world_from_cyclopean[2, 3]) / world_from_cyclopean[2, 2]
    return np.asarray(world_from_cyclopean[:3, 3] + along * world_from_cyclopean[:3, 2])


def limits(guard: Limits, reach_mm: float, shoulder_mm: Array = ORIGIN) -> Iterator[Implausible]:
    """Check pick.limits for an arm that reaches reach_mm from shoulder_mm (3,), world."""
    low, high = np.array(guard.box_low_mm), np.array(guard.box_high_mm)
    smallest, nearest = float((high - low).min()), float(np.linalg.norm(np.clip(shoulder_mm, low, high) - shoulder_mm))
    if smallest < SMALLEST_BOX_MM:
        side = "xyz"[int((high - low).argmin())]
        yield _found((*LIMITS, "box_high_mm"), "a workspace", f"one {smallest:g} mm long in {side}", AS_METRES)
    elif nearest > reach_mm:
        found = f"its nearest place {nearest:.0f} mm off, the arm's reach is {reach_mm:.0f}"
        yield _found((*LIMITS, "box_low_mm"), "a box the arm gets into", found, "check units and signs")
    yield from _table(guard)
    yield from _body(guard)
    yield from _keep_outs(guard)


def _table(guard: Limits) -> Iterator[Implausible]:
    keys, above_mm = (*LIMITS, "table_z_mm"), guard.box_low_mm[2] - guard.table_z_mm
    expected = f"the table within {FROM_TABLE_MM:g} mm of the box's least z = {guard.box_low_mm[2]:g}"
    if above_mm > FROM_TABLE_MM:
        mend = "measure the table's height: no rule would keep the arm off it"
        yield _found(keys, expected, f"it {above_mm:.0f} mm below", mend)
    elif above_mm < -FROM_TABLE_MM:
        yield _found(keys, expected, f"it {-above_mm:.0f} mm above", "check units and sign")


def _body(guard: Limits) -> Iterator[Implausible]:
    links = {capsule.link for capsule in guard.capsules}
    if not guard.body_mm and "tool" not in links:
        yield _found((*LIMITS, "body_mm"), "points or capsules of the gripper", "none", AS_DEFAULT)
    for link in ("upper_arm", "forearm", "wrist"):
        if link not in links:
            yield _found((*LIMITS, "capsules"), f"a capsule of the {link.replace('_', ' ')}", "none", AS_DEFAULT)
    farthest = max((float(np.linalg.norm(point)) for point in guard.body_mm), default=np.inf)
    if farthest < METRES_MM:
        yield _found((*LIMITS, "body_mm"), "millimetres", f"no point farther than {farthest:g}", AS_METRES)
    for number, capsule in enumerate(guard.capsules):
        size = max(float(np.linalg.norm(end)) for end in (capsule.from_mm, capsule.to_mm)) + capsule.radius_mm
        if size < METRES_MM:
            keys = (*LIMITS, "capsules", number)
            yield _found(keys, "millimetres", f"{capsule.name!r} within {size:g} of its link", AS_METRES)


def hand(guard: Limits, tip_mm: float, outside: tuple[str, float]) -> Iterator[Implausible]:
    """Check that the guarded shape covers the gripper of pick.gripper, which grasps are computed with. tip_mm: how far
    the gripper reaches beyond the tool centre point (z); outside: the key and the mm of its reach to each side (y)."""
    ends = [
        (np.array(end), capsule.radius_mm)
        for capsule in guard.capsules
        if capsule.link == "tool"
        for end in (capsule.from_mm, capsule.to_mm)
    ] + [(np.array(point), 0.0) for point in guard.body_mm]
    tips = [(end, radius) for end, radius in ends if end[2] + radius > tip_mm - DIGITS_MM]
    wide, outside_mm = outside
    for key, axis, says_mm, which in (("tip_mm", 2, tip_mm, ends), (wide, 1, outside_mm, tips or ends)):
        guarded_mm = max((float(end[axis]) + radius for end, radius in which), default=0.0)
        if says_mm > guarded_mm + DIGITS_MM:
            expected = f"a gripper inside the guarded capsules, {guarded_mm:g} mm in {'xyz'[axis]}"
            remedy = "give pick.limits.capsules and body_mm a gripper as long and as wide"
            yield _found(("pick", "gripper", key), expected, f"{says_mm:g}", remedy)


def _keep_outs(guard: Limits) -> Iterator[Implausible]:
    names = [box.name for box in guard.keep_out]
    for number, box in enumerate(guard.keep_out):
        keys: Keys = (*LIMITS, "keep_out", number)
        sizes = np.array(box.high_mm) - np.array(box.low_mm)
        side = "xyz"[int(sizes.argmin())]
        if not box.name.strip() or names.count(box.name) > 1:
            yield _found((*keys, "name"), "a name of its own", repr(box.name), "refusals show it")
        if sizes.min() <= 0:
            found = f"it {-sizes.min():g} mm above"
            yield _found((*keys, "low_mm"), f"{side} below high_mm's", found, "swap the two")
        elif sizes.max() < METRES_MM:
            yield _found(keys, "millimetres", f"a box of {sizes.max():g}", AS_METRES)
