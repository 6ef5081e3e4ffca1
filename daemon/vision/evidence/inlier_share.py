"""How much of the straight edges that both cameras see where a part would be are that part's own.

In: both cameras, a part laid onto them. Out: a share. Where a stranger lies, a guess has some of its edges by chance,
and leaves the others unexplained. Print leaves some, too: it lies inside the faces of parts that are there.
"""

from collections.abc import Sequence

import numpy as np

from daemon import frames
from daemon.arrays import Array, Flags
from daemon.vision.geometry import PlanarShape, Polyhedron, clear_of
from daemon.vision.hypotheses import pixels
from daemon.vision.image import StereoImages
from daemon.vision.refine import ExpectedEdges, across

ASIDE_PX = 3.0
"""How far beside what a part covers the middle of a segment may lie that is held against it."""
OFF_PX, TURNED, BEYOND = 2.5, np.sin(np.radians(10.0)), 0.05
"""How far the middle of a segment may lie off its edge, and past its end as a share of its length; and the sine of the
angle between them."""


def edge_inlier_share(
    solid: Polyhedron,
    pose: Array,
    edges: tuple[ExpectedEdges, ExpectedEdges],
    images: StereoImages,
    covered: Sequence[Sequence[PlanarShape]] = ((), ()),
) -> float | None:
    """Fraction of the image segments where a part at cyclopean_from_part (4, 4) would be, by length, that lie on its
    expected edges; None if there are none. covered: what nearer objects cover in either image; segments there do not
    count."""
    own = every = 0.0
    corners_px = pixels(frames.apply(pose, solid.corners_mm), images.geometry)
    for view, expected, corners, nearer in zip(images.views, edges, corners_px, covered, strict=True):
        middle = (view.segments.start + view.segments.end) / 2
        there = (PlanarShape.hull(corners).depth(middle) > -ASIDE_PX) & clear_of(nearer, middle, ASIDE_PX)
        segments = view.segments.chosen(there)
        lengths = segments.lengths_px
        every += float(lengths.sum())
        way = (segments.end - segments.start) / lengths[:, None]
        own += float(lengths[_on_an_edge(middle[there], way, expected)].sum())
    return own / every if every else None


def _on_an_edge(middle: Array, way: Array, edges: ExpectedEdges) -> Flags:
    """(N,) which segments with such middles (N, 2) px and unit ways (N, 2) lie on any of the edges."""
    normal, from_start = across(edges.start, edges.end), middle[:, None] - edges.start
    off_px = np.abs((from_start * normal).sum(2))
    share = (from_start * (edges.end - edges.start)).sum(2) / edges.lengths_px**2
    bent = 4 * np.abs(edges.bow[:, 1] - (edges.bow[:, 0] + edges.bow[:, 2]) / 2) / edges.lengths_px
    near = (off_px < OFF_PX) & (share > -BEYOND) & (share < 1 + BEYOND) & (np.abs(way @ normal.T) < TURNED + bent)
    return np.asarray(near.any(1))
