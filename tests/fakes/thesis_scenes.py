"""The thesis's pictures made again by the simulated cell's renderer, with exact truth: box, views, silhouettes.

Sources: D'Souza, figure 4.1 (objects), figures 5.6, 5.7 (box and distances), 5.22 (six training views), chapter 4
(512 x 480 pixels, converging cameras 200 mm apart). Elevations of the views are ours: the thesis has only pictures.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cache
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from daemon import frames
from daemon.arrays import Array
from daemon.vision.geometry import Camera, StereoRig
from drivers.simcell.light import CellLight
from drivers.simcell.optics import LensCamera
from drivers.simcell.parts import PartShape, box, part_shape, shape
from drivers.simcell.render import PixelRays, RenderedSolid, radiance
from drivers.simcell.truth import Lamp, Lighting
from tests.fakes.pictures import TABLE, looking
from tests.fakes.rigs import STRAIGHT
from tests.fakes.rigs import rig as any_rig

Picture = NDArray[np.uint8]
NOISE, BLUR_PX = 2.0, 0.6
LEAST_FACING = 0.1
BOX = shape("box", box((0, 0, 0), (64, 63, 64)))
TRAINING = (
    ("cube", (4, 4, 4)),
    ("pyramid", (3, 3, 3, 3)),
    ("pyramid", (3, 3, 4)),
    ("triangular_prism", (3, 4, 4)),
    ("pentagonal_prism", (4, 4, 4, 5)),
    ("pentagonal_prism", (4, 4, 5)),
)
"""Figure 5.22 and section 5.6: part, and the numbers of corners of the facets that the view shows."""
LIT = Lighting(
    ambient=95.0,
    lamps=[
        Lamp(position_mm=[100.0, -700.0, 500.0], radius_mm=60.0, level=190.0),
        Lamp(position_mm=[900.0, 900.0, 400.0], radius_mm=60.0, level=100.0),
    ],
    gloss=0.0,
    facet_albedo=0.8,
    table_albedo=0.15,
)
"""Every face of a part has a different grey, and the table is darker than all of them."""


class Shot(NamedTuple):
    """A stereo pair of one part; cyclopean_from_part (4, 4) mm; facets (N, 3) mm, cyclopean, that both cameras see."""

    left: Picture
    right: Picture
    label: str
    cyclopean_from_part: Array
    facets_mm: list[Array]


def shot(
    part: PartShape,
    rest: int,
    elevation_deg: float,
    azimuth_deg: float,
    distance_mm: float,
    rig: StereoRig,
    seed: int = 0,
) -> Shot:
    """An image pair of a part on one of its stable faces in the table's middle, from a direction and a distance."""
    rng = np.random.default_rng(seed)
    world_from_part, pose = laid(part, rest, elevation_deg, azimuth_deg, distance_mm)
    light = CellLight(TABLE, LIT)
    light.cast([frames.apply(world_from_part, piece.vertices) for piece in part.pieces])
    things = [RenderedSolid(piece, world_from_part, LIT.facet_albedo) for piece in part.pieces]
    left, right = (_exposed(_sharp(one, rig.image_size, pose, things, light), rng) for one in (rig.left, rig.right))
    cyclopean_from_part = frames.inverse(pose) @ world_from_part
    return Shot(left, right, part.label, cyclopean_from_part, _seen(part, cyclopean_from_part, rig))


def box_shots(
    rig: StereoRig, distances_mm: Sequence[float], turns_deg: Sequence[float] = (40.0, 45.0, 50.0)
) -> Iterator[tuple[float, Shot]]:
    """The box of figure 5.6 at each distance, turned several ways: three of its faces in view."""
    for mm in distances_mm:
        for k, turn in enumerate(turns_deg):
            yield mm, shot(BOX, 0, 35.0, turn, mm, rig, seed=k)


def training_shots(rig: StereoRig, distance_mm: float = 560.0) -> list[Shot]:
    """The six views of figure 5.22."""
    return [
        shot(part_shape(name), *_clearest(name, wanted, rig.baseline_mm, distance_mm), distance_mm, rig)
        for name, wanted in TRAINING
    ]


