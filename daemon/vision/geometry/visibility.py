"""Which facets of a solid a camera sees whole: those that face it and that nothing else covers in part. Pure."""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from daemon import frames
from daemon.arrays import Array, Flags
from daemon.vision.geometry.facet_measures import area_vector
from daemon.vision.geometry.polygon import inside
from daemon.vision.geometry.polyhedron import PARALLEL, Polyhedron

FACING = 0.3  # cosine below which a facet is too oblique to count on
INSIDE = 0.95  # where a facet is tried for being covered: its corners and the middles of its sides, drawn in so far
BEFORE_MM = 1.0
BEHIND_MM = 1.5  # how far beside an edge it is asked what the solid itself has behind it
EDGE_ON = 1e-3


def visible_from(
    solid: Polyhedron, directions: Array, least_facing: float = FACING, beside: Sequence[Array] = ()
) -> Flags:
    """(D, F) the facets that face a camera in each of the directions (D, 3), far away, and that no other facet covers
    in part.

    least_facing: cosine below which a facet is too oblique to be seen; beside: polygons (N, 3) of other things, in the
    solid's frame, that may cover it as well.
    """
    seen = directions @ solid.normals.T > least_facing
    rings = [*(solid.corners_mm[ring] for ring in solid.rings), *solid.covers, *beside]
    for facet, ring in enumerate(solid.rings):
        corners = solid.corners_mm[ring]
        for other in rings:
            if ((other - corners[0]) @ solid.normals[facet] > BEFORE_MM).any():  # reaches to where it could cover it
                seen[:, facet] &= ~_in_front(other, _tried(corners), directions)
    return np.asarray(seen)


def hidden(solid: Polyhedron, points: Array, viewpoint: Array) -> Flags:
    """(N,) which points (N, 3) of a solid a camera (3,), in the solid's frame, does not see, as a facet, or what
    else of it hides things, lies before them."""
    rings, normals, levels_mm = _outside(solid)
    rays = points - viewpoint
    far = np.linalg.norm(rays, axis=1)[:, None]
    height, slope = normals @ viewpoint - levels_mm, -(rays @ normals.T)
    before = (height > 0) & (slope * far > 0) & (slope > height)  # the plane is met before the point
    reach = height / np.where(before, slope, 1.0)
    before &= (1 - reach) * far > BEFORE_MM
    covered = np.zeros(len(points), bool)
    for k in np.flatnonzero(before.any(0)).tolist():
        asked = np.flatnonzero(before[:, k] & ~covered)
        level = np.delete(np.arange(3), np.abs(normals[k]).argmax())
        met = (viewpoint + reach[asked, k, None] * rays[asked])[:, level]
        covered[asked] = inside(met, rings[k][None, :, level])[0]
    return covered


def encloses(solid: Polyhedron, points: Array) -> Flags:
    """(...) which points (..., 3) lie in a solid, in its frame: facets, each a fan of triangles, fill more than half of
    the directions about them, so that a side that was never taught does not matter. Source: van Oosterom and Strackee,
    The solid angle of a plane triangle, 1983."""
    angles = np.zeros(points.shape[:-1])
    for ring in solid.rings:
        rays = solid.corners_mm[ring] - points[..., None, :]
        far = np.linalg.norm(rays, axis=-1)
        a, b, c = rays[..., :1, :], rays[..., 1:-1, :], rays[..., 2:, :]
        of_a, of_b, of_c = far[..., :1], far[..., 1:-1], far[..., 2:]
        volume = (a * np.cross(b, c)).sum(-1)
        beside = of_a * of_b * of_c + (a * b).sum(-1) * of_c + (b * c).sum(-1) * of_a + (c * a).sum(-1) * of_b
        angles += 2 * np.arctan2(volume, beside).sum(-1)
    return np.asarray(angles > 2 * np.pi)


