"""Of two parts at one place the edges tell that only one of them has."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from daemon.vision.evidence.rivals import by_own_edges
from daemon.vision.geometry import exact
from daemon.vision.image.stereo_images import StereoImages, open_stereo
from daemon.vision.refine.edge_samples import EdgeSamples, edge_samples_of
from daemon.vision.refine.expected_edges import ShapeBatch
from tests.fakes.printed import print_pair, straight_rig
from tests.fakes.solids import KNOWN, Body, pose

WHERE = pose(np.array([0.75, 0.35, 0.6]), 0.3, 330.0)
CUBE = KNOWN["cube"]
FACING = [k for k in range(6) if exact(CUBE.corners_mm, CUBE.facets).facing(WHERE)[k] > 0]


@cache
def eyes() -> StereoImages:
    return open_stereo(*print_pair(CUBE, WHERE, 3), straight_rig())


def shown(corners_mm: np.ndarray, facets) -> list[EdgeSamples]:
    return edge_samples_of(ShapeBatch.of([exact(corners_mm, facets)]), eyes(), WHERE[None], 0.25)


def longer(body: Body, share: float) -> np.ndarray:
    return body.corners_mm * [1.0, 1.0, share]


def test_a_part_with_the_same_edges_is_told_apart_by_nothing() -> None:
    own = shown(CUBE.corners_mm, CUBE.facets)
    assert by_own_edges(own, own) == pytest.approx(0.0)


def test_a_face_alone_says_no_more_than_the_part_that_has_it() -> None:
    """All its edges are the part's as well, though some weigh more in it: its outline runs inside the part's."""
    whole, face = (shown(CUBE.corners_mm, facets) for facets in (CUBE.facets, [CUBE.facets[FACING[0]]]))
    assert by_own_edges(whole, face) > 10.0
    assert by_own_edges(face, whole) == pytest.approx(-by_own_edges(whole, face))


def test_an_edge_that_is_not_there_speaks_against_the_part_that_has_it() -> None:
    whole, other = shown(CUBE.corners_mm, CUBE.facets), shown(longer(CUBE, 1.4), CUBE.facets)
    assert by_own_edges(whole, other) > 10.0