def other_shots(rig: StereoRig, each: int, seed: int = 5) -> Iterator[Shot]:
    """Random views of each part: any stable face, any azimuth, elevation 25 to 75 degrees, 500 to 700 mm away."""
    rng = np.random.default_rng(seed)
    for name in dict.fromkeys(name for name, *_ in TRAINING):
        for k in range(each):
            rest = int(rng.integers(len(part_shape(name).rests)))
            up, turn, mm = rng.uniform(25, 75), rng.uniform(0, 360), rng.uniform(500, 700)
            yield shot(part_shape(name), rest, up, turn, mm, rig, seed + k)


def rig_of(baseline_mm: float, fixation_mm: float) -> StereoRig:
    """The thesis's cameras with another baseline, converging at a distance (infinity: parallel)."""
    centre = (255.5, 239.5)
    return any_rig(
        baseline_mm,
        float(np.arctan2(baseline_mm / 2, fixation_mm)),
        (760.0, 760.0),
        (centre, centre),
        STRAIGHT,
        (512, 480),
    )


def silhouette_picture(
    name: str, shift_px: tuple[int, int] = (0, 0), turn_deg: float = 0.0, scale: float = 1.0
) -> Picture:
    """One of the objects of figure 4.1, dark on a light background, 512 x 480, with sensor noise."""
    image = np.full((480 * 4, 512 * 4), 225.0, np.float32)
    middle = np.array([256 + shift_px[0], 240 + shift_px[1]], float)
    turn = np.deg2rad(turn_deg + LAID_DEG.get(name, 0.0))
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    for outline, grey in OUTLINES[name]:
        points = ((np.array(outline, float) * scale) @ rotation.T + middle) * 4
        cv2.fillPoly(image, [np.rint(points).astype(np.int32)], grey)
    small = cv2.resize(image, (512, 480), interpolation=cv2.INTER_AREA)
    noisy = small + np.random.default_rng(1).normal(0, NOISE, small.shape)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


def corner_picture(angle_deg: float, turn_deg: float, seed: int) -> tuple[NDArray[np.float32], Array]:
    """A light triangle on a dark background, 120 x 120 grey levels with sensor noise; where its corner of that angle
    is (2,), px."""
    ways = np.deg2rad([turn_deg, turn_deg + angle_deg])
    legs = 180 * np.stack([np.cos(ways), np.sin(ways)], 1)
    image = np.full((480, 480), 60.0, np.float32)
    cv2.fillPoly(image, [np.rint((np.vstack([np.zeros(2), legs]) + 240) * 16).astype(np.int32)], 170.0, shift=4)
    small = cv2.resize(image, (120, 120), interpolation=cv2.INTER_AREA)
    noise = np.random.default_rng(seed).normal(0, NOISE, small.shape)
    return (small + noise).astype(np.float32), np.full(2, 240 / 4 - 0.375)


def corner_face(angle_deg: float, turn_deg: float, rig: StereoRig, seed: int) -> tuple[Picture, Picture, Array]:
    """A light face, 60 mm wide and square to the view at 560 mm, as a house with a gable of that angle; both pictures
    with sensor noise, and where the gable's corner is in the left one (2,), px."""
    gable = 30 / np.tan(np.deg2rad(angle_deg) / 2)
    outline = np.array([(0, 0), (30, gable), (30, gable + 40), (-30, gable + 40), (-30, gable)], float)
    turn = np.deg2rad(turn_deg)
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    points = np.column_stack([(outline - outline.mean(0)) @ rotation.T, np.full(5, 560.0)])
    rng, pictures = np.random.default_rng(seed), []
    for camera in (rig.left, rig.right):
        image = np.full((480 * 4, 512 * 4), 60.0, np.float32)
        # A pixel's middle is its place, and four small pixels are one: hence the half pixels.
        corners = ((camera.project(points) + 0.5) * 4 - 0.5) * 16
        cv2.fillPoly(image, [np.rint(corners).astype(np.int32)], 170.0, shift=4)
        pictures.append(_exposed(cv2.resize(image, (512, 480), interpolation=cv2.INTER_AREA), rng))
    return pictures[0], pictures[1], np.asarray(rig.left.project(points[:1])[0])


def _disc(radius: float) -> list[tuple[float, float]]:
    angle = np.linspace(0, 2 * np.pi, 72, endpoint=False)
    return [(float(radius * np.cos(a)), float(radius * np.sin(a))) for a in angle]


def _rectangle(x0: float, y0: float, x1: float, y1: float) -> list[tuple[float, float]]:
    return [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]


