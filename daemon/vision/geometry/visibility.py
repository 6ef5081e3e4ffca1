"""Which facets of a solid an eye sees whole: those that face it and that nothing else covers in part. Pure."""

from collections.abc import Sequence

import numpy as np

from daemon.arrays import Array, Flags
from daemon.vision.geometry.facet_measures import area_vector
from daemon.vision.geometry.polygon import inside
from daemon.vision.geometry.polyhedron import Polyhedron

FACING = 0.3  # cosine below which a facet is too oblique to count on
INSIDE = 0.95  # where a facet is tried for being covered: its corners and the middles of its sides, drawn in so far
BEFORE_MM = 1.0
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


def hidden(solid: Polyhedron, points: Array, eye: Array) -> Flags:
    """(N,) which points (N, 3) of a solid an eye (3,), in the solid's frame, does not see, as a facet, or what
    else of it hides things, lies before them."""
    covered = np.zeros(len(points), bool)
    rays = points - eye
    far = np.linalg.norm(rays, axis=1)
    for ring, normal in _outside(solid):
        corner = ring[0]
        height = float((eye - corner) @ normal)
        slope = -(rays @ normal)
        before = (height > 0) & (slope * far > 0) & (slope > height)  # the facet's plane is met before the point
        reach = height / np.where(before, slope, 1.0)
        before &= (1 - reach) * far > BEFORE_MM
        if before.any():
            level = np.delete(np.arange(3), np.abs(normal).argmax())
            met = (eye + reach[before, None] * rays[before])[:, level]
            covered[before] |= inside(met, ring[None, :, level])[0]
    return covered


def _outside(solid: Polyhedron) -> list[tuple[Array, Array]]:
    """All that can hide something: corners (N, 3) and the outward unit normal."""
    vectors = [area_vector(cover) for cover in solid.covers]
    covers = [(cover, vector / np.linalg.norm(vector)) for cover, vector in zip(solid.covers, vectors, strict=True)]
    return [*((solid.corners_mm[ring], solid.normals[k]) for k, ring in enumerate(solid.rings)), *covers]


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
