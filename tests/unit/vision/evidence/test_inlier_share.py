"""A part explains the edges that are seen where it lies; what lies there and is another's, it does not."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from daemon.vision.evidence.by_edges import USUAL_EXPLAINED
from daemon.vision.evidence.inlier_share import edge_inlier_share
from daemon.vision.geometry import exact
from daemon.vision.geometry.polyhedron import SolidBatch
from daemon.vision.image.stereo_images import StereoImages, open_stereo
from daemon.vision.refine.expected_edges import expected
from tests.fakes.painted import paint_pair
from tests.fakes.rigs import rig
from tests.fakes.solids import KNOWN, pose

WHERE = pose(np.array([0.75, 0.35, 0.6]), 0.3, 330.0)
TOLERANCE_MM = 0.25


@cache
def images_of(name: str | None) -> StereoImages:
    bodies = [] if name is None else [(KNOWN[name], WHERE)]
    return open_stereo(*paint_pair(bodies, np.random.default_rng(3)), rig())


def share(name: str, images: StereoImages) -> float | None:
    solid = exact(KNOWN[name].corners_mm, KNOWN[name].facets)
    laid = SolidBatch.of([solid])
    edges = expected(laid, images, WHERE[None], np.ones(1, bool), TOLERANCE_MM)
    return edge_inlier_share(solid, WHERE, edges, images)


@pytest.mark.parametrize("name", sorted(KNOWN))
def test_a_part_explains_what_is_seen_where_it_lies_and_no_other_part_does(name: str) -> None:
    own = share(name, images_of(name))
    assert own is not None
    assert own > USUAL_EXPLAINED
    others = [share(other, images_of(name)) for other in KNOWN if other != name]
    assert all(other is not None and other < 0.3 for other in others)


def test_where_no_edge_is_seen_nothing_is_said() -> None:
    assert share("cube", images_of(None)) is None