LIGHT, DARK = 225.0, 45.0
LAID_DEG = {"floppy": 20.0}
"""The floppy does not lie along the grid: a disc and a square frame that both fill it share 0.60 of the disc's cells,
which no vigilance of 0.4 would tell apart."""
OUTLINES: dict[str, list[tuple[list[tuple[float, float]], float]]] = {
    "floppy": [
        (_rectangle(-90, -90, 90, 90), DARK),
        (_rectangle(-50, -84, 50, -30), LIGHT),
        (_rectangle(-60, 20, 60, 84), LIGHT),
    ],
    "cork": [(_disc(80), DARK)],
    "pen": [(_rectangle(-8, -110, 8, 70), DARK), ([(-8, 74), (8, 74), (0, 110)], DARK)],
    "screwdriver": [
        (_rectangle(-22, -110, 22, -20), DARK),
        (_rectangle(-5, -18, 5, 100), DARK),
        (_rectangle(-9, 100, 9, 110), DARK),
    ],
}
"""Polygons (px about the picture's middle) and their grey levels: drawn after the thesis's description."""


def laid(
    part: PartShape, rest: int, elevation_deg: float, azimuth_deg: float, distance_mm: float
) -> tuple[Array, Array]:
    """world_from_part on the table, and world_from_cyclopean of cameras that look at its middle."""
    middle = np.array([*TABLE.centre_mm, TABLE.height_mm])
    world_from_part = frames.rigid(np.eye(3), middle) @ part.rests[rest]
    at = frames.apply(world_from_part, part.centre_of_mass[None])[0]
    up, around = np.deg2rad([elevation_deg, azimuth_deg])
    away = np.array([np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)])
    return world_from_part, looking((at + distance_mm * away).tolist(), at.tolist())


ROUNDING = 1e-9


@cache
def _clearest(name: str, wanted: tuple[int, ...], baseline_mm: float, distance_mm: float) -> tuple[int, float, float]:
    """The rest, elevation and azimuth from which both cameras see just these facets, each as squarely as can be; of
    views that are the same by the part's symmetry the last, on whatever computer."""
    part, best, found = part_shape(name), 0.0, (0, 0.0, 0.0)
    for rest in range(len(part.rests)):
        for up in range(25, 81, 5):
            for turn in range(0, 360, 10):
                world_from_part, pose = laid(part, rest, up, turn, distance_mm)
                facing = _facing(part, frames.inverse(pose) @ world_from_part, baseline_mm)
                shown = [len(face) for face, f in zip(part.hull.faces, facing, strict=True) if f > 0]
                if tuple(sorted(shown)) == wanted and facing[facing > 0].min() > best - ROUNDING:
                    best, found = float(facing[facing > 0].min()), (rest, float(up), float(turn))
    return found


def _facing(part: PartShape, cyclopean_from_part: Array, baseline_mm: float) -> Array:
    """Cosine (F,) between each face's normal and the less favourable camera's direction."""
    corners = frames.apply(cyclopean_from_part, part.hull.vertices)
    middles = np.array([corners[list(face)].mean(0) for face in part.hull.faces])
    normals = part.hull.normals @ cyclopean_from_part[:3, :3].T
    cosines = []
    for x in (-baseline_mm / 2, baseline_mm / 2):
        towards = np.array([x, 0.0, 0.0]) - middles
        cosines.append((normals * towards).sum(1) / np.linalg.norm(towards, axis=1))
    return np.minimum(*cosines)


def _sharp(camera: Camera, size: tuple[int, int], pose: Array, things: list[RenderedSolid], light: CellLight) -> Array:
    lens = LensCamera(camera.matrix, camera.distortion, camera.cyclopean_from_camera)
    return np.asarray(radiance(PixelRays(lens, *size), pose, things, light), float)


def _exposed(image: np.ndarray, rng: np.random.Generator) -> Picture:
    blurred = cv2.GaussianBlur(image, (0, 0), BLUR_PX)
    return np.clip(np.rint(blurred + rng.normal(0, NOISE, image.shape)), 0, 255).astype(np.uint8)


def _seen(part: PartShape, cyclopean_from_part: Array, rig: StereoRig) -> list[Array]:
    corners = frames.apply(cyclopean_from_part, part.hull.vertices)
    facing = _facing(part, cyclopean_from_part, rig.baseline_mm)
    return [corners[list(face)] for face, cosine in zip(part.hull.faces, facing, strict=True) if cosine > LEAST_FACING]
