"""A known part's edges laid onto both images: its pose from grey levels, where facets alone are not told apart.

Two faces in the same light melt into one outline, and no facet is found; whoever knows the part and about where it
lies knows which edges each eye should see, and measures those. Pure: images, a shape and a near pose in, a pose out.
Naming is not done here, and what to make of a part that is not there is the cycle's business.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from daemon import frames
from daemon.vision.geometry.polyhedron import Polyhedron
from daemon.vision.geometry.rectified import Eye, baseline
from daemon.vision.geometry.rig import StereoRig
from daemon.vision.image.edge_lines import find_sides, fit_sides, probe_sides
from daemon.vision.image.grey import Noise, measure_noise
from daemon.vision.registration.corner_pose import Fit
from daemon.vision.registration.pose_step import Solved, across, corners_in, off_places, solve

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

SHAPE_MM = 0.25
"""How well a taught edge is known, at its ends and across it."""
THIN_PX = (-3.0, 6.0)
"""A facet this thin in the image (negative: just turned away) has edges that may be taken for one another."""
ROOM_PX, LEAST_LENGTH_PX = 6.0, 12.0
SMOOTHING_PX = 1.0
ROUGHLY = (1.0, 0.4)
"""Shares of the reach within which edges are searched for, round by round."""
MOST_ROUNDS, SMALL_MM = 5, 0.3
"""How often edges are measured anew, and a motion after which that would change nothing more."""
SEARCH_DEG = 3.0
LEAST_EVIDENCE, LEAST_SUPPORT = 6.0, 0.5
TUKEY, PASSES = 5.6, 5
LEAST_SHARE = 0.75
"""Of the length of the outline that an eye should see, what it must show on its place."""
ON_PLACE = 2.0
"""An edge is on its place within so many times what the shape leaves open."""
SAFE_CONDITION = 1e7
SCALE = np.array([1.0, 1.0, 1.0, 0.03, 0.03, 0.03])
"""Turns are weighed at a lever of some 30 mm, so that mm and rad compare."""


@dataclass(frozen=True, eq=False)
class Eyed:
    """One eye's image made ready: grey levels as they are, and smoothed with a noise of one everywhere."""

    eye: Eye
    grey: NDArray[np.float32]
    smooth: NDArray[np.float32]
    noise: Noise


Eyes = tuple[Eyed, Eyed]
"""Both eyes of one look, left and right."""


@dataclass(frozen=True, eq=False)
class _Edges:
    """Edges one eye should see with the part at a pose: start, end (E, 2) px; jacobian (E, 2, 6), how far each end
    moves across its edge with the pose; outline (E,): which belong to one facing facet only, and show in any light;
    doubt_px: what the shape leaves open there."""

    start: Array
    end: Array
    jacobian: Array
    outline: Flags
    doubt_px: float

    def off(self, start: Array, end: Array) -> Array:
        """(E, 2) px how far ends found (E, 2) are from their places, across their edges."""
        return off_places(self.start, self.end, start, end)


@dataclass(frozen=True, eq=False)
class _Reading:
    """Edges as found: off (E, 2) px from their places, weight (E, 2, 2), and which of them (E,) are there at all."""

    edges: _Edges
    off: Array
    weight: Array
    there: Flags


def open_eyes(left: NDArray[np.uint8], right: NDArray[np.uint8], rig: StereoRig) -> Eyes:
    """Make a stereo pair, (H, W) each, ready."""
    geometry = baseline(rig)
    return _eyed(geometry.left, left), _eyed(geometry.right, right)


def _eyed(eye: Eye, image: NDArray[np.uint8]) -> Eyed:
    noise = measure_noise(image)
    smooth = np.asarray(cv2.GaussianBlur(cv2.LUT(image, noise.stretch), (0, 0), SMOOTHING_PX), np.float32)
    return Eyed(eye, image.astype(np.float32), smooth, noise)


