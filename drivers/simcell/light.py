"""Light in the cell: what level a facet or the table shows, and the soft shadows parts cast on the table.

Grey levels of a linear sensor, float32. No rays and no pixels (render.py); no noise (camera.py).
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from drivers.simcell.optics import Array32
from drivers.simcell.rigid import Array
from drivers.simcell.truth import Lamp, Lighting, Table

HIGHLIGHT_POWER = 12.0
SHADOW_RAYS = 32
TEXEL_MM = 1.0
FLOOR_LEVEL = 8.0
LAMP_REFERENCE_MM = 1000.0
_SHIFT = 5


def facet_levels(points: Array32, normal: Array, albedo: Array32 | float, eye_mm: Array, lighting: Lighting) -> Array32:
    """(N, 3) world mm on a facet with outward (3,) normal -> (N,) grey levels seen from eye_mm.

    Lambert, inverse square, and a broad highlight (Blinn). No shadow of other parts.
    """
    diffuse = np.full(len(points), lighting.ambient * (0.75 + 0.25 * normal[2]), np.float32)
    shine = np.zeros(len(points), np.float32)
    to_eye = _unit(eye_mm.astype(np.float32) - points)[0]
    for lamp in lighting.lamps:
        to_lamp, distance = _unit(np.asarray(lamp.position_mm, np.float32) - points)
        falling = np.maximum(to_lamp @ normal.astype(np.float32), 0) * (LAMP_REFERENCE_MM / distance) ** 2
        diffuse += lamp.level * falling
        halfway, _ = _unit(to_lamp + to_eye)
        shine += lamp.level * np.maximum(halfway @ normal.astype(np.float32), 0) ** HIGHLIGHT_POWER * (falling > 0)
    levels: Array32 = albedo * diffuse + lighting.gloss * shine
    return levels


def _unit(vectors: Array32) -> tuple[Array32, Array32]:
    length = np.sqrt(np.einsum("ij,ij->i", vectors, vectors))
    return vectors / length[:, None], length


class TableLight:
    """The table top as a map of grey levels, TEXEL_MM apart, with the shadows of what stands on it.

    Bare light is worked out once; `cast` renews the shadows when something has moved.
    """

    def __init__(self, table: Table, lighting: Lighting) -> None:
        self._table, self._lighting = table, lighting
        half = table.half_size_mm
        self._low = np.array(table.centre_mm) - half
        self._size = round(2 * half / TEXEL_MM) + 1
        self._bare = [self._lamp_on_table(lamp) for lamp in lighting.lamps]
        self._map = self._sum([1.0] * len(self._bare), np.zeros((self._size, self._size), np.float32))

    def cast(self, bodies: Sequence[Array]) -> None:
        """Renew the shadows: bodies are the (V, 3) world corners of each convex solid."""
        lit = [self._lit(lamp, bodies) for lamp in self._lighting.lamps]
        self._map = self._outward_in(self._sum(lit, self._crowding(bodies)), bodies)

    def seen_by(self, rays: Array32, world_from_camera: Array) -> Array32:
        """(H, W, 2) camera rays x / z, y / z -> (H, W) grey levels of the bare table they end on."""
        turn, eye = world_from_camera[:3, :3], world_from_camera[:3, 3]
        fall = self._table.height_mm - eye[2]
        # The table point over each ray is a homography of it: eye + fall * direction / direction_z.
        x, y = rays[..., 0], rays[..., 1]
        down = _linear(turn[2], x, y)
        reach = np.float32(fall) / np.where(down * fall > 0, down, np.float32(np.nan))
        column = (_linear(turn[0], x, y) * reach + np.float32(eye[0] - self._low[0])) / np.float32(TEXEL_MM)
        row = (_linear(turn[1], x, y) * reach + np.float32(eye[1] - self._low[1])) / np.float32(TEXEL_MM)
        far = np.float32(4 * self._size)
        where = [np.asarray(np.clip(np.where(np.isnan(c), far, c), -far, far), np.float32) for c in (column, row)]
        seen = cv2.remap(
            self._map, where[0], where[1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=FLOOR_LEVEL
        )
        return np.asarray(seen, np.float32)

    def _lamp_on_table(self, lamp: Lamp) -> Array32:
        steps = np.arange(self._size) * TEXEL_MM
        dx = lamp.position_mm[0] - (self._low[0] + steps)[None, :]
        dy = lamp.position_mm[1] - (self._low[1] + steps)[:, None]
        dz = lamp.position_mm[2] - self._table.height_mm
        squared = dx**2 + dy**2 + dz**2
        return np.asarray(lamp.level * dz * LAMP_REFERENCE_MM**2 / squared**1.5, np.float32)

    def _sum(self, lit: Sequence[Array32 | float], crowding: Array32) -> Array32:
        level = self._lighting.ambient * (1.0 - crowding)
        for bare, share in zip(self._bare, lit, strict=True):
            level = level + bare * share
        total: Array32 = (self._lighting.table_albedo * level).astype(np.float32)
        return total

    def _outward_in(self, levels: Array32, bodies: Sequence[Array]) -> Array32:
        """Give the hidden table under each body the levels just outside it, so that no texel straddles its foot."""
        hidden = np.zeros(levels.shape, np.uint8)
        for corners in bodies:
            foot = corners[corners[:, 2] < self._table.height_mm + 1.0]
            if len(foot) >= 3:
                self._fill(hidden, foot[:, :2], 1)
        if not hidden.any():
            return levels
        open_to_light = 1.0 - hidden.astype(np.float32)
        share = cv2.GaussianBlur(open_to_light, (0, 0), 1.5)
        outside = cv2.GaussianBlur(levels * open_to_light, (0, 0), 1.5) / np.maximum(share, np.float32(1e-6))
        return np.where((hidden > 0) & (share > 1e-4), outside, levels).astype(np.float32)

    def _lit(self, lamp: Lamp, bodies: Sequence[Array]) -> Array32:
        """(size, size) share of the lamp's disc that each table point sees."""
        dark = np.zeros((self._size, self._size), np.uint8)
        shaded = np.zeros_like(dark)
        for spot in _disc(lamp):
            shaded[:] = 0
            for corners in bodies:
                if corners[:, 2].max() < spot[2]:
                    self._fill(shaded, self._shadow(corners, spot), 1)
            cv2.add(dark, shaded, dst=dark)
        return np.asarray(1.0 - dark / np.float32(SHADOW_RAYS), np.float32)

    def _shadow(self, corners: Array, spot: Array) -> Array:
        """(V, 3) corners thrown from the (3,) spot onto the table: (V, 2) world mm."""
        share = (spot[2] - self._table.height_mm) / (spot[2] - corners[:, 2:])
        thrown: Array = spot[:2] + (corners[:, :2] - spot[:2]) * share
        return thrown

    def _crowding(self, bodies: Sequence[Array]) -> Array32:
        """(size, size) share of the ambient light kept off the table by bodies close over it."""
        print_of = np.zeros((self._size, self._size), np.uint8)
        for corners in bodies:
            near = np.clip(1.0 - (corners[:, 2].min() - self._table.height_mm) / 60.0, 0.0, 1.0)
            self._fill(print_of, corners[:, :2], int(140 * near))
        return cv2.GaussianBlur(print_of, (0, 0), 9.0 / TEXEL_MM).astype(np.float32) / 255.0

    def _fill(self, canvas: cv2.typing.MatLike, outline_mm: Array, value: int) -> None:
        points = (outline_mm - self._low) / TEXEL_MM
        points = np.clip(points, -self._size, 2 * self._size)
        ring = cv2.convexHull(np.round(points * 2**_SHIFT).astype(np.int32))
        cv2.fillConvexPoly(canvas, ring, value, shift=_SHIFT)


def _linear(row: Array, x: Array32, y: Array32) -> Array32:
    a, b, c = row.astype(np.float32)
    product: Array32 = a * x + b * y + c
    return product


def _disc(lamp: Lamp) -> Array:
    """(SHADOW_RAYS, 3) points evenly over the lamp's level disc (a sunflower), world mm."""
    k = np.arange(SHADOW_RAYS) + 0.5
    radius, angle = lamp.radius_mm * np.sqrt(k / SHADOW_RAYS), np.pi * (1 + 5**0.5) * k
    flat = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.zeros(SHADOW_RAYS)])
    spots: Array = np.asarray(lamp.position_mm) + flat
    return spots
