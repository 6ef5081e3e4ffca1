"""The part in the gripper as it is: its corners against planes, what encloses it against boxes, and the one stretch on
which it may come down to its support."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon import frames
from daemon.arm.belief import Reading
from daemon.arm.body import CarriedCapsule, FixtureBox, KeepOut, away_mm, carried_part, upright_bounds
from daemon.arm.guard import ArmState, Limits, MoveCommand, SupportContact, hand_above_mm
from daemon.arm.motion import Arrival, Mover
from daemon.arm.sweep import path_refusal
from daemon.pick.grippers.two_fingers import tool_rotation
from drivers import puma560
from tests.fakes.fake_cell import World, build, permitted
from tests.fakes.swept import ARM, ROBOT

LIMITS = Limits()
CUBE = 40.0 * (np.indices((2, 2, 2)).reshape(3, 8).T.astype(float) - 0.5)
"""(8, 3) corners of a 40 mm cube about the tool centre point."""


def pose(z_mm: float, tilt_deg: float = 0.0) -> np.ndarray:
    rotation = tool_rotation(np.array([1.0, 0.0, 0.0]), np.radians(tilt_deg))
    return frames.rigid(rotation, np.array([520.0, 0.0, z_mm]))


def held(corners: np.ndarray = CUBE) -> Limits:
    return replace(LIMITS, capsules=LIMITS.capsules + carried_part(corners, "cube in the gripper"))


def lowered(limits: Limits, start_mm: float, end_mm: float, contact: SupportContact | None) -> str | None:
    start = pose(start_mm)
    reading = Reading(start, puma560.inverse(start, puma560.Configuration(), ARM))
    capsules = tuple(
        replace(c, level_mm=contact.level_mm, may_touch=contact.fixture)
        if contact is not None and isinstance(c, CarriedCapsule)
        else c
        for c in limits.capsules
    )
    command = MoveCommand(pose(end_mm), True, 10.0, "down", contact=contact)
    standing = ArmState(None, start, 0.0)
    refusal = path_refusal(command, standing, reading, ROBOT, replace(limits, capsules=capsules))
    return None if refusal is None else refusal.rule


@given(st.floats(-260.0, -100.0), st.floats(0.0, 40.0))
def test_a_carried_part_is_as_high_as_its_lowest_corner(z_mm: float, tilt_deg: float) -> None:
    here = pose(z_mm, tilt_deg)
    bare = hand_above_mm(here, LIMITS)
    corner = float(frames.apply(here, CUBE)[:, 2].min()) - LIMITS.table_z_mm
    assert hand_above_mm(here, held()) == pytest.approx(min(bare, corner))


def test_a_cube_may_be_carried_three_mm_above_the_table_and_one_mm_above_only_on_its_last_stretch() -> None:
    """The capsule around it reached 14 mm below its face: a cube 10 mm above the table was refused."""
    on_table = LIMITS.table_z_mm + 20.0
    assert lowered(held(), on_table + 60.0, on_table + 3.0, None) is None
    assert lowered(held(), on_table + 60.0, on_table + 1.0, None) == "below_table"
    assert lowered(held(), on_table + 60.0, on_table + 0.5, SupportContact(LIMITS.table_z_mm)) is None


def test_a_part_is_never_lowered_below_what_it_is_to_rest_on() -> None:
    on_table = LIMITS.table_z_mm + 20.0
    assert lowered(held(), on_table + 60.0, on_table - 1.0, SupportContact(LIMITS.table_z_mm)) == "below_table"
    support = SupportContact(LIMITS.table_z_mm + 15.0)
    assert lowered(held(), on_table + 60.0, on_table + 14.0, support) == "below_table"
    assert lowered(held(), on_table + 60.0, on_table + 15.5, support) is None


def test_the_gripper_keeps_the_table_s_clearance_where_the_part_comes_down() -> None:
    """A small part, deep between the fingers: its support is no leave for the finger tips."""
    small = CUBE * 0.1
    assert lowered(held(small), -200.0, LIMITS.table_z_mm + 6.0, SupportContact(LIMITS.table_z_mm)) == "below_table"


def test_a_part_may_be_near_the_boxes_of_its_own_fixture_alone_and_arm_and_gripper_near_none() -> None:
    wall = FixtureBox("fixture nest, box 1", (25.0, -20.0, 0.0), (35.0, 20.0, 12.0), (520.0, 0.0, -300.0), 0.0)
    limits = replace(held(), keep_out=(wall,))
    on_table = LIMITS.table_z_mm + 20.0
    own, other = SupportContact(-300.0, ("fixture nest, box 1",)), SupportContact(-300.0, ("fixture tray, box 1",))
    assert lowered(limits, on_table + 60.0, on_table + 0.5, own) is None
    assert lowered(limits, on_table + 60.0, on_table + 0.5, other) == "kept_out"
    under_a_finger = replace(wall, low_mm=(-10.0, 40.0, 0.0), high_mm=(10.0, 60.0, 60.0))
    assert lowered(replace(limits, keep_out=(under_a_finger,)), on_table + 60.0, on_table + 0.5, own) == "kept_out"


@given(st.floats(-180.0, 180.0), st.floats(-100.0, 100.0), st.floats(-100.0, 100.0), st.floats(0.0, 80.0))
def test_a_turned_fixture_is_as_far_as_an_upright_box_seen_from_its_own_frame(
    heading_deg: float, x: float, y: float, z: float
) -> None:
    plain = KeepOut("box", (-20.0, -10.0, 0.0), (20.0, 10.0, 30.0))
    origin = np.array([30.0, -40.0, 5.0])
    turned = FixtureBox("box", plain.low_mm, plain.high_mm, (30.0, -40.0, 5.0), heading_deg)
    angle = np.radians(heading_deg)
    rotation = frames.rotation_from_vector(np.array([0.0, 0.0, angle]))
    ends = np.array([[[[x, y, z], [x + 15.0, y - 5.0, z + 20.0]]]])
    local = (ends - origin) @ rotation
    radius = np.array([3.0])
    assert away_mm(ends, radius, [turned], 1e3) == pytest.approx(away_mm(local, radius, [plain], 1e3), abs=1e-6)
    low, high = upright_bounds([turned])[0]
    corners = np.array([[sx, sy, sz] for sx in (-20, 20) for sy in (-10, 10) for sz in (0, 30)]) @ rotation.T + origin
    assert (corners >= low - 1e-9).all()
    assert (corners <= high + 1e-9).all()


def test_the_mover_lets_only_the_part_down_and_only_on_that_move() -> None:
    mover = permitted(Mover(build(World(np.random.default_rng(0))), LIMITS, Arrival()))
    mover.beliefs.learn("commanded", held_shape=carried_part(CUBE, "cube"))  # type: ignore[arg-type]
    down = MoveCommand(pose(-279.5), True, 10.0, "down", contact=SupportContact(-300.0))
    levels = [c.level_mm for c in mover._bounds(down).capsules if isinstance(c, CarriedCapsule)]
    assert set(levels) == {-300.0}
    assert not any(
        isinstance(c, CarriedCapsule) and c.level_mm is not None
        for c in mover._bounds(replace(down, contact=None)).capsules
    )
    assert all(c in mover._bounds(down).capsules for c in LIMITS.capsules)
