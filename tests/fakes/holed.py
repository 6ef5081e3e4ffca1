"""Blocks with one hole, in pairs that differ by it alone: there or not, its place, its radius, its shape, its depth.

A kind's name and a seed give a pair. Even seeds are for tuning; odd seeds are held out, and no choice may depend on
their results.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from daemon.arrays import Array
from daemon.teaching.solid_from_mesh import Drawing
from drivers.simcell.parts import PartShape
from tests.fakes.drawn import CUBE_RINGS, box, obj
from tests.fakes.machined import drawing, shown_shape

QUARTER = 12
"""The number of corners of a rim in each quadrant."""


class Holed(NamedTuple):
    """One part of a pair: its drawing, and its shape in the simulated cell."""

    label: str
    drawing: Drawing
    shape: PartShape


def rounded(width: float, height: float, radius: float) -> Array:
    """(4 QUARTER, 2) a rectangle with round corners about the origin, from +x anticlockwise; a circle where both sides
    are twice the radius."""
    turns = np.pi / 2 * (np.arange(4 * QUARTER) + 0.5) / QUARTER
    x, y = np.cos(turns), np.sin(turns)
    return np.column_stack([
        radius * x + np.sign(x) * (width / 2 - radius), radius * y + np.sign(y) * (height / 2 - radius)])  # fmt: skip


def holed_block(
    sides: Array, rim: Array | None, at: tuple[float, float], depth: float | None = None
) -> tuple[Array, list[tuple[int, ...]]]:
    """Corners and rings of a box with a hole along z: rim (4 N, 2) about a place of its top, through all of it or so
    deep."""
    corners, rings = box(*sides)
    if rim is None:
        return corners, list(rings)
    count, quarter = len(rim), len(rim) // 4
    low = 0.0 if depth is None else sides[2] - depth
    ends = [np.column_stack([rim + at, np.full(count, z)]) for z in (sides[2], low)]
    top, bottom = 8, 8 + count
    walls = [(top + k, top + (k + 1) % count, bottom + (k + 1) % count, bottom + k) for k in range(count)]
    upper, lower = (7, 3, 1, 5), (6, 2, 0, 4)  # the box's corners by quadrant
    made = [ring for ring in rings if ring not in (CUBE_RINGS[5], CUBE_RINGS[4])]
    made = [wall[::-1] for wall in walls] + made + _about(top, count, quarter, upper)
    if depth is None:
        made += [ring[::-1] for ring in _about(bottom, count, quarter, lower)]
    else:
        made += [CUBE_RINGS[4], tuple(range(bottom, bottom + count))]
    return np.vstack([corners, *ends]), made


def _about(first: int, count: int, quarter: int, outer: tuple[int, ...]) -> list[tuple[int, ...]]:
    """Triangles between a rim and the corners around it, anticlockwise as seen from the rim's side."""
    found: list[tuple[int, ...]] = []
    for k in range(count):
        after = (k + 1) % count
        corner, beyond = outer[k // quarter], outer[after // quarter]
        found.append((first + after, first + k, corner))
        if beyond != corner:
            found.append((first + after, corner, beyond))
    return found


Draw = Callable[[np.random.Generator], tuple[tuple[Array, list[tuple[int, ...]]], ...]]


def _pair(kind: str) -> Draw:
    def drawn(rng: np.random.Generator) -> tuple[tuple[Array, list[tuple[int, ...]]], ...]:
        sides = np.array([rng.uniform(48, 72), rng.uniform(34, 48), rng.uniform(14, 30)])
        radius = rng.uniform(4.0, 8.0)
        at = float(sides[0] * rng.uniform(0.55, 0.72)), float(sides[1] * rng.uniform(0.4, 0.6))

        def bored(factor: float, moved: float = 0.0) -> tuple[Array, list[tuple[int, ...]]]:
            own = radius * factor
            return holed_block(sides, rounded(2 * own, 2 * own, own), (at[0] - moved, at[1]))

        match kind:
            case "bore":
                return holed_block(sides, None, at), bored(1.0)
            case "place":
                return bored(1.0), bored(1.0, rng.uniform(4.0, 7.0))
            case "radius_20" | "radius_10" | "radius_5":
                return bored(1.0), bored(1.0 + int(kind.split("_")[1]) / 100)
            case "slot":
                slot = rounded(2 * radius + rng.uniform(7, 12), 2 * radius, radius)
                return bored(1.0), holed_block(sides, slot, at)
            case _:
                pocket = rounded(rng.uniform(11, 16), rng.uniform(11, 16), 0.5)
                return holed_block(sides, None, at), holed_block(sides, pocket, at, rng.uniform(4, 8))

    return drawn


KINDS = ("bore", "place", "radius_20", "radius_10", "radius_5", "slot", "pocket")


def holed_pair(kind: str, seed: int) -> tuple[Holed, Holed]:
    """The pair of a kind and seed."""
    rng = np.random.default_rng([*kind.encode(), seed])
    found = []
    for label, (corners, rings) in zip("ab", _pair(kind)(rng), strict=True):
        made = drawing(f"{label}.obj", obj(corners, rings))
        found.append(Holed(label, made, shown_shape(label, made)))
    return found[0], found[1]


def rounded_pair(radius_mm: float, seed: int) -> tuple[Holed, Holed]:
    """A block with sharp edges, and the same with its four upright edges rounded."""
    rng = np.random.default_rng(seed)
    sides = np.array([rng.uniform(48, 72), rng.uniform(34, 48), rng.uniform(14, 30)])
    rim = rounded(sides[0], sides[1], radius_mm) + sides[:2] / 2
    count = len(rim)
    corners = np.vstack([np.column_stack([rim, np.full(count, z)]) for z in (sides[2], 0.0)])
    walls = [(k, count + k, count + (k + 1) % count, (k + 1) % count) for k in range(count)]
    rings = [tuple(range(count)), tuple(range(2 * count - 1, count - 1, -1)), *walls]
    found = []
    for label, (points, faces) in zip(("sharp", "rounded"), (box(*sides), (corners, rings)), strict=True):
        made = drawing(f"{label}.obj", obj(points, faces))
        found.append(Holed(label, made, shown_shape(label, made)))
    return found[0], found[1]
