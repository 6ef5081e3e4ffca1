"""Illumination of the simulated cell: grey levels of facets and table for a linear sensor, float32."""

from collections.abc import Callable, Sequence
from functools import lru_cache

import cv2
import numpy as np

from drivers.arrays import Array
from drivers.rigid import apply, rigid
from drivers.simcell.optics import Array32
from drivers.simcell.shadows import TEXEL_MM, Patch, lit_share, patch_under
from drivers.simcell.textures import table_factors
from drivers.simcell.truth import Lighting, TableTruth

HIGHLIGHT_POWER = 12.0
FLOOR_LEVEL = 8.0
ABOVE_MM = 0.5
"""How far before a face of its own part a piece reaches that throws a shadow on it."""
LAMP_REFERENCE_MM = 1000.0
CROWDING, CROWDING_MM, CROWDING_HEIGHT_MM = 0.55, 9.0, 60.0


def facet_levels(
    points: Array32,
    normal: Array,
    albedo: Array32 | float,
    viewer_mm: Array,
    lighting: Lighting,
    lit: Sequence[Array32 | None] | None = None,
) -> Array32:
    """Shade (N, 3) world mm on a facet with outward (3,) normal, or on a curved surface with (N, 3) normals -> (N,)
    grey levels seen from viewer_mm.

    Lambert, inverse square, and a broad highlight (Blinn). lit: share (N,) of each lamp visible from each point, None
    for all of it.
    """
    out = np.broadcast_to(normal.astype(np.float32), points.shape)
    diffuse = np.asarray(lighting.ambient * (0.75 + 0.25 * out[:, 2]), np.float32)
    shine = np.zeros(len(points), np.float32)
    to_viewer = _unit(viewer_mm.astype(np.float32) - points)[0]
    for lamp, share in zip(lighting.lamps, lit or [None] * len(lighting.lamps), strict=True):
        to_lamp, distance = _unit(np.asarray(lamp.position_mm, np.float32) - points)
        level = np.float32(lamp.level) if share is None else lamp.level * share
        falling = np.maximum(_along(to_lamp, out), 0) * (LAMP_REFERENCE_MM / distance) ** 2
        diffuse += level * falling
        halfway, _ = _unit(to_lamp + to_viewer)
        shine += level * np.maximum(_along(halfway, out), 0) ** HIGHLIGHT_POWER * (falling > 0)
    return albedo * diffuse + lighting.gloss * shine


def _along(one: Array32, other: Array32) -> Array32:
    """(N,) scalar products of (N, 3)."""
    return np.asarray(np.einsum("ij,ij->i", one, other))


def _unit(vectors: Array32) -> tuple[Array32, Array32]:
    length = np.sqrt(np.einsum("ij,ij->i", vectors, vectors))
    return vectors / length[:, None], length


