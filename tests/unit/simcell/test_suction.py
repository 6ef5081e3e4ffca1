"""The simulated suction cup: tight on a flat place, leaking at edges and holes, and what it loses as it turns."""

from itertools import product

import msgspec
import numpy as np
import pytest

from daemon import frames
from daemon.pick.grippers.suction import SuctionCup
from daemon.store import folders
from daemon.vision.geometry import exact
from drivers.rigid import rigid
from drivers.simcell.parts import TAUGHT, part_shape
from drivers.simcell.suction import cup_strikes, holds, suck
from drivers.simcell.truth import load_truth
from tests.fakes.holed import holed_pair
from tests.fakes.suction_cell import bracket

TRUTH = load_truth(folders.HOUSE / "etc" / "suction" / "simcell.yaml").suction
assert TRUTH is not None
CUP = SuctionCup(cup_radius_mm=TRUTH.radius_mm, lip_mm=TRUTH.lip_mm, density_g_cm3=TRUTH.density_g_cm3)
DOWN = np.array([0.0, 0.0, 1.0])
ERROR_MM = 1.0
CUBE = part_shape("cube")


def under(x=0.0, y=0.0, pressed_mm=1.5):
    """tool_from_part of a cup on the cube's top, so far off its middle."""
    return rigid(np.diag([1.0, -1.0, -1.0]), [x, y, 25.0 - pressed_mm])


def test_it_is_tight_on_a_flat_place_and_touches_nothing_where_it_is_not_pressed_on():
    assert suck(CUBE, under(), TRUTH).held
    assert suck(CUBE, under(pressed_mm=-0.5), TRUTH) is None
    assert suck(CUBE, under(x=60.0), TRUTH) is None


@pytest.mark.parametrize(("x", "held"), [(16.5, True), (17.5, False), (24.0, False)])
def test_it_leaks_over_an_edge(x, held):
    grip = suck(CUBE, under(x=x), TRUTH)
    assert grip.held is held
    assert held or "leaks" in grip.why


def test_it_leaks_where_it_leans_by_more_than_the_lip_gives():
    leaning = rigid(frames.rotation_from_vector(np.array([0.0, np.radians(20.0), 0.0])), [0.0, 0.0, 0.0]) @ under()
    assert not suck(CUBE, leaning, TRUTH).held


def test_a_cup_that_is_driven_into_the_part_strikes_it():
    assert cup_strikes(CUBE, under(pressed_mm=TRUTH.lip_mm + 1.0), TRUTH)
    assert not cup_strikes(CUBE, under(), TRUTH)


def test_no_bore_inside_or_across_its_lip_is_tight():
    part = bracket()
    shift = part.shape.surface.corners_mm[0] - part.drawing.surface.corners_mm[0]
    solid = part.drawing.solid
    assert solid.holes
    for hole in solid.holes:
        normal, middle = solid.normals[hole.facet], hole.ring_mm.mean(axis=0) + shift
        x = np.linalg.svd(normal[None])[2][1]
        axes = np.column_stack([x, np.cross(-normal, x), -normal])
        grip = suck(part.shape, frames.inverse(rigid(axes, middle - 1.5 * normal)), TRUTH)
        assert grip is None or not grip.held


def test_it_loses_what_is_too_heavy_and_what_hangs_too_far_beside_it():
    assert not holds(CUBE, under(), DOWN, TRUTH)
    assert "too heavy" in holds(CUBE, under(), DOWN, msgspec.structs.replace(TRUTH, density_g_cm3=20.0))
    middling = msgspec.structs.replace(TRUTH, density_g_cm3=4.0)
    assert not holds(CUBE, under(), DOWN, middling)
    assert "beside the cup" in holds(CUBE, under(x=16.0), DOWN, middling)
    turned = frames.rotation_from_vector(np.array([0.0, 0.9, 0.0])) @ DOWN
    assert holds(CUBE, under(), turned, middling), "what is held level is lost as the hand leans"


def planned(solid, shape, shift, rest, turn):
    """(world_from_shape, grasps) of a part at rest."""
    spin = frames.rigid(frames.rotation_from_vector(np.array([0.0, 0.0, turn])), np.array([520.0, 0.0, -300.0]))
    pose = spin @ shape.rests[rest]
    return pose, CUP.grasps(solid, pose @ frames.rigid(np.eye(3), shift), -300.0, ERROR_MM)[0]


LEVEL_ABOVE = [label for label in TAUGHT if label != "pyramid"]  # of which nothing level looks up


def part(label):
    """Of one of the demo's parts, or of a block with a bore, slot or pocket: solid, shape, and where its origin is."""
    if label in LEVEL_ABOVE:
        shape = part_shape(label)
        return exact(shape.hull.vertices, shape.hull.faces), shape, np.zeros(3)
    made = holed_pair(label, 2)[1]
    return made.drawing.solid, made.shape, made.shape.surface.corners_mm[0] - made.drawing.surface.corners_mm[0]


@pytest.mark.parametrize("label", [*LEVEL_ABOVE, "bore", "slot", "pocket"])
def test_what_is_planned_is_tight_and_held_though_the_part_is_off_by_the_error(label):
    solid, shape, shift = part(label)
    rng, count = np.random.default_rng(7), 0
    for rest, turn in product(range(len(shape.rests)), (0.3, 1.9)):
        pose, found = planned(solid, shape, shift, rest, turn)
        for grasp in found[::6]:
            way, tilt = rng.normal(size=3), rng.normal(size=3)
            error = np.concatenate([ERROR_MM * way / np.linalg.norm(way), np.radians(tilt / np.linalg.norm(tilt))])
            at = grasp.world_from_tool[:3, 3]
            there = frames.rigid(np.eye(3), at) @ frames.perturb(frames.rigid(np.eye(3), -at) @ pose, error)
            grip = suck(shape, frames.inverse(grasp.world_from_tool) @ there, TRUTH)
            assert grip is not None, grasp.told
            assert grip.held, (grip.why, grasp.told)
            down = grasp.world_from_tool[:3, :3].T @ np.array([0.0, 0.0, -1.0])
            assert not holds(shape, grip.tool_from_part, down, TRUTH)
            count += 1
    assert count, f"{label} has grasps"
