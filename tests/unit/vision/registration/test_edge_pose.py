"""Parts laid onto both images side by side are laid as each would be alone."""

from __future__ import annotations

import numpy as np
import pytest

from daemon import frames
from daemon.vision.geometry.polyhedron import exact
from daemon.vision.image.both_eyes import open_eyes
from daemon.vision.registration.edge_pose import Placements, locate
from tests.worlds.painted import paint_pair
from tests.worlds.rigs import rig
from tests.worlds.solids import KNOWN, pose

WHERE = pose(np.array([0.75, 0.25, 0.6]), 0.3, 300.0)
BESIDE = np.array([24.0, -16.0, 0.0, 0.0, 0.0, 0.3])
NEAR = np.array([1.0, -1.0, 0.5, 0.01, 0.0, -0.01])
SHAPES = [exact(KNOWN[label].corners_mm, KNOWN[label].facets) for label in ("cube", "pyramid", "cube", "cube")]


def test_a_placement_is_located_the_same_beside_others_and_a_hopeless_one_spoils_none() -> None:
    eyes = open_eyes(*paint_pair([(KNOWN["cube"], WHERE)], np.random.default_rng(1)), rig())
    near = np.array([frames.perturb(WHERE, motion) for motion in (NEAR, NEAR, BESIDE, -NEAR)])
    together = locate(SHAPES, eyes, near, 2.0)
    assert [found is not None for found in together] == [True, False, False, True]
    for shape, start, found in zip(SHAPES, near, together, strict=True):
        (alone,) = locate([shape], eyes, start[None], 2.0)
        assert (found is None) == (alone is None)
        if found is not None and alone is not None:
            assert found.pose == pytest.approx(alone.pose, abs=1e-6)
            assert found.solved.motion == pytest.approx(alone.solved.motion, abs=1e-6)
            for one, other in zip(found.observed, alone.observed, strict=True):
                assert np.array_equal(one.edges.ends, other.edges.ends)
                assert one.off == pytest.approx(other.off, abs=1e-4)


def test_nothing_to_lay_is_nothing_located() -> None:
    eyes = open_eyes(*paint_pair([], np.random.default_rng(1)), rig())
    assert locate([], eyes, np.zeros((0, 4, 4)), 2.0) == []


def test_edges_side_by_side_keep_their_own_corners_and_facets() -> None:
    laid = Placements.of(SHAPES[:2])
    for k, shape in enumerate(SHAPES[:2]):
        own = laid.owner == k
        assert np.array_equal(laid.ends[own] - laid.begins[k], shape.lines[0])
        first = len(SHAPES[0].facets) * k
        for facets, bounds in zip(laid.beside[own], shape.lines[1].T, strict=True):
            assert sorted(facets - first) == np.flatnonzero(bounds).tolist()
