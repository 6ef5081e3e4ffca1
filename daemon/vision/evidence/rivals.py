"""Which of two parts at one place the images support: taught ones, and near-duplicates that nobody taught; and whether
the length of a part that leaves the image is proven.

In: what both parts show, edge sample by edge sample. Out: nats. Edges that both parts have decide nothing. A part of
which one face shows has few edges, all of them another part's; a part with one edge more, which is there, is the
likelier one, however much the others weigh in either. Where all edges along a part leave the image, longer and shorter
parts fit as well, and no name is proven; an edge that ends in view, or an end of the part that does, gives the length.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from daemon import frames
from daemon.arrays import Array
from daemon.vision.evidence.edge_places import EdgePlaces
from daemon.vision.evidence.near_duplicates import near_duplicates
from daemon.vision.geometry import Polyhedron, SolidBatch
from daemon.vision.hypotheses import in_sizes, pixels
from daemon.vision.image import StereoImages
from daemon.vision.refine import EdgeSamples, edge_samples_of
from daemon.vision.settings import TOLERANCE_MM

ALONG = np.cos(np.radians(12.0))  # an edge that lies on another one points so nearly the same way
SAME_PX = 2.0  # an edge no farther off shows by the same slopes
BY_OUTLINE_PX = (0.0, 0.0)
"""Near-duplicates differ by thin facets, which change the outline by what they stick out: none is too thin here. The
rivals of right names in the tuned-on looks then lead by 4.1 nats at most instead of 12."""
LEAST_APART = 1.5
"""Nats by which the edges that a part alone has must speak more for it than those that only another part, laid on the
same place, has speak for that: less leaves the name open, however little the other would be believed. Of 99 names that
edges give parts with twins that differ in a side this leaves 89 right and one wrong; of 184 without twins 182."""


def by_own_edges(one: Sequence[EdgeSamples], other: Sequence[EdgeSamples]) -> float:
    """By how many nats the edges that only one has, in either eye, speak more for it than those that only the other has
    speak for that."""
    return sum(_alone(a, b) - _alone(b, a) for a, b in zip(one, other, strict=True))


def _alone(one: EdgeSamples, other: EdgeSamples) -> float:
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


def cut_off(solid: Polyhedron, pose: Array, eyes: StereoImages) -> bool:
    """Whether a part at cyclopean_from_part (4, 4) leaves the picture of either eye."""
    most = np.array(eyes.rig.image_size) - 1
    seen = pixels(frames.apply(pose, solid.corners_mm), eyes.geometry)
    return any(bool(((px < 0) | (px > most)).any()) for px in seen)


def ahead_of_sizes(
    solid: Polyhedron, pose: Array, seen: Sequence[EdgeSamples], eyes: StereoImages, tolerance_mm: float
) -> float:
    """By how many nats what both eyes show at a pose (4, 4) speaks more for a part than for the same part longer or
    shorter there, whichever is nearest to it."""
    sizes = in_sizes(solid)
    laid = SolidBatch.of(sizes)
    both = edge_samples_of(laid, eyes, pose[None].repeat(len(sizes), 0), tolerance_mm)
    return min(by_own_edges(seen, [one.only(k, laid) for one in both]) for k in range(len(sizes)))


class UntaughtRival(NamedTuple):
    """By how many nats a near-duplicate fits better than a part, 0 where none does; how it differs, in words."""

    nats: float = 0.0
    how: str = ""


def untaught_rival(solid: Polyhedron, pose: Array, eyes: StereoImages, both: Sequence[EdgePlaces]) -> UntaughtRival:
    """What the edges that only a near-duplicate has speak more for it than those that only the part has speak for that,
    at cyclopean_from_part (4, 4), whichever near-duplicate is ahead; both: what both images show along its edges."""
    others = near_duplicates(solid, pose, eyes, both)
    if not others:
        return UntaughtRival()
    laid = SolidBatch.of([solid, *(one.solid for one in others)])
    poses = pose[None].repeat(len(others) + 1, 0)
    shown = edge_samples_of(laid, eyes, poses, TOLERANCE_MM, BY_OUTLINE_PX)
    own, *theirs = ([seen.only(k, laid) for seen in shown] for k in range(len(others) + 1))
    ahead = [by_own_edges(seen, own) for seen in theirs]
    best = int(np.argmax(ahead))
    return UntaughtRival(ahead[best], others[best].how) if ahead[best] > 0 else UntaughtRival()
