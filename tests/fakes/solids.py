"""Parts with exact geometry, and simulated stereo measurements of them: facets with realistic corner noise.

For tests only. Nothing here renders; corners come from geometry and the noise from a stated covariance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from daemon import frames
from daemon.arrays import Array
from daemon.vision.facets.grouping import merge_vertices
from daemon.vision.values import Facet, Group

LATERAL_MM, DEPTH_MM = 0.08, 0.4  # at 350 mm, 700 px focal length, 60 mm base, 0.1 px


@dataclass(frozen=True, eq=False)
class Body:
    """corners_mm (K, 3) and facets, anticlockwise from outside."""

    corners_mm: Array
    facets: tuple[tuple[int, ...], ...]

    def mirrored(self) -> Body:
        """The same part seen in a mirror."""
        return Body(self.corners_mm * [-1, 1, 1], tuple(f[::-1] for f in self.facets))


def prism(base: Array, height_mm: float) -> Body:
    """base (N, 2) anticlockwise, extruded along z."""
    n = len(base)
    low = np.column_stack([base, np.zeros(n)])
    high = np.column_stack([base, np.full(n, height_mm)])
    sides = tuple((i, (i + 1) % n, n + (i + 1) % n, n + i) for i in range(n))
    return Body(np.vstack([low, high]), (tuple(range(n))[::-1], tuple(range(n, 2 * n)), *sides))


def regular(sides: int, length_mm: float) -> Array:
    """(N, 2) regular polygon of that side length."""
    radius = length_mm / 2 / np.sin(np.pi / sides)
    angle = 2 * np.pi * np.arange(sides) / sides
    return radius * np.column_stack([np.cos(angle), np.sin(angle)])


def pyramid(base_mm: float, height_mm: float) -> Body:
    half = base_mm / 2
    corners = np.array([[-half, -half, 0], [half, -half, 0], [half, half, 0], [-half, half, 0], [0, 0, height_mm]])
    return Body(corners, ((3, 2, 1, 0), (0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)))


CUBE = prism(regular(4, 50.0), 50.0)
PYRAMID = pyramid(50.0, 50.0)
TRIANGULAR = prism(regular(3, 50.0), 70.0)
PENTAGONAL = prism(regular(5, 32.0), 70.0)
KNOWN = {"cube": CUBE, "pyramid": PYRAMID, "triangular_prism": TRIANGULAR, "pentagonal_prism": PENTAGONAL}
TETRAHEDRON = Body(
    np.array([[-25, -14.434, 0], [25, -14.434, 0], [0, 28.868, 0], [0, 0, 40.825]]),
    ((2, 1, 0), (0, 1, 3), (1, 2, 3), (2, 0, 3)),
)
L_BASE = np.array([[-22.0, -22], [38, -22], [38, 3], [3, 3], [3, 38], [-22, 38]])
STRANGERS = {
    "hexagonal_prism": prism(regular(6, 28.0), 60.0),
    "l_block": prism(L_BASE, 40.0),
    "tetrahedron": TETRAHEDRON,
    "smaller cube": prism(regular(4, 45.0), 45.0),
    "box": prism(np.array([[0.0, 0], [50, 0], [50, 60], [0, 60]]), 50.0),
    "steeper pyramid": pyramid(50.0, 60.0),
    "wider triangular prism": prism(regular(3, 56.0), 70.0),
    "heptagonal prism": prism(regular(7, 24.0), 60.0),
}


def pose(direction: Array, roll_rad: float, distance_mm: float = 350.0) -> Array:
    """cyclopean_from_part that shows the part from `direction` (in the part frame, towards the camera)."""
    z = -np.asarray(direction, float) / np.linalg.norm(direction)
    aside = np.array([1.0, 0, 0]) if abs(z[0]) < 0.8 else np.array([0, 1.0, 0])
    x = np.cross(aside, z)
    x /= np.linalg.norm(x)
    camera_from_part = np.stack([x, np.cross(z, x), z])
    turn = frames.rotation_from_vector(np.array([0, 0, roll_rad]))
    return frames.rigid(turn @ camera_from_part, np.array([0.0, 0.0, distance_mm]))


def seen_facets(body: Body, cyclopean_from_part: Array, least_facing: float = 0.2) -> list[int]:
    """Indices of the facets turned to the camera."""
    corners = frames.apply(cyclopean_from_part, body.corners_mm)
    found = []
    for index, ring in enumerate(body.facets):
        p = corners[list(ring)]
        normal = np.cross(p - p[0], np.roll(p, -1, axis=0) - p[0]).sum(0)
        normal /= np.linalg.norm(normal)
        if -normal @ p.mean(0) / np.linalg.norm(p.mean(0)) > least_facing:
            found.append(index)
    return found


def measured(corners_mm: Array, rng: np.random.Generator | None, noise: float = 1.0) -> Facet:
    """A facet at (N, 3) mm, with noise of its predicted covariance; rng None: exact corners, the same covariance."""
    rays = corners_mm / np.linalg.norm(corners_mm, axis=1, keepdims=True)
    along = rays[:, :, None] * rays[:, None, :]
    covariance = noise**2 * (DEPTH_MM**2 * along + LATERAL_MM**2 * (np.eye(3) - along))
    corners = corners_mm
    if rng is not None:
        corners = corners_mm + np.array([rng.multivariate_normal(np.zeros(3), c) for c in covariance])
    px = 700 * corners[:, :2] / corners[:, 2:] + [320, 240]
    shift = np.array([700 * 60, 0]) / corners[:, 2:]
    return Facet(corners, covariance, px + shift / 2, px - shift / 2, np.zeros(len(corners)), 0.0)


def view_of(
    body: Body, cyclopean_from_part: Array, rng: np.random.Generator | None = None, noise: float = 1.0
) -> Group:
    """What one look measures of a part: every facet turned to the camera."""
    corners = frames.apply(cyclopean_from_part, body.corners_mm)
    shown = seen_facets(body, cyclopean_from_part)
    return merge_vertices(tuple(measured(corners[list(body.facets[f])], rng, noise) for f in shown))
