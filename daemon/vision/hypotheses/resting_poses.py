"""Support plane: on which corners taught parts can rest on it, whether a pose does, and named parts snapped to it.

In: taught solids at poses, a plane. Out: poses snapped to the plane; whether a part rests on it. A part rests on three
corners or more with none below: on a plane of its convex hull, whether that side was taught or not. Two faces leave
distance and tilt in depth open to half a millimetre and a degree; the plane, measured on all of a patterned table, says
both better. Whether a part rests on it is decided by what its own edges show.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations

import numpy as np

from daemon import frames
from daemon.arrays import Array
from daemon.vision.facets import TablePlane
from daemon.vision.geometry import Baseline, Polyhedron, chi_square_limit, solve
from daemon.vision.hypotheses.pose_batch import PoseBatch
from daemon.vision.model import in_batches
from daemon.vision.refine import PRIOR, turned

FLAT_MM = 1.0
"""Corners this near to a plane lie in it, as far as parts are taught."""
SAME_TURN = np.cos(np.radians(3.0))
"""Of the normals of planes that are one."""
LEAST_AREA_MM2 = 25.0
"""Three corners on less are nearly on a line, and say nothing of a plane."""
MOST_AT_ONCE = 20_000_000
"""Corners against planes that are held at once, six times over."""
MOST_CORNERS = 48
"""Of a solid, any three of which it may rest on; one with more rests on its facets."""
MOST_TILT, MOST_MM = np.radians(25.0), 8.0
"""By how much a guess may be tilted against the table, and moved along its sight, to lie on it: about what a corner of
two edges leaves open."""
LEAST_SLOPE = 0.2
"""Of the sight against the table: flatter, and a little height is a long way."""
LIES_TILT, LIES_MM = np.radians(3.5), 4.0
"""A part that was laid onto the pictures lies on the table if it is less than this off: so were 99 of 100 of 317 true
ones in rendered looks."""
NEARLY_TILT, NEARLY_MM = np.radians(6.0), 5.0
"""One that is off by less than this may be a true one laid badly or another that fits by chance: that says nothing."""
HIGH_MM = 40.0
"""What is so high above the table lies on something else, or is held."""


@dataclass(frozen=True, eq=False)
class SupportPlane:
    """The table that parts lie on, as both cameras see it or else as somebody knows it: then what does not lie on it
    may lie on something else."""

    table: TablePlane
    seen: bool

    @classmethod
    def of(cls, seen: TablePlane | None, known: TablePlane | None) -> SupportPlane | None:
        """Return the plane that is seen, else the one that is known, if any."""
        return cls(seen, True) if seen else cls(known, False) if known else None


@lru_cache(maxsize=256)
def resting_planes(solid: Polyhedron) -> Array:
    """(R, 4) the planes that a solid can rest on: unit outward normal n and level d, n . corner <= d everywhere."""
    return _rests_of_as_many((solid,))[0]


@lru_cache(maxsize=4)
def resting_planes_of(shapes: tuple[Polyhedron, ...]) -> list[Array]:
    """Return the resting planes of several solids, those that have as many corners together."""
    return in_batches(shapes, lambda count: MOST_AT_ONCE // count**4, _rests_of_as_many)


def _rests_of_as_many(shapes: Sequence[Polyhedron]) -> list[Array]:
    """The planes of solids that have as many corners as each other: those through three corners that none lies beyond,
    one of those that are turned alike."""
    corners = np.stack([shape.corners_mm for shape in shapes])
    if corners.shape[1] > MOST_CORNERS:
        return [_on_facets(shape) for shape in shapes]
    a, b, c = corners[:, list(combinations(range(corners.shape[1]), 3))].transpose(2, 0, 1, 3)
    across = np.cross(b - a, c - a)
    twice = np.linalg.norm(across, axis=2)
    wide = twice > 2 * LEAST_AREA_MM2
    normals = across / np.where(wide, twice, 1.0)[..., None]
    own = (normals * a).sum(2)
    levels_mm = normals @ corners.transpose(0, 2, 1)
    found = []
    for k in range(len(shapes)):
        ends = levels_mm[k].max(1, initial=-np.inf), -levels_mm[k].min(1, initial=np.inf)
        kept = [
            np.flatnonzero(wide[k] & (end < way * own[k] + FLAT_MM)) for way, end in zip((1, -1), ends, strict=True)
        ]
        planes = [
            np.column_stack([way * normals[k, which], end[which]])
            for way, end, which in zip((1, -1), ends, kept, strict=True)
        ]
        found.append(_turned_apart(np.concatenate(planes)))
    return found


def _on_facets(solid: Polyhedron) -> Array:
    """The planes of a solid's facets that no corner lies beyond."""
    levels_mm = (solid.corners_mm @ solid.normals.T).max(0)
    kept = levels_mm < (solid.normals * solid.centres_mm).sum(1) + FLAT_MM
    return _turned_apart(np.column_stack([solid.normals, levels_mm])[kept])


