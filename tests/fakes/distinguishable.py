"""Whether a stereo view distinguishes one part from another: the length of edges visible of one but not of the other.

Geometry alone, without the recogniser. The other part is tried in every pose that puts one of its facets on a visible
one, as it is then and after alignment of the nearest corners; the pose with the least difference counts.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from daemon.arrays import Array
from drivers.rigid import apply, inverse, rigid
from drivers.simcell.optics import LensCamera
from drivers.simcell.parts import ConvexSolid, PartShape
from tests.fakes.photographed import cell

Flags = NDArray[np.bool_]
STEP_MM, COARSE = 2.0, 4
FINE_MM = STEP_MM / COARSE
TELLS_MM = 16.0
"""So much edge at least, of both cameras, shows in one of the two and not in the other, where they can be told
apart."""
APART_PX = 1.5
"""Edges nearer than this count as the same edge."""
FIT_MM = 6.0
"""The largest rms distance at which a facet of the other part is placed on a visible one."""
NEAR_MM, ROUNDS = 10.0, 3
APART_MM = 2.0
MOST = 24
"""So many ways are looked at: corners that are nearer than APART_MM are one, and ways with few others come first."""
SKIN_MM = 0.3
"""Least free distance in front of a visible surface point."""


def telling_mm(shape: PartShape, other: PartShape, cyclopean_from_part: Array) -> float:
    """The length of edges, mm in both images, by which a part differs from the other in its most similar pose."""
    cameras = [cell().left.lens(), cell().right.lens()]
    coarse, fine = (
        [_seen(shape, _edge_points(shape, step_mm), cyclopean_from_part, camera) for camera in cameras]
        for step_mm in (STEP_MM, FINE_MM)
    )
    best, theirs_mm = np.inf, _edge_points(other, FINE_MM)
    for pose in _laid(shape, other, cyclopean_from_part)[:MOST]:
        differs = 0.0
        for camera, mine, mine_fine in zip(cameras, coarse, fine, strict=True):
            theirs = _seen(other, theirs_mm, pose, camera)
            differs += STEP_MM * (_alone(mine, theirs) + _alone(theirs[::COARSE], mine_fine))
            if differs >= best:
                break
        best = min(best, differs)
    return best


def _alone(points: Array, others: Array) -> int:
    """How many points (N, 2) px have none of the others (M, 2) near them."""
    if not len(points) or not len(others):
        return len(points)
    away = (points**2).sum(1)[:, None] + (others**2).sum(1) - 2 * points @ others.T
    return int((away.min(1) > APART_PX**2).sum())


def _seen(shape: PartShape, on_edges: Array, pose: Array, camera: LensCamera) -> Array:
    """(N, 2) px: the points (K, 3) of the part's edges that the camera sees."""
    points = apply(pose, on_edges)
    centre = camera.cyclopean_from_camera[:3, 3]
    way = centre - points
    start = points + SKIN_MM * way / np.linalg.norm(way, axis=1, keepdims=True)
    free = np.ones(len(points), bool)
    for piece in shape.pieces:
        free &= ~hides(piece, pose, start, centre)
    return camera.project(points[free])


def _edge_points(shape: PartShape, step_mm: float) -> Array:
    """(N, 3): points along the edges of the pieces, without the seams between pieces."""
    found = []
    for piece in shape.pieces:
        others = [other for other in shape.pieces if other is not piece]
        edges = {tuple(sorted(pair)) for f in piece.faces for pair in zip(f, (*f[1:], f[0]), strict=True)}
        for a, b in sorted(edges):
            start, end = piece.vertices[a], piece.vertices[b]
            share = np.linspace(0, 1, max(2, round(float(np.linalg.norm(end - start)) / step_mm)))[:, None]
            points = start + share * (end - start)
            found.append(points[~_smooth(piece, (a, b), points, others)])
    return np.vstack(found)


