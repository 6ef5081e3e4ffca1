"""Render the radiance of one camera's image by ray casting, without blur and noise.

Pixels crossed by an edge are sampled many times, so that an edge is within about 0.01 px of its projection.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.arrays import Array
from drivers.rigid import apply, inverse
from drivers.simcell.light import CellLight
from drivers.simcell.optics import Array32, LensCamera
from drivers.simcell.parts import ConvexSolid, PartShape
from drivers.simcell.surface import DrawnSurface
from drivers.simcell.textures import Pattern

NOTHING = -1
SAMPLES, STRIDE = 34, 21
NEAREST_MM = 20.0
BULGE_PX = 6
MOST_FACES = 100_000
LEAST_AREA_MM2, EDGE_ON = 1e-6, 1e-3
"""Smaller triangles, and those seen by so small a cosine times their distance in mm, are left out."""
SEAM = np.float32(5e-7)
"""By which a face reaches over its sides, as a share of the distance: rounding leaves no gap between triangles."""


@dataclass(frozen=True, eq=False)
class RenderedSolid:
    """A convex solid in the world: world_from_solid (4, 4) mm, albedo 0 to 1, prints on some of its faces.

    Of a part from a drawing the first piece has the surface, which is what shows; shown: whether the piece itself does;
    pieces: how many solids, from this one on, are the part's.
    """

    solid: ConvexSolid
    world_from_solid: Array
    albedo: float
    patterns: tuple[Pattern, ...] = ()
    surface: DrawnSurface | None = None
    shown: bool = True
    pieces: int = 1


def rendered(
    shape: PartShape, world_from_part: Array, albedo: float, patterns: Sequence[tuple[Pattern, ...]] = ()
) -> tuple[RenderedSolid, ...]:
    """A part as solids to render. patterns: prints on the faces of each piece, or of all."""
    if shape.surface is None:
        ink = patterns or [()] * len(shape.pieces)
        return tuple(
            RenderedSolid(piece, world_from_part, albedo, own) for piece, own in zip(shape.pieces, ink, strict=True)
        )
    count = len(shape.pieces)
    first = RenderedSolid(shape.pieces[0], world_from_part, albedo, (), shape.surface, False, count)
    rest = (RenderedSolid(piece, world_from_part, albedo, shown=False) for piece in shape.pieces[1:])
    return first, *rest


@dataclass(frozen=True, eq=False)
class _Face:
    """A face turned to the camera, in camera coordinates. body: index of its solid; index: its number in the solid, the
    same where there is no edge between.

    turning (2, 3, 3), of a curved surface: the inverse of its corners as
    columns, and the outward normals at them as columns; flat: whether it is of a flat face of a drawing's surface.
    edges (3, m): inward normals of the planes through the optical centre and each side; normal (3,) and distance (mm)
    of the face's plane; window: rows and columns of the pixels it can touch.
    """

    rendered: RenderedSolid
    body: int
    index: int
    edges: Array32
    normal: Array32
    distance: np.float32
    window: tuple[slice, slice]
    pattern: Pattern | None
    print_from_camera: Array32
    turning: Array32 | None = None
    flat: bool = False

    def normals(self, rays: Array32) -> Array32:
        """Outward normals, camera coordinates, where (N, 2) rays meet the face: (3,), or (N, 3) of a curved one."""
        if self.turning is None:
            return self.normal
        straight = np.concatenate([rays, np.ones_like(rays[:, :1])], axis=1)
        shares = np.maximum(straight @ self.turning[0].T, np.float32(1e-6))
        found: Array32 = shares @ self.turning[1].T
        return np.asarray(found / np.linalg.norm(found, axis=1, keepdims=True))

    def points(self, rays: Array32) -> Array32:
        """Intersection (..., 3) mm of (..., 2) rays with the face's plane, camera coordinates."""
        straight = np.concatenate([rays, np.ones_like(rays[..., :1])], axis=-1)
        return straight * self.depth(rays)[..., None]

    def albedo(self, rays: Array32) -> Array32:
        """Albedo (N,) of the face where (N, 2) rays meet it."""
        if self.pattern is None:
            return np.full(len(rays), self.rendered.albedo, np.float32)
        cells = self.pattern.cells
        flat = self.points(rays) @ self.print_from_camera[:2, :3].T + self.print_from_camera[:2, 3]
        column, row = np.floor(flat / np.float32(self.pattern.cell_mm)).astype(np.intp).T
        on = (row >= 0) & (row < cells.shape[0]) & (column >= 0) & (column < cells.shape[1])
        found = np.where(on, cells[np.where(on, row, 0), np.where(on, column, 0)], np.float32(self.rendered.albedo))
        return np.asarray(found, np.float32)

    def depth(self, rays: Array32) -> Array32:
        """Depth z, mm, at which (..., 2) rays meet the face's plane."""
        n = self.normal
        with np.errstate(divide="ignore"):
            met: Array32 = self.distance / (rays[..., 0] * n[0] + rays[..., 1] * n[1] + n[2])
        return met

    def covers(self, rays: Array32) -> NDArray[np.bool_]:
        """Whether each of (..., 2) rays passes inside the face's sides."""
        x, y = rays[..., 0], rays[..., 1]
        inside = np.ones(rays.shape[:-1], bool)
        for a, b, c in self.edges.T:
            inside &= a * x + b * y >= -c - SEAM
        return inside


