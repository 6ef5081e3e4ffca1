"""Where two straight edges meet in space, and which such corners taught solids have.

In: segment corners of both eyes; solids. Out: corners in space. A corner's place is met by two rays, the firmer of its
edges by two planes; of the other the left eye's plane is known, and where it points in either eye.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from daemon import frames
from daemon.arrays import Array, Flags, Index
from daemon.vision.geometry import Baseline, Eye, Polyhedron
from daemon.vision.image import SegmentCorners, pairs_within

NEAREST_MM, FARTHEST_MM = 120.0, 1500.0  # where parts may be
ROW_PX = 2.0  # how far apart the rows may be in which two eyes see a corner
MOST_MET = 800  # of corners seen by both eyes those with the longest arms: each is a guess for every taught corner
TURNED = np.radians(28.0)  # by how much a corner's arm may point elsewhere in the other eye
FIRM = np.sin(np.radians(1.2))  # of the angle between the planes of an edge; less, and its direction is anyone's
ANGLE = np.radians(2.0)  # taught corners are of a kind whose angles round to the same in this
ALIKE_MM = 1.5  # corners of a solid this near to others' places after a turn make the turn one of its symmetries


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

    def chosen(self, which: Index) -> SpaceCorners:
        """Some of them."""
        return SpaceCorners(
            self.at[which], self.firm[which], self.plane[which], self.other[:, which], self.right[which]
        )


@dataclass(frozen=True, eq=False)
class CornersInEye:
    """Corners in one eye, in ideal coordinates: at (C, 2), arms (C, 2, 2) from it, sign (C, 2)."""

    at: Array
    arms: Array
    sign: Array

    @classmethod
    def of(cls, found: SegmentCorners, eye: Eye) -> CornersInEye:
        ideal = eye.ideal(np.concatenate([found.at, found.arms.reshape(-1, 2)]))
        at, ends = np.split(ideal, [len(found.at)])
        return cls(at, ends.reshape(-1, 2, 2) - at[:, None], found.sign)

    def chosen(self, which: Index, swapped: bool = False) -> CornersInEye:
        """Some of them, their arms the other way round or not."""
        order = [1, 0] if swapped else [0, 1]
        return CornersInEye(self.at[which], self.arms[which][:, order], self.sign[which][:, order])

    def longer_first(self) -> CornersInEye:
        """The same, the longer arm of each first."""
        each, longer = np.arange(len(self.at)), np.linalg.norm(self.arms, axis=2).argmax(1)
        order = np.stack([longer, 1 - longer], 1)
        return CornersInEye(self.at, self.arms[each[:, None], order], self.sign[each[:, None], order])

    def planes(self) -> Array:
        """(C, 2, 3) unit normals of the planes through the eye and each arm."""
        ray = np.concatenate([self.at, np.ones((len(self.at), 1))], 1)
        normal = np.cross(ray[:, None], np.concatenate([self.arms, np.zeros((*self.arms.shape[:2], 1))], 2))
        return np.asarray(normal / np.linalg.norm(normal, axis=2, keepdims=True))


def meet(left: SegmentCorners, right: SegmentCorners, geometry: Baseline) -> SpaceCorners:
    """Every two corners, one in each eye, that could be one."""
    in_left, in_right = CornersInEye.of(left, geometry.left), CornersInEye.of(right, geometry.right)
    i, j = pairs_within(in_left.at[:, 1], in_right.at[:, 1], ROW_PX / geometry.left.focal_px)
    apart = in_left.at[i, 0] - in_right.at[j, 0]
    near = (apart * FARTHEST_MM > geometry.length_mm) & (apart * NEAREST_MM < geometry.length_mm)
    i, j = i[near], j[near]
    pairs = []
    for swapped in (False, True):
        one, other = in_left.chosen(i), in_right.chosen(j, swapped)
        good = np.flatnonzero((angle(one.arms, other.arms) < TURNED).all(1) & (one.sign == other.sign).all(1))
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


def _joined(parts: list[CornersInEye]) -> CornersInEye:
    return CornersInEye(*(np.concatenate([getattr(p, name) for p in parts]) for name in ("at", "arms", "sign")))


@lru_cache(maxsize=256)
def taught_corners(solid: Polyhedron) -> tuple[Array, Array, Array]:
    """Every two edges at every corner of a solid, in either order, those left out that a turn of the solid makes of
    others, facets and all (a part that was not taught from all round has sides that nobody knows): (K, 4, 4)
    corner_from_part, x along the first edge, the second in x y; cosines (K,) between them; lengths (K, 2) of both, mm.
    """
    every, cosines, lengths = corner_frames(solid)
    corner_from_part = np.asarray(np.linalg.inv(every), float)
    seen = solid.corners_mm @ corner_from_part[:, :3, :3].transpose(0, 2, 1) + corner_from_part[:, None, :3, 3]
    far = np.linalg.norm(seen, axis=2)
    facets = {frozenset(ring) for ring in solid.facets}
    found, left = list[int](), np.arange(len(every))
    while len(left):
        first = int(left[0])
        found.append(first)
        alike = _as_far(far[left], far[first])
        apart2 = _apart2(seen[left[alike]], seen[first])
        alike[alike] = near = apart2.min(2).max(1) < ALIKE_MM**2
        onto = apart2[near].argmin(2)
        alike[alike] = [{frozenset(to[ring].tolist()) for ring in solid.rings} == facets for to in onto]
        left = left[~alike]
    return corner_from_part[found], cosines[found], lengths[found]


@lru_cache(maxsize=1024)
def lookalikes(solid: Polyhedron, seen: tuple[int, ...]) -> Array:
    """(S, 4, 4) the turns after which every corner that is seen lies where a corner of the solid was, as far as that is
    known; the first is none. Where all are seen, these are the solid's symmetries."""
    every = corner_frames(solid)[0]
    own = np.flatnonzero((every[:, :3, 3] == solid.corners_mm[seen[0]]).all(1))[0]
    turns = np.delete(every, own, 0) @ frames.inverse(every[own])
    moved = solid.corners_mm[list(seen)] @ turns[:, :3, :3].transpose(0, 2, 1) + turns[:, None, :3, 3]
    near = _apart2(moved, solid.corners_mm).min(2).max(1) < ALIKE_MM**2
    return np.concatenate([np.eye(4)[None], turns[near]])