def _smooth(piece: ConvexSolid, edge: tuple[int, int], points: Array, others: list[ConvexSolid]) -> Flags:
    """Which points of a piece's edge are on a seam, where another piece continues the surface flat."""
    smooth = np.zeros(len(points), bool)
    normals = [n for f, n in zip(piece.faces, piece.normals, strict=True) if edge[0] in f and edge[1] in f]
    for other in others:
        level = points @ other.normals.T - other.offsets
        inside = (level < 1e-3).all(1)
        for normal in normals:
            along = other.normals @ normal > 1 - 1e-6
            if along.any():
                smooth |= inside & (np.abs(level[:, along]) < 1e-3).any(1)
    return smooth


def hides(piece: ConvexSolid, pose: Array, start: Array, centre: Array) -> Flags:
    """(N,): whether the convex piece is between points (N, 3) and the camera at centre (3,)."""
    back = inverse(pose)
    a, b = apply(back, start), apply(back, centre)
    fall = (b - a) @ piece.normals.T
    room = piece.offsets - a @ piece.normals.T
    with np.errstate(divide="ignore", invalid="ignore"):
        at = room / fall
    enter = np.where(fall < 0, at, -np.inf).max(1)
    leave = np.where(fall > 0, at, np.inf).min(1)
    outside = ((fall == 0) & (room < 0)).any(1)
    return ~outside & (np.minimum(leave, 1.0) - np.maximum(enter, 0.0) > 1e-3)


def _laid(shape: PartShape, other: PartShape, pose: Array) -> list[Array]:
    """cyclopean_from_other (4, 4) of each way to lay the other over the part at a pose, no two alike, those first that
    leave the fewest corners of either without one of the other, and of these those whose corners are nearest."""
    found: dict[bytes, Array] = {}
    mine = apply(pose, np.unique(np.vstack([p.vertices for p in shape.pieces]).round(6), axis=0))
    theirs = np.unique(np.vstack([p.vertices for p in other.pieces]).round(6), axis=0)
    towards = -pose[:3, 3] / np.linalg.norm(pose[:3, 3])
    for piece in (*shape.pieces, shape.hull):  # whose facets the pieces may make up together
        for face, normal in zip(piece.faces, piece.normals, strict=True):
            if pose[:3, :3] @ normal @ towards < 0.05:
                continue
            ring = apply(pose, piece.vertices[list(face)])
            for another in (*other.pieces, other.hull):
                for its in another.faces:
                    if len(its) != len(face):
                        continue
                    for shift in range(len(its)):
                        way, rms = _fit(another.vertices[list(np.roll(its, shift))], ring)
                        if rms < FIT_MM:
                            for one in (way, _drawn_to(way, theirs, mine)):
                                found[(one.round(1) + 0.0).tobytes()] = one

    def lonely(way: Array) -> tuple[int, float]:
        away = np.linalg.norm(apply(way, theirs)[:, None] - mine, axis=2)
        each = np.concatenate([away.min(0), away.min(1)])
        return int((each > APART_MM).sum()), float(each.sum())

    return sorted(found.values(), key=lonely)


def _drawn_to(way: Array, theirs: Array, mine: Array) -> Array:
    """A pose (4, 4) after its corners were aligned with the nearest ones."""
    for _ in range(ROUNDS):
        away = np.linalg.norm(apply(way, theirs)[:, None] - mine, axis=2)
        near = away.min(1) < NEAR_MM
        if near.sum() < 3:
            break
        way = _fit(theirs[near], mine[away.argmin(1)[near]])[0]
    return way


def _fit(points: Array, onto: Array) -> tuple[Array, float]:
    """The rigid motion (4, 4) of points (N, 3) onto others, least squares, and its rms distance, mm (Kabsch)."""
    a, b = points.mean(0), onto.mean(0)
    u, _, vt = np.linalg.svd((onto - b).T @ (points - a))
    rotation = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt
    way = rigid(rotation, b - rotation @ a)
    return way, float(np.sqrt(((apply(way, points) - onto) ** 2).sum(1).mean()))
