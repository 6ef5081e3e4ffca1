"""Taught parts of one shape, and turns of one part, that only holes tell apart: which of them the pictures support.

A plate with a bore off its middle is another part, or lies another way, than its outline can say. In: a label at a pose
that edges or facets support, both images. Out: the label and pose whose holes are there, and how clearly.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from daemon import frames
from daemon.arrays import Array
from daemon.vision.evidence.hole_rims import hole_nats
from daemon.vision.geometry import Polyhedron, rough_fit
from daemon.vision.image import StereoImages
from daemon.vision.model import Model, correspondences, turns_but_for_holes

SAME_MM = 0.5
"""Rms by which corners may differ of shapes that are one but for their holes."""


class ByHoles(NamedTuple):
    """Of all parts and turns of one shape the one whose holes the pictures support most: label, pose (4, 4)
    cyclopean_from_part, nats; apart, by how many nats more than the next label's."""

    label: str
    pose: Array
    nats: float
    apart: float


def by_holes(label: str, pose: Array, model: Model, eyes: StereoImages) -> ByHoles:
    """What holes say of a part at a pose (4, 4): it is that, another turn of it, or another part of its shape."""
    own, best = model.metric[label].solid, dict[str, tuple[float, Array]]()
    labels, solids = tuple(model.metric), tuple(known.solid for known in model.metric.values())
    for k in of_its_size(own, solids):
        other = labels[k]
        there = pose if other == label else next((pose @ one for one in _motions(own, solids[k])), None)
        if there is not None:
            best[other] = turned_by_holes(other, there, model, eyes)
    ranked = sorted(best, key=lambda name: (-best[name][0], name != label))
    apart = best[ranked[0]][0] - best[ranked[1]][0] if len(ranked) > 1 else np.inf
    nats, turned = best[ranked[0]]
    return ByHoles(ranked[0], turned, nats, float(apart))


def turned_by_holes(label: str, pose: Array, model: Model, eyes: StereoImages) -> tuple[float, Array]:
    """What pictures speak for the holes of a part in the turn of its shape for which they speak most, and that pose;
    near a pose (4, 4), which it is where none is better."""
    solid = model.metric[label].solid
    if not solid.holes:
        return 0.0, pose
    poses = [pose, *(pose @ turn for turn in turns_but_for_holes(solid)[1:])]
    nats = [hole_nats(solid, one, eyes, model.parameters.tolerance_mm) for one in poses]
    most = int(np.argmax(nats))
    return nats[most], poses[most]


def of_its_size(one: Polyhedron, solids: tuple[Polyhedron, ...]) -> list[int]:
    """Which of solids have as many corners and facets as one: others have another shape."""
    return _by_size(solids).get((len(one.corners_mm), len(one.facets)), [])


@lru_cache(maxsize=8)
def _by_size(solids: tuple[Polyhedron, ...]) -> dict[tuple[int, int], list[int]]:
    """The numbers of solids by how many corners and facets they have; made once of all that is taught."""
    found: dict[tuple[int, int], list[int]] = {}
    for number, solid in enumerate(solids):
        found.setdefault((len(solid.corners_mm), len(solid.facets)), []).append(number)
    return found


def _motions(one: Polyhedron, other: Polyhedron) -> Array:
    """(N, 4, 4) one_from_other, as motions_onto, of solids that holes may tell apart."""
    return motions_onto(one, other) if one.holes or other.holes else np.zeros((0, 4, 4))


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
