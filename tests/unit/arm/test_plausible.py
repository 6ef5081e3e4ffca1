"""Geometry that cannot be meant is refused in one line: what, where, what to do."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from daemon.arm import plausible
from daemon.arm.body import Capsule, KeepOut
from daemon.arm.collision_shapes import ARM
from daemon.arm.guard import Limits
from daemon.calibration.file import load_calibration
from daemon.config import load_config

ETC = Path(__file__).resolve().parents[3] / "etc"
REACH_MM = 995.0
TOOL = np.array([[1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 130], [0, 0, 0, 1]])
MOUNTED = load_calibration(ETC / "calibration.yaml").tool_from_cyclopean


def moved(matrix, x, y, z):
    found = matrix.copy()
    found[:3, 3] = x, y, z
    return found


def mirrored(matrix):
    return matrix @ np.diag([1.0, -1.0, 1.0, 1.0])


def test_what_is_delivered_is_plausible():
    assert list(plausible.limits(load_config(ETC / "facetd.yaml").values.pick.limits, REACH_MM)) == []
    assert list(plausible.limits(Limits(), REACH_MM)) == []
    assert list(plausible.tool(TOOL)) == []
    assert list(plausible.hand_eye(MOUNTED, REACH_MM)) == []


def test_a_tool_at_the_wrist_itself_is_plausible():
    assert list(plausible.tool(np.eye(4))) == []


@pytest.mark.parametrize(
    ("matrix", "told"),
    [
        (mirrored(TOOL), "mirrored"),
        (moved(TOOL, 0, 0, 0.13), "metres?"),
        (moved(TOOL, 0, 0, 1300), "at most 500 mm"),
        (moved(TOOL, 0, 0, -130), "invert the matrix?"),
        (TOOL * 1.01, "a rotation"),
        (TOOL.T, "a last row"),
        (np.eye(3), "4x4"),
        (np.full((4, 4), np.nan), "4x4"),
    ],
)
def test_a_tool_that_cannot_be_meant_is_told(matrix, told):
    (found,) = plausible.tool(matrix)
    assert found.keys == ("arm", "flange_from_tool")
    assert told in found.problem
    assert "\n" not in found.problem


@pytest.mark.parametrize(
    ("matrix", "told"),
    [
        (mirrored(MOUNTED), "mirrored"),
        (moved(MOUNTED, -0.075, 0, -0.11), "metres?"),
        (moved(MOUNTED, -7500, 0, -110), "at most 500 mm"),
        (moved(MOUNTED, -75, 0, 110), "behind the tool centre point"),
        (np.linalg.inv(MOUNTED), "behind the tool centre point"),
        (MOUNTED @ np.diag([1.0, -1.0, -1.0, 1.0]), "look where the gripper goes"),
    ],
)
def test_a_hand_eye_that_cannot_be_meant_is_told(matrix, told):
    (found,) = plausible.hand_eye(matrix, REACH_MM)
    assert found.keys == ("hand_eye", "tool_from_cyclopean")
    assert told in found.problem


def test_a_box_is_held_against_the_reach_from_where_the_shoulder_is_in_the_world():
    away = np.array([1500.0, -200.0, 700.0])
    box = replace(
        Limits(), box_low_mm=tuple(np.array(Limits().box_low_mm) + away), table_z_mm=400.0,
        box_high_mm=tuple(np.array(Limits().box_high_mm) + away),
    )  # fmt: skip
    assert list(plausible.limits(box, REACH_MM, away)) == []
    assert "a box the arm gets into" in next(plausible.limits(box, REACH_MM)).problem


def test_cameras_farther_off_than_half_of_what_the_arm_reaches_are_not_on_its_hand():
    (found,) = plausible.hand_eye(moved(MOUNTED, -300, 0, -110), 600.0)
    assert "the arm's reach is 600" in found.problem


def box(low=(0.0, 0.0, 0.0), high=(10.0, 10.0, 10.0), name="post"):
    return KeepOut(name, low, high)


LIMITS = Limits()


def without(link: str) -> tuple[Capsule, ...]:
    """The arm but for one of its links."""
    return tuple(capsule for capsule in ARM if capsule.link != link)


@pytest.mark.parametrize(
    ("limits", "keys", "told"),
    [
        (replace(LIMITS, table_z_mm=-30000.0), ("table_z_mm",), "29700 mm below"),
        (replace(LIMITS, table_z_mm=-0.3), ("table_z_mm",), "300 mm above"),
        (replace(LIMITS, table_z_mm=300.0), ("table_z_mm",), "600 mm above"),
        (replace(LIMITS, box_low_mm=(0, -0.65, -0.3), box_high_mm=(0.9, 0.65, 1.1)), ("box_high_mm",), "metres?"),
        (replace(LIMITS, box_low_mm=(5000, -650, -300), box_high_mm=(5900, 650, 1100)), ("box_low_mm",), "gets into"),
        (replace(LIMITS, body_mm=(), capsules=without("tool")), ("body_mm",), "found none"),
        (replace(LIMITS, capsules=without("upper_arm")), ("capsules",), "a capsule of the upper arm"),
        (replace(LIMITS, capsules=without("forearm")), ("capsules",), "a capsule of the forearm"),
        (replace(LIMITS, capsules=without("wrist")), ("capsules",), "a capsule of the wrist"),
        (replace(LIMITS, body_mm=((0.0, 0.05, 0.01),)), ("body_mm",), "metres?"),
        (
            replace(LIMITS, capsules=(*ARM, Capsule("x", "tool", (0, 0, 0.1), (0, 0, 0.2), 0.05))),
            ("capsules", len(ARM)),
            "metre",
        ),
        (replace(LIMITS, keep_out=(box(high=(10, -10, 10)),)), ("keep_out", 0, "low_mm"), "swap the two"),
        (replace(LIMITS, keep_out=(box(high=(0.1, 0.2, 0.3)),)), ("keep_out", 0), "metres?"),
        (replace(LIMITS, keep_out=(box(name=" "),)), ("keep_out", 0, "name"), "a name of its own"),
        (replace(LIMITS, keep_out=(box(), box())), ("keep_out", 0, "name"), "a name of its own"),
    ],
)
def test_limits_that_cannot_be_meant_are_told(limits, keys, told):
    found = list(plausible.limits(limits, REACH_MM))
    assert found, told
    assert found[0].keys[: 2 + len(keys)] == ("pick", "limits", *keys)
    assert told in found[0].problem


def bounded(value: float) -> dict[str, list[plausible.Implausible]]:
    """What is found at each bound, in units of that bound."""
    metre_mm = value * plausible.METRES_MM
    small = (Capsule("x", "tool", (0, 0, 0), (0, 0, metre_mm - 0.5), 0.5),)
    high = tuple(np.add(LIMITS.box_low_mm, (plausible.SMALLEST_BOX_MM * value, 900, 900)))
    nearest = tuple(np.add(LIMITS.box_low_mm, (value * REACH_MM - LIMITS.box_low_mm[0], 0, 0)))
    moved_box = replace(LIMITS, box_low_mm=nearest, box_high_mm=tuple(np.add(nearest, 900)))
    low, off = LIMITS.box_low_mm[2], plausible.FROM_TABLE_MM * value
    return {
        "long hand": list(plausible.tool(moved(TOOL, 0, 0, plausible.LONGEST_HAND_MM * value))),
        "cameras": list(plausible.hand_eye(moved(MOUNTED, -300 * value, 0, 0), 600.0)),
        "reach": list(plausible.limits(moved_box, REACH_MM)),
        "table below": list(plausible.limits(replace(LIMITS, table_z_mm=low - off), REACH_MM)),
        "table above": list(plausible.limits(replace(LIMITS, table_z_mm=low + off), REACH_MM)),
        "hand": list(
            plausible.hand(
                replace(LIMITS, capsules=(), body_mm=((0, 9, 9),)), 9 + value * plausible.DIGITS_MM, ("opening_mm", 9)
            )
        ),
        "metres, tool": list(plausible.tool(moved(TOOL, 0, 0, metre_mm))),
        "metres, capsule": list(plausible.limits(replace(LIMITS, capsules=(*ARM, *small)), REACH_MM)),
        "metres, points": list(plausible.limits(replace(LIMITS, body_mm=((0.0, 0.0, metre_mm),)), REACH_MM)),
        "metres, keep-out": list(plausible.limits(replace(LIMITS, keep_out=(box(high=(metre_mm,) * 3),)), REACH_MM)),
        "small box": list(plausible.limits(replace(LIMITS, box_high_mm=high), REACH_MM)),
    }


def test_each_bound_itself_is_plausible_and_what_is_just_beyond_is_told():
    least = {"metres, tool", "metres, capsule", "metres, points", "metres, keep-out", "small box"}
    assert {name for name, found in bounded(1.0).items() if found} == set()
    assert {name for name, found in bounded(0.999).items() if found} == least
    assert {name for name, found in bounded(1.001).items() if found} == bounded(1.0).keys() - least


def fixed(x=0.0, y=0.0, above_mm=600.0, lean=0.0):
    """Cameras over the table that look down, leaning so far (sine) towards x."""
    made = np.eye(4)
    made[:3, 2], made[:3, 3] = (lean, 0.0, -np.sqrt(1.0 - lean**2)), (x, y, LIMITS.table_z_mm + above_mm)
    return made


@pytest.mark.parametrize(
    ("world_from_cyclopean", "told"),
    [
        (fixed(), None),
        (fixed(y=plausible.METRES_MM, above_mm=-LIMITS.table_z_mm), None),
        (fixed(y=0.9 * plausible.METRES_MM, above_mm=-LIMITS.table_z_mm), "a translation of 1.8 altogether"),
        (fixed(above_mm=plausible.LOWEST_MM), None),
        (fixed(above_mm=plausible.LOWEST_MM - 1.0), "them 99 mm above it"),
        (fixed(lean=0.97, above_mm=300.0), None),
        (fixed(lean=0.985, above_mm=100.0), "another way"),
        (fixed(x=1.5 * REACH_MM), None),
        (fixed(x=1.5 * REACH_MM + 1.0), "them to look at a place"),
        (fixed(y=-1.5 * REACH_MM - 1.0), "them to look at a place"),
    ],
)
def test_fixed_cameras_are_plausible_up_to_each_bound(world_from_cyclopean, told):
    # the place that is looked at is measured from the world's origin, in height as well
    guard = replace(LIMITS, table_z_mm=0.0) if abs(world_from_cyclopean[:2, 3]).max() > REACH_MM else LIMITS
    found = [wrong.problem for wrong in plausible.fixed_cameras(world_from_cyclopean, guard, REACH_MM)]
    assert len(found) == (told is not None), found
    assert told is None or told in found[0]


def test_a_gripper_of_capsules_or_of_points_is_enough():
    assert list(plausible.limits(replace(LIMITS, body_mm=()), REACH_MM)) == []
    assert (
        list(plausible.limits(replace(LIMITS, body_mm=((0.0, 0.0, 50.0),), capsules=without("tool")), REACH_MM)) == []
    )


@pytest.mark.parametrize(("tip_mm", "outside_mm", "key"), [(60.0, 53.0, "tip_mm"), (10.0, 70.0, "opening_mm")])
def test_a_gripper_that_reaches_beyond_the_hand_that_is_guarded_is_told(tip_mm, outside_mm, key):
    """Taken over without a word, longer fingers went 25 mm under the table: the guard kept those it had."""
    (found,) = plausible.hand(LIMITS, tip_mm, ("opening_mm", outside_mm))
    assert found.keys == ("pick", "gripper", key)
    longer = Capsule("finger", "tool", (0.0, 60.0, 0.0), (0.0, 60.0, 50.0), 10.0)
    assert not list(plausible.hand(replace(LIMITS, capsules=(*ARM, longer)), tip_mm, ("opening_mm", outside_mm)))
    assert not list(plausible.hand(LIMITS, 10.0, ("opening_mm", 53.0)))
