"""What both pictures show along the rims of a part's holes at a pose: whether a rim is there, where, and of what size.

In: a solid with holes at a pose, both images. Out: RimSeen of each camera. Light, blur and the distance may hide a rim:
what is too small in the picture, or too oblique, says nothing.
Source: a contrario evidence of edge samples as of edge_samples.py, on ellipses.
"""

from typing import NamedTuple

import numpy as np

from daemon import frames
from daemon.arrays import Array, Flags
from daemon.vision.geometry import Hole, Polyhedron, in_sight, robust_weight, solve
from daemon.vision.image import LEAST_SIGMAS, STEP_PX, CameraImage, StereoImages, peak_places, peaks, rim_slopes

LEAST_FACING, LEAST_PX, ROOM_PX = 0.25, 3.0, 12.0
"""Cosine at which a face is too oblique for its holes, half of the least width at which a rim is looked for, and how
far inside the picture it must lie."""
LEAST_VISIBLE = 0.6
"""Share of a rim that the part itself must leave in view."""
REACH_PX, ROUNDS_PX = 7, (2.0, 1.2, 0.8, 0.6)
ON_RIM_PX, BESIDE_PX = 1.0, 3.5
"""Within what of the fitted rim an edge is the rim's; from where on what shows is chance."""
PULLED = 1.34
MOVES_PX = 1.2
"""Standard deviation of a rim's place in the picture, of errors of the pose."""
SHOWS, LEAST_CHANCE, MOST_CHANCE = 0.93, 0.05, 0.6
"""How much of a rim that is there shows as edges, and limits of what a picture's own chance is taken for."""
SPACING_PX = 3.75
"""As for straight edges: a stretch so long says something of its own."""
SHRUNK_PX, RADIUS_PX, OF_TOLERANCE = -0.12, 0.15, 0.35
"""By how much smoothing draws a rim in, how far its size is off besides, and the share of what naming allows corners to
be off that a hole's size may be. The first two by 38 rims in path-traced looks; in the simulated cell's rims are
drawn in by .07 and differ by .05."""


SURE_SHARE, SURE_SIGMAS = 0.7, 3.0
"""Of a rim, what must show for it to hold the pose, and by how much its size may differ."""


class RimPlace(NamedTuple):
    """off_px (2,): where one camera shows a rim beside where it is expected; jacobian (2, 6): how that moves with the
    pose; sigma_px: how far off either coordinate is."""

    off_px: Array
    jacobian: Array
    sigma_px: float


class RimSeen(NamedTuple):
    """One camera's view of one hole: stretches, how many say something of their own; shows, the share of them that has
    an edge on the fitted rim; chance, how often one is there by chance; larger_px, by how much the rim is larger than
    the taught one, without what smoothing does; sigma_px of that; place, where it is."""

    stretches: float
    shows: float
    chance: float
    larger_px: float
    sigma_px: float
    place: RimPlace | None = None

    @property
    def sure(self) -> bool:
        """Whether so much of the rim shows that it surely is there."""
        return self.shows > SURE_SHARE

    @property
    def edge_nats(self) -> float:
        """Log likelihood ratio of a rim's being there against chance."""
        there, missing = np.log(SHOWS / self.chance), np.log((1 - SHOWS) / (1 - self.chance))
        return float(self.stretches * (self.shows * there + (1 - self.shows) * missing))


def rims_seen(solid: Polyhedron, pose: Array, images: StereoImages, tolerance_mm: float) -> list[list[RimSeen]]:
    """Return of each hole in view what each camera shows that has it in view."""
    if not solid.holes:
        return []
    found = []
    facing = [solid.facing(pose, viewpoint_mm) for viewpoint_mm in images.geometry.cameras_mm]
    for hole in solid.holes:
        both = [
            _seen(solid, hole, pose, view, viewpoint_mm, tolerance_mm)
            for view, viewpoint_mm, cosines in zip(images.views, images.geometry.cameras_mm, facing, strict=True)
            if cosines[hole.facet] > LEAST_FACING
        ]
        if kept := [seen for seen in both if seen is not None]:
            found.append(kept)
    return found


def rim_places(solid: Polyhedron, pose: Array, images: StereoImages, tolerance_mm: float) -> list[RimPlace]:
    """Return the places of the rims that surely are there and have their size, where either camera has them."""
    every = (seen for both in rims_seen(solid, pose, images, tolerance_mm) for seen in both)
    return [
        seen.place for seen in every if seen.place and seen.sure and abs(seen.larger_px) < SURE_SIGMAS * seen.sigma_px
    ]


