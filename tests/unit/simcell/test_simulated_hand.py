"""What the hand does to parts: what it takes, what it misses, and where parts come to lie."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import pytest

from drivers.simcell.arm import Arm
from drivers.simcell.controller import Machine
from drivers.simcell.gripper import Grip, close_on
from drivers.simcell.parts import STRANGERS, TAUGHT, part_shape
from drivers.simcell.rigid import Array, apply, inverse, rigid, turn
from drivers.simcell.stand import VIEWS, NoViewError, characteristic_pose
from drivers.simcell.truth import load_truth
from drivers.simcell.witness import Witness, pose_error
from drivers.simcell.world import Where, World, settle

TRUTH = load_truth(Path(__file__).parents[3] / "etc" / "simcell.yaml")
DOWN = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
TABLE_MM = TRUTH.table.height_mm


def tool(x_mm: float, y_mm: float, z_mm: float, turn_rad: float = 0.0, lean_rad: float = 0.0) -> Array:
    """world_from_tool of a hand pointing down, tool y along world x before it is turned about the vertical."""
    return rigid(turn([0, 0, 1], turn_rad) @ DOWN @ turn([0, 1, 0], lean_rad), [x_mm, y_mm, z_mm])


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
    assert grip.struck == ("strikes" in why)


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
    assert "cube-1: a finger" in world.strikes[0]
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
    assert "more than one" in world.closings[-1].grip.why  # type: ignore[union-attr]


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
    assert cube.where is Where.TABLE
    assert np.linalg.norm(cube.pose[:2, 3] - pyramid.pose[:2, 3]) > 60


def test_a_part_let_go_beyond_the_table_is_on_the_floor() -> None:
    world = World(TRUTH)
    world.stand("cube", 0, 520.0, 0.0, 0.0)
    world.close_hand(tool(520.0, 0.0, -280.0))
    world.open_hand(tool(520.0, 600.0, -240.0))
    assert world.parts[0].where is Where.FLOOR


def test_the_witness_tells_a_claimed_pose_from_the_true_one() -> None:
    world = World(TRUTH)
    part = world.stand("pentagonal_prism", 1, 520.0, 0.0, 0.4)
    witness = Witness(TRUTH, world, Machine(Arm()), lambda: np.eye(4))
    truth = witness.corners(part.name)
    middle = truth.mean(axis=0)
    off = rigid(turn([1, 2, 3], np.radians(1.5)), [0.0, 0.0, 0.0])
    claimed = apply(off, truth[:7] - middle) + middle + np.array([0.6, -0.8, 0.0])
    mm, deg = pose_error(claimed, witness.corners(part.name))
    assert deg == pytest.approx(1.5, abs=1e-6)
    assert mm == pytest.approx(1.0, abs=0.5)
    assert pose_error(truth, truth) == pytest.approx((0.0, 0.0), abs=1e-6)


@pytest.mark.parametrize(("label", "view"), [(label, v) for label, views in VIEWS.items() for v in range(len(views))])
def test_the_stand_shows_both_eyes_just_the_facets_of_the_characteristic_view(label: str, view: int) -> None:
    shape = part_shape(label)
    world_from_cyclopean = rigid(turn([1, 0.1, 0], 2.9), [480.0, 20.0, 100.0])
    eyes = [eye.eye().cyclopean_from_camera[:3, 3] for eye in (TRUTH.left, TRUTH.right)]
    pose = characteristic_pose(label, view, world_from_cyclopean, eyes, TRUTH.lighting)
    normals = shape.hull.normals @ pose[:3, :3].T
    for eye in eyes:
        to_eye = apply(world_from_cyclopean, eye) - apply(pose, np.zeros(3))
        offsets = shape.hull.offsets
        seen = normals @ to_eye > offsets
        sides = sorted(len(f) for f, s in zip(shape.hull.faces, seen, strict=True) if s)
        assert sides == sorted(VIEWS[label][view])


def test_a_view_that_does_not_exist_is_refused_by_number() -> None:
    with pytest.raises(NoViewError, match="numbered 0 to 0, not 1"):
        characteristic_pose("cube", 1, np.eye(4), [np.zeros(3)], TRUTH.lighting)
