"""Where taught parts would be that rest on a table and have such a corner as one camera sees: for where both see none.

In: segment corners of one camera, a table, taught solids, maps of segments. Out: poses, to be laid onto both images. A
guess is no recognition. How high a corner of a part is over the table that it rests on says where on its sight it lies;
the longer of its edges says how the part is turned; the other must point where that has it, neither may show longer
than it is, and the other camera bears both out.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from daemon import frames
from daemon.arrays import Array, Index
from daemon.vision.facets import TablePlane
from daemon.vision.geometry import Baseline, Polyhedron, SolidBatch, basis
from daemon.vision.hypotheses.directional_edge_map import DirectionalEdgeMap
from daemon.vision.hypotheses.junctions import (
    ANGLE,
    CameraJunctions,
    TaughtJunctions,
    sorted_by_kind,
    taught_junctions,
)
from daemon.vision.hypotheses.pose_batch import PoseBatch
from daemon.vision.hypotheses.resting_poses import resting_planes_of
from daemon.vision.image import SegmentCorners, runs

OFF = np.tan(np.radians(6.0))
"""By how much the second edge may point elsewhere than the first one and the table have it."""
LEAST_LEVEL = 0.3
"""Cosine of an edge's slope: one that stands up steeper says nothing of how a part is turned."""
LEAST_SLOPE = 0.15
"""Of the sight against the table."""
BEHIND = 0.1
"""Of a corner's depth: what ends nearer to the camera is not in sight."""
TOO_LONG, ROOM = 1.1, 0.01
"""So many times its length an edge may show, and so much more in ideal coordinates."""
MOST_ASKED, MOST_GUESSES = 100_000, 1500
"""Kinds of taught corners times corners of one camera, as many of these as that leaves; of their guesses those that the
other camera bears out most."""
SHARES = np.array([0.1, 0.3, 0.5, 0.7, 0.9], np.float32)
"""At which shares of an edge the other camera is asked."""


@dataclass(frozen=True, eq=False)
class RestingJunctions:
    """Every corner of several solids, on every plane that each can rest on (K,): the number (K,) of the corner among
    those taught, its height_mm over the table, and angles (K, 3): both edges' slopes upwards, and by how much the
    second points farther round than the first, counter-clockwise from above; sorted by their kinds (U, 3), begins
    (U + 1,): where each begins.
    """

    taught: TaughtJunctions
    corner: Index
    height_mm: Array
    angles: Array
    kinds: Array
    begins: Index


@lru_cache(maxsize=4)
def resting_junctions_of(shapes: tuple[Polyhedron, ...]) -> RestingJunctions:
    """Return the junctions whose first edge says how the part is turned; angles are of a kind that round to the
    same."""
    taught, planes = taught_junctions(shapes), resting_planes_of(shapes)
    count = np.array([len(each) for each in planes], np.intp)
    every = np.concatenate([np.zeros((0, 4)), *planes])
    k, r = runs((np.cumsum(count) - count)[taught.part], count[taught.part])
    turn, cosine = taught.corner_from_part[:, :3, :3], taught.cosine
    down = every[r]
    up = -(turn[k] @ down[:, :3, None])[..., 0]
    corner = -(taught.corner_from_part[:, None, :3, 3] @ turn)[:, 0]
    sine_between = np.sqrt(1 - cosine**2)
    first, second = up[:, 0], up[:, 0] * cosine[k] + up[:, 1] * sine_between[k]
    slopes = np.clip(np.stack([first, second], 1), -1, 1)
    round_ = np.arctan2(up[:, 2] * sine_between[k], cosine[k] - slopes.prod(1))
    angles = np.column_stack([np.arcsin(slopes), round_])
    good = np.flatnonzero(np.cos(angles[:, 0]) > LEAST_LEVEL)
    kinds, order, begins = sorted_by_kind((angles[good] / ANGLE).round().astype(np.intp))
    order = good[order]
    corners, planes_of = k[order], down[order]
    height = planes_of[:, 3] - (planes_of[:, :3] * corner[corners]).sum(1)
    return RestingJunctions(taught, corners, height, angles[order], kinds * ANGLE, begins)


