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
from daemon.arrays import Array, Flags
from daemon.vision.geometry import Hole, Polyhedron, hidden, robust_weight, rough_fit, solve
from daemon.vision.image import LEAST_SIGMAS, STEP_PX, CameraImage, StereoImages, peak_places, peaks, rim_slopes
from daemon.vision.model import Model, correspondences, turns_but_for_holes
from daemon.vision.recognition import PoseEvidence
from daemon.vision.settings import TOLERANCE_MM

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
BY_RIM, HIDDEN_NATS, MOST_NATS = 0.7, -4.0, 5.0
"""What nats of a rim's edges weigh, and the least and the most they can come to: how seldom light hides a rim that is
there, and how seldom one shows that is not. By 53 rims that are there and 143 that are not in rendered looks; of the
former the least had 9 nats, of the latter the most -6. tests/bench/holes.py makes these and SHOWS again."""
SHRUNK_PX, RADIUS_PX, OF_TOLERANCE = -0.12, 0.15, 0.35
"""By how much smoothing draws a rim in, how far its size is off besides, and the share of what naming allows corners to
be off that a hole's size may be. The first two by 38 rims in path-traced looks; in the simulated cell's rims are
drawn in by .07 and differ by .05."""


class RimSeen(NamedTuple):
    """One camera's view of one hole: stretches, how many say something of their own; shows, the share of them that has
    an edge on the fitted rim; chance, how often one is there by chance; larger_px, by how much the rim is larger than
    the taught one, without what smoothing does; sigma_px of that."""

    stretches: float
    shows: float
    chance: float
    larger_px: float
    sigma_px: float

    @property
    def edge_nats(self) -> float:
        """Log likelihood ratio of a rim's being there against chance."""
        there, missing = np.log(SHOWS / self.chance), np.log((1 - SHOWS) / (1 - self.chance))
        return float(self.stretches * (self.shows * there + (1 - self.shows) * missing))


def hole_evidence(model: Model, eyes: StereoImages) -> PoseEvidence:
    """hole_nats of a model's parts."""

    def seen(label: str, pose: Array) -> float:
        return hole_nats(model.metric[label].solid, pose, eyes, model.parameters.tolerance_mm)

    return seen


def hole_nats(solid: Polyhedron, pose: Array, eyes: StereoImages, tolerance_mm: float = TOLERANCE_MM) -> float:
    """How much more both pictures speak for the holes of a part at cyclopean_from_part (4, 4) than for none; 0 where it
    has none in view."""
    return sum(rim_nats(both) for both in rims_seen(solid, pose, eyes, tolerance_mm)) if solid.holes else 0.0


def rim_nats(both: list[RimSeen]) -> float:
    """Of one hole, by the cameras that have it in view: how surely a rim is there at all, and whether it has the size.
    Both cameras see one size; a rim that is there is no more so for being long."""
    there = min(max(BY_RIM * sum(seen.edge_nats for seen in both), HIDDEN_NATS), MOST_NATS)
    if there <= 0:
        return there
    off = float(np.mean([seen.larger_px / seen.sigma_px for seen in both]))
    return max(there - off**2 / 2, HIDDEN_NATS)


def rims_seen(solid: Polyhedron, pose: Array, eyes: StereoImages, tolerance_mm: float) -> list[list[RimSeen]]:
    """Of each hole in view what each camera shows that has it in view."""
    if not solid.holes:
        return []
    found = []
    facing = [solid.facing(pose, eye_mm) for eye_mm in eyes.geometry.eyes_mm]
    for hole in solid.holes:
        both = [
            _seen(solid, hole, pose, view, eye_mm, tolerance_mm)
            for view, eye_mm, cosines in zip(eyes.views, eyes.geometry.eyes_mm, facing, strict=True)
            if cosines[hole.facet] > LEAST_FACING
        ]
        if kept := [seen for seen in both if seen is not None]:
            found.append(kept)
    return found


def _seen(
    solid: Polyhedron, hole: Hole, pose: Array, view: CameraImage, eye_mm: Array, tolerance_mm: float
) -> RimSeen | None:
    """What a camera shows of a hole; None where it is too small, or too much of it out of view."""
    camera = view.eye.camera
    ring_mm = frames.apply(pose, hole.ring_mm)
    ring_px = camera.project(ring_mm)
    room = np.array(view.grey.shape[::-1]) - 1 - ROOM_PX
    if np.ptp(ring_px) > 2 * room.max():
        return None  # beside the camera or behind it a rim may be millions of px long
    places = _along(hole, ring_px)
    px = camera.project(frames.apply(pose, places))
    normal = _normals(px)
    inside: Flags = np.asarray(((px > ROOM_PX) & (px < room)).all(1))
    if _half_width_px(px) < LEAST_PX or inside.mean() < LEAST_VISIBLE:
        return None
    if not solid.convex:
        inside &= ~hidden(solid, places, frames.apply(frames.inverse(pose), eye_mm[None])[0])
        if inside.mean() < LEAST_VISIBLE:
            return None
    slopes = np.abs(rim_slopes(view.smooth, px, normal, REACH_PX))[inside]
    px_per_mm = view.eye.focal_px / float(np.linalg.norm(ring_mm.mean(0) - eye_mm))
    sigma_px = float(np.hypot(RADIUS_PX, OF_TOLERANCE * tolerance_mm * px_per_mm))
    return _fitted(slopes, normal[inside], sigma_px)


def _fitted(slopes: Array, normal: Array, sigma_px: float) -> RimSeen:
    """The rim moved and grown to where slopes (N, C) have it along normals (N, 2)."""
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
    return RimSeen(stretches, float(on.any(1).mean()), chance, float(moved[2]) - SHRUNK_PX, sigma_px)


def _along(hole: Hole, ring_px: Array) -> Array:
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


def _half_width_px(px: Array) -> float:
    """Half of the least width of a curve (N, 2), px."""
    return float(np.linalg.svd(px - px.mean(0), compute_uv=False)[1] * np.sqrt(2 / len(px)))


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
