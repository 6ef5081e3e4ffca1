"""Random textures of tables and prints on parts, as albedo. One seed gives one texture."""

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.arrays import Array
from drivers.rigid import rigid
from drivers.simcell.optics import Array32
from drivers.simcell.parts import ConvexSolid

TableKind = Literal["plain", "patterned"]
PartsKind = Literal["plain", "printed"]
Paper = NDArray[np.uint8]
CELL_MM = 0.25
PRINTED_SHARE = 0.8
"""Share of a part's faces with a print."""
DARKEST, LIGHTEST = 0.05, 0.95
WORDS = ("TOP", "LOT 318", "TYPE K", "8 x 40", "No 52", "KEEP FLAT", "24 V", "PASSED", "REV 3", "50 mm")
STRETCH = 0.35
"""Standard deviation of a table's albedo over its mean."""


@dataclass(frozen=True, eq=False)
class Pattern:
    """A print on one face of a solid: cells (rows, columns) albedo, cell_mm wide, in the plane z = 0 of print.

    solid_from_print: x along a row, y down the rows, the first cell's outer corner at the origin.
    """

    face: int
    cells: Array32
    cell_mm: float
    solid_from_print: Array


def table_factors(rng: np.random.Generator, size: int, texel_mm: float) -> Array32:
    """Factors (size, size) of a table's albedo, mean 1: wood, a woven belt, painted bands, or concrete."""
    pattern = (_wood, _belt, _bands, _concrete)[int(rng.integers(4))](rng, size, texel_mm)
    factors = np.clip(1.0 + STRETCH * (pattern - pattern.mean()) / pattern.std(), 0.15, 2.5)
    return np.asarray(factors, np.float32)


def _wood(rng: np.random.Generator, size: int, texel_mm: float) -> Array32:
    grain = cv2.GaussianBlur(_noise(rng, size), (0, 0), sigmaX=25 / texel_mm, sigmaY=1.0 / texel_mm)
    return np.asarray(grain / grain.std() + 0.4 * _noise(rng, size), np.float32)


def _belt(rng: np.random.Generator, size: int, texel_mm: float) -> Array32:
    across, along = _turned(rng, size, texel_mm)
    pitch = rng.uniform(5, 14)
    return np.asarray(np.sin(2 * np.pi * across / pitch) * np.sin(2 * np.pi * along / pitch) + 0.3 * _noise(rng, size))


def _bands(rng: np.random.Generator, size: int, texel_mm: float) -> Array32:
    across, _ = _turned(rng, size, texel_mm)
    edges = np.cumsum(rng.uniform(8, 45, 400)) - 2000
    levels = rng.uniform(-1, 1, len(edges) + 1).astype(np.float32)
    return levels[np.searchsorted(edges, across)] + 0.2 * _noise(rng, size)


def _concrete(rng: np.random.Generator, size: int, texel_mm: float) -> Array32:
    layers = [cv2.GaussianBlur(_noise(rng, size), (0, 0), mm / texel_mm) for mm in (1.5, 6.0, 30.0)]
    return np.asarray(sum(layer / layer.std() for layer in layers), np.float32)


def _noise(rng: np.random.Generator, size: int) -> Array32:
    return rng.standard_normal((size, size), dtype=np.float32)


def _turned(rng: np.random.Generator, size: int, texel_mm: float) -> tuple[Array32, Array32]:
    """Coordinates, mm, across and along a random direction."""
    y, x = np.mgrid[:size, :size].astype(np.float32) * np.float32(texel_mm)
    turn = rng.uniform(0, np.pi)
    cos, sin = np.float32(np.cos(turn)), np.float32(np.sin(turn))
    return x * cos + y * sin, y * cos - x * sin


def printed_faces(solid: ConvexSolid, albedo: float, rng: np.random.Generator) -> tuple[Pattern, ...]:
    """Prints for most faces of a solid of one albedo."""
    return tuple(_printed(solid, face, albedo, rng) for face in range(len(solid.faces)) if rng.random() < PRINTED_SHARE)


