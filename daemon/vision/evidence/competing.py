"""Which of two parts at one place the images support, and whether the length of a part that leaves an image is proven.

In: what both parts show, edge sample by edge sample. Out: nats. Edges that both parts have decide nothing. A part of
which one face shows has few edges, all of them another part's; a part with one edge more, which is there, is the
likelier one, however much the others weigh in either. Where all edges along a part leave the image, longer and shorter
parts fit as well, and no name is proven; an edge that ends in view, or an end of the part that does, gives the length.
"""

from collections.abc import Sequence

import numpy as np

from daemon import frames
from daemon.arrays import Array
from daemon.vision.geometry import Polyhedron, SolidBatch
from daemon.vision.hypotheses import in_sizes, pixels
from daemon.vision.image import StereoImages
from daemon.vision.refine import EdgeSamples, edge_samples_of

ALONG = np.cos(np.radians(12.0))  # an edge that lies on another one points so nearly the same way
SAME_PX = 2.0  # an edge no farther off shows by the same slopes
LEAST_APART = 1.5
"""Nats by which the edges that a part alone has must speak more for it than those that only another part, laid on the
same place, has speak for that: less leaves the name open, however little the other would be believed. Of 99 names that
edges give parts with near-duplicates that differ in a side this leaves 89 right and one wrong; of 184 without 182."""


def lead_by_own_edges(one: Sequence[EdgeSamples], other: Sequence[EdgeSamples]) -> float:
    """Log likelihood ratio, in nats, of two hypotheses from the edges in either camera that only one of them has."""
    return sum(_nats_of_own(a, b) - _nats_of_own(b, a) for a, b in zip(one, other, strict=True))


def _nats_of_own(one: EdgeSamples, other: EdgeSamples) -> float:
    """Nats of the stretches of one's edges on which none of the other lies."""
    edges, others = one.edges, other.edges
    way, along = (each.end - each.start for each in (edges, others))
    way_unit, unit = (each / np.linalg.norm(each, axis=1)[:, None] for each in (way, along))
    count = one.surprise.shape[1]
    at = edges.start[:, None] + ((np.arange(count) + 0.5) / count)[:, None] * way[:, None]
    away = at[:, :, None] - others.start
    ahead, aside = (away * unit).sum(3), away[..., 0] * unit[:, 1] - away[..., 1] * unit[:, 0]
    on = (ahead > -SAME_PX) & (ahead < others.lengths_px + SAME_PX) & (np.abs(aside) < SAME_PX)
    shared = (on & (np.abs(way_unit @ unit.T) > ALONG)[:, None]).any(2)
    return float(one.nats_of(~shared).sum())


def leaves_a_picture(solid: Polyhedron, pose: Array, images: StereoImages) -> bool:
    """Whether a part at cyclopean_from_part (4, 4) leaves the picture of either camera."""
    most = np.array(images.rig.image_size) - 1
    seen = pixels(frames.apply(pose, solid.corners_mm), images.geometry)
    return any(bool(((px < 0) | (px > most)).any()) for px in seen)


def lead_over_other_lengths(
    solid: Polyhedron, pose: Array, seen: Sequence[EdgeSamples], images: StereoImages, tolerance_mm: float
) -> float:
    """Log likelihood ratio, in nats, of a part at a pose (4, 4) against the same part longer or shorter, whichever is
    nearest, from both cameras."""
    sizes = in_sizes(solid)
    batch = SolidBatch.of(sizes)
    both = edge_samples_of(batch, images, pose[None].repeat(len(sizes), 0), tolerance_mm)
    return min(lead_by_own_edges(seen, [one.only(k, batch) for one in both]) for k in range(len(sizes)))
