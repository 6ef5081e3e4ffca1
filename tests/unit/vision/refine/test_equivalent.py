"""Of a part that was taught from one side, the pose among those that fit alike which has in view what was taught."""

from __future__ import annotations

import numpy as np
import pytest

from daemon import frames
from daemon.arrays import Array
from daemon.vision.geometry.polyhedron import Polyhedron, exact
from daemon.vision.image.stereo_images import StereoImages, open_stereo
from daemon.vision.refine.edge_adjustment import most_in_view
from tests.fakes.painted import paint_pair
from tests.fakes.rigs import rig
from tests.fakes.solids import PENTAGONAL, Body, pose

FIFTH = frames.rigid(frames.rotation_from_vector(np.array([0.0, 0.0, 2 * np.pi / 5])), np.zeros(3))
THREE_SIDES = exact(PENTAGONAL.corners_mm, PENTAGONAL.facets[2:5])
"""Of the prism's five sides, those that were taught, one beside the other."""


def in_view(solid: Polyhedron, where: Array) -> int:
    return int((solid.facing(where) > 0).sum())


def seen(body: Body, where: Array) -> StereoImages:
    return open_stereo(*paint_pair([(body, where)], np.random.default_rng(4), rig()), rig())


def lying(off_deg: float) -> tuple[Array, Array]:
    """How the whole prism lies, one of its sides so many degrees from looking at the cameras and one on either hand of
    it in view; and the five poses that its symmetry allows, one at which only two of these were taught first."""
    angle = np.radians(36.0 + off_deg)
    where = pose(np.array([np.cos(angle), np.sin(angle), 0.2]), 0.3, 300.0)
    poses = np.stack([where @ np.linalg.matrix_power(FIFTH, k) for k in range(5)])
    known = [in_view(THREE_SIDES, one) for one in poses]
    assert max(known) == 3
    return where, np.roll(poses, -known.index(2), axis=0)


@pytest.mark.parametrize("off_deg", [-10.0, -4.0, 0.0, 4.0, 10.0])
def test_the_pose_under_which_all_that_is_in_view_was_taught(off_deg: float) -> None:
    where, poses = lying(off_deg)
    assert in_view(THREE_SIDES, poses[most_in_view(THREE_SIDES, poses, seen(PENTAGONAL, where))]) == 3


def test_a_part_known_from_all_sides_stays_as_it_was_found() -> None:
    """However it is turned, it shows the same."""
    where, poses = lying(4.0)
    assert most_in_view(exact(PENTAGONAL.corners_mm, PENTAGONAL.facets), poses, seen(PENTAGONAL, where)) == 0
    assert most_in_view(THREE_SIDES, poses[:0], seen(PENTAGONAL, where)) == 0
