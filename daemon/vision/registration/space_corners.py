"""Where two straight edges meet in space, and where taught parts would be that have such a corner.

In: segment corners of both eyes, taught solids. Out: pose guesses, to be laid onto both images. A guess is no
recognition. The corner's place is met by two rays, the firmer of its edges by two planes; the other lies in the left
eye's plane at the angle that the taught corner has, and is borne out by the right eye.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from daemon import frames
from daemon.arrays import Array
from daemon.vision.geometry import Baseline, Eye, Polyhedron
from daemon.vision.image import SegmentCorners, pairs_within
from daemon.vision.model import Model

NEAREST_MM, FARTHEST_MM = 120.0, 1500.0  # where parts may be
ROW_PX = 2.0  # how far apart the rows may be in which two eyes see a corner
MOST_MET = 800  # of corners seen by both eyes those with the longest arms: each is a guess for every taught corner
MOST_GUESSES = 12000  # of one part: what the corners with the longest arms say
TURNED = np.radians(28.0)  # by how much a corner's arm may point elsewhere in the other eye
OFF = np.radians(7.0)  # and by how much elsewhere than the taught angle says
MOST_COSINE = 1.03  # what a taught angle may ask of a direction in a plane, by a little that measuring leaves open
FIRM = np.sin(np.radians(1.2))  # of the angle between the planes of an edge; less, and its direction is anyone's
ALIKE_MM = 1.5  # corners of a solid this near to others' places after a turn make the turn one of its symmetries


@dataclass(frozen=True, eq=False)
class PoseGuess:
    """A part and where it could be: label, cyclopean_from_part (G, 4, 4) mm."""

    label: str
    poses: Array


@dataclass(frozen=True, eq=False)
class SpaceCorners:
    """Corners that both eyes see: at (C, 3) mm from the left eye; firm (C, 3), the unit direction of the arm whose
    planes meet at the larger angle; plane (C, 3), the unit normal of the left eye's plane through the other arm, all
    along the axes of the baseline; other (2, C, 2), where that arm points in the left and the right eye; right (C, 2),
    the corner there, both in ideal coordinates.
    """

    at: Array
    firm: Array
    plane: Array
    other: Array
    right: Array


@dataclass(frozen=True, eq=False)
class _Seen:
    """Corners in one eye, in ideal coordinates: at (C, 2), arms (C, 2, 2) from it, sign (C, 2)."""

    at: Array
    arms: Array
    sign: Array

    @classmethod
    def of(cls, found: SegmentCorners, eye: Eye) -> _Seen:
        ideal = eye.ideal(np.concatenate([found.at, found.arms.reshape(-1, 2)]))
        at, ends = np.split(ideal, [len(found.at)])
        return cls(at, ends.reshape(-1, 2, 2) - at[:, None], found.sign)

    def chosen(self, which: NDArray[np.intp], swapped: bool = False) -> _Seen:
        """Some of them, their arms the other way round or not."""
        order = [1, 0] if swapped else [0, 1]
        return _Seen(self.at[which], self.arms[which][:, order], self.sign[which][:, order])

    def planes(self) -> Array:
        """(C, 2, 3) unit normals of the planes through the eye and each arm."""
        ray = np.concatenate([self.at, np.ones((len(self.at), 1))], 1)
        normal = np.cross(ray[:, None], np.concatenate([self.arms, np.zeros((*self.arms.shape[:2], 1))], 2))
        return np.asarray(normal / np.linalg.norm(normal, axis=2, keepdims=True))


def meet(left: SegmentCorners, right: SegmentCorners, geometry: Baseline) -> SpaceCorners:
    """Every two corners, one in each eye, that could be one."""
    in_left, in_right = _Seen.of(left, geometry.left), _Seen.of(right, geometry.right)
    i, j = pairs_within(in_left.at[:, 1], in_right.at[:, 1], ROW_PX / geometry.left.focal_px)
    apart = in_left.at[i, 0] - in_right.at[j, 0]
    near = (apart * FARTHEST_MM > geometry.length_mm) & (apart * NEAREST_MM < geometry.length_mm)
    i, j = i[near], j[near]
    pairs = []
    for swapped in (False, True):
        one, other = in_left.chosen(i), in_right.chosen(j, swapped)
        good = np.flatnonzero((_angle(one.arms, other.arms) < TURNED).all(1) & (one.sign == other.sign).all(1))
        pairs.append((one.chosen(good), other.chosen(good)))
    one, other = (_joined([pair[k] for pair in pairs]) for k in (0, 1))
    planes = one.planes()
    line = np.cross(planes, other.planes())
    sine = np.linalg.norm(line, axis=2)
    firm = sine.argmax(1)
    every = np.flatnonzero(sine.max(1, initial=0.0) > FIRM)
    if len(every) > MOST_MET:
        reach = np.minimum(*(np.linalg.norm(seen.arms[every], axis=2).min(1) for seen in (one, other)))
        every = every[np.sort(np.argpartition(-reach, MOST_MET)[:MOST_MET])]
    firm = firm[every]
    one, other = one.chosen(every), other.chosen(every)
    each = np.arange(len(every))
    direction = line[every, firm] / sine[every, firm, None]
    shown = direction[:, :2] - one.at * direction[:, 2:]
    direction = direction * np.sign((shown * one.arms[each, firm]).sum(1))[:, None]
    depth = geometry.length_mm / (one.at[:, 0] - other.at[:, 0])
    ray = np.stack([one.at[:, 0], (one.at[:, 1] + other.at[:, 1]) / 2, np.ones(len(every))], 1)
    arms = np.stack([one.arms[each, 1 - firm], other.arms[each, 1 - firm]])
    return SpaceCorners(depth[:, None] * ray, direction, planes[every, 1 - firm], arms, other.at)


def _joined(parts: list[_Seen]) -> _Seen:
    return _Seen(*(np.concatenate([getattr(p, name) for p in parts]) for name in ("at", "arms", "sign")))


@lru_cache(maxsize=256)
def taught_corners(solid: Polyhedron) -> tuple[Array, Array]:
    """Every two edges at every corner of a solid, in either order, those left out that a turn of the solid makes of
    others: (K, 4, 4) corner_from_part, x along the first edge, the second in x y; cosines (K,) between them.
    """
    found, cosines = list[Array](), list[float]()
    for frame, cosine in _corner_frames(solid):
        if not any(_turned_onto(solid, known @ frames.inverse(frame)) for known in found):
            found.append(frame)
            cosines.append(cosine)
    return np.array([frames.inverse(frame) for frame in found]).reshape(-1, 4, 4), np.array(cosines)


@lru_cache(maxsize=1024)
def lookalikes(solid: Polyhedron, seen: tuple[int, ...]) -> Array:
    """(S, 4, 4) the turns after which every corner that is seen lies where a corner of the solid was, as far as that is
    known; the first is none. Where all are seen, these are the solid's symmetries."""
    every = _corner_frames(solid)
    first = next(frame for frame, _ in every if (frame[:3, 3] == solid.corners_mm[seen[0]]).all())
    turns = [frame @ frames.inverse(first) for frame, _ in every if frame is not first]
    return np.array([np.eye(4), *(turn for turn in turns if _turned_onto(solid, turn, list(seen)))])


