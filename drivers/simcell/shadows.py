"""Soft shadows: share of a lamp's disc that is visible from each point of a plane, past the bodies in between."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.arrays import Array
from drivers.rigid import apply, inverse, rigid
from drivers.simcell.optics import Array32
from drivers.simcell.truth import Lamp

TEXEL_MM = 1.0
SHADOW_RAYS = 32
CLEARANCE_MM = 0.01
_SHIFT = 5


@dataclass(frozen=True, eq=False)
class Patch:
    """A rectangle of a plane, in texels. plane_from_world (4, 4): z out of it; low_mm (2,): texel (0, 0)."""

    plane_from_world: Array
    low_mm: Array
    rows: int
    columns: int

    def texels(self, points_mm: Array) -> Array:
        """Column and row (N, 2) of points (N, 2) mm in the plane."""
        return (points_mm - self.low_mm) / TEXEL_MM

    def fill(self, canvas: NDArray[np.uint8], outline_mm: Array, value: int) -> None:
        """Write a value to the texels (rows, columns) of canvas covered by the hull of (N, 2) mm."""
        far = 2 * max(self.rows, self.columns)
        places = np.clip(self.texels(outline_mm), -far, far)
        cv2.fillConvexPoly(canvas, cv2.convexHull(np.round(places * 2**_SHIFT).astype(np.int32)), value, shift=_SHIFT)


def patch_under(ring_mm: Array) -> Patch:
    """The patch around a flat polygon (N, 3) world mm, anticlockwise about the outward normal."""
    along = ring_mm[1] - ring_mm[0]
    normal = np.cross(along, ring_mm[2] - ring_mm[1])
    x, z = along / np.linalg.norm(along), normal / np.linalg.norm(normal)
    plane_from_world = inverse(rigid(np.column_stack([x, np.cross(z, x), z]), ring_mm[0]))
    flat = apply(plane_from_world, ring_mm)[:, :2]
    low = flat.min(axis=0) - 2 * TEXEL_MM
    columns, rows = np.ceil((flat.max(axis=0) - low) / TEXEL_MM).astype(int) + 3
    return Patch(plane_from_world, low, int(rows), int(columns))


def lit_share(patch: Patch, lamp: Lamp, bodies: Sequence[Array]) -> Array32 | None:
    """Visible share (rows, columns) of the lamp's disc at each texel; None where no body is in the way.

    bodies: the (V, 3) world corners of convex solids; their volume below the plane casts no shadow on it.
    """
    spots = apply(patch.plane_from_world, _disc(lamp))
    above = [_above(apply(patch.plane_from_world, corners)) for corners in bodies]
    casting = [corners for corners in above if len(corners) and corners[:, 2].max() < spots[:, 2].min()]
    projected = [shadow for shadow in (_projected(corners, spots) for corners in casting) if _may_reach(patch, shadow)]
    if not projected:
        return None
    dark, shaded = np.zeros((2, patch.rows, patch.columns), np.uint8)
    for number in range(len(spots)):
        shaded[:] = 0
        for shadow in projected:
            patch.fill(shaded, shadow[number], 1)
        cv2.add(dark, shaded, dst=dark)
    return np.asarray(1.0 - dark / np.float32(SHADOW_RAYS), np.float32)


def _projected(corners: Array, spots: Array) -> Array:
    """Project (V, 3) corners from (S, 3) spots onto the plane z = 0: (S, V, 2)."""
    level, up = spots[:, None, :2], spots[:, None, 2:]
    return level + (corners[:, :2] - level) * (up / (up - corners[:, 2:]))


def _may_reach(patch: Patch, projected: Array) -> bool:
    places = patch.texels(projected)
    return bool(np.all(places.max(axis=(0, 1)) > 0) and np.all(places.min(axis=(0, 1)) < [patch.columns, patch.rows]))


def _above(corners: Array) -> Array:
    """Clip the hull of (V, 3) corners at z = 0: the (N, 3) corners of its upper side, which may be empty."""
    up = corners[:, 2] > CLEARANCE_MM
    over, under = corners[up], corners[~up]
    if not len(over) or not len(under):
        return over
    a, b = np.repeat(over, len(under), axis=0), np.tile(under, (len(over), 1))
    share = (a[:, 2] / (a[:, 2] - b[:, 2]))[:, None]
    return np.vstack([over, a + share * (b - a)])


def _disc(lamp: Lamp) -> Array:
    """SHADOW_RAYS points evenly over the lamp's level disc (a sunflower pattern), world mm."""
    k = np.arange(SHADOW_RAYS) + 0.5
    radius, angle = lamp.radius_mm * np.sqrt(k / SHADOW_RAYS), np.pi * (1 + 5**0.5) * k
    flat = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.zeros(SHADOW_RAYS)])
    return np.asarray(np.asarray(lamp.position_mm) + flat)