class PixelRays:
    """The rays of one camera's pixels, computed once: corners between pixels, and samples inside a pixel."""

    def __init__(self, lens: LensCamera, width: int, height: int) -> None:
        self.lens = lens
        self.corners = lens.directions(width, height)
        c = self.corners
        self.centres: Array32 = (c[:-1, :-1] + c[:-1, 1:] + c[1:, :-1] + c[1:, 1:]) * np.float32(0.25)
        a, b = _spread()
        weights = [(1 - a) * (1 - b), a * (1 - b), (1 - a) * b, a * b]
        self.weights = np.stack(weights).astype(np.float32)

    def window(self, pixels: Array) -> tuple[slice, slice] | None:
        """Rows and columns of the pixels that a polygon with (N, 2) px corners can touch; None outside the image."""
        height, width = self.centres.shape[:2]
        low = np.floor(pixels.min(axis=0)).astype(int) - BULGE_PX
        high = np.ceil(pixels.max(axis=0)).astype(int) + BULGE_PX + 1
        if np.any(high <= 0) or low[0] >= width or low[1] >= height:
            return None
        return slice(max(low[1], 0), min(high[1], height)), slice(max(low[0], 0), min(high[0], width))

    def samples(self, rows: NDArray[np.intp], columns: NDArray[np.intp]) -> Array32:
        """Rays (N, SAMPLES, 2) evenly over each of N pixels, bilinear between its corners."""
        c = self.corners
        quad = np.stack(
            [c[rows, columns], c[rows, columns + 1], c[rows + 1, columns], c[rows + 1, columns + 1]], axis=-1
        )
        return np.asarray(np.einsum("nck,ks->nsc", quad, self.weights, optimize=True))


def _spread() -> tuple[Array, Array]:
    """SAMPLES points evenly over the unit square: a centred Fibonacci lattice."""
    index = np.arange(SAMPLES)
    return (index + 0.5) / SAMPLES, (index * STRIDE % SAMPLES + 0.5) / SAMPLES


def radiance(
    pixel_rays: PixelRays, world_from_cyclopean: Array, solids: Sequence[RenderedSolid], light: CellLight
) -> Array32:
    """Render the sharp image (H, W) in grey levels, before blur, vignette, gain and noise.

    solids: first those of the last `light.cast`, in that order, then any others.
    """
    world_from_camera = world_from_cyclopean @ pixel_rays.lens.cyclopean_from_camera
    image = light.table_levels(pixel_rays.centres, world_from_camera)
    faces = [face for k, rendered in enumerate(solids) for face in _facing(rendered, k, pixel_rays, world_from_camera)]
    if not faces:
        return image
    at_corners = _nearest(
        faces, pixel_rays.corners, lambda face: tuple(slice(s.start, s.stop + 1) for s in face.window)
    )
    filled, crossed = _sort_pixels(at_corners, faces, pixel_rays.corners)
    paint = _Painter(faces, world_from_camera, light)
    paint.fill(image, filled, pixel_rays.centres)
    rows, columns = np.nonzero(crossed)
    rays = pixel_rays.samples(rows, columns)

    def near(face: _Face) -> NDArray[np.intp]:
        down, across = face.window
        inside = (rows >= down.start) & (rows < down.stop) & (columns >= across.start) & (columns < across.stop)
        return np.flatnonzero(inside)

    image[rows, columns] = paint.mix(image[rows, columns], _nearest(faces, rays, near), rays, near)
    return image