def _turned_apart(planes: Array) -> Array:
    """Keep of planes (N, 4) the first of those that are turned alike."""
    alike = planes[:, :3] @ planes[:, :3].T >= SAME_TURN
    left, found = np.ones(len(planes), bool), list[int]()
    for k in range(len(planes)):
        if left[k]:
            found.append(k)
            left &= ~alike[k]
    return planes[found]


def lies_on_support(ground: SupportPlane, solid: Polyhedron, pose: Array) -> bool | None:
    """Whether a solid at cyclopean_from_part (4, 4) lies on a table, as well as it can be laid onto the pictures; None
    where it nearly does, may lie on something else or on a side of its own of which too little is known, or sinks in:
    then it may be that what was taken for the table is none."""
    up = pose[:3, :3].T @ ground.table.up
    lowest_mm = (solid.corners_mm @ up).min() + pose[:3, 3] @ ground.table.up - ground.table.level_mm
    tilt = np.arccos(np.clip((resting_planes(solid)[:, :3] @ -up).max(initial=-1.0), -1.0, 1.0))
    if tilt < LIES_TILT and abs(lowest_mm) < LIES_MM:
        return True
    if tilt < NEARLY_TILT and abs(lowest_mm) < NEARLY_MM:
        return None
    known = np.linalg.matrix_rank(solid.normals, tol=0.1) == 3  # three sides, and the others have corners of theirs
    return False if ground.seen and known and -NEARLY_MM < lowest_mm < HIGH_MM else None


def nearest_resting_plane(solid: Polyhedron, down: Array) -> tuple[Array, Array]:
    """Return of the planes that a solid can rest on the one that faces most down, a direction (3,) in the part: its
    outward normal (3,), as the corners in it have it, and their middle (3,)."""
    planes = resting_planes(solid)
    normal, level = np.split(planes[(planes[:, :3] @ down).argmax()], [3])
    foot = solid.corners_mm[solid.corners_mm @ normal > level - FLAT_MM]
    middle = foot.mean(0)
    flat = np.linalg.svd(foot - middle)[2][2]
    return np.asarray(flat * np.sign(flat @ normal)), np.asarray(middle)


def snapped_poses(posed: PoseBatch, hinges: Array, table: TablePlane, geometry: Baseline) -> tuple[PoseBatch, Array]:
    """Guesses that could be rests turned about a point of each until they are, and moved along the left camera's sight
    of it; hinges (G, 2, 3): that point and the direction of the line it could turn about else, cyclopean, no direction
    for what was snapped to the table. Others stay as they are.

    Where a corner is the pictures say; how far away it is, and how a part is tilted in depth, the table says better.
    """
    points = hinges[:, 0]
    rest, cosine = _nearest_rest(posed, table)
    turns = smallest_turns((posed.poses[:, :3, :3] @ rest[..., None])[..., 0], -table.up)
    poses = turned(posed.poses, turns, points)
    sight = points - (geometry.middle_mm - geometry.cyclopean_from_baseline[:, 0] * geometry.length_mm / 2)
    sight = sight / np.linalg.norm(sight, axis=1, keepdims=True)
    up = poses[:, :3, :3].transpose(0, 2, 1) @ table.up
    heights = (posed.solids.corners_mm[posed.part] @ up[..., None])[..., 0]  # what fills up is a corner of its own
    too_high_mm = heights.min(1) + poses[:, :3, 3] @ table.up - table.level_mm
    farther = too_high_mm / np.maximum(-sight @ table.up, LEAST_SLOPE)
    poses[:, :3, 3] += farther[:, None] * sight
    down = (cosine > np.cos(MOST_TILT)) & (np.abs(farther) < MOST_MM)
    found = PoseBatch(posed.solids, posed.part, np.where(down[:, None, None], poses, posed.poses))
    still = hinges.copy()
    still[down, 1] = 0.0
    return found, still