def _seen(
    solid: Polyhedron, hole: Hole, pose: Array, view: CameraImage, viewpoint_mm: Array, tolerance_mm: float
) -> RimSeen | None:
    """Measure what a camera shows of a hole; None where it is too small, or too much of it out of view."""
    camera = view.rectified.camera
    ring_mm = frames.apply(pose, hole.ring_mm)
    ring_px = camera.project(ring_mm)
    room = np.array(view.grey.shape[::-1]) - 1 - ROOM_PX
    if np.ptp(ring_px) > 2 * room.max():
        return None  # beside the camera or behind it a rim may be millions of px long
    places = places_along_rim(hole, ring_px)
    px = camera.project(frames.apply(pose, places))
    normal = _normals(px)
    inside: Flags = np.asarray(((px > ROOM_PX) & (px < room)).all(1)) & in_sight(solid, places, pose, viewpoint_mm)
    half_width_px = float(np.linalg.svd(px - px.mean(0), compute_uv=False)[1] * np.sqrt(2 / len(px)))
    if half_width_px < LEAST_PX or inside.mean() < LEAST_VISIBLE:
        return None
    slopes = np.abs(rim_slopes(view.smooth, px, normal, REACH_PX))[inside]
    px_per_mm = view.rectified.focal_px / float(np.linalg.norm(ring_mm.mean(0) - viewpoint_mm))
    sigma_px = float(np.hypot(RADIUS_PX, OF_TOLERANCE * tolerance_mm * px_per_mm))
    found, off_px = _fitted(slopes, normal[inside], sigma_px)
    lever = ring_mm.mean(0, keepdims=True) - pose[:3, 3]
    _, slope = camera.project_with_slope(lever + pose[:3, 3])
    return found._replace(place=RimPlace(off_px, (slope @ frames.point_motion(lever))[0], sigma_px))


def _fitted(slopes: Array, normal: Array, sigma_px: float) -> tuple[RimSeen, Array]:
    """The rim moved and grown to where slopes (N, C) have it along normals (N, 2); and by how much (2,), px."""
    offsets = np.arange(-REACH_PX, REACH_PX + 1.0)
    edge = np.where(peaks(slopes, LEAST_SIGMAS), slopes[:, 1:-1], 0.0)
    rows = np.column_stack([normal, np.ones(len(normal))])[:, None, :]
    prior = np.diag([MOVES_PX**-2.0, MOVES_PX**-2.0, 1.0])
    weight = np.full(len(normal), STEP_PX / SPACING_PX)
    here, moved = np.zeros(len(normal)), np.zeros(3)
    for near in ROUNDS_PX:
        likely = np.sqrt(edge) * np.exp(-0.5 * ((offsets[1:-1] - here[:, None]) / near) ** 2)
        best = likely.argmax(1) + 1
        found = offsets[best] + peak_places(slopes, best)[1]
        use = weight * (likely.max(1) > 0)
        trust = use * robust_weight((found - here) ** 2, PULLED * near)
        answer = solve(
            rows[None], found[None, :, None], use[None], prior, outlier=PULLED * near, passes=2, trust=trust[None]
        )
        moved = answer.unknowns[0]
        here = rows[:, 0] @ moved
    away = np.abs(offsets[1:-1] - here[:, None])
    on, beside = (edge > 0) & (away <= ON_RIM_PX), (edge > 0) & (away > BESIDE_PX)
    often = beside.sum() / max((away > BESIDE_PX).sum(), 1) * (2 * ON_RIM_PX)
    chance = float(np.clip(often, LEAST_CHANCE, MOST_CHANCE))
    stretches = len(normal) * STEP_PX / SPACING_PX
    shows = float(on.any(1).mean())
    return RimSeen(stretches, shows, chance, float(moved[2]) - SHRUNK_PX, sigma_px), moved[:2]


def places_along_rim(hole: Hole, ring_px: Array) -> Array:
    """(N, 3) mm places along a rim, about STEP_PX apart in the picture, where its corners are at (M, 2) px."""
    after = np.roll(hole.ring_mm, -1, 0)
    lengths = np.linalg.norm(np.roll(ring_px, -1, 0) - ring_px, axis=1)
    until = np.cumsum(lengths)
    count = max(round(until[-1] / STEP_PX), 8)
    at = (np.arange(count) + 0.5) * until[-1] / count
    side = np.searchsorted(until, at).clip(0, len(lengths) - 1)
    share = 1 - (until[side] - at) / np.maximum(lengths[side], 1e-9)
    return np.asarray(hole.ring_mm[side] + share[:, None] * (after - hole.ring_mm)[side])


def _normals(px: Array) -> Array:
    """(N, 2) unit normals of a closed curve at places (N, 2) px on it, out of it."""
    way = np.roll(px, -1, 0) - np.roll(px, 1, 0)
    normal = way[:, ::-1] * [1.0, -1.0] / np.maximum(np.linalg.norm(way, axis=1), 1e-9)[:, None]
    return np.asarray(normal if ((px - px.mean(0)) * normal).sum() > 0 else -normal)
