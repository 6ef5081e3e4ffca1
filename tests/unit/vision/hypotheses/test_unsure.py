"""Poses beside one, at which a part looks nearly the same."""

from __future__ import annotations

import numpy as np
import pytest

from daemon import frames
from daemon.vision.geometry import exact
from daemon.vision.hypotheses.search import TILT, perturbed_poses
from tests.fakes.solids import KNOWN, pose

WHERE = pose(np.array([0.75, 0.35, 0.6]), 0.3, 330.0)
PYRAMID = exact(KNOWN["pyramid"].corners_mm, KNOWN["pyramid"].facets)


def test_poses_nearby_leave_the_middle_of_a_part_where_it_is_seen() -> None:
    middle = frames.apply(WHERE, PYRAMID.corners_mm).mean(0)
    found = perturbed_poses(PYRAMID, WHERE)
    there = np.array([frames.apply(one, PYRAMID.corners_mm).mean(0) for one in found])
    assert there / np.linalg.norm(there, axis=1)[:, None] == pytest.approx(
        np.tile(middle / np.linalg.norm(middle), (len(found), 1))
    )
    assert [round(frames.angle_between(one, WHERE) / TILT) for one in found] == [1, 1, 1, 1, 0, 0]
