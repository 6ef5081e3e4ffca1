"""A taught part laid onto both images: its pose moved until its edges lie on the grey levels' edges.

In: a metric model, a pose near the truth, both eyes. Out: the better pose and which of its facets the images confirm.
Whether that is enough for a name is not decided here.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from daemon import frames
from daemon.vision.geometry.polyhedron import Polyhedron
from daemon.vision.geometry.rectified import Baseline
from daemon.vision.image.edge_lines import Sides, edge_sigmas, fit_sides
from daemon.vision.image.one_eye import OneEye
from daemon.vision.registration.pose_step import across, corners_in, off_places, solve

Array = NDArray[np.float64]
Edge = tuple[int, int]

HOPELESS_PX, LEAST_SHARE = 2.5, 0.4  # moved twice, an edge is this near, of so much of their length; or all is wrong
ROUNDS = 2  # move the pose, measure the edges anew, and again
MODEL_MM = 0.25  # how well a taught corner is known: in pixels the least an edge may be off
TUKEY, PASSES = 4.0, 4
HARDLY = 1e-6  # what keeps a motion finite that nothing holds
NEAR = 2.3  # an edge is on its place within so many times the model's doubt
LEAST_SUPPORT = 0.5
LEAST_EVIDENCE = 6.0
LEAST_SIGMAS = 4.0  # of the slope across an edge against what lies beside it
FOUND_PX = 0.1  # how sure a side that was found is, at best


@dataclass(frozen=True, eq=False)
class Aligned:
    """pose (4, 4) cyclopean_from_part; facets: which of the model's visible facets the images confirm; share: of the

    length of all edges that should be seen, in both eyes, what was found on its place; outlines: for each of the
    facets its corners (N, 2) px in the left eye, their covariance (N, 2, 2), and the same in the right.
    """

    pose: Array
    facets: tuple[int, ...]
    share: float
    outlines: tuple[tuple[Array, Array, Array, Array], ...]


@dataclass(frozen=True, eq=False)
class _Reading:
    """Edges of one eye against the pose: expected ends (E, 2, 2) px; off (E, 2) px how far they were found across the

    edge; its jacobian (E, 2, 6) and weight (E, 2, 2); the sides as found; what the model leaves open, px.
    """

    expected: Array
    off: Array
    jacobian: Array
    weight: Array
    sides: Sides
    doubt_px: float


@dataclass(frozen=True, eq=False)
class Placement:
    """A solid somewhere in space: which of its facets are in view there, and its pose, cyclopean_from_part (4, 4)."""

    solid: Polyhedron
    visible: tuple[int, ...]
    pose: Array


def align(place: Placement, geometry: Baseline, eyes: tuple[OneEye, OneEye]) -> Aligned:
    """Move a placement so that the visible facets' edges meet the image edges, and see which facets do.

    It must be near enough that most edges are within some two pixels.
    """
    solid, edges = place.solid, _edges(place.solid, place.visible)
    for _ in range(ROUNDS):
        rough = [_read(place, edges, geometry, sight, k, roughly=True) for k, sight in enumerate(eyes)]
        place = replace(place, pose=frames.perturb(place.pose, _motion(rough)))
    if _share([_shows(r.sides) & (np.abs(r.off).max(1) < HOPELESS_PX) for r in rough], rough) < LEAST_SHARE:
        return Aligned(place.pose, (), 0.0, ())
    fine = [_read(place, edges, geometry, sight, k) for k, sight in enumerate(eyes)]
    place = replace(place, pose=frames.perturb(place.pose, _motion(fine)))
    readings = [_read(place, edges, geometry, sight, k) for k, sight in enumerate(eyes)]
    good = np.stack([_good(r, sight) for r, sight in zip(readings, eyes, strict=True)])
    confirmed = tuple(f for f in place.visible if _confirmed(solid, f, edges, good))
    outlines = tuple(
        (*_outline(solid, f, edges, readings[0], good[0]), *_outline(solid, f, edges, readings[1], good[1]))
        for f in confirmed
    )
    return Aligned(place.pose, confirmed, _share(list(good), readings), outlines)


def _share(good: list[NDArray[np.bool_]], readings: list[_Reading]) -> float:
    """Of the length of all edges in both eyes, that of the good ones."""
    lengths = np.stack([np.hypot(*(r.expected[:, 1] - r.expected[:, 0]).T) for r in readings])
    return float((lengths * np.stack(good)).sum() / lengths.sum())


def _edges(solid: Polyhedron, visible: tuple[int, ...]) -> list[Edge]:
    """Every edge of the visible facets once, as one of its facets runs through it."""
    edges: dict[frozenset[int], Edge] = {}
    for f in visible:
        ring = solid.facets[f]
        for a, b in zip(ring, (*ring[1:], ring[0]), strict=True):
            edges.setdefault(frozenset((a, b)), (a, b))
    return list(edges.values())


def _read(
    place: Placement, edges: list[Edge], geometry: Baseline, sight: OneEye, eye: int, *, roughly: bool = False
) -> _Reading:
    camera = (geometry.right if eye else geometry.left).camera
    px, slope = corners_in(camera, place.pose, place.solid.corners_mm)
    a, b = np.array(edges).T
    sides = fit_sides(sight.image, sight.noise, px[a], px[b], sight.eye, roughly=roughly)
    normal = across(px[a], px[b])[:, None]
    jacobian = np.stack([(normal @ slope[k])[:, 0] for k in (a, b)], 1)
    doubt_px = MODEL_MM * sight.eye.focal_px / float(frames.apply(place.pose, place.solid.corners_mm)[:, 2].mean())
    weight = np.linalg.inv(sides.covariance + doubt_px**2 * np.eye(2))
    off = off_places(px[a], px[b], sides.start, sides.end)
    return _Reading(np.stack([px[a], px[b]], 1), off, jacobian, np.asarray(weight), sides, doubt_px)


def _motion(readings: list[_Reading]) -> Array:
    """The motion (6,) that brings the pose onto the edges, robustly."""
    off, jacobian, weight = (np.concatenate([getattr(r, n) for r in readings]) for n in ("off", "jacobian", "weight"))
    usable = np.concatenate([r.sides.evidence > LEAST_EVIDENCE for r in readings]).astype(float)
    return solve(off, jacobian, weight, usable, HARDLY * np.eye(6), TUKEY, PASSES, HARDLY).motion


def _shows(sides: Sides) -> NDArray[np.bool_]:
    """(E,) whether there is an edge near."""
    return np.asarray((sides.evidence > LEAST_EVIDENCE) & (sides.support > LEAST_SUPPORT))


def _good(reading: _Reading, sight: OneEye) -> NDArray[np.bool_]:
    """(E,) whether an edge was found on its place, and stands out from the shading and the grain beside it."""
    clear = edge_sigmas(sight.smooth, reading.sides.start, reading.sides.end) > LEAST_SIGMAS
    return _shows(reading.sides) & _on_place(reading) & clear


def _on_place(reading: _Reading) -> NDArray[np.bool_]:
    """(E,) whether an edge was found where it should be."""
    return np.asarray(np.abs(reading.off).max(1) < NEAR * reading.doubt_px)


def _confirmed(solid: Polyhedron, facet: int, edges: list[Edge], good: NDArray[np.bool_]) -> bool:
    """Whether every side of a facet is good in one eye at least, and all but one in each.

    good (2, E). Sides along the baseline look right at any depth: one eye alone must not place a facet.
    """
    own = good[:, _sides_of(solid, facet, edges)[0]]
    return bool(own.any(0).all()) and int(own.sum(1).min()) >= own.shape[1] - 1


def _sides_of(solid: Polyhedron, facet: int, edges: list[Edge]) -> tuple[list[int], list[bool]]:
    """Which edge each side of a facet is, and whether it runs the other way there."""
    ring = solid.facets[facet]
    at = {edge: k for k, edge in enumerate(edges)}
    pairs = list(zip(ring, (*ring[1:], ring[0]), strict=True))
    return [at[p] if p in at else at[p[::-1]] for p in pairs], [p not in at for p in pairs]


def _outline(
    solid: Polyhedron, facet: int, edges: list[Edge], reading: _Reading, good: NDArray[np.bool_]
) -> tuple[Array, Array]:
    """Most likely corners (N, 2) px given the model and the sides that were found, and their covariance (N, 2, 2)."""
    which, backwards = _sides_of(solid, facet, edges)
    sides = reading.sides.chosen(np.array(which), np.array(backwards))
    turned = np.array(backwards)[:, None]
    expected = np.where(turned, reading.expected[which, 1], reading.expected[which, 0])
    normal = across(sides.start, sides.end)
    place = np.sum(normal * sides.start, 1)
    firm = good[which, None] / (sides.covariance[:, (0, 1), (0, 1)] + FOUND_PX**2)
    information = np.eye(2) / reading.doubt_px**2 + np.zeros((len(which), 1, 1))
    pull = expected / reading.doubt_px**2
    for weight, n, d in (
        (firm[:, 0], normal, place),
        (np.roll(firm[:, 1], 1), np.roll(normal, 1, 0), np.roll(place, 1)),
    ):
        information = information + weight[:, None, None] * n[:, :, None] * n[:, None, :]
        pull = pull + (weight * d)[:, None] * n
    covariance = np.asarray(np.linalg.inv(information), float)
    return (covariance @ pull[..., None])[..., 0], covariance
