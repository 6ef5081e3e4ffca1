"""Jaws that close on a part: where it ends up, or why it is missed."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial

import msgspec
import numpy as np
import pytest

from daemon.arrays import Array
from drivers.rigid import apply, inverse, rigid, turn
from drivers.simcell.gripper import Grip, close_on, finger_rods, fingers
from drivers.simcell.parts import PartShape, part_shape
from tests.bench import machined
from tests.fakes.drawn import obj, prism
from tests.fakes.gripper_poses import TABLE_MM, TRUTH, tool
from tests.fakes.machined import drawing, shown_shape


def close_over(label: str, rest: int, part_turn_rad: float, hand: Array) -> Grip:
    """Close the hand on a part that stands at (520, 0)."""
    shape = part_shape(label)
    standing = rigid(turn([0, 0, 1], part_turn_rad), [520.0, 0.0, TABLE_MM]) @ shape.rests[rest]
    return close_on(shape, inverse(hand) @ standing, inverse(hand)[:3, 2], TRUTH.gripper)


def rest_on(label: str, sides: int) -> int:
    """The number of a rest on a face with that many sides."""
    shape = part_shape(label)
    for number, rest in enumerate(shape.rests):
        if np.sum(apply(rest, shape.hull.vertices)[:, 2] < 1e-6) == sides:
            return number
    raise AssertionError


@pytest.mark.parametrize("off_mm", [-5.5, -2.0, 0.0, 3.0, 5.5])
def test_closing_jaws_centre_a_part_and_tell_by_how_much(off_mm: float) -> None:
    grip = close_over("cube", 0, 0.0, tool(520.0 + off_mm, 0.0, -280.0))
    assert grip.held, grip.why
    assert abs(grip.shift_mm) == pytest.approx(abs(off_mm), abs=1e-6)
    across = apply(grip.tool_from_part, part_shape("cube").hull.vertices)[:, 1]
    assert across.max() + across.min() == pytest.approx(0.0, abs=1e-6)
    assert grip.width_mm == pytest.approx(50.0)


@pytest.mark.parametrize("turn_deg", [-11.0, -3.0, 4.0, 11.0])
def test_closing_jaws_turn_a_part_flush(turn_deg: float) -> None:
    grip = close_over("cube", 0, np.radians(turn_deg), tool(520.0, 0.0, -280.0))
    assert grip.held, grip.why
    assert abs(grip.turn_deg) == pytest.approx(abs(turn_deg), abs=1e-6)
    assert grip.width_mm == pytest.approx(50.0)


def test_a_part_is_flush_about_the_vertical_even_under_a_leaning_hand() -> None:
    grip = close_over("cube", 0, np.radians(5.0), tool(520.0, 0.0, -275.0, lean_rad=np.radians(25)))
    assert grip.held, grip.why
    assert abs(grip.turn_deg) == pytest.approx(5.0, abs=1e-6)


@pytest.mark.parametrize(
    ("label", "part_turn_deg", "hand", "why"),
    [
        ("cube", 0.0, tool(527.0, 0.0, -280.0), "too far to one side"),
        ("cube", 20.0, tool(520.0, 0.0, -280.0), "no side of the part lies along the jaws"),
        ("cube", 45.0, tool(520.0, 0.0, -280.0), "no side of the part lies along the jaws"),
        ("cube", 0.0, tool(545.0, 0.0, -280.0), "strikes"),
        ("cube", 0.0, tool(520.0, 0.0, -310.0), "strikes"),
        ("cube", 0.0, tool(520.0, 0.0, -242.0), "only the tips"),
    ],
)
def test_a_grasp_beyond_the_grippers_tolerance_misses(label: str, part_turn_deg: float, hand: Array, why: str) -> None:
    grip = close_over(label, 0, np.radians(part_turn_deg), hand)
    assert not grip.held
    assert why in grip.why


@cache
def drawn(label: str) -> PartShape:
    return shown_shape(label, machined.drawn(label))


@pytest.mark.parametrize("turn_deg", [-11.0, -4.0, 1.5, 7.0])
@pytest.mark.parametrize(("label", "width_mm"), [("flange", 60.0), ("knob", 44.0)])
def test_jaws_turn_no_disc_and_are_its_diameter_apart(label: str, width_mm: float, turn_deg: float) -> None:
    shape, hand = drawn(label), tool(520.0, 0.0, TABLE_MM + 15.0)
    standing = rigid(turn([0, 0, 1], np.radians(turn_deg)), [520.0, 1.0, TABLE_MM]) @ shape.rests[0]
    grip = close_on(shape, inverse(hand) @ standing, inverse(hand)[:3, 2], TRUTH.gripper)
    assert grip.held, grip.why
    assert grip.turn_deg == 0.0
    assert grip.width_mm == pytest.approx(width_mm, abs=0.15)


@cache
def bar() -> PartShape:
    """A rod of 30 mm, flat below."""
    angles = np.radians(np.linspace(-60.0, 240.0, 61))
    corners, rings = prism([(15.0 * np.cos(a), 15.0 * np.sin(a)) for a in angles], 60.0)
    return shown_shape("bar", drawing("bar.obj", obj(corners, rings)))


@pytest.mark.parametrize("turn_deg", [-9.0, 5.0])
@pytest.mark.parametrize(("made", "width_mm"), [(partial(drawn, "filleted_block"), 40.0), (bar, 30.0)])
def test_jaws_turn_flush_what_is_round_but_not_the_same_however_it_is_turned(
    made: Callable[[], PartShape], width_mm: float, turn_deg: float
) -> None:
    """They meet the roundings of a block beside one another, and a rod that lies along all of its side."""
    shape = made()
    (rest,) = [r for r in shape.rests if abs(r[2, 2]) < 0.5][:1]
    along = np.arctan2(*(rest[:3, :3] @ [0.0, 0.0, 1.0])[1::-1])
    hand = tool(520.0, 0.0, TABLE_MM + 15.0)
    standing = rigid(turn([0, 0, 1], np.pi / 2 - along + np.radians(turn_deg)), [520.0, 0.0, TABLE_MM]) @ rest
    grip = close_on(shape, inverse(hand) @ standing, inverse(hand)[:3, 2], TRUTH.gripper)
    assert grip.held, grip.why
    assert abs(grip.turn_deg) == pytest.approx(abs(turn_deg), abs=0.1)
    assert grip.width_mm == pytest.approx(width_mm, abs=0.05)


def test_a_part_gripped_by_its_end_swings_out() -> None:
    lying = rest_on("triangular_prism", 4)
    shape = part_shape("triangular_prism")
    axis = (shape.rests[lying][:3, :3] @ [0.0, 0.0, 1.0])[:2]
    along = float(np.arctan2(axis[1], axis[0]))
    for distance_mm, held in ((0.0, True), (33.0, False)):
        grip = close_over("triangular_prism", lying, np.pi / 2 - along, tool(520.0, distance_mm, -289.0))
        assert grip.held == held, grip.why


def test_a_slope_is_held_only_inside_the_friction_cone() -> None:
    shape, hand = part_shape("pyramid"), tool(520.0, 0.0, -270.0)
    standing = rigid(np.eye(3), [520.0, 0.0, TABLE_MM]) @ shape.rests[rest_on("pyramid", 4)]
    for friction, held in ((0.7, True), (0.3, False)):
        gripper = msgspec.structs.replace(TRUTH.gripper, friction=friction)
        grip = close_on(shape, inverse(hand) @ standing, inverse(hand)[:3, 2], gripper)
        assert grip.held == held, grip.why
    assert "slope" in grip.why


def test_the_bars_that_the_motion_monitor_watches_are_the_gripper_s_own_fingers() -> None:
    """Longer ones would else go under the table and nobody say so."""
    for gripper in (TRUTH.gripper, msgspec.structs.replace(TRUTH.gripper, tip_mm=60.0, opening_mm=70.0)):
        rods = finger_rods(gripper)
        for side in (1, -1):
            mine = [rod for rod in rods if rod.from_mm[1] * side > 0]
            boxed = fingers(gripper, gripper.opening_mm)[side < 0].vertices
            low, high = boxed.min(axis=0), boxed.max(axis=0)
            for axis in (0, 2):
                reach = max(end[axis] + rod.radius_mm for rod in mine for end in (rod.from_mm, rod.to_mm))
                assert reach == pytest.approx(high[axis], abs=0.6)
            for rod in mine:
                assert rod.from_mm[1] == pytest.approx((low[1] + high[1]) / 2)
