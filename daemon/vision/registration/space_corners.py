"""Where two straight edges meet in space, and where taught parts would be that have such a corner.

In: segment corners of both eyes, taught solids. Out: pose guesses, to be laid onto both images. A guess is no
recognition. The corner's place is met by two rays, the firmer of its edges by two planes; the other lies in the left
eye's plane at the angle that the taught corner has, and is borne out by the right eye.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from daemon import frames
from daemon.arrays import Array
from daemon.vision.geometry import Baseline, Polyhedron
from daemon.vision.image import SegmentCorners
from daemon.vision.model import Model

NEAREST_MM, FARTHEST_MM = 120.0, 1500.0  # where parts may be
ROW_PX = 2.0  # how far apart the rows may be in which two eyes see a corner
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
    """at (C, 3) mm; firm (C, 3), the firmer arm's unit direction; plane (C, 3), the unit normal of the left eye's plane
    through the other arm, both in the baseline's frame; left, right (C, 2) ideal directions of the other arm; swapped (C,): the firm arm is the second."""

    at: Array
    firm: Array
    plane: Array
    left: Array
    right: Array


def meet(left: SegmentCorners, right: SegmentCorners, geometry: Baseline) -> SpaceCorners:
    """Corners that both eyes see, every pair that could be one."""
    if not len(left.at) or not len(right.at):
        none = np.zeros((0, 3))
        return SpaceCorners(none, none, none, none[:, :2], np.zeros((0, 4)))
    seen = []
    for eye, found in ((geometry.left, left), (geometry.right, right)):
        count = len(found.at)
        ideal = eye.ideal(np.concatenate([found.at, found.arms.reshape(-1, 2)]))
        at, arms = ideal[:count], ideal[count:].reshape(-1, 2, 2)
        angle = np.arctan2(*np.moveaxis(arms - at[:, None], -1, 0)[::-1])
        seen.append((at, arms, angle, found.sign))
    (at_l, arms_l, angle_l, sign_l), (at_r, arms_r, angle_r, sign_r) = seen
    row = ROW_PX / geometry.left.focal_px
    apart = at_l[:, None, 0] - at_r[None, :, 0]
    near = (np.abs(at_l[:, None, 1] - at_r[None, :, 1]) < row) & (apart * FARTHEST_MM > geometry.length_mm)
    i, j = np.nonzero(near & (apart * NEAREST_MM < geometry.length_mm))
    found = []
    for order in ((0, 1), (1, 0)):
        turn = angle_l[i] - angle_r[j][:, order]
        turn = np.abs(np.arctan2(np.sin(turn), np.cos(turn)))
        good = (turn < TURNED).all(1) & (sign_l[i] == sign_r[j][:, order]).all(1)
        k, m = i[good], j[good]
        found.append((at_l[k], arms_l[k], at_r[m], arms_r[m][:, order]))
    at_l, arms_l, at_r, arms_r = (np.concatenate(each) for each in zip(*found, strict=True))
    depth = geometry.length_mm / (at_l[:, 0] - at_r[:, 0])
    y = (at_l[:, 1] + at_r[:, 1]) / 2
    place = depth[:, None] * np.stack([at_l[:, 0], y, np.ones_like(y)], 1)
    planes_l, planes_r = (_planes(at, arms) for at, arms in ((at_l, arms_l), (at_r, arms_r)))
    line = np.cross(planes_l, planes_r)
    sine = np.linalg.norm(line, axis=2)
    firm = np.argmax(sine, 1)
    rows = np.arange(len(firm))
    ok = sine[rows, firm] > FIRM
    rows, firm = rows[ok], firm[ok]
    other = 1 - firm
    direction = line[rows, firm] / sine[rows, firm, None]
    shown = direction[:, :2] - at_l[rows] * direction[:, 2:]
    towards = arms_l[rows, firm] - at_l[rows]
    direction = direction * np.sign((shown * towards).sum(1))[:, None]
    return SpaceCorners(place[rows], direction, planes_l[rows, other], arms_l[rows, other] - at_l[rows], np.concatenate([at_r[rows], arms_r[rows, other] - at_r[rows]], 1))


def _planes(at: Array, arms: Array) -> Array:
    """(C, 2, 3) unit normals of the planes through an eye, a corner (C, 2) and each of its arms (C, 2, 2)."""
    ray = np.concatenate([at, np.ones((len(at), 1))], 1)[:, None]
    far = np.concatenate([arms, np.ones((*arms.shape[:2], 1))], 2)
    normal = np.cross(np.broadcast_to(ray, far.shape), far)
    return np.asarray(normal / np.linalg.norm(normal, axis=2, keepdims=True))


@lru_cache(maxsize=256)
def taught_corners(solid: Polyhedron) -> tuple[Array, Array]:
    """Every two edges at every corner of a solid, in either order, those left out that a turn of the solid makes of
    others: (K, 4, 4) corner_from_part, x along the first edge, the second in x y; cosines (K,) between them.
    """
    pairs = solid.lines[0]
    found, cosines = list[Array](), list[float]()
    for corner in range(len(solid.corners_mm)):
        ends = [int(b if a == corner else a) for a, b in pairs if corner in (a, b)]
        ways = [solid.corners_mm[e] - solid.corners_mm[corner] for e in ends]
        ways = [w / np.linalg.norm(w) for w in ways]
        for p, x in enumerate(ways):
            for q, to in enumerate(ways):
                if p == q:
                    continue
                frame = frames.rigid(_basis(x[None], to[None])[0], solid.corners_mm[corner])
                if not any(_turned_onto(solid, known @ frames.inverse(frame)) for known in found):
                    found.append(frame)
                    cosines.append(float(x @ to))
    return np.array([frames.inverse(frame) for frame in found]).reshape(-1, 4, 4), np.array(cosines)


def _turned_onto(solid: Polyhedron, motion: Array) -> bool:
    """Whether a motion takes every corner of a solid onto one of its corners."""
    moved = frames.apply(motion, solid.corners_mm)
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
    at_l, at_r, arm_r = corners.at[:, :2] / corners.at[:, 2:], corners.right[:, :2], corners.right[:, 2:]
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
            ahead = ((other[..., :2] - at_l * other[..., 2:]) * corners.left).sum(-1) > 0
            off = _angle(other[..., :2] - at_r * other[..., 2:], arm_r)
            which, where = np.nonzero(ahead & (off < OFF) & (np.abs(share) < MOST_COSINE))
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