def _nearest_rest(posed: PoseBatch, table: TablePlane) -> tuple[Array, Array]:
    """The outward normal (G, 3), in the part, of the plane that each pose is nearest to resting on, and the cosine (G,)
    of its tilt."""
    down = -(posed.poses[:, :3, :3].transpose(0, 2, 1) @ table.up)
    planes = _side_by_side(posed.solids.shapes)[posed.part]
    cosines = (planes @ down[..., None])[..., 0]
    best = np.arange(len(planes)), cosines.argmax(1)
    return planes[best], cosines[best]


def smallest_turns(one: Array, to: Array) -> Array:
    """(G, 3, 3) the smallest rotations that take unit directions (G, 3) to another (3,)."""
    cross = frames.cross_matrices(np.cross(one, to))
    return np.asarray(np.eye(3) + cross + cross @ cross / np.maximum(1 + one @ to, 1e-6)[:, None, None])


@lru_cache(maxsize=8)
def _side_by_side(shapes: tuple[Polyhedron, ...]) -> Array:
    """(P, R, 3) the normals of the rests of several solids; what one has less of is filled up with none."""
    each = resting_planes_of(shapes)
    found = np.zeros((len(each), max([1, *map(len, each)]), 3))
    for normals, own in zip(found, each, strict=True):
        normals[: len(own)] = own[:, :3]
    return found


TABLE_MM, TABLE_RAD = 0.15, np.radians(0.1)
"""How well the table that both cameras see is known where a part stands, standard deviations: in half of the rendered
scenes it is .07 mm and .03 degrees off, in one of twenty .2 mm and .14 degrees."""
LIES, SUNK = chi_square_limit(3, 0.01), chi_square_limit(3, 1e-6)
"""Chi-square of a part's height and tilt against the table: more, and it stands on something else; for one that seems
to have sunk in, which none has, so much that it is no table."""


def snapped_where_it_lies(
    ground: SupportPlane | None, solid: Polyhedron, pose: Array, covariance: Array
) -> tuple[Array, Array]:
    """Pose (4, 4) cyclopean_from_part and covariance (6, 6) of a solid, on the table if that is seen and it lies
    there."""
    lies = ground is not None and ground.seen and lies_on_support(ground, solid, pose)
    found = snapped_pose(ground.table, solid, pose, covariance) if ground is not None and lies else None
    return found or (pose, covariance)


def snapped_pose(table: TablePlane, solid: Polyhedron, pose: Array, covariance: Array) -> tuple[Array, Array] | None:
    """Pose (4, 4) cyclopean_from_part and covariance (6, 6) of a solid that rests on a table, if it may: both together
    say where it is. The plane is one block of three residuals: the height of its foot, and its tilt two ways. What no
    edge measures stays, as in a fit by edges: a table moves nothing along itself."""
    normal, foot = nearest_resting_plane(solid, pose[:3, :3].T @ -table.up)
    down, lever = pose[:3, :3] @ normal, pose[:3, :3] @ foot
    along = np.linalg.svd(table.up[None])[2][1:]
    slope = np.zeros((3, 6))
    slope[0] = table.up @ frames.point_motion(lever[None])[0]
    slope[1:, 3:] = np.cross(down, along)
    off = np.array([table.level_mm - table.up @ (lever + pose[:3, 3]), *(-along @ down)])
    sure = np.array([TABLE_MM, TABLE_RAD, TABLE_RAD])
    rows, far, held = slope / sure[:, None], off / sure, np.asarray(np.linalg.inv(covariance), float)
    found = solve(rows[None, None], far[None, None], np.ones((1, 1)), held + PRIOR)
    motion = found.unknowns[0]
    if found.miss[0, 0] + motion @ held @ motion > (SUNK if off[0] > 0 else LIES):
        return None
    return frames.perturb(pose, motion), np.asarray(np.linalg.inv(found.held[0] - PRIOR))