def _corner_frames(solid: Polyhedron) -> list[tuple[Array, float]]:
    """Every two edges at every corner, in either order: part_from_corner (4, 4), and the cosine between them."""
    pairs = solid.lines[0]
    found = []
    for corner in range(len(solid.corners_mm)):
        ends = [int(b if a == corner else a) for a, b in pairs if corner in (a, b)]
        ways = [solid.corners_mm[e] - solid.corners_mm[corner] for e in ends]
        for x, to in permutations([w / np.linalg.norm(w) for w in ways], 2):
            found.append((frames.rigid(_basis(x[None], to[None])[0], solid.corners_mm[corner]), float(x @ to)))
    return found


def _turned_onto(solid: Polyhedron, motion: Array, seen: list[int] | None = None) -> bool:
    """Whether a motion takes every corner of a solid, or those seen, onto one of its corners."""
    moved = frames.apply(motion, solid.corners_mm if seen is None else solid.corners_mm[seen])
    apart = np.linalg.norm(moved[:, None] - solid.corners_mm, axis=2)
    return bool(apart.min(1).max() < ALIKE_MM)


def _basis(x: Array, to: Array) -> Array:
    """(N, 3, 3) rotations whose columns are unit x (N, 3), the rest of `to` (N, 3) at right angles to it, and their
    cross product."""
    y = to - (x * to).sum(1, keepdims=True) * x
    y = y / np.linalg.norm(y, axis=1, keepdims=True)
    return np.stack([x, y, np.cross(x, y)], 2)


def guesses_from_space(corners: SpaceCorners, geometry: Baseline, model: Model) -> list[PoseGuess]:
    """Every taught corner laid onto every corner in space whose arms could make its angle."""
    along = corners.firm - (corners.firm * corners.plane).sum(1, keepdims=True) * corners.plane
    size = np.maximum(np.linalg.norm(along, axis=1), 1e-9)
    along = along / size[:, None]
    beside = np.cross(corners.plane, along)
    at_l, at_r = corners.at[:, :2] / corners.at[:, 2:], corners.right
    turn = frames.rigid(geometry.cyclopean_from_baseline, geometry.middle_mm)
    middle = corners.at - [geometry.length_mm / 2, 0.0, 0.0]
    found = []
    for label, metric in model.metric.items():
        from_part, cosines = taught_corners(metric.solid)
        share = cosines[:, None] / size
        bend = np.arccos(np.clip(share, -1.0, 1.0))
        poses = [np.zeros((0, 4, 4))]
        for sign in (1.0, -1.0):
            other = np.cos(bend)[..., None] * along + sign * np.sin(bend)[..., None] * beside
            ahead = ((other[..., :2] - at_l * other[..., 2:]) * corners.other[0]).sum(-1) > 0
            off = _angle(other[..., :2] - at_r * other[..., 2:], corners.other[1])
            where, which = np.nonzero((ahead & (off < OFF) & (np.abs(share) < MOST_COSINE)).T)
            where, which = where[: MOST_GUESSES // 2], which[: MOST_GUESSES // 2]
            cyclopean_from_corner = np.zeros((len(where), 4, 4))
            cyclopean_from_corner[:, :3, :3] = _basis(corners.firm[where], other[which, where])
            cyclopean_from_corner[:, :3, 3], cyclopean_from_corner[:, 3, 3] = middle[where], 1.0
            poses.append(turn @ cyclopean_from_corner @ from_part[which])
        found.append(PoseGuess(label, np.concatenate(poses)))
    return found


def _angle(one: Array, other: Array) -> Array:
    """Angles (...) between directions (..., 2)."""
    cross = one[..., 0] * other[..., 1] - one[..., 1] * other[..., 0]
    return np.asarray(np.abs(np.arctan2(cross, (one * other).sum(-1))))
