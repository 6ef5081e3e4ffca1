"""From which side to look at a part whose turn does not show along its approach."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from daemon import frames
from daemon.arm import OnHand
from daemon.arrays import Array
from daemon.pick.grippers.two_fingers import tool_rotation
from daemon.pick.planning.side_look import side_that_shows_turn
from daemon.pick.pose_fusion import Sighting, sighting
from daemon.pick.settings import Settings
from daemon.vision.geometry import Polyhedron
from daemon.vision.geometry.polyhedron import exact
from daemon.vision.refine import expected_covariance
from tests.bench import machined
from tests.fakes.fake_cell import TOOL_FROM_CYCLOPEAN
from tests.fakes.rigs import rig
from tests.fakes.solids import CUBE

MOUNTING, RIG, SETTINGS = OnHand(TOOL_FROM_CYCLOPEAN), rig(), Settings()
FROM_ABOVE = tool_rotation(np.array([1.0, 0.0, 0.0]), np.radians(10.0))
UP = np.array([0.0, 0.0, 1.0])
FOOT, RIM = [0.0, 0.0, 1.0], [0.0, 0.0, -1.0]
"""Which way the knob's foot and its rim look in the frame of its drawing."""


def knob() -> Polyhedron:
    """Round from above: a cylinder on a foot with two flats, which lie under its rim."""
    return machined.drawn("knob").solid


def standing(shape: Polyhedron, foot: Array) -> Array:
    """world_from_part (4, 4) of a part whose outermost side with a normal (3,) is down."""
    outwards = np.where(shape.normals @ foot > 0.99, shape.centres_mm @ foot, -np.inf)
    side = int(outwards.argmax())
    return frames.rigid(np.diag([1.0, -1.0, -1.0]), np.array([500.0, 40.0, -300.0])) @ shape.flat_from_solid[side]


def seen_from_above(shape: Polyhedron, world_from_part: Array) -> Sighting:
    """A look along a grasp from above, as surely as its edges would make it."""
    centre = frames.apply(world_from_part, shape.corners_mm).mean(axis=0)
    tool = MOUNTING.look_pose(FROM_ABOVE, centre, 300.0)
    pose = frames.inverse(MOUNTING.world_from_cyclopean_at(tool)) @ world_from_part
    covariance = expected_covariance(shape, RIG, pose[None])[0]
    return sighting(tool, TOOL_FROM_CYCLOPEAN, pose, covariance, SETTINGS.doubt, 700.0, RIG.baseline_mm)


def side(shape: Polyhedron, foot: Array, leans_deg: float = 90.0, free_axis: Array | None = None) -> Array | None:
    """side_that_shows for a part that stands on a foot; leans_deg: how far off the vertical the arm can look."""

    def allows(tools: Array) -> Array:
        return -(tools @ TOOL_FROM_CYCLOPEAN)[:, 2, 2] > np.cos(np.radians(leans_deg))

    reach: Any = SimpleNamespace(allows_each=allows)
    seen = [seen_from_above(shape, standing(shape, foot))]
    return side_that_shows_turn(shape, seen, FROM_ABOVE, SETTINGS, MOUNTING, RIG, reach, free_axis)


def test_a_knob_is_looked_at_from_where_the_flats_under_its_rim_show() -> None:
    found = side(knob(), np.array(FOOT))
    assert found is not None
    assert np.degrees(np.arccos(-(found @ TOOL_FROM_CYCLOPEAN[:3, 2])[2])) > 30.0


@pytest.mark.parametrize(
    ("shape", "foot", "leans_deg", "free_axis"),
    [
        ("knob", RIM, 90.0, None),
        ("cube", [0.0, 0.0, -1.0], 90.0, None),
        ("knob", FOOT, 12.0, None),
        ("knob", FOOT, 90.0, UP),
    ],
    ids=["its flats up", "a cube", "no side in reach", "any turn will do"],
)
def test_what_shows_along_the_approach_or_from_nowhere_in_reach_is_looked_at_along_the_approach(
    shape: str, foot: list[float], leans_deg: float, free_axis: Array | None
) -> None:
    solid = knob() if shape == "knob" else exact(CUBE.corners_mm, CUBE.facets)
    assert side(solid, np.array(foot), leans_deg, free_axis) is None
