"""A taught part laid onto both images: its pose moved until its edges lie on the grey levels' edges.

In: a metric model, a pose near the truth, both eyes. Out: the better pose and which of its facets the images confirm.
Whether that is enough for a name is not decided here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from daemon import frames
from daemon.vision.epipolar import Baseline
from daemon.vision.eye import Sight
from daemon.vision.relation import Solid
from daemon.vision.shapes import corners_of
from daemon.vision.sides import Sides, fit_sides

Array = NDArray[np.float64]
Index = NDArray[np.intp]
Edge = tuple[int, int]

ROUNDS = 2  # move the pose, measure the edges anew, and again
MODEL_MM = 0.25  # how well a taught corner is known: in pixels the least an edge may be off
TUKEY = 4.0
NEAR = 1.4  # an edge is on its place within so many times the model's doubt
LEAST_SUPPORT = 0.5
LEAST_EVIDENCE = 6.0
FAINT = 0.1  # an edge this much fainter than the strongest is taken for grain
LEAST_SHARE = 0.65  # of a facet's sides, in both eyes together
FOUND_PX = 0.15  # how sure a corner is whose two sides were found


@dataclass(frozen=True, eq=False)
class Aligned:
    """pose (4, 4) cyclopean_from_part; facets: which of the model's visible facets the images confirm; outlines: for

    each of those its corners (N, 2) px in the left and right eye, where its sides were found to meet, and how sure a
    corner is there, (N,) px.
    """

    pose: Array
    facets: tuple[int, ...]
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

    solid: Solid
    visible: tuple[int, ...]
    pose: Array


def showing(placements: Sequence[Placement], geometry: Baseline, eyes: tuple[Sight, Sight]) -> list[Placement]:
    """Those placements of which two facets at least have an image edge near each of their sides. All tried at once."""
    if not placements:
        return []
    edges = [_edges(p.solid, p.visible) for p in placements]
    first = np.cumsum([0, *(len(e) for e in edges)])
    shows = []
    for eye, sight in enumerate(eyes):
        ends = [_ends(_project(p, geometry, eye)[0], e) for p, e in zip(placements, edges, strict=True)]
        start_px, end_px = np.concatenate(ends, axis=1)
        sides = fit_sides(sight.image, sight.noise, start_px, end_px, sight.eye)
        shows.append(_shows(sides, first))
    kept = []
    for place, own, start, end in zip(placements, edges, first[:-1], first[1:], strict=True):
        good = np.stack([s[start:end] for s in shows])
        if sum(_confirmed(place.solid, f, own, good) for f in place.visible) > 1:
            kept.append(place)
    return kept


def align(place: Placement, geometry: Baseline, eyes: tuple[Sight, Sight]) -> Aligned:
    """Move a placement so that the visible facets' edges meet the image edges, and see which facets do.

    It must be near enough that most edges are within some two pixels. Source: Gauss-Newton on the distances of the
    edges' ends across the edges, with Tukey's weights because some edges find another one nearby.
    """
    solid, edges = place.solid, _edges(place.solid, place.visible)
    readings = [_read(place, edges, geometry, sight, k) for k, sight in enumerate(eyes)]
    for _ in range(ROUNDS):
        place = replace(place, pose=frames.perturb(place.pose, _motion(readings)))
        readings = [_read(place, edges, geometry, sight, k) for k, sight in enumerate(eyes)]
    good = np.stack([_shows(r.sides, np.array([0, len(edges)])) & _on_place(r) for r in readings])
    confirmed = tuple(f for f in place.visible if _confirmed(solid, f, edges, good))
    outlines = tuple(
        (*_outline(solid, f, edges, readings[0], good[0]), *_outline(solid, f, edges, readings[1], good[1]))
        for f in confirmed
    )
    return Aligned(place.pose, confirmed, outlines)


def _edges(solid: Solid, visible: tuple[int, ...]) -> list[Edge]:
    """Every edge of the visible facets once, as one of its facets runs through it."""
    edges: dict[frozenset[int], Edge] = {}
    for f in visible:
        ring = solid.facets[f]
        for a, b in zip(ring, (*ring[1:], ring[0]), strict=True):
            edges.setdefault(frozenset((a, b)), (a, b))
    return list(edges.values())


def _ends(px: Array, edges: list[Edge]) -> Array:
    """(2, E, 2) px: where each edge starts and ends."""
    return np.asarray(px[np.array(edges).T])


def _read(place: Placement, edges: list[Edge], geometry: Baseline, sight: Sight, eye: int) -> _Reading:
    px, slope = _project(place, geometry, eye)
    a, b = np.array(edges).T
    sides = fit_sides(sight.image, sight.noise, px[a], px[b], sight.eye)
    chord = px[b] - px[a]
    across = np.stack([chord[:, 1], -chord[:, 0]], 1) / np.maximum(np.hypot(*chord.T), 1e-6)[:, None]
    off = np.stack([((sides.start - px[a]) * across).sum(1), ((sides.end - px[b]) * across).sum(1)], 1)
    jacobian = np.stack([np.einsum("ei,eij->ej", across, slope[k]) for k in (a, b)], 1)
    doubt_px = MODEL_MM * sight.eye.focal_px / float(frames.apply(place.pose, place.solid.corners_mm)[:, 2].mean())
    weight = np.linalg.inv(sides.covariance + doubt_px**2 * np.eye(2))
    return _Reading(np.stack([px[a], px[b]], 1), off, jacobian, np.asarray(weight), sides, doubt_px)


def _project(place: Placement, geometry: Baseline, eye: int) -> tuple[Array, Array]:
    """Corners (K, 2) px in one eye, and their derivative (K, 2, 6) by a motion of the pose."""
    one = geometry.right if eye else geometry.left
    steps = np.concatenate([np.zeros((1, 6)), np.diag([0.1] * 3 + [1e-3] * 3)])
    points = np.concatenate([frames.apply(frames.perturb(place.pose, s), place.solid.corners_mm) for s in steps])
    px = one.pixels(geometry.project(points)[eye]).reshape(7, -1, 2)
    slope = (px[1:] - px[0]) / np.array([0.1] * 3 + [1e-3] * 3)[:, None, None]
    return px[0], np.moveaxis(slope, 0, 2)


def _motion(readings: list[_Reading]) -> Array:
    """The motion (6,) that brings the pose onto the edges, robustly."""
    off = np.concatenate([r.off for r in readings])
    jacobian = np.concatenate([r.jacobian for r in readings])
    weight = np.concatenate([r.weight for r in readings])
    usable = np.concatenate([r.sides.evidence > LEAST_EVIDENCE for r in readings]).astype(float)
    motion = np.zeros(6)
    trust = usable
    for _ in range(4):
        weighted = weight * trust[:, None, None]
        normal = np.einsum("eai,eab,ebj->ij", jacobian, weighted, jacobian) + 1e-6 * np.eye(6)
        motion = np.linalg.solve(normal, np.einsum("eai,eab,eb->i", jacobian, weighted, off))
        left = off - jacobian @ motion
        miss = np.einsum("ei,eij,ej->e", left, weight, left)
        trust = usable * np.maximum(1 - miss / TUKEY**2, 0.0) ** 2 + 1e-6
    return np.asarray(motion)


def _shows(sides: Sides, first: Index) -> NDArray[np.bool_]:
    """(E,) whether there is an edge near, and not something much fainter than the same part's other edges.

    first: where each part's edges begin, and the end.
    """
    strongest = np.repeat(np.maximum.reduceat(sides.evidence, first[:-1]), np.diff(first))
    faintest = np.maximum(LEAST_EVIDENCE, FAINT * strongest)
    return np.asarray((sides.evidence > faintest) & (sides.support > LEAST_SUPPORT))


def _on_place(reading: _Reading) -> NDArray[np.bool_]:
    """(E,) whether an edge was found where it should be."""
    return np.asarray(np.abs(reading.off).max(1) < NEAR * reading.doubt_px)


def _confirmed(solid: Solid, facet: int, edges: list[Edge], good: NDArray[np.bool_]) -> bool:
    """Whether every side of a facet is good in one eye at least, and most are in both."""
    own = good[:, _sides_of(solid, facet, edges)[0]]
    return bool(own.any(0).all()) and float(own.mean()) >= LEAST_SHARE


def _sides_of(solid: Solid, facet: int, edges: list[Edge]) -> tuple[list[int], list[bool]]:
    """Which edge each side of a facet is, and whether it runs the other way there."""
    ring = solid.facets[facet]
    at = {edge: k for k, edge in enumerate(edges)}
    pairs = list(zip(ring, (*ring[1:], ring[0]), strict=True))
    return [at[p] if p in at else at[p[::-1]] for p in pairs], [p not in at for p in pairs]


def _outline(
    solid: Solid, facet: int, edges: list[Edge], reading: _Reading, good: NDArray[np.bool_]
) -> tuple[Array, Array]:
    """Corners (N, 2) px where the sides meet, and their doubt (N,) px; a side not found stays where expected."""
    which, turned = _sides_of(solid, facet, edges)
    found = good[which]
    start = np.where(found[:, None], reading.sides.start[which], reading.expected[which, 0])
    end = np.where(found[:, None], reading.sides.end[which], reading.expected[which, 1])
    back = np.array(turned)[:, None]
    start, end = np.where(back, end, start), np.where(back, start, end)
    doubt = np.where(found & np.roll(found, 1), FOUND_PX, reading.doubt_px + FOUND_PX)
    return corners_of(start, end), doubt
