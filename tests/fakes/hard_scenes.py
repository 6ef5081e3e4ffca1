"""Scenes that are hard to recognise: heaps, prints like a part's edges, unknown look-alikes, patterned tables.

Kind, seed and possible parts give a scene. Even seeds are for tuning, odd ones held out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np

from daemon.arrays import Array
from drivers.rigid import apply, inverse, rigid
from drivers.simcell.parts import ConvexSolid, PartShape, shape
from drivers.simcell.render import RenderedSolid
from drivers.simcell.textures import CELL_MM, Pattern
from drivers.simcell.world import World
from tests.fakes.distinguishable import TELLS_MM, hides, telling_mm
from tests.fakes.families import cut
from tests.fakes.heaps import heap
from tests.fakes.many_parts import FAMILIES, DrawnPart
from tests.fakes.photographed import (
    DISTANCE_MM,
    ELEVATION_DEG,
    STRAY_MM,
    TABLES,
    Image,
    cell,
    pose_above,
    print_for,
    taken,
)

Print = Literal["bare", "printed", "edges"]
KINDS: dict[str, tuple[tuple[int, int], bool, Print, bool]] = {
    "alone": ((1, 1), False, "bare", False),
    "patterned": ((1, 1), True, "printed", False),
    "edges": ((1, 1), False, "edges", False),
    "look_alike": ((1, 1), False, "bare", True),
    "heap": ((3, 5), False, "bare", False),
    "all": ((3, 5), True, "edges", True),
}
"""Number of parts, whether the table is patterned, the print on the parts, whether unknown parts are look-alikes."""
STRANGE = 0.4
"""The share of parts that were never taught."""
INSET_MM, LINE_MM = (3.0, 9.0), (0.8, 2.5)
"""How far inside a face's sides print runs along them, and how wide its lines are."""
RESIZED = (0.05, 0.10)
"""The share by which one size of a look-alike differs; at least 2.5 mm."""
LEAST_MM = 2.5
SAMPLES = 60
CUT = ("box", "wedge", "frustum", "triangular_prism", "pentagonal_prism", "hexagonal_prism")


@dataclass(frozen=True, eq=False)
class Body:
    """One part in a scene: its label, whether it is a stranger, its shape, cyclopean_from_part (4, 4) mm; in_view: what
    share of its surface that faces both cameras is hidden from neither by another part or the picture's rim."""

    label: str
    stranger: bool
    shape: PartShape
    cyclopean_from_part: Array
    in_view: float
    tells: bool


@dataclass(frozen=True, eq=False)
class Staged:
    """The images of both cameras, and the true scene."""

    kind: str
    seed: int
    left: Image
    right: Image
    bodies: tuple[Body, ...]


def staged(kind: str, seed: int, known: Sequence[DrawnPart], strangers: Sequence[DrawnPart]) -> Staged:
    """The scene of a kind and seed, from known and unknown parts; look-alikes are made from known ones."""
    (least, most), patterned, ink, alikes = KINDS[kind]
    rng = np.random.default_rng([*kind.encode(), seed])
    shapes, strange, models = list[PartShape](), list[bool](), list[PartShape | None]()
    for k in range(int(rng.integers(least, most + 1))):
        strange.append(bool(rng.random() < STRANGE))
        one = known[int(rng.integers(len(known)))]
        other = strangers[int(rng.integers(len(strangers)))]
        shapes.append(_named(look_alike(one, rng) if alikes else other.shape, k) if strange[-1] else one.shape)
        models.append(one.shape if strange[-1] and alikes else None)
    truth = cell()
    spot = np.array([*np.add(truth.table.centre_mm, rng.uniform(-STRAY_MM, STRAY_MM, 2)), truth.table.height_mm])
    world = World(truth)
    world.draw(shapes)
    heap(world, [s.label for s in shapes], spot, rng)
    middle = np.mean([part.pose[:3, 3] for part in world.parts], axis=0)
    cameras = pose_above(float(rng.uniform(*DISTANCE_MM)), middle, rng, ELEVATION_DEG)
    albedo = truth.lighting.facet_albedo
    things = [
        RenderedSolid(piece, part.pose, albedo, tuple(marks))
        for part in world.parts
        for piece, marks in zip(part.shape.pieces, _prints(part.shape, albedo, ink, rng), strict=True)
    ]
    table = int(rng.integers(TABLES)) if patterned else None
    left, right = taken(table, cameras, tuple(things), int(rng.integers(2**32)))
    poses = [inverse(cameras) @ part.pose for part in world.parts]
    bodies = tuple(
        Body(
            part.label,
            odd,
            part.shape,
            poses[k],
            _in_view(k, [p.shape for p in world.parts], poses, rng),
            like is None or telling_mm(part.shape, like, poses[k]) >= TELLS_MM,
        )
        for k, (part, odd, like) in enumerate(zip(world.parts, strange, models, strict=True))
    )
    return Staged(kind, seed, left, right, bodies)


