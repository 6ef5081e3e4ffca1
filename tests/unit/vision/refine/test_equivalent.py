"""Of a part that was taught from one side, the pose among those that fit alike which has in view what was taught."""

from __future__ import annotations

import numpy as np
import pytest

from daemon import frames
from daemon.arrays import Array
from daemon.vision.geometry.polyhedron import Polyhedron, exact
from daemon.vision.image.stereo_images import StereoImages, open_stereo
from daemon.vision.refine.edge_pose import fit_at
from daemon.vision.refine.refined import best_fitted, most_in_view
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


def test_a_thin_side_beyond_an_edge_moves_the_part_less_where_it_is_known() -> None:
    """Unknown, it is what the edge beyond which it lies stands out from."""
    off_mm = []
    for off_deg in np.arange(6.0, 13.0):
        where, poses = lying(off_deg)
        eyes, near = seen(PENTAGONAL, where), frames.perturb(poses[0], np.array([0.3, -0.2, 0.8, 0.003, 0.0, 0.0]))
        first, _ = fit_at(THREE_SIDES, eyes, near, 0.25)
        best, observed = best_fitted(THREE_SIDES, near @ frames.inverse(poses[0]) @ poses, eyes, 0.25)
        assert in_view(THREE_SIDES, best.cyclopean_from_part) >= 2
        assert {len(eye.off) for eye in observed} != {0}
        off_mm.append([_off_mm(fit.cyclopean_from_part, poses) for fit in (first, best)])
    unknown, known = np.array(off_mm).T
    assert known.mean() < 0.8 * unknown.mean()


def _off_mm(found: Array, poses: Array) -> float:
    """How far the middle of what was taught is from where it lies, at that of the true poses which was found."""
    middle = THREE_SIDES.corners_mm.mean(0)
    return float(min(np.linalg.norm(frames.apply(found, middle) - frames.apply(pose, middle)) for pose in poses))


def test_a_side_that_the_part_does_not_have_is_not_believed_for_the_symmetry_of_the_others() -> None:
    """Cut across behind two of its sides, the prism shows none where its symmetry would have the third."""
    where, poses = lying(4.0)
    shown = frames.inverse(poses[0]) @ where
    two = [f for f in THREE_SIDES.facets if exact(PENTAGONAL.corners_mm, [f]).facing(poses[0])[0] > 0]
    half = Body(frames.apply(frames.inverse(shown), PENTAGONAL.corners_mm), tuple(two))
    best, _ = best_fitted(THREE_SIDES, poses, seen(half, where), 0.25)
    assert np.abs(frames.difference(best.cyclopean_from_part, poses[0])).max() < 1.0
