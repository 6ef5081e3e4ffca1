"""One part on the simulated cell's table as both cameras see it, made from a seed; pictures are kept where asked.

The folder named by FACETD_RENDERED, if it is set, keeps each pair as .npz under a name that says what was rendered, so
that two versions of the recogniser are shown the same pictures, and the second is not kept waiting.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from hashlib import sha256
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from daemon.arrays import Array
from drivers.rigid import apply, inverse, rigid, turn
from drivers.simcell.camera import SimulatedPair, SimulatedScene
from drivers.simcell.parts import ConvexSolid, PartShape
from drivers.simcell.render import RenderedSolid, rendered
from drivers.simcell.textures import Pattern, printed_faces
from drivers.simcell.truth import Truth, load_truth

DISTANCE_MM, ELEVATION_DEG = (280.0, 420.0), (30.0, 70.0)
ETC = Path(__file__).parents[2] / "etc"
STRAY_MM = 40.0
"""The greatest distance of a part from the table's middle, along x and y."""
TABLES = 6
"""The number of patterned tables."""
SAME_PLANE = 1e-6
TRIES = 3000
"""The most views that are drawn in search of a wanted one."""
WELL, HARDLY = 0.10, 0.05
"""Cosines of a facet's normal and a camera's direction: above the first it is seen well, below the second hardly."""
Image = NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class Photograph:
    """left, right (H, W) grey; cyclopean_from_part (4, 4) mm; which table (None: plain) and whether print is on it."""

    left: Image
    right: Image
    cyclopean_from_part: Array
    table: int | None
    printed: bool


def pose_above(
    stand_off_mm: float, at: Array, rng: np.random.Generator, up_deg: tuple[float, float] = (50.0, 75.0)
) -> Array:
    """world_from_cyclopean that looks at a point from any side, at an elevation in degrees, rolled a little."""
    up, around = np.radians(rng.uniform(*up_deg)), rng.uniform(-np.pi, np.pi)
    z = -np.array([np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)])
    x = turn(z, rng.uniform(-0.3, 0.3)) @ np.cross(z, [0, 0, 1])
    x = x / np.linalg.norm(x)
    return rigid(np.column_stack([x, np.cross(z, x), z]), at - stand_off_mm * z)


@cache
def cell() -> Truth:
    """The truth of the simulated cell."""
    return load_truth(ETC / "simcell.yaml")


def photograph(
    shape: PartShape,
    rng: np.random.Generator,
    wanted: Callable[[Array], bool] | None = None,
    distance_mm: tuple[float, float] = DISTANCE_MM,
) -> Photograph:
    """The part alone on the table, on any of its rests and in any turn, from anywhere within distance_mm and
    ELEVATION_DEG; half the tables patterned, half the parts printed. wanted: whether a cyclopean_from_part (4, 4) will
    do. Raises LookupError where none of TRIES does."""
    truth = cell()
    for _ in range(TRIES):
        table = int(rng.integers(TABLES)) if rng.random() < 0.5 else None
        printed = bool(rng.random() < 0.5)
        spot = np.array([*np.add(truth.table.centre_mm, rng.uniform(-STRAY_MM, STRAY_MM, 2)), truth.table.height_mm])
        rest = shape.rests[int(rng.integers(len(shape.rests)))]
        lies = rigid(turn([0, 0, 1], rng.uniform(-np.pi, np.pi)), spot) @ rest
        cameras = pose_above(float(rng.uniform(*distance_mm)), np.array([*spot[:2], lies[2, 3]]), rng, ELEVATION_DEG)
        if wanted is None or wanted(inverse(cameras) @ lies):
            break
    else:
        raise LookupError(f"{shape.label}: none of {TRIES} views is as wanted")
    albedo = truth.lighting.facet_albedo
    prints = print_for(shape, albedo, rng) if printed else [()] * len(shape.pieces)
    things = rendered(shape, lies, albedo, prints)
    left, right = taken(table, cameras, things, int(rng.integers(2**32)))
    return Photograph(left, right, inverse(cameras) @ lies, table, printed)