def _printed(solid: ConvexSolid, face: int, albedo: float, rng: np.random.Generator) -> Pattern:
    """A print that covers one face, with rows along its first side."""
    ring: Array = solid.vertices[list(solid.faces[face])]
    x = (ring[1] - ring[0]) / np.linalg.norm(ring[1] - ring[0])
    axes = np.column_stack([x, np.cross(x, solid.normals[face]), -solid.normals[face]])
    flat = (ring - ring[0]) @ axes[:, :2]
    low = flat.min(axis=0)
    columns, rows = np.ceil((flat.max(axis=0) - low) / CELL_MM).astype(int) + 1
    paper = np.full((rows, columns), round(255 * albedo), np.uint8)
    (_text, _label, _stripes, _dots, _scratches)[int(rng.integers(5))](paper, rng)
    levels: Array32 = np.clip(paper / 255, DARKEST, LIGHTEST).astype(np.float32)
    return Pattern(face, levels, CELL_MM, rigid(axes, ring[0] + axes[:, :2] @ low))


def _ink(rng: np.random.Generator) -> int:
    return int(rng.integers(10, 150))


def _text(paper: Paper, rng: np.random.Generator) -> None:
    rows, columns = paper.shape
    for _ in range(rng.integers(2, 5)):
        at = int(rng.integers(-columns // 4, columns // 2)), int(rng.integers(rows // 6, rows))
        word, size = str(rng.choice(WORDS)), float(rng.uniform(0.7, 2.2))
        cv2.putText(paper, word, at, int(rng.integers(0, 5)), size, _ink(rng), int(rng.integers(2, 6)), cv2.LINE_AA)


def _label(paper: Paper, rng: np.random.Generator) -> None:
    """A sticker with a bar code and a line of text."""
    (top, left), (high, wide) = (
        (np.array(paper.shape) * rng.uniform(low, most, 2)).astype(int) for low, most in ((0.1, 0.4), (0.4, 0.55))
    )
    sticker = paper[top : top + high, left : left + wide]
    sticker[:] = rng.integers(50, 230)
    bars = np.repeat(rng.random(wide // 4 + 1) < 0.5, 4)[:wide]
    sticker[: high // 2, bars] = 10
    cv2.putText(sticker, str(rng.choice(WORDS)), (4, int(high) - 6), 0, 0.9, 10, 2, cv2.LINE_AA)


def _stripes(paper: Paper, rng: np.random.Generator) -> None:
    for _ in range(rng.integers(1, 4)):
        across = paper if rng.random() < 0.5 else paper.T
        start, width = rng.uniform(0, 0.8), rng.uniform(0.05, 0.3)
        across[int(start * len(across)) : int((start + width) * len(across))] = _ink(rng)


def _dots(paper: Paper, rng: np.random.Generator) -> None:
    pitch, ink = int(rng.integers(24, 64)), _ink(rng)
    for y in range(pitch // 2, paper.shape[0], pitch):
        for x in range(pitch // 2, paper.shape[1], pitch):
            cv2.circle(paper, (x, y), pitch // 4, ink, -1, cv2.LINE_AA)


def _scratches(paper: Paper, rng: np.random.Generator) -> None:
    """Wear: stains, and scratches across the face."""
    stains = cv2.GaussianBlur(rng.standard_normal(paper.shape, dtype=np.float32), (0, 0), float(rng.uniform(6, 20)))
    paper[:] = np.clip(paper + 18 * stains / stains.std(), 0, 255).astype(np.uint8)
    for _ in range(rng.integers(4, 14)):
        a, b = ((int(x), int(y)) for x, y in rng.integers(0, paper.shape[::-1], (2, 2)))
        cv2.line(paper, a, b, _ink(rng), int(rng.integers(1, 3)), cv2.LINE_AA)
