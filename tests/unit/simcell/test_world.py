"""Parts that rest, are pushed, struck, held, dropped and fall, as they would on a table."""

from __future__ import annotations

import numpy as np
import pytest

from drivers.rigid import apply, inverse, rigid, turn
from drivers.simcell.parts import STRANGERS, TAUGHT, part_shape
from drivers.simcell.world import PartPlace, World, settle
from tests.fakes.gripper_poses import TABLE_MM, TRUTH, tool


def test_parts_are_strewn_on_stable_faces_without_touching() -> None:
    for seed in range(20):
        world = World(TRUTH)
        world.scatter(TAUGHT, np.random.default_rng(seed))
        feet = [apply(p.pose, p.shape.hull.vertices) for p in world.parts]
        for corners in feet:
            assert corners[:, 2].min() == pytest.approx(TABLE_MM)
            assert np.linalg.norm(corners[:, :2] - [520.0, 0.0], axis=1).max() < 175
        for i, a in enumerate(feet):
            for b in feet[:i]:
                assert np.linalg.norm(a[:, None, :2] - b[None, :, :2], axis=2).min() > 20


def test_parts_strewn_steadily_lie_with_their_mass_as_low_as_it_can_be() -> None:
    world, lowest = World(TRUTH), {"cube": 25.0, "pyramid": 12.5, "triangular_prism": 14.4, "pentagonal_prism": 22.0}
    for seed in range(10):
        world.scatter(TAUGHT, np.random.default_rng(seed), steady=True)
    for part in world.parts:
        height_mm = apply(part.pose, part.shape.centre_of_mass)[2] - TABLE_MM
        assert height_mm == pytest.approx(lowest[part.label], abs=0.1)


def test_strewing_is_repeated_by_its_seed() -> None:
    poses = []
    for seed in (3, 3, 4):
        world = World(TRUTH)
        world.scatter(TAUGHT, np.random.default_rng(seed))
        poses.append(np.array([p.pose for p in world.parts]))
    assert np.array_equal(poses[0], poses[1])
    assert not np.allclose(poses[0], poses[2])


def test_a_missed_part_is_pushed_and_stays_on_the_table() -> None:
    world = World(TRUTH)
    part = world.stand("cube", 0, 520.0, 0.0, 0.0)
    world.close_hand(tool(528.0, 0.0, -280.0))
    assert not world.held
    moved = world.parts[0].pose[:3, 3] - part.pose[:3, 3]
    assert moved == pytest.approx([TRUTH.gripper.centring_mm, 0.0, 0.0], abs=1e-9)


def test_a_struck_part_or_table_is_on_record() -> None:
    world = World(TRUTH)
    world.stand("cube", 0, 520.0, 0.0, 0.0)
    world.close_hand(tool(545.0, 0.0, -280.0))
    world.close_hand(tool(700.0, 0.0, -295.0))
    assert len(world.strikes) == 2
    assert "cube-1: the gripper" in world.strikes[0]
    assert "table" in world.strikes[1]


def test_a_hand_that_comes_down_through_a_neighbour_is_on_record_even_if_it_ends_clear() -> None:
    world = World(TRUTH)
    world.stand("cube", 0, 520.0, 0.0, 0.0)
    world.stand("cube", 0, 575.0, 45.0, 0.0)
    slanting = [tool(520.0, 90.0 - 90.0 * share, -180.0 - 100.0 * share) for share in np.linspace(0.0, 1.0, 20)]
    world.close_hand(slanting[-1], slanting)
    assert world.held
    assert len(world.strikes) == 1
    assert "cube-2" in world.strikes[0]


def test_two_parts_between_the_jaws_are_not_taken() -> None:
    world = World(TRUTH)
    world.stand("cube", 0, 520.0, -26.0, 0.0)
    world.stand("cube", 0, 520.0, 26.0, 0.0)
    world.close_hand(tool(520.0, 0.0, -280.0))
    assert world.held is None
    assert "more than one" in world.closings[-1].grip.why


@pytest.mark.parametrize("label", [*TAUGHT, *STRANGERS])
def test_a_part_let_go_over_the_table_falls_onto_a_stable_face_right_below(label: str) -> None:
    rng = np.random.default_rng(5)
    shape = part_shape(label)
    for _ in range(20):
        held = rigid(turn(rng.normal(size=3), rng.uniform(0, 3)), [500.0, 30.0, -100.0])
        landed = settle(shape, held, TABLE_MM)
        heights = apply(landed, shape.hull.vertices)[:, 2]
        assert heights.min() == pytest.approx(TABLE_MM)
        assert np.sum(heights < TABLE_MM + 1e-6) >= 3
        centres = [apply(pose, shape.centre_of_mass)[:2] for pose in (held, landed)]
        assert centres[0] == pytest.approx(centres[1], abs=1e-6)


def test_a_part_standing_upright_lands_as_it_stood() -> None:
    for label in TAUGHT:
        for rest in part_shape(label).rests:
            standing = rigid(turn([0, 0, 1], 0.7), [500.0, 10.0, TABLE_MM]) @ rest
            lifted = rigid(np.eye(3), [0.0, 0.0, 80.0]) @ standing
            assert np.allclose(settle(part_shape(label), lifted, TABLE_MM), standing, atol=1e-6)


def test_a_part_dropped_onto_another_slides_off_it() -> None:
    world = World(TRUTH)
    world.stand("cube", 0, 520.0, 0.0, 0.0)
    world.close_hand(tool(520.0, 0.0, -280.0))
    world.stand("pyramid", 0, 600.0, 0.0, 0.0)
    world.open_hand(tool(595.0, 0.0, -240.0))
    cube, pyramid = world.parts
    assert cube.where is PartPlace.TABLE
    assert np.linalg.norm(cube.pose[:2, 3] - pyramid.pose[:2, 3]) > 49.0


@pytest.mark.parametrize(("apart_mm", "stays"), [(55.0, True), (20.0, False)])
def test_a_part_that_is_set_down_close_beside_another_stays_where_it_was_set(apart_mm: float, stays: bool) -> None:
    """Cubes of 50 mm side by side: circles round them overlap, and they do not."""
    world = World(TRUTH)
    world.stand("cube", 0, 520.0, 0.0, 0.0)
    world.close_hand(tool(520.0, 0.0, -280.0))
    held = world.held
    assert held is not None
    world.stand("cube", 0, 400.0, 0.0, 0.0)
    lying = next(part for part in world.parts if part.name != held.name)
    there = rigid(np.eye(3), [0.0, apart_mm, 0.0]) @ lying.pose
    world.open_hand(there @ inverse(held.pose))
    landed = next(part for part in world.parts if part.name == held.name)
    assert bool(np.linalg.norm((landed.pose - there)[:2, 3]) < 0.5) is stays


def test_a_part_let_go_beyond_the_table_is_on_the_floor() -> None:
    world = World(TRUTH)
    world.stand("cube", 0, 520.0, 0.0, 0.0)
    world.close_hand(tool(520.0, 0.0, -280.0))
    world.open_hand(tool(520.0, 600.0, -240.0))
    assert world.parts[0].where is PartPlace.FLOOR