class CellLight:
    """Illumination of the table, as a map of grey levels, and of the bodies on it. The map is computed when it is first
    needed: many a cell is never looked at."""

    def __init__(self, table: TableTruth, lighting: Lighting, pattern: np.random.Generator | None = None) -> None:
        """pattern: random generator of the table's pattern; None: uniform albedo."""
        self.lighting, self._table = lighting, table
        low = np.array(table.centre_mm) - table.half_size_mm
        size = round(2 * table.half_size_mm / TEXEL_MM) + 1
        self._top = Patch(rigid(np.eye(3), [0.0, 0.0, -table.height_mm]), low, size, size)
        self._factors = None if pattern is None else table_factors(pattern, size, TEXEL_MM)
        self._facets: dict[tuple[int, tuple[int, ...]], tuple[Patch, list[Array32 | None]]] = {}
        self.cast(())

    def cast(self, bodies: Sequence[Array], covered: bool = False) -> None:
        """Compute the shadows of bodies, (V, 3) world corners of each convex solid.

        covered: a plain cloth hides the table's pattern.
        """
        self._bodies, self._cloth = bodies, covered
        self._facets.clear()
        self._map: Array32 | None = None

    def _table_map(self) -> Array32:
        """Grey levels (rows, columns) of the table under the bodies of the last `cast`."""
        level, top_mm = self.lighting.ambient * (1.0 - self._crowding(self._bodies)), self._table.height_mm
        for lamp in self.lighting.lamps:
            share = lit_share(self._top, lamp, self._bodies)
            bare = _lamp_on_table(tuple(lamp.position_mm), lamp.level, self._top.rows, tuple(self._top.low_mm), top_mm)
            level += bare if share is None else bare * share
        if self._factors is not None and not self._cloth:
            level *= self._factors
        return self._extended_under(self.lighting.table_albedo * level, self._bodies)

    def table_levels(self, rays: Array32, world_from_camera: Array) -> Array32:
        """Camera rays (H, W, 2) x / z, y / z -> (H, W) grey levels where they meet the table."""
        self._map = self._table_map() if self._map is None else self._map
        turn, viewer = world_from_camera[:3, :3], world_from_camera[:3, 3]
        fall = self._table.height_mm - viewer[2]
        # The table point over each ray is a homography of it: camera + fall * direction / direction_z.
        x, y = rays[..., 0], rays[..., 1]
        down = _linear(turn[2], x, y)
        reach = np.float32(fall) / np.where(down * fall > 0, down, np.float32(np.nan))
        column = (_linear(turn[0], x, y) * reach + np.float32(viewer[0] - self._top.low_mm[0])) / np.float32(TEXEL_MM)
        row = (_linear(turn[1], x, y) * reach + np.float32(viewer[1] - self._top.low_mm[1])) / np.float32(TEXEL_MM)
        far = np.float32(4 * self._top.rows)
        where = [np.asarray(np.clip(np.where(np.isnan(c), far, c), -far, far), np.float32) for c in (column, row)]
        seen = cv2.remap(
            self._map, where[0], where[1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=FLOOR_LEVEL
        )
        return np.asarray(seen, np.float32)

    def facet_levels(
        self, body: int, loop: tuple[int, ...], points: Array32, normal: Array, albedo: Array32, viewer_mm: Array
    ) -> Array32:
        """Shade (N, 3) world mm on the face with corners `loop` of a body -> (N,) grey levels seen from viewer_mm.

        body: its index in the last `cast`; a larger one is a body outside of it, in no shadow.
        """
        lit = None
        if body < len(self._bodies):
            ring = self._bodies[body][list(loop)]
            lit = self._lit((body, loop), ring, points, lambda number, _: number != body)
        return facet_levels(points, normal, albedo, viewer_mm, self.lighting, lit)

    def surface_levels(
        self,
        own: range,
        part_of: int,
        ring: Array | None,
        points: Array32,
        normal: Array,
        albedo: Array32,
        viewer_mm: Array,
    ) -> Array32:
        """Shade (N, 3) world mm on the surface of a part from a drawing, whose pieces are the bodies `own` of the last
        `cast`. part_of: the number of the face; ring (4, 3): a rectangle round a flat one, None of a curved surface, on
        which the shadows of other bodies are not drawn."""
        lit = None
        if ring is not None and own.stop <= len(self._bodies):
            out = np.cross(ring[1] - ring[0], ring[2] - ring[1])
            out /= np.linalg.norm(out)

            def in_the_way(number: int, corners: Array) -> bool:
                return number not in own or bool(((corners - ring[0]) @ out).max() > ABOVE_MM)

            lit = self._lit((own.start, (-1, part_of)), ring, points, in_the_way)
        return facet_levels(points, normal, albedo, viewer_mm, self.lighting, lit)

    def _lit(
        self, key: tuple[int, tuple[int, ...]], ring: Array, points: Array32, in_the_way: Callable[[int, Array], bool]
    ) -> list[Array32 | None]:
        """The shares (N,) of each lamp at points (N, 3) of a flat face, whose corners are ring (4, 3) or more.

        in_the_way: whether a body, by its number and its corners, may throw a shadow on it.
        """
        if key not in self._facets:
            others = [corners for number, corners in enumerate(self._bodies) if in_the_way(number, corners)]
            patch = patch_under(ring)
            self._facets[key] = patch, [lit_share(patch, lamp, others) for lamp in self.lighting.lamps]
        patch, shares = self._facets[key]
        if not any(share is not None for share in shares):
            return shares
        places = patch.texels(apply(patch.plane_from_world, points.astype(float))[:, :2]).astype(np.float32)
        return [None if share is None else _read(share, places) for share in shares]

    def _crowding(self, bodies: Sequence[Array]) -> Array32:
        """Share (rows, columns) of the ambient light that bodies close to the table block."""
        covered = np.zeros((self._top.rows, self._top.columns), np.uint8)
        for corners in bodies:
            gap_mm = corners[:, 2].min() - self._table.height_mm
            near = np.clip(1.0 - gap_mm / CROWDING_HEIGHT_MM, 0.0, 1.0)
            self._top.fill(covered, corners[:, :2], int(255 * CROWDING * near))
        return np.asarray(cv2.GaussianBlur(covered, (0, 0), CROWDING_MM / TEXEL_MM) / np.float32(255.0), np.float32)

    def _extended_under(self, levels: Array32, bodies: Sequence[Array]) -> Array32:
        """Extend the levels around each body to the hidden table under it, so that no texel mixes both at its edge."""
        hidden = np.zeros(levels.shape, np.uint8)
        for corners in bodies:
            foot = corners[corners[:, 2] < self._table.height_mm + 1.0]
            if len(foot) >= 3:
                self._top.fill(hidden, foot[:, :2], 1)
        if not hidden.any():
            return levels
        open_to_light = 1.0 - hidden.astype(np.float32)
        share = cv2.GaussianBlur(open_to_light, (0, 0), 1.5)
        outside = cv2.GaussianBlur(levels * open_to_light, (0, 0), 1.5) / np.maximum(share, np.float32(1e-6))
        return np.asarray(np.where((hidden > 0) & (share > 1e-4), outside, levels), np.float32)


@lru_cache(maxsize=8)
def _lamp_on_table(
    lamp_mm: tuple[float, ...], lamp_level: float, rows: int, low_mm: tuple[float, ...], top_mm: float
) -> Array32:
    """Grey levels (rows, rows) that a lamp alone gives a white table with nothing on it, from its corner low_mm on."""
    steps = np.arange(rows) * TEXEL_MM
    dx = lamp_mm[0] - (low_mm[0] + steps)[None, :]
    dy = lamp_mm[1] - (low_mm[1] + steps)[:, None]
    dz = lamp_mm[2] - top_mm
    squared = dx**2 + dy**2 + dz**2
    levels = np.asarray(lamp_level * dz * LAMP_REFERENCE_MM**2 / squared**1.5, np.float32)
    levels.setflags(write=False)
    return levels


def _read(texels: Array32, places: Array32) -> Array32:
    """Values of a map at (N, 2) column, row, bilinear."""
    inside = np.clip(places, 0, np.array(texels.shape[::-1]) - np.float32(1.001)).astype(np.float32)
    column, row = inside.astype(np.intp).T
    right, down = (inside - np.floor(inside)).T
    upper = texels[row, column] * (1 - right) + texels[row, column + 1] * right
    lower = texels[row + 1, column] * (1 - right) + texels[row + 1, column + 1] * right
    return np.asarray(upper * (1 - down) + lower * down)


def _linear(row: Array, x: Array32, y: Array32) -> Array32:
    a, b, c = row.astype(np.float32)
    return np.asarray(a * x + b * y + c)