def fit_edges(shape: Polyhedron, eyes: Eyes, near: Array, reach_mm: float = 5.0) -> Fit | None:
    """The pose (cyclopean_from_part) within some reach_mm of `near` at which the part's edges lie on the images' edges.

    None where an eye shows too few of the edges it should see, or they leave the pose open. Fit.matched counts edges.
    Source: edges searched for across their expected places, the pose by Gauss-Newton on their ends with Tukey's weights
    (as Harris's RAPiD does point by point), then on sub-pixel lines until it moves no more.
    """
    pose = near
    for share in ROUGHLY:
        rough = [_searched(_edges(shape, one, pose), one, reach_mm * share) for one in eyes]
        pose = frames.perturb(pose, _solved(rough, reach_mm).motion)
    for _ in range(MOST_ROUNDS):
        fine = [_measured(_edges(shape, one, pose), one) for one in eyes]
        motion = _solved(fine, reach_mm).motion
        if float(np.linalg.norm(motion / SCALE)) < SMALL_MM:
            return _judged(pose, fine, reach_mm)
        pose = frames.perturb(pose, motion)
    return _judged(pose, [_measured(_edges(shape, one, pose), one) for one in eyes], reach_mm)


def shown(shape: Polyhedron, eyes: Eyes, pose: Array, reach_mm: float) -> float:
    """Share of the outline of a part at cyclopean_from_part (4, 4) near which both eyes have edges, within reach_mm;
    0 where an eye does not have it in view. Cheaper than a fit, and for what is only partly in view."""
    shares = []
    for one in eyes:
        edges = _edges(shape, one, pose)
        length = np.linalg.norm(edges.end - edges.start, axis=1) * edges.outline
        there = _searched(edges, one, reach_mm).there
        shares.append(float(length[there].sum()) / float(length.sum()) if length.sum() > 0 else 0.0)
    return min(shares)


def facing(shape: Polyhedron, eyes: Eyes, pose: Array) -> int:
    """How many facets of a part at cyclopean_from_part (4, 4) both eyes see, none of them edge-on."""
    points = frames.apply(pose, shape.corners_mm)
    px = [one.eye.camera.project(points) for one in eyes]
    return sum(all(_thickness(seen[ring]) >= THIN_PX[1] for seen in px) for ring in shape.rings)


def _searched(edges: _Edges, one: Eyed, reach_mm: float) -> _Reading:
    """The strongest straight gradient within the reach of each edge."""
    count = len(edges.start)
    if not count:
        return _nothing(edges)
    reach_px = float(np.clip(reach_mm * edges.doubt_px / SHAPE_MM, 2.0, 24.0))
    ends = find_sides(one.smooth, edges.start, edges.end, reach_px, np.zeros(count), np.full(count, reach_px / 2))
    strength, seen = probe_sides(one.smooth, *ends, SMOOTHING_PX)
    there = (np.abs(strength) > LEAST_EVIDENCE) & (seen > LEAST_SUPPORT)
    weight = np.eye(2) / max(1.0, reach_px / 6) ** 2
    return _Reading(edges, edges.off(*ends), np.tile(weight, (count, 1, 1)), there)


def _measured(edges: _Edges, one: Eyed) -> _Reading:
    """Each edge's sub-pixel line."""
    if not len(edges.start):
        return _nothing(edges)
    sides = fit_sides(one.grey, one.noise, edges.start, edges.end, one.eye)
    weight = np.asarray(np.linalg.inv(sides.covariance + edges.doubt_px**2 * np.eye(2)))
    there = (sides.evidence > LEAST_EVIDENCE) & (sides.support > LEAST_SUPPORT)
    return _Reading(edges, edges.off(sides.start, sides.end), weight, there)


def _nothing(edges: _Edges) -> _Reading:
    return _Reading(edges, np.zeros((0, 2)), np.zeros((0, 2, 2)), np.zeros(0, bool))


def _solved(readings: Sequence[_Reading], reach_mm: float) -> Solved:
    """The motion that brings the pose onto the edges of both eyes, not much more than the reach."""
    rows = zip(*((r.off, r.edges.jacobian, r.weight, r.there) for r in readings), strict=True)
    off, jacobian, weight, there = (np.concatenate(each) for each in rows)
    prior = np.diag(([reach_mm**-2] * 3) + [np.radians(SEARCH_DEG) ** -2] * 3)
    return solve(off, jacobian, weight, there.astype(float), prior, TUKEY, PASSES)