def _facing(rendered: RenderedSolid, body: int, pixel_rays: PixelRays, world_from_camera: Array) -> list[_Face]:
    """The faces of a solid that are turned to the camera and may be in its image."""
    camera_from_solid = inverse(world_from_camera) @ rendered.world_from_solid
    if rendered.surface is not None:
        return _facing_surface(rendered, rendered.surface, body, pixel_rays, camera_from_solid)
    corners = apply(camera_from_solid, rendered.solid.vertices)
    if corners[:, 2].min() < NEAREST_MM or not rendered.shown:
        return []
    pixels = pixel_rays.lens.project(apply(pixel_rays.lens.cyclopean_from_camera, corners))
    found = []
    for index, loop in enumerate(rendered.solid.faces):
        ring = corners[list(loop)]
        normal = camera_from_solid[:3, :3] @ rendered.solid.normals[index]
        window = pixel_rays.window(pixels[list(loop)])
        if normal @ ring[0] >= 0 or window is None:
            continue
        pattern = next((p for p in rendered.patterns if p.face == index), None)
        on_print = np.eye(4) if pattern is None else inverse(camera_from_solid @ pattern.solid_from_print)
        found.append(_Face(rendered, body, index, *_planes(ring, normal), window, pattern, on_print.astype(np.float32)))
    return found


def _planes(ring: Array, normal: Array) -> tuple[Array32, Array32, np.float32]:
    """Inward normals (3, m) of the planes through the optical centre and each side of a face (m, 3), and its own plane
    with the outward normal (3,). Sides run anticlockwise as seen from outside, where the camera is: inward is left."""
    edges = np.cross(np.roll(ring, -1, axis=0), ring).T
    edges = np.asarray(edges / np.linalg.norm(edges, axis=0))
    return edges.astype(np.float32), normal.astype(np.float32), np.float32(normal @ ring[0])


def _facing_surface(
    rendered: RenderedSolid, surface: DrawnSurface, body: int, pixel_rays: PixelRays, camera_from_solid: Array
) -> list[_Face]:
    """The triangles of a drawing's surface that are turned to the camera and may be in its image."""
    corners = apply(camera_from_solid, surface.corners_mm)
    if corners[:, 2].min() < NEAREST_MM:
        return []
    pixels = pixel_rays.lens.project(apply(pixel_rays.lens.cyclopean_from_camera, corners))
    rings = corners[surface.triangles]
    areas = np.cross(rings[:, 1] - rings[:, 0], rings[:, 2] - rings[:, 0])
    sizes = np.linalg.norm(areas, axis=1)
    seen = (sizes > LEAST_AREA_MM2) & (np.sum(areas * rings[:, 0], axis=1) < -EDGE_ON * sizes)
    found = []
    for index in np.flatnonzero(seen).tolist():
        window = pixel_rays.window(pixels[surface.triangles[index]])
        if window is None:
            continue
        ring, normal, part_of = rings[index], areas[index] / sizes[index], int(surface.part_of[index])
        flat = bool(surface.flat[index])
        at_corners = surface.normals[index] @ camera_from_solid[:3, :3].T
        turning = None if flat else np.stack([np.linalg.inv(ring.T), at_corners.T]).astype(np.float32)
        planes = _planes(ring, normal)
        found.append(_Face(rendered, body, part_of, *planes, window, None, np.eye(4, dtype=np.float32), turning, flat))
    return found