@lru_cache(maxsize=1024)
def corner_frames(solid: Polyhedron) -> tuple[Array, Array, Array]:
    """Every two edges at every corner, in either order: part_from_corner (K, 4, 4), the cosine between them (K,), and
    how long both are (K, 2), mm."""
    ends = np.concatenate([solid.lines[0], solid.lines[0][:, ::-1]])
    which = np.argwhere((ends[:, :1] == ends[:, 0]) & ~np.eye(len(ends), dtype=bool))
    ways = solid.corners_mm[ends[:, 1]] - solid.corners_mm[ends[:, 0]]
    length = np.sqrt((ways * ways).sum(1))
    x, to = (ways[own] / length[own, None] for own in which.T)
    found = np.zeros((len(which), 4, 4))
    found[:, :3, :3], found[:, :3, 3], found[:, 3, 3] = basis(x, to), solid.corners_mm[ends[which[:, 0], 0]], 1.0
    return found, (x * to).sum(1), length[which]


def _apart2(many: Array, one: Array) -> Array:
    """(M, N, K) squares of the distances of sets of points (M, N, 3) from points (K, 3)."""
    found = np.zeros((*many.shape[:2], len(one)))
    for axis in range(3):
        off = many[:, :, None, axis] - one[:, axis]
        found += off * off
    return found


def _as_far(many: Array, one: Array) -> Flags:
    """(M,) of which sets of distances (M, N) from the origin each has one of (K,) that points so near could have."""
    known = np.concatenate([[-np.inf], np.sort(one), [np.inf]])
    after = np.searchsorted(known, many)
    off = np.minimum(many - known[after - 1], known[after] - many)
    return np.asarray(off.max(1) < ALIKE_MM + 1e-6)


def sorted_by_kind(rows: Array) -> tuple[Array, Index, Index]:
    """The kinds (U, M) of which rows (K, M) are, the order (K,) that sorts them by kind, and where each begins there
    (U + 1,)."""
    kinds, kind = np.unique(rows, axis=0, return_inverse=True)
    order = np.argsort(kind.reshape(-1), kind="stable")
    return kinds, order, np.searchsorted(kind.reshape(-1)[order], np.arange(len(kinds) + 1))


def basis(x: Array, to: Array) -> Array:
    """(N, 3, 3) rotations whose columns are unit x (N, 3), the rest of `to` (N, 3) at right angles to it, and their
    cross product."""
    y = to - (x * to).sum(1, keepdims=True) * x
    y = y / np.linalg.norm(y, axis=1, keepdims=True)
    return np.stack([x, y, np.cross(x, y)], 2)


def angle(one: Array, other: Array) -> Array:
    """Angles (...) between directions (..., 2)."""
    cross = one[..., 0] * other[..., 1] - one[..., 1] * other[..., 0]
    return np.asarray(np.abs(np.arctan2(cross, (one * other).sum(-1))))