def look_alike(part: DrawnPart, rng: np.random.Generator) -> PartShape:
    """A part that was never taught and resembles one that was: one size differs, or one corner is cut off."""
    draw, _ = FAMILIES[part.family]
    if part.family in CUT and rng.random() < 0.5:
        corners = draw(*part.sizes).corners
        clouds = cut(corners, int(rng.integers(len(corners))), rng.uniform(0.25, 0.5, 3)).clouds
        return shape(f"{part.label}_cut", *clouds)
    sizes = np.array(part.sizes, float)
    which = int(rng.integers(len(sizes)))
    step = max(LEAST_MM, float(rng.uniform(*RESIZED)) * sizes[which])
    sizes[which] += step if rng.random() < 0.5 else -step
    return shape(f"{part.label}_resized", *draw(*sizes).clouds)


def _named(one: PartShape, number: int) -> PartShape:
    """An unknown part with a name that is unique in the scene."""
    return PartShape(f"stranger_{number}_{one.label}", one.pieces, one.hull, one.centre_of_mass, one.rests)


def _prints(part: PartShape, albedo: float, ink: Print, rng: np.random.Generator) -> list[tuple[Pattern, ...]]:
    if ink == "printed":
        return print_for(part, albedo, rng)
    if ink == "edges":
        return [tuple(_framed(piece, face, albedo, rng) for face in range(len(piece.faces))) for piece in part.pieces]
    return [() for _ in part.pieces]


def _framed(piece: ConvexSolid, face: int, albedo: float, rng: np.random.Generator) -> Pattern:
    """A line along the sides of a face, a little inside them: straight, and of the face's own shape."""
    ring: Array = piece.vertices[list(piece.faces[face])]
    x = (ring[1] - ring[0]) / np.linalg.norm(ring[1] - ring[0])
    axes = np.column_stack([x, np.cross(x, piece.normals[face]), -piece.normals[face]])
    flat = (ring - ring[0]) @ axes[:, :2]
    low = flat.min(axis=0)
    columns, rows = np.ceil((flat.max(axis=0) - low) / CELL_MM).astype(int) + 1
    middle = flat.mean(axis=0)
    to_side = float(np.abs(_from_sides(flat, middle)).min())
    inner = middle + max(1 - float(rng.uniform(*INSET_MM)) / to_side, 0.3) * (flat - middle)
    paper = np.full((rows, columns), round(255 * albedo), np.uint8)
    wide = max(1, round(float(rng.uniform(*LINE_MM)) / CELL_MM))
    tone = int(rng.integers(10, 150))
    cv2.polylines(paper, [np.rint(16 * (inner - low) / CELL_MM).astype(np.int32)], True, tone, wide, cv2.LINE_AA, 4)
    return Pattern(face, np.asarray(paper / 255, np.float32), CELL_MM, rigid(axes, ring[0] + axes[:, :2] @ low))


def _from_sides(flat: Array, point: Array) -> Array:
    """(N,) distance of a point from each side of a polygon (N, 2)."""
    way = np.roll(flat, -1, axis=0) - flat
    off = point - flat
    crossed: Array = (way[:, 0] * off[:, 1] - way[:, 1] * off[:, 0]) / np.linalg.norm(way, axis=1)
    return crossed


def _in_view(which: int, shapes: list[PartShape], poses: list[Array], rng: np.random.Generator) -> float:
    """What share of points of one part's surface that face both cameras is seen by both; the others, or a picture's
    rim, hide the rest."""
    sight = [cell().left.lens(), cell().right.lens()]
    cameras = [camera.cyclopean_from_camera[:3, 3] for camera in sight]
    points, normals = _on_surface(shapes[which], rng)
    points, normals = apply(poses[which], points), normals @ poses[which][:3, :3].T
    facing = np.all([((camera - points) * normals).sum(1) > 0 for camera in cameras], axis=0)
    inside = [camera.project(points) for camera in sight]
    free = facing & np.all([(px > 0) & (px < np.array(cell().image_size)) for px in inside], axis=(0, 2))
    own = facing.copy()
    for camera in cameras:
        way = camera - points
        start = points + way / np.linalg.norm(way, axis=1, keepdims=True)
        for k, (part, pose) in enumerate(zip(shapes, poses, strict=True)):
            for piece in part.pieces:
                hidden = hides(piece, pose, start, camera)
                free &= ~hidden
                own &= ~hidden if k == which else True
    return float(free.sum() / max(own.sum(), 1))


def _on_surface(part: PartShape, rng: np.random.Generator) -> tuple[Array, Array]:
    """Points (N, 3) on the faces of the pieces, and the normal of each."""
    points, normals = [], []
    for piece in part.pieces:
        for face, normal in zip(piece.faces, piece.normals, strict=True):
            shares = rng.dirichlet(np.ones(len(face)), SAMPLES)
            points.append(shares @ piece.vertices[list(face)])
            normals.append(np.repeat(normal[None], SAMPLES, axis=0))
    return np.vstack(points), np.vstack(normals)