def _judged(pose: Array, readings: Sequence[_Reading], reach_mm: float) -> Fit | None:
    """The pose moved a last time, with its covariance, if the images bear it out."""
    on_place = []
    for reading in readings:
        edges = reading.edges
        length = np.linalg.norm(edges.end - edges.start, axis=1) * edges.outline
        near = np.abs(reading.off).max(axis=1, initial=0.0) < ON_PLACE * max(edges.doubt_px, 0.5)
        on_place.append(reading.there & near)
        if not length.size or float(length[on_place[-1]].sum()) < LEAST_SHARE * float(length.sum()):
            return None
    solved = _solved(readings, reach_mm)
    if np.linalg.cond(solved.information * np.outer(SCALE, SCALE)) > SAFE_CONDITION:
        return None
    kept = np.concatenate(on_place)
    off_px = np.concatenate([r.off for r in readings])[kept]
    residual_mm = float(np.sqrt((off_px**2).mean())) / readings[0].edges.doubt_px * SHAPE_MM
    covariance = np.asarray(np.linalg.inv(solved.information), float) * solved.excess
    return Fit(frames.perturb(pose, solved.motion), covariance, residual_mm, int(kept.sum()))


def _edges(shape: Polyhedron, one: Eyed, pose: Array) -> _Edges:
    """The edges of the facets that look at this eye, as far as they are inside its image."""
    px, slope = corners_in(one.eye.camera, pose, shape.corners_mm)
    a, b, outline = _sharp_edges(shape, px)
    first, last = _inside(px[a], px[b], one.grey.shape)
    keep = (last - first) * np.linalg.norm(px[b] - px[a], axis=1) >= LEAST_LENGTH_PX
    a, b, first, last = a[keep], b[keep], first[keep, None], last[keep, None]
    start, way = px[a], px[b] - px[a]
    normal = across(px[a], px[b])[:, None]
    at_a, at_b = ((normal @ slope[k])[:, 0] for k in (a, b))
    jacobian = np.stack([at_a + share * (at_b - at_a) for share in (first, last)], 1)
    doubt_px = SHAPE_MM * one.eye.focal_px / float(frames.apply(pose, shape.corners_mm)[:, 2].mean())
    return _Edges(start + first * way, start + last * way, jacobian, outline[keep], doubt_px)


def _sharp_edges(shape: Polyhedron, px: Array) -> tuple[NDArray[np.int64], NDArray[np.int64], Flags]:
    """Indices (E,), (E,) of both ends of each edge of the facets that face an eye, once each, and which belong to one
    of them only (E,); none of a facet that is seen edge-on. px (N, 2): where the eye sees the shape's corners."""
    found: dict[frozenset[int], tuple[int, int]] = {}
    facing: Counter[frozenset[int]] = Counter()
    doubtful: set[frozenset[int]] = set()
    for ring in shape.rings:
        thick_px = _thickness(px[ring])
        pairs = list(zip(ring.tolist(), np.roll(ring, -1).tolist(), strict=True))
        edges = [frozenset(pair) for pair in pairs]
        if THIN_PX[0] < thick_px < THIN_PX[1]:
            doubtful.update(edges)
        elif thick_px > 0:
            facing.update(edges)
            found.update(zip(edges, pairs, strict=True))
    kept = [edge for edge in found if edge not in doubtful]
    ends = np.array([found[edge] for edge in kept], np.int64).reshape(-1, 2)
    return ends[:, 0], ends[:, 1], np.array([facing[edge] == 1 for edge in kept], bool)


def _thickness(ring_px: Array) -> float:
    """Area by length of a ring (N, 2) px, both halved round: the width of a long one; negative where it is seen from
    behind (it then runs clockwise)."""
    x, y = ring_px.T
    following = np.roll(ring_px, -1, axis=0)
    twice_area = float(np.sum(x * following[:, 1] - y * following[:, 0]))
    return -twice_area / float(np.linalg.norm(following - ring_px, axis=1).sum())


def _inside(start: Array, end: Array, shape: tuple[int, ...]) -> tuple[Array, Array]:
    """Shares (E,), (E,) of the way start -> end between which each edge is inside an image (Liang and Barsky); the
    second is not above the first where none of it is."""
    way = end - start
    first, last = np.zeros(len(start)), np.ones(len(start))
    for axis, length in enumerate(shape[::-1]):
        for sign, limit in ((-1.0, -ROOM_PX), (1.0, length - 1 - ROOM_PX)):
            speed, room = sign * way[:, axis], limit - sign * start[:, axis]
            with np.errstate(divide="ignore", invalid="ignore"):
                at = room / speed
            first = np.where(speed < -1e-9, np.maximum(first, at), first)
            last = np.where(speed > 1e-9, np.minimum(last, at), last)
            last = np.where((np.abs(speed) <= 1e-9) & (room < 0), -1.0, last)
    return first, last
