"""What both pictures show of the holes of a part at a pose: rims that are there, rims that are missing, and where; and
taught parts of one shape, and turns of one part, that only holes tell apart.

A hole seen speaks for a part and for the turn of it that has the hole there; one that should be in view and is not
speaks against both. Light, blur and the distance may hide a rim: what is too small in the picture says nothing, and no
rim says more against a part than how seldom one is hidden. A plate with a bore off its middle is another part, or lies
another way, than its outline can say. In: a solid with holes at a pose, or a label at one, both images. Out: nats; the
label and pose whose holes are there, and how clearly.
Source: a contrario evidence of edge samples as of edge_samples.py, on ellipses; for place and radius the square of what
is left in sigmas.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from daemon import frames
from daemon.arrays import Array
from daemon.vision.geometry import Polyhedron, rough_fit
from daemon.vision.image import StereoImages
from daemon.vision.model import Model, correspondences, turns_but_for_holes
from daemon.vision.refine import RimSeen, rims_seen
from daemon.vision.settings import TOLERANCE_MM

BY_RIM, HIDDEN_NATS, MOST_NATS = 0.7, -4.0, 5.0
"""What nats of a rim's edges weigh, and the least and the most they can come to: how seldom light hides a rim that is
there, and how seldom one shows that is not. By 53 rims that are there and 143 that are not in rendered looks; of the
former the least had 9 nats, of the latter the most -6. tests/bench/holes.py makes these and SHOWS again."""


def hole_nats(solid: Polyhedron, pose: Array, images: StereoImages, tolerance_mm: float = TOLERANCE_MM) -> float:
    """Return how many nats more both pictures speak for the holes of a part at cyclopean_from_part (4, 4) than for
    none; 0 where it has none in view."""
    return sum(rim_nats(both) for both in rims_seen(solid, pose, images, tolerance_mm)) if solid.holes else 0.0


def rim_nats(both: list[RimSeen]) -> float:
    """Log likelihood, in nats, that a hole's rim is there and that it has the taught size, over the cameras that have
    the hole in view. Both cameras see one size; a long rim is no surer to be there than a short one."""
    there = min(max(BY_RIM * sum(seen.edge_nats for seen in both), HIDDEN_NATS), MOST_NATS)
    if there <= 0:
        return there
    off = float(np.mean([seen.larger_px / seen.sigma_px for seen in both]))
    return max(there - off**2 / 2, HIDDEN_NATS)


def other_hole_nats(solid: Polyhedron, pose: Array, images: StereoImages, tolerance_mm: float) -> float:
    """Log likelihood ratio, in nats, of another size against the taught one, of the hole of a part at
    cyclopean_from_part (4, 4) that says most, of those whose rims surely are there; 0 where none is."""
    nats = 0.0
    for both in rims_seen(solid, pose, images, tolerance_mm):
        larger = [seen.larger_px / seen.sigma_px for seen in both if seen.sure]
        nats = max(nats, float(np.mean(larger or [0.0])) ** 2 / 2)
    return nats


SAME_MM = 0.5
"""Rms by which corners may differ of shapes that are one but for their holes."""


class ByHoles(NamedTuple):
    """Of all parts and turns of one shape the one whose holes the pictures support most: label, pose (4, 4)
    cyclopean_from_part, nats; apart, by how many nats more than the next label's."""

    label: str
    pose: Array
    nats: float
    apart: float


def by_holes(label: str, pose: Array, model: Model, images: StereoImages) -> ByHoles:
    """Decide by holes what a part at a pose (4, 4) is: that, another turn of it, or another part of its shape."""
    own, best = model.metric[label].solid, dict[str, tuple[float, Array]]()
    labels, solids = tuple(model.metric), tuple(known.solid for known in model.metric.values())
    for k in of_its_size(own, solids):
        other = labels[k]
        motions = motions_onto(own, solids[k]) if own.holes or solids[k].holes else ()  # which holes may distinguish
        there = pose if other == label else next((pose @ one for one in motions), None)
        if there is not None:
            best[other] = turned_by_holes(other, there, model, images)
    ranked = sorted(best, key=lambda name: (-best[name][0], name != label))
    apart = best[ranked[0]][0] - best[ranked[1]][0] if len(ranked) > 1 else np.inf
    nats, turned = best[ranked[0]]
    return ByHoles(ranked[0], turned, nats, float(apart))


def turned_by_holes(label: str, pose: Array, model: Model, images: StereoImages) -> tuple[float, Array]:
    """Return the nats by which pictures speak for the holes of a part in the turn of its shape for which they speak
    most, and that pose; near a pose (4, 4), which it is where none is better."""
    solid = model.metric[label].solid
    if not solid.holes:
        return 0.0, pose
    poses = [pose, *(pose @ turn for turn in turns_but_for_holes(solid)[1:])]
    nats = [hole_nats(solid, one, images, model.parameters.tolerance_mm) for one in poses]
    most = int(np.argmax(nats))
    return nats[most], poses[most]


def of_its_size(one: Polyhedron, solids: tuple[Polyhedron, ...]) -> list[int]:
    """Return which of solids have as many corners and facets as one: others have another shape."""
    return _by_size(solids).get((len(one.corners_mm), len(one.facets)), [])


@lru_cache(maxsize=8)
def _by_size(solids: tuple[Polyhedron, ...]) -> dict[tuple[int, int], list[int]]:
    """The numbers of solids by how many corners and facets they have; made once of all that is taught."""
    found: dict[tuple[int, int], list[int]] = {}
    for number, solid in enumerate(solids):
        found.setdefault((len(solid.corners_mm), len(solid.facets)), []).append(number)
    return found


@lru_cache(maxsize=4096)
def motions_onto(one: Polyhedron, other: Polyhedron) -> Array:
    """(N, 4, 4) one_from_other, the motions that lay a solid on another of the same shape, their holes apart."""
    none = np.zeros((0, 4, 4))
    if len(one.corners_mm) != len(other.corners_mm) or len(one.facets) != len(other.facets):
        return none
    if np.abs(_radii(one) - _radii(other)).max() > 2 * SAME_MM:
        return none
    ways = [way.corners for way in correspondences(one, other) if (way.corners >= 0).all()]
    if not ways:
        return none
    onto = other.corners_mm[np.array(ways)]
    rotation, shift, rms = rough_fit(one.corners_mm, one.covariance_mm2, onto, np.ones(onto.shape[:2], bool))
    good = rms < SAME_MM
    return frames.rigid(rotation[good], shift[good])


def _radii(solid: Polyhedron) -> Array:
    return np.sort(np.linalg.norm(solid.corners_mm - solid.corners_mm.mean(0), axis=1))
