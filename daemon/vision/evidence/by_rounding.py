"""Taught parts of one shape but for how round their corners are: which of them the pictures show.

At a distance a block and one like it with rounded edges have the same facets and edges to a pixel or two; where their
borders stay from the corners tells them apart, and where both are taught with arcs, of what radius all edges together
say these are; or else the look names neither. In: a named part at its pose, both images. Out: the part that its corners
are of, or no name, and which two it may be.
"""

from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from daemon import frames
from daemon.arrays import Array
from daemon.vision.evidence.corner_rounding import Bend, bends, squared, stay_of
from daemon.vision.evidence.hole_rims import motions_onto, of_its_size
from daemon.vision.evidence.other_sizes import other_radius_nats
from daemon.vision.evidence.registered import measure_at, recognised_at
from daemon.vision.geometry import Polyhedron
from daemon.vision.image import StereoImages
from daemon.vision.model import Model, symmetries
from daemon.vision.recognition import Recognised, without_name
from daemon.vision.refine import WORN_MM

LEAST_FACING = 0.25
SAME_PLACE_MM, SAME_WAY, LEAST_GAP_MM, LEAST_GAP_PX = 1.5, 0.97, 0.3, 0.35
"""Of bends of two parts: how far apart they are at most that are at one place, the cosine between their facets; and by
how much the lengths at which their sides end, and the places where a camera should have their borders, differ at
least."""
SPREAD_PX, COMMON_PX, MOST_NATS = 0.12, 0.13, 4.0
"""Standard deviation of the place of a border about those of its look; of all borders of a look together, which are
besides off by as much as corners are worn; and the most that they say for one of two parts, as seldom one is led
astray. By 392 borders in 77 rendered looks, of which 76 tell the part that lay there, one neither (python -m
tests.bench.rounding)."""
APART = 2.2
"""Nats by which the borders must speak for one part more than for any other: nine to one, as a name by facets needs."""


class BorderSeen(NamedTuple):
    """A camera's view of one corner at which two parts differ: where it has the border, and where it should have it of
    either part, px from where the sides meet; gap_mm: by how much these are apart on the parts."""

    seen_px: float
    one_px: float
    other_px: float
    gap_mm: float

    @property
    def gap_px(self) -> float:
        """Return by how many px the other part's border is farther in."""
        return self.other_px - self.one_px

    @property
    def share(self) -> float:
        """Return where between the two the border is: 0, at the one's; 1, at the other's."""
        return (self.seen_px - self.one_px) / self.gap_px


def nats_of(borders: list[BorderSeen]) -> float:
    """Return the log likelihood ratio of the one part against the other by borders; 0 where none is seen."""
    if not borders:
        return 0.0
    gap_px, gap_mm, share = (
        np.array(each) for each in zip(*((b.gap_px, b.gap_mm, b.share) for b in borders), strict=True)
    )
    weight = gap_px**2
    order = np.argsort(share)
    upto = np.cumsum(weight[order])
    middle = float(np.interp(upto[-1] / 2, upto - weight[order] / 2, share[order]))  # their weighted median
    usual = float(np.sqrt(np.average(gap_mm**2, weights=weight)))
    together = float(np.abs(gap_px).sum()) / float(weight.sum())  # of the share, for each px that all are off by
    variance = (WORN_MM / usual) ** 2 + (COMMON_PX * together) ** 2 + SPREAD_PX**2 / float(weight.sum())
    return float(np.clip((0.5 - middle) / variance, -MOST_NATS, MOST_NATS))


def borders_seen(
    one: Polyhedron, other: Polyhedron, one_from_other: Array, pose: Array, images: StereoImages
) -> list[BorderSeen]:
    """Measure what both cameras show where two parts differ in how round a corner is, at cyclopean_from_one (4, 4)."""
    found = []
    for own, theirs in _differing(one, other, one_from_other):
        round_one = own.tangent_mm > theirs.tangent_mm
        bend, solid = (own, one) if round_one else (theirs, other)
        there = pose if round_one else pose @ one_from_other
        for view, viewpoint_mm in zip(images.views, images.geometry.cameras_mm, strict=True):
            if solid.facing(there, viewpoint_mm)[bend.facet] < LEAST_FACING:
                continue
            seen = stay_of(solid, bend, bend.tangent_mm, there, view, viewpoint_mm)
            if seen is None:
                continue
            camera = view.rectified.camera
            px = camera.project(frames.apply(there, bend.corner_mm[None]))
            one_px, other_px = (
                seen.expected_px(camera.project(frames.apply(there, bend.curve_mm(each.tangent_mm))) - px)
                for each in (own, theirs)
            )
            border = BorderSeen(seen.seen_px, one_px, other_px, abs(own.stay_mm - theirs.stay_mm))
            if abs(border.gap_px) > LEAST_GAP_PX:
                found.append(border)
    return found


def _differing(one: Polyhedron, other: Polyhedron, one_from_other: Array) -> Iterator[tuple[Bend, Bend]]:
    """Bends of two parts at one place, differently round."""
    there = bends(other)
    places = frames.apply(one_from_other, np.array([bend.corner_mm for bend in there]).reshape(-1, 3))
    normals = other.normals[[bend.facet for bend in there]] @ one_from_other[:3, :3].T
    for own in bends(one):
        near = np.linalg.norm(places - own.corner_mm, axis=1) < SAME_PLACE_MM
        for k in np.flatnonzero(near & (normals @ one.normals[own.facet] > SAME_WAY)).tolist():
            if abs(there[k].tangent_mm - own.tangent_mm) > LEAST_GAP_MM:
                yield own, there[k]