def seen_by_one(shape: PartShape, cyclopean_from_part: Array) -> bool:
    """Whether both cameras see one facet of a part's hull well, and only one of them sees a second."""
    hull, truth = shape.hull, cell()
    cosines = []
    for camera in (truth.left, truth.right):
        at = apply(inverse(cyclopean_from_part), np.array(camera.cyclopean_from_camera)[:3, 3])
        away = np.array([at - hull.vertices[list(face)].mean(0) for face in hull.faces])
        cosines.append((away * hull.normals).sum(1) / np.linalg.norm(away, axis=1))
    low, high = np.min(cosines, 0), np.max(cosines, 0)
    return int((low > WELL).sum()) == 1 and bool(((high > WELL) & (low < HARDLY)).any())


def print_for(shape: PartShape, albedo: float, rng: np.random.Generator) -> list[tuple[Pattern, ...]]:
    """Print for each piece's faces; a facet that several pieces make up is bare, as print does not go on from one to
    the next."""
    found = []
    for piece in shape.pieces:
        others = [other for other in shape.pieces if other is not piece]
        ink = printed_faces(piece, albedo, rng)
        found.append(tuple(p for p in ink if not any(_goes_on(piece, p.face, other) for other in others)))
    return found


def _goes_on(piece: ConvexSolid, face: int, other: ConvexSolid) -> bool:
    """Whether another piece continues a face in the same plane on the same side."""
    along = other.normals @ piece.normals[face] > 1 - SAME_PLANE
    return bool((along & (np.abs(other.offsets - piece.offsets[face]) < SAME_PLANE * 1000)).any())


def taken(
    table: int | None, world_from_cyclopean: Array, things: tuple[RenderedSolid, ...], seed: int
) -> tuple[Image, Image]:
    """Left and right image (H, W) of objects in front of a table; the sensor noise comes from the seed."""
    kept = os.environ.get("FACETD_RENDERED")
    path = Path(kept) / f"{_mark(table, world_from_cyclopean, things, seed)}.npz" if kept else None
    if path is not None and path.is_file():
        with np.load(path) as file:
            return file["left"], file["right"]
    cameras, stage, noise = _studio(table)
    noise.bit_generator.state = np.random.default_rng(seed).bit_generator.state
    stage[:] = [SimulatedScene(world_from_cyclopean, things, object())]
    pair = cameras.grab(0.0, 2.0)
    if path is not None:
        path.parent.mkdir(parents=True, exist_ok=True)
        beside = path.with_name(f"{os.getpid()}-{path.name}")
        np.savez_compressed(beside, left=pair.left.pixels, right=pair.right.pixels)
        beside.replace(path)
    return pair.left.pixels, pair.right.pixels


@cache
def _studio(table: int | None) -> tuple[SimulatedPair, list[SimulatedScene], np.random.Generator]:
    """Cameras over a table, their scene, and the generator of their noise. Their clock does not run."""
    stage: list[SimulatedScene] = []
    noise = np.random.default_rng()
    pattern = None if table is None else np.random.default_rng(table)
    cameras = SimulatedPair(
        cell(), lambda _: stage[-1], noise, clock=lambda: 0.0, sleep=lambda _: None, table_pattern=pattern
    )
    cameras.open()
    return cameras, stage, noise


def _mark(table: int | None, world_from_cyclopean: Array, things: tuple[RenderedSolid, ...], seed: int) -> str:
    """A digest that identifies an image."""
    told = sha256(f"{table} {seed}".encode() + world_from_cyclopean.tobytes())
    for thing in things:
        told.update(thing.solid.vertices.tobytes() + thing.world_from_solid.tobytes())
        if thing.surface is not None:
            told.update(thing.surface.corners_mm.tobytes() + thing.surface.triangles.tobytes())
        for ink in thing.patterns:
            told.update(ink.cells.tobytes() + bytes([ink.face]))
    return told.hexdigest()[:24]
