"""Which of two parts at one place the images support: taught ones, and mirror images that nobody taught; and whether
the length of a part that leaves the image is proven.

In: what both parts show, edge sample by edge sample. Out: nats. Edges that both parts have decide nothing. A part of
which one face shows has few edges, all of them another part's; a part with one edge more, which is there, is the
likelier one, however much the others weigh in either. Where all edges along a part leave the image, longer and shorter
parts fit as well, and no name is proven; an edge that ends in view, or an end of the part that does, gives the length.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from daemon import frames
from daemon.arrays import Array
from daemon.vision.geometry import Polyhedron, exact
from daemon.vision.hypotheses import in_sizes, pixels
from daemon.vision.image import StereoImages
from daemon.vision.model import mirror_images
from daemon.vision.refine import EdgeSamples, ShapeBatch, edge_samples_of
from daemon.vision.settings import TOLERANCE_MM

ALONG = np.cos(np.radians(12.0))  # an edge that lies on another one points so nearly the same way
SAME_PX = 2.0  # an edge no farther off shows by the same slopes
PLACES = (np.arange(8) + 0.5) / 8
LEAST_APART = 1.5
"""Nats by which the edges that a part alone has must speak more for it than those that only another part, laid on the
same place, has speak for that: less leaves the name open, however little the other would be believed. Of 99 names that
edges give parts with twins that differ in a side this leaves 89 right and one wrong; of 184 without twins 182."""


MIRRORED = 2
"""Mirror images that are held against a part. With one five of twelve near twins that kept their names are told, with
two seven, with twelve no more."""
FLAT_MM = 1.0
"""Of the singular values of a rim's corners about their plane, what is none."""


def by_own_edges(one: Sequence[EdgeSamples], other: Sequence[EdgeSamples]) -> float:
    """By how many nats the edges that only one has, in either eye, speak more for it than those that only the other has
    speak for that."""
    return sum(_alone(a, b) - _alone(b, a) for a, b in zip(one, other, strict=True))


def _alone(one: EdgeSamples, other: EdgeSamples) -> float:
    """Nats of the edges of one, as far as none of the other lies there."""
    edges, others = one.edges, other.edges
    way, along = (each.end - each.start for each in (edges, others))
    way_unit, unit = (each / np.linalg.norm(each, axis=1)[:, None] for each in (way, along))
    at = edges.start[:, None] + PLACES[:, None] * way[:, None]
    away = at[:, :, None] - others.start
    ahead, aside = (away * unit).sum(3), away[..., 0] * unit[:, 1] - away[..., 1] * unit[:, 0]
    on = (ahead > -SAME_PX) & (ahead < others.lengths_px + SAME_PX) & (np.abs(aside) < SAME_PX)
    shared = (on & (np.abs(way_unit @ unit.T) > ALONG)[:, None]).any(2).mean(1)
    return float((1 - shared) @ one.nats)


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
    laid = ShapeBatch.of(sizes)
    both = edge_samples_of(laid, eyes, pose[None].repeat(len(sizes), 0), tolerance_mm)
    return min(by_own_edges(seen, [one.only(k, laid) for one in both]) for k in range(len(sizes)))


@lru_cache(maxsize=256)
def inverted_corners(solid: Polyhedron) -> tuple[Polyhedron, ...]:
    """A solid with the tip of each pyramid on it sunk as far as it was raised, or raised as far as it was sunk."""
    found = list[Polyhedron]()
    for corner in range(len(solid.corners_mm)):
        own = [ring for ring in solid.facets if corner in ring]
        rim = sorted({k for ring in own for k in ring} - {corner})
        if (
            any(len(ring) > 3 for ring in own)
            or len(own) != len(rim)
            or any(set(ring) == set(rim) for ring in solid.facets)
        ):
            continue
        middle = solid.corners_mm[rim].mean(0)
        _, sizes, ways = np.linalg.svd(solid.corners_mm[rim] - middle)
        if sizes[2] < FLAT_MM:
            moved = solid.corners_mm.copy()
            moved[corner] -= 2 * ((moved[corner] - middle) @ ways[2]) * ways[2]
            found.append(exact(moved, solid.facets))
    return tuple(found)


def untaught_rival(solid: Polyhedron, pose: Array, eyes: StereoImages) -> float:
    """By how many nats the edges that only a look-alike has, its mirror image or one with a tip the other way, speak
    more for it than those speak for a part at cyclopean_from_part (4, 4) that only that has, whichever look-alike is
    nearest to it; 0 where none is. A mirror image lies where it keeps most of what the left camera sees of the part.
    """
    shown_mm2 = np.maximum(solid.facing(pose, eyes.geometry.eyes_mm[0]), 0.0) * np.linalg.norm(solid.areas_mm2, axis=1)
    mirrored = sorted(mirror_images(solid), key=lambda one: -float(shown_mm2 @ one.kept))[:MIRRORED]
    shapes = [solid, *(one.solid for one in mirrored if shown_mm2 @ one.kept > 0), *inverted_corners(solid)]
    if len(shapes) == 1:
        return 0.0
    laid = ShapeBatch.of(shapes)
    both = edge_samples_of(laid, eyes, pose[None].repeat(len(shapes), 0), TOLERANCE_MM)
    own, *others = ([seen.only(k, laid) for seen in both] for k in range(len(shapes)))
    return max(0.0, *(by_own_edges(other, own) for other in others))