class _Competitor(NamedTuple):
    """A part of the same shape but for its corners: its label, its pose (4, 4), and the nats by which the borders speak
    more for it than for the part that was named."""

    label: str
    pose: Array
    nats: float


def resolved_by_rounding(one: Recognised, model: Model, images: StereoImages) -> Recognised:
    """Rename a part to the taught part of its shape whose corner radii the images show; without a name if they do not
    tell."""
    pose, competing, rounder = one.part.cyclopean_from_part, list[_Competitor](), list[str]()
    labels, solids = tuple(model.metric), tuple(known.solid for known in model.metric.values())
    own = model.metric[one.label].solid
    for k in of_its_size(squared(own), _squared(solids)):
        label, solid = labels[k], solids[k]
        if solid is own:
            continue
        motions = rounded_alike(own, solid)
        rounder += [label] if len(motions) and _roundings_mm(solid) > _roundings_mm(own) else []
        borders = [borders_seen(own, solid, motion, pose, images) for motion in motions]
        by_borders, by_arcs = [-nats_of(seen) for seen in borders], 0.0
        round_ = own.circles.any() and solid.circles.any()
        if round_ and any(abs(nats) <= APART for nats in by_borders):
            there = pose @ min(motions, key=lambda motion: _arcs_apart_mm(own, solid, motion))
            by_arcs = _arcs_nats(own, pose, images, model) - _arcs_nats(solid, there, images, model)
        for motion, seen, nats in zip(motions, borders, by_borders, strict=True):
            if seen or abs(by_arcs) > APART:
                competing.append(_Competitor(label, pose @ motion, nats + by_arcs))
    if not competing and rounder:  # a sharp facet is found in a rounded one, and not the other way round
        why = f"may be {one.label} or {rounder[0]}: no visible corner distinguishes them"
        return without_name(one, why, one.part.recognition.confidence / 2, model)
    if not competing:
        return one
    ahead = max(competing, key=lambda competitor: competitor.nats)
    if ahead.nats < -APART:
        return one
    others = [r.nats for r in competing if r.label != ahead.label]
    if ahead.nats > APART and ahead.nats - max(others, default=-np.inf) > APART:
        return _renamed(one, ahead, model, images)
    why = f"may be {one.label} or {ahead.label}: their corner radii do not distinguish them"
    return without_name(one, why, one.part.recognition.confidence / (1 + float(np.exp(ahead.nats))), model)


def _arcs_apart_mm(one: Polyhedron, other: Polyhedron, one_from_other: Array) -> float:
    """Return how far apart the arcs of two solids lie, where a motion lays one on the other."""
    own, theirs = (solid.circles[solid.circles[:, 3] > 0, :3] for solid in (one, other))
    return float(np.linalg.norm(frames.apply(one_from_other, theirs)[:, None] - own, axis=2).min(1).max())


def _arcs_nats(solid: Polyhedron, pose: Array, images: StereoImages, model: Model) -> float:
    """Nats, MOST_NATS at most, by which the edges of a part near a pose (4, 4) speak for another radius of its arcs."""
    measured, tolerance = measure_at(solid, pose, images, model), model.parameters.tolerance_mm
    return min(other_radius_nats(solid, measured.fit.cyclopean_from_part, measured.edges, tolerance), MOST_NATS)


def _roundings_mm(solid: Polyhedron) -> float:
    """Return how round a part's corners are, all together."""
    return sum(bend.tangent_mm for bend in bends(solid))


@lru_cache(maxsize=4)
def any_rounded(model: Model) -> bool:
    """Whether a part was taught that has rounded corners."""
    return any(squared(known.solid) is not known.solid for known in model.metric.values())


@lru_cache(maxsize=4)
def _squared(solids: tuple[Polyhedron, ...]) -> tuple[Polyhedron, ...]:
    """All that is taught with its corners sharp."""
    return tuple(map(squared, solids))


def rounded_alike(one: Polyhedron, other: Polyhedron) -> Array:
    """(N, 4, 4) one_from_other, the motions that lay a part on another of the same shape, as either of them has rounded
    corners."""
    sharp = squared(one), squared(other)
    if sharp == (one, other):
        return np.zeros((0, 4, 4))
    return motions_onto(*sharp)


def _renamed(one: Recognised, competitor: _Competitor, model: Model, images: StereoImages) -> Recognised:
    """The part of which the corners are, where its edges have it."""
    solid = model.metric[competitor.label].solid
    measured = measure_at(solid, competitor.pose, images, model)
    if not measured.numbers:
        return without_name(one, f"may be {one.label} or {competitor.label}", one.part.recognition.confidence, model)
    verdict, pose = one.part.recognition, measured.fit.cyclopean_from_part
    name = replace(
        verdict,
        label=competitor.label,
        runner_up=one.label,
        confidence=verdict.confidence / (1 + float(np.exp(-competitor.nats))),
        candidates=(competitor.label,),
        reason=f"{verdict.reason}; its corners are as round as those of {competitor.label}",
    )
    equivalents = np.asarray(pose @ symmetries(solid).motions)
    return recognised_at(solid, measured, name, pose, measured.fit.covariance, equivalents)