def poses_on_support(
    seen: tuple[SegmentCorners, SegmentCorners],
    geometry: Baseline,
    maps: tuple[DirectionalEdgeMap, DirectionalEdgeMap],
    table: TablePlane,
    solids: SolidBatch,
) -> tuple[PoseBatch, int]:
    """Taught corners laid onto the corners that either camera sees, of parts that rest on a table, and how many
    could."""
    taught = resting_junctions_of(solids.shapes)
    if not len(taught.corner):
        return PoseBatch(solids, np.zeros(0, np.intp), np.zeros((0, 4, 4))), 0
    turn = geometry.cyclopean_from_baseline
    parts, poses, tests = list[Index](), list[Array](), 0
    for k, camera in enumerate((geometry.left, geometry.right)):
        corners = CameraJunctions.of(seen[k].at_most(MOST_ASKED // len(taught.kinds)), camera).longer_first()
        viewpoint_mm = geometry.middle_mm + (k - 0.5) * geometry.length_mm * turn[:, 0]
        which, at, ways = possible_places(
            corners, taught, turn.T @ table.up, float(table.up @ viewpoint_mm) - table.level_mm
        )
        tests += len(which)
        from_other = at - [(1 - 2 * k) * geometry.length_mm, 0.0, 0.0]
        own = taught.corner[which]
        best = _most_evident(from_other, ways, taught.taught.lengths_mm[own], maps[1 - k])
        own = own[best]
        from_corner = frames.rigid(turn @ basis(ways[0, best], ways[1, best]), at[best] @ turn.T + viewpoint_mm)
        parts.append(taught.taught.part[own])
        poses.append(from_corner @ taught.taught.corner_from_part[own])
    return PoseBatch(solids, np.concatenate(parts), np.concatenate(poses)), tests


def possible_places(
    corners: CameraJunctions, taught: RestingJunctions, up: Array, viewpoint_mm: float
) -> tuple[Index, Array, Array]:
    """Return which taught corners (N,) could lie where, (N, 3) mm from the camera, and where both of their edges point
    then (2, N, 3), in axes of the baseline; the camera is so high over the table, up (3,) is away from that."""
    ray = np.concatenate([corners.at, np.ones((len(corners.at), 1))], 1)
    slope = -ray @ up
    flat = slope > LEAST_SLOPE
    corners, ray, slope = corners.chosen(np.flatnonzero(flat)), ray[flat], slope[flat]
    east = np.cross(up, np.eye(3)[np.abs(up).argmin()])
    east /= np.linalg.norm(east)
    axes = np.stack([east, np.cross(up, east), up])
    kind, c, bearing = _turned(corners, ray, axes, taught.kinds)
    ways = _ways(bearing, taught.kinds[kind], axes)
    of, which = runs(taught.begins[kind], np.diff(taught.begins)[kind])
    depth = (viewpoint_mm - taught.height_mm[which]) / slope[c[of]]
    good = depth > 0
    which, of, depth = which[good], of[good], depth[good]
    shown = np.linalg.norm(corners.arms, axis=2)[c[of]]
    reach = np.empty_like(shown)
    for edge in (0, 1):
        along, own = taught.taught.lengths_mm[taught.corner[which], edge] / depth, ways[edge]
        shift = np.linalg.norm(own[:, :2] - corners.at[c] * own[:, 2:], axis=1)
        reach[:, edge] = along * shift[of] / np.maximum(1 + along * own[of, 2], BEHIND)
    good = (shown < TOO_LONG * reach + ROOM).all(1)
    which, of = which[good], of[good]
    return which, depth[good, None] * ray[c[of]], _ways(bearing[of], taught.angles[which], axes)


def _ways(bearing: Array, angles: Array, axes: Array) -> Array:
    """(2, N, 3) where both edges of corners of such angles (N, 3) point, their first ones along bearings (N,); axes
    (3, 3): east, north and up."""
    slopes, both = angles.T[:2], np.stack([bearing, bearing + angles[:, 2]])
    return np.asarray(
        np.stack([np.cos(slopes) * np.cos(both), np.cos(slopes) * np.sin(both), np.sin(slopes)], 2) @ axes
    )


def _turned(corners: CameraJunctions, ray: Array, axes: Array, kinds: Array) -> tuple[Index, Index, Array]:
    """Return which kind of corner (N,) could be which one that is seen (N,), and the bearing (N,) of its first edge
    then."""
    first, second = corners.arms[:, 0], corners.arms[:, 1]
    across = np.cross(ray, np.concatenate([first, np.zeros((len(first), 1))], 1)) @ axes.T
    slopes, of_slope = np.unique(kinds[:, 0], return_inverse=True)
    share = -np.tan(slopes)[:, None] * (across[:, 2] / np.maximum(np.hypot(across[:, 0], across[:, 1]), 1e-12))
    aside = np.arccos(np.clip(share, -1, 1))
    middle = np.arctan2(across[:, 1], across[:, 0])
    bearing = np.stack([middle - aside, middle + aside])  # (2, V, C)
    level, steep = np.cos(slopes)[:, None], np.sin(slopes)[:, None]
    shift = axes[:, :2] - axes[:, 2:] * corners.at[:, None]  # (C, 3, 2) by how much what each axis moves shows
    ahead = (shift * first[:, None]).sum(2).T
    cosine, sine = np.cos(bearing), np.sin(bearing)
    good = (np.abs(share) < 1) & (level * (cosine * ahead[0] + sine * ahead[1]) + steep * ahead[2] > 0)
    unit = second / np.linalg.norm(second, axis=1, keepdims=True)
    along = (shift * unit[:, None]).sum(2).T.astype(np.float32)
    off = (shift * np.stack([-unit[:, 1], unit[:, 0]], 1)[:, None]).sum(2).T.astype(np.float32)
    of_slope = of_slope.reshape(-1)
    cosine, sine, good = (each[:, of_slope] for each in (cosine.astype(np.float32), sine.astype(np.float32), good))
    turn, level, steep = (
        np.asarray(each, np.float32)[:, None] for each in (kinds[:, 2], np.cos(kinds[:, 1]), np.sin(kinds[:, 1]))
    )
    east = level * (cosine * np.cos(turn) - sine * np.sin(turn))
    north = level * (sine * np.cos(turn) + cosine * np.sin(turn))
    forward = east * along[0] + north * along[1] + steep * along[2]
    aside = east * off[0] + north * off[1] + steep * off[2]
    side, kind, c = np.nonzero(good & (np.abs(aside) < np.float32(OFF) * forward))
    return kind, c, bearing[side, of_slope[kind], c]


def _most_evident(at: Array, ways: Array, lengths_mm: Array, seen: DirectionalEdgeMap) -> Index:
    """Return of corners at (N, 3) from a camera, whose edges (N, 2) point along ways (2, N, 3), those MOST_GUESSES
    whose edges it has most of."""
    nats = np.zeros(len(at), np.float32)
    start = ((at[:, :2] / at[:, 2:] - seen.origin) * seen.scale).astype(np.float32)
    for k, way in enumerate(ways):
        end = at + lengths_mm[:, k, None] * way
        shift = ((end[:, :2] / end[:, 2:] - seen.origin) * seen.scale).astype(np.float32) - start
        nats += seen.of_lines(start, shift, SHARES)[0]
    best = np.flatnonzero(nats > 0)
    return best[np.argsort(-nats[best], kind="stable")[:MOST_GUESSES]]