def in_sight(solid: Polyhedron, places: Array, pose: Array, viewpoint_mm: Array) -> Flags:
    """(...) which places (..., 3) of a solid at cyclopean_from_part (4, 4) are not hidden by the solid itself from a
    camera at viewpoint_mm (3,), cyclopean."""
    if solid.convex:
        return np.ones(places.shape[:-1], bool)
    viewpoint = frames.apply(frames.inverse(pose), viewpoint_mm[None])[0]
    return ~hidden(solid, places.reshape(-1, 3), viewpoint).reshape(places.shape[:-1])


def hides_parallel_facet(solid: Polyhedron, places: Array, viewpoint: Array) -> Flags:
    """(E, S) which places (E, S, 3) along the lines of a solid a camera (3,) in its frame sees before a facet that
    faces the same way as the only one that it sees beside the edge: both are as bright, and no edge shows."""
    found = np.zeros(places.shape[:2], bool)
    for facet, lines, aside in solid.parallel_behind:
        normal, corner = solid.normals[facet], solid.corners_mm[solid.rings[facet][0]]
        of_viewpoint = float((viewpoint - corner) @ normal)
        if of_viewpoint <= 0:
            continue
        there, other = places[lines], solid.sides_of_lines[lines]
        other = np.where((solid.normals[other] @ normal > PARALLEL) & (other >= 0), -1, other).max(1)
        middle = there.mean(1)
        shows = ((viewpoint - middle) * (solid.normals[other] * (other >= 0)[:, None] + solid.walls[lines])).sum(1)
        met = there + BEHIND_MM * aside[:, None]
        height = (met - corner) @ normal
        met = met + (height / np.maximum(of_viewpoint - height, BEFORE_MM))[..., None] * (met - viewpoint)
        level = np.delete(np.arange(3), np.abs(normal).argmax())
        flat, ring = met[..., level].reshape(-1, 2), solid.corners_mm[None, solid.rings[facet]][..., level]
        behind = (height > 0) & (shows <= 0)[:, None] & inside(flat, ring)[0].reshape(height.shape)
        if behind.any():
            behind[behind] = ~hidden(solid, met[behind], viewpoint)
        found[lines] |= behind
    return found


@lru_cache(maxsize=1024)
def _outside(solid: Polyhedron) -> tuple[list[Array], Array, Array]:
    """All that can hide something: corners (N, 3) of each, outward unit normals (F, 3), and how far along these their
    planes lie (F,)."""
    rings = [*(solid.corners_mm[ring] for ring in solid.rings), *solid.covers]
    vectors = np.array([area_vector(cover) for cover in solid.covers]).reshape(-1, 3)
    normals = np.concatenate([solid.normals, vectors / np.linalg.norm(vectors, axis=1, keepdims=True)])
    return rings, normals, (normals * np.array([ring[0] for ring in rings])).sum(1)


def _tried(corners: Array) -> Array:
    """(2N, 3) where a facet is tried for being covered: its corners and the middles of its sides, drawn in a little."""
    middles = (corners + np.roll(corners, -1, axis=0)) / 2
    middle = corners.mean(axis=0)
    return np.asarray(middle + INSIDE * (np.concatenate([corners, middles]) - middle))


def _in_front(ring: Array, points: Array, directions: Array) -> Flags:
    """(D,) whether a ray from any of the points (N, 3) in each direction (D, 3) goes through a polygon (M, 3)."""
    normal = area_vector(ring)
    slope = directions @ normal
    through = np.abs(slope) > EDGE_ON * np.linalg.norm(normal)
    reach = ((ring[0] - points) @ normal) / np.where(through, slope, 1.0)[:, None]
    level = np.delete(np.arange(3), np.abs(normal).argmax())
    met = points[:, level] + reach[..., None] * directions[:, None, level]
    within = inside(met.reshape(-1, 2), ring[None, :, level])[0].reshape(reach.shape)
    return np.asarray(through & (within & (reach > BEFORE_MM)).any(axis=1))