def _nearest(faces: Sequence[_Face], rays: Array32, touched: Callable[[_Face], Any]) -> NDArray[np.int16]:
    """Index (...) of the face that each of (..., 2) rays meets first, NOTHING where it meets only the table.

    touched: index of the rays that may meet a face.
    """
    which = np.full(rays.shape[:-1], NOTHING, np.int16)
    nearest = np.full(which.shape, np.inf, np.float32)
    for number, face in enumerate(faces):
        here = touched(face)
        depth = face.depth(rays[here])
        closer = face.covers(rays[here]) & (depth < nearest[here])
        which[here] = np.where(closer, np.int16(number), which[here])
        nearest[here] = np.where(closer, depth, nearest[here])
    return which


def _sort_pixels(
    which: NDArray[np.int16], faces: Sequence[_Face], corners: Array32
) -> tuple[NDArray[np.int16], NDArray[np.bool_]]:
    """Classify pixels by the faces at their corners: ((H, W) face that fills the pixel, or NOTHING; (H, W) edge
    inside)."""
    groups = np.array([*(MOST_FACES * face.body + face.index for face in faces), NOTHING], np.int32)
    kind = groups[which] * 2
    for number, face in enumerate(faces):
        if face.pattern is not None:
            on = np.nonzero(which == number)
            kind[on] += face.albedo(corners[on]) > 0.5
    first = kind[:-1, :-1]
    crossed = (first != kind[:-1, 1:]) | (first != kind[1:, :-1]) | (first != kind[1:, 1:])
    return np.where(crossed, np.int16(NOTHING), which[:-1, :-1]), crossed


class _Painter:
    """Writes the grey levels of faces to pixels."""

    def __init__(self, faces: Sequence[_Face], world_from_camera: Array, light: CellLight) -> None:
        self._faces, self._light = faces, light
        self._turn: Array32 = world_from_camera[:3, :3].astype(np.float32)
        self._viewer = world_from_camera[:3, 3]

    def fill(self, image: Array32, filled: NDArray[np.int16], centres: Array32) -> None:
        """Paint the pixels (H, W) filled by one face."""
        for number, face in enumerate(self._faces):
            on = np.nonzero(filled[face.window] == number)
            rays = centres[face.window][on]
            image[face.window][on] = self._levels(face, rays, face.albedo(rays))

    def mix(
        self, behind: Array32, which: NDArray[np.int16], rays: Array32, near: Callable[[_Face], NDArray[np.intp]]
    ) -> Array32:
        """Levels (N,) of pixels crossed by edges, from the table's (N,), the faces met (N, SAMPLES), rays (N, SAMPLES,
        2). near: which of them a face may touch.

        A face is lit at the middle of its samples in the pixel: light varies little inside one.
        """
        mixed: Array32 = behind * np.mean(which == NOTHING, axis=1, dtype=np.float32)
        for number, face in enumerate(self._faces):
            some = near(face)
            share = np.asarray(np.mean(which[some] == number, axis=1), np.float32)
            some, share = some[share > 0], share[share > 0]
            weight = (which[some] == number).astype(np.float32) / (share[:, None] * SAMPLES)
            middle = np.einsum("ns,nsc->nc", weight, rays[some])
            albedo = face.albedo(middle)
            if face.pattern is not None:
                each = face.albedo(rays[some].reshape(-1, 2)).reshape(weight.shape)
                albedo = np.einsum("ns,ns->n", weight, each)
            mixed[some] += share * self._levels(face, middle, albedo)
        return mixed

    def _levels(self, face: _Face, rays: Array32, albedo: Array32) -> Array32:
        points = face.points(rays) @ self._turn.T + self._viewer.astype(np.float32)
        normal = (face.normals(rays) @ self._turn.T).astype(float)
        if face.rendered.surface is None:
            loop = face.rendered.solid.faces[face.index]
            return self._light.facet_levels(face.body, loop, points, normal, albedo, self._viewer)
        plate = face.rendered.surface.plates[face.index] if face.flat else None
        ring = None if plate is None else apply(face.rendered.world_from_solid, plate)
        own = range(face.body, face.body + face.rendered.pieces)
        return self._light.surface_levels(own, face.index, ring, points, normal, albedo, self._viewer)
