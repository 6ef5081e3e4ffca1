"""Drawings of many parts such as shops have: boxes, wedges, L and T blocks, prisms, frusta, each family in many sizes.

Everything is random by a seed. A part has a drawing (corners, rings) for teaching, and convex pieces for the simulated
cell to render.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import cycle
from typing import NamedTuple

import numpy as np

from daemon.store.library import load_facets
from daemon.vision.model.model import Model, empty_model, learn_solids
from drivers.simcell.parts import PartShape, shape
from tests.fakes.drawn import obj, prism, solid

Rings = list[tuple[int, ...]]
Outline = list[tuple[float, float]]

LEAST_MM, MOST_MM = 22, 80
"""The bounds of sizes, which are whole millimetres."""
APART_MM = 5
"""The least difference, in at least one size, between two parts of one family."""
TRIES = 2000
"""The most sizes that are drawn before a family counts as full."""


class Drawing(NamedTuple):
    """Corners (K, 3) mm, rings that run anticlockwise from outside, and the clouds whose hulls make up the same."""

    corners: np.ndarray
    rings: Rings
    clouds: tuple[np.ndarray, ...]


@dataclass(frozen=True, eq=False)
class DrawnPart:
    """label, its family, the sizes it was drawn with (mm), its OBJ file, and what the cell shows."""

    label: str
    family: str
    sizes: tuple[int, ...]
    drawing: bytes
    shape: PartShape


def _upright(outline: Outline, height: float, *pieces: Outline) -> Drawing:
    """A prism over an outline, made of prisms over convex pieces of it."""
    corners, rings = prism(outline, height)
    return Drawing(corners, rings, tuple(prism(piece, height)[0] for piece in pieces or (outline,)))


def _rectangle(x0: float, y0: float, x1: float, y1: float) -> Outline:
    return [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]


def regular(sides: int, side_mm: float) -> Outline:
    """A regular polygon about the origin, anticlockwise."""
    turn = 2 * np.pi * np.arange(sides) / sides
    radius = side_mm / 2 / np.sin(np.pi / sides)
    return [(float(radius * np.cos(a)), float(radius * np.sin(a))) for a in turn]


def _box(a: int, b: int, c: int) -> Drawing:
    return _upright(_rectangle(0, 0, a, b), c)


def _wedge(a: int, b: int, c: int) -> Drawing:
    return _upright([(0, 0), (a, 0), (0, b)], c)


def _l_block(a: int, b: int, c: int, arm: int) -> Drawing:
    outline: Outline = [(0, 0), (a, 0), (a, arm), (arm, arm), (arm, b), (0, b)]
    return _upright(outline, c, _rectangle(0, 0, a, arm), _rectangle(0, arm, arm, b))


def _t_block(a: int, b: int, c: int, arm: int) -> Drawing:
    left, right = (a - arm) / 2, (a + arm) / 2
    outline: Outline = [(0, 0), (a, 0), (a, arm), (right, arm), (right, b), (left, b), (left, arm), (0, arm)]
    return _upright(outline, c, _rectangle(0, 0, a, arm), _rectangle(left, arm, right, b))


def _prism(sides: int) -> Callable[..., Drawing]:
    return lambda side, height: _upright(regular(sides, side), height)


def _frustum(a: int, b: int, height: int, top: int) -> Drawing:
    """A frustum of a pyramid: its top is `top` percent of its base."""
    corners, rings = prism(_rectangle(-a / 2, -b / 2, a / 2, b / 2), height)
    corners[4:, :2] *= top / 100
    return Drawing(corners, rings, (corners,))


def _sizes(rng: np.random.Generator, number: int, least: int = LEAST_MM, most: int = MOST_MM) -> tuple[int, ...]:
    return tuple(int(v) for v in rng.integers(least, most + 1, number))


def _with_arm(rng: np.random.Generator) -> tuple[int, ...]:
    a, b, c = *_sizes(rng, 2, 45), *_sizes(rng, 1, 20, 60)
    return a, b, c, int(rng.integers(15, min(a, b) - 20))


FAMILIES: dict[str, tuple[Callable[..., Drawing], Callable[[np.random.Generator], tuple[int, ...]]]] = {
    "box": (_box, lambda rng: tuple(sorted(_sizes(rng, 3)))),
    "l_block": (_l_block, _with_arm),
    "wedge": (_wedge, lambda rng: (*sorted(_sizes(rng, 2, 30)), *_sizes(rng, 1))),
    "frustum": (_frustum, lambda rng: (*sorted(_sizes(rng, 2, 35)), *_sizes(rng, 1, 20, 60), *_sizes(rng, 1, 45, 80))),
    "triangular_prism": (_prism(3), lambda rng: (*_sizes(rng, 1, 35, 70), *_sizes(rng, 1, 25))),
    "t_block": (_t_block, _with_arm),
    "pentagonal_prism": (_prism(5), lambda rng: (*_sizes(rng, 1, 20, 42), *_sizes(rng, 1, 25))),
    "hexagonal_prism": (_prism(6), lambda rng: (*_sizes(rng, 1, 18, 36), *_sizes(rng, 1, 25))),
}  # fmt: skip


def drawn_parts(number: int, seed: int = 0) -> tuple[DrawnPart, ...]:
    """So many parts, family by family in turn, no two alike. A family in whose sizes there is no room for another is
    left out from then on: of a thousand parts most are blocks, wedges and frusta, which have many sizes."""
    rng = np.random.default_rng(seed)
    known: dict[str, list[tuple[int, ...]]] = {family: [] for family in FAMILIES}
    found: list[DrawnPart] = []
    for family in cycle(FAMILIES):
        if family not in known:
            continue
        draw, sized = FAMILIES[family]
        tried = (sized(rng) for _ in range(TRIES))
        sizes = next((s for s in tried if not any(_alike(s, other) for other in known[family])), None)
        if sizes is None:
            del known[family]
            if not known:
                raise ValueError(f"{number} parts: no family has room for more than {len(found)} in all")
            continue
        drawing = draw(*sizes)
        label = "_".join([family, *map(str, sizes)])
        known[family].append(sizes)
        content = obj(drawing.corners, drawing.rings)
        found.append(DrawnPart(label, family, sizes, content, shape(label, *drawing.clouds)))
        if len(found) == number:
            break
    return tuple(found)


def _alike(one: tuple[int, ...], other: tuple[int, ...]) -> bool:
    return max(abs(a - b) for a, b in zip(one, other, strict=True)) < APART_MM


def taught(parts: tuple[DrawnPart, ...], start: Model | None = None) -> Model:
    """A model that has learnt their drawings, on top of what it knew."""
    drawn = [(part.label, solid(f"{part.label}.obj", part.drawing), part.label) for part in parts]
    return learn_solids(start or empty_model(load_facets()), drawn)
