"""Families of parts that look alike: mirror images, near sizes, a cut corner, other dihedral angles, one side more.

A family's name and a seed give a pair of drawings that differ in the family's way. Even seeds are for tuning; odd seeds
are held out, and no choice may depend on their results.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np

from daemon.arrays import Array, Index
from drivers.simcell.parts import hull, shape
from tests.fakes.drawn import obj, prism
from tests.fakes.many_parts import FAMILIES as SHOP
from tests.fakes.many_parts import Drawing, DrawnPart, Outline, Rings, regular

LARGER = 1.05
"""How much the larger of two sizes measures over the smaller."""
SHOP_SIZED = ("box", "wedge", "l_block", "t_block", "frustum", "pentagonal_prism")
SHOP_CUT = ("box", "wedge", "frustum", "triangular_prism", "hexagonal_prism")
Pair = tuple[Drawing, Drawing]


class ConfusablePair(NamedTuple):
    """Two parts of one family that could be taken for each other."""

    family: str
    kind: str
    seed: int
    parts: tuple[DrawnPart, DrawnPart]


def alike(family: str, seed: int) -> ConfusablePair:
    """The pair of that family and seed, its kinds in turn. Either part can stand on the table."""
    rng = np.random.default_rng([*family.encode(), seed])
    kinds = FAMILIES[family]
    kind = list(kinds)[seed // 2 % len(kinds)]
    while True:
        drawings = kinds[kind](rng)
        first, second = (
            DrawnPart(label, family, (), obj(d.corners, d.rings), shape(label, *d.clouds))
            for label, d in zip((f"{kind}_a", f"{kind}_b"), drawings, strict=True)
        )
        if first.shape.rests and second.shape.rests:
            return ConfusablePair(family, kind, seed, (first, second))


def convex(cloud: Array) -> Drawing:
    """The hull of a cloud (K, 3) of corners, mm."""
    return Drawing(cloud, list(hull(cloud).faces), (cloud,))


def mirrored(drawing: Drawing) -> Drawing:
    """The same in a mirror."""
    flip = np.array([-1.0, 1.0, 1.0])
    rings = [ring[::-1] for ring in drawing.rings]
    return Drawing(drawing.corners * flip, rings, tuple(cloud * flip for cloud in drawing.clouds))


def scaled(drawing: Drawing, factor: float) -> Drawing:
    """The same in another size."""
    return Drawing(drawing.corners * factor, drawing.rings, tuple(cloud * factor for cloud in drawing.clouds))


def cut(cloud: Array, corner: int, shares: Array) -> Drawing:
    """A convex solid without one of its corners, at which three edges meet: each is cut at such a share (3,) of it."""
    faces = hull(cloud).faces
    ends = sorted({r[(r.index(corner) + step) % len(r)] for r in faces if corner in r for step in (-1, 1)})
    planes = [cloud[corner] + share * (cloud[end] - cloud[corner]) for share, end in zip(shares, ends, strict=True)]
    return convex(np.vstack([np.delete(cloud, corner, axis=0), planes]))


def stacked(boxes: list[tuple[Array, Array]]) -> Drawing:
    """Boxes (low (3,), high (3,)) that share faces and do not overlap, as one solid."""
    ends = np.array(boxes)
    ticks = [np.unique(ends[:, :, axis]) for axis in range(3)]
    counts = [len(t) - 1 for t in ticks]
    middles = np.stack(np.meshgrid(*[(t[:-1] + t[1:]) / 2 for t in ticks], indexing="ij"), axis=-1)
    full = np.zeros([n + 2 for n in counts], bool)
    inner = [np.all((middles > low) & (middles < high), axis=-1) for low, high in ends]
    full[1:-1, 1:-1, 1:-1] = np.any(inner, axis=0)
    number = {tuple(k): i for i, k in enumerate(np.ndindex(*[n + 1 for n in counts]))}
    corners = np.stack(np.meshgrid(*ticks, indexing="ij"), axis=-1).reshape(-1, 3)
    rings: Rings = []
    for cell in np.argwhere(full):
        for axis in range(3):
            for side in (0, 1):
                beyond = cell.copy()
                beyond[axis] += 2 * side - 1
                if not full[tuple(beyond)]:
                    rings.append(tuple(number[tuple(k)] for k in _square(cell - 1, axis, side)))
    used = sorted({k for ring in rings for k in ring})
    place = {k: n for n, k in enumerate(used)}
    clouds = tuple(np.array([[x, y, z] for x in b[:, 0] for y in b[:, 1] for z in b[:, 2]]) for b in ends)
    return Drawing(corners[used], [tuple(place[k] for k in ring) for ring in rings], clouds)


def _square(cell: Index, axis: int, side: int) -> list[Array]:
    """The corners, by their ticks, of one side of a grid's cell, anticlockwise from outside."""
    across, along = np.eye(3, dtype=int)[[(axis + 1) % 3, (axis + 2) % 3]]
    start = cell + side * np.eye(3, dtype=int)[axis]
    ring = [start, start + across, start + across + along, start + along]
    return ring if side else ring[::-1]


def _of_shop(names: tuple[str, ...], rng: np.random.Generator) -> Drawing:
    draw, sized = SHOP[names[int(rng.integers(len(names)))]]
    return draw(*sized(rng))


def _box(sides: Array) -> Array:
    return np.array([[x, y, z] for x in (0, sides[0]) for y in (0, sides[1]) for z in (0, sides[2])], float)


def _unequal(rng: np.random.Generator, least: float, most: float, apart: float = 6.0) -> Array:
    """Three sizes, each so much unlike the others."""
    while True:
        sizes = rng.uniform(least, most, 3)
        if np.diff(np.sort(sizes)).min() > apart:
            return sizes


def _cut_block(rng: np.random.Generator) -> Drawing:
    """A box of three unlike sides without one of its corners."""
    return cut(_box(_unequal(rng, 28, 75)), 7, rng.uniform(0.3, 0.55, 3))


def _screw(rng: np.random.Generator) -> Drawing:
    """Four bricks, each set on the last in another direction, as a screw turns."""
    ticks = np.cumsum(np.vstack([np.zeros(3), rng.uniform(17, 30, (2, 3))]), axis=0)
    cells = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (1, 1, 1)])
    pick = np.arange(3)
    bricks = [(ticks[cell, pick], ticks[cell + 1, pick]) for cell in cells]
    bricks[3][0][0] += rng.uniform(4, 8)  # flush with none of the first brick's sides: no corner on another's edge
    return stacked(bricks)


def _slanted_l(rng: np.random.Generator) -> Drawing:
    """An L whose longer leg ends in a slant."""
    a, b, height = rng.uniform(58, 80), rng.uniform(38, 54), rng.uniform(22, 40)
    wide, thick, slant = rng.uniform(17, 26), rng.uniform(15, 24), rng.uniform(9, 20)
    outline: Outline = [(0, 0), (a, 0), (a, thick), (wide, thick), (wide, b), (0, b)]
    corners, rings = prism(outline, height)
    pieces: list[Outline] = [[(0, 0), (a, 0), (a, thick), (0, thick)], [(0, thick), (wide, thick), (wide, b), (0, b)]]
    legs = [prism(piece, height)[0] for piece in pieces]
    for cloud in (corners, legs[0]):
        cloud[(cloud[:, 0] == a) & (cloud[:, 2] == height), 0] -= slant
    return Drawing(corners, rings, tuple(legs))


def _stepped_wedge(rng: np.random.Generator) -> Drawing:
    """A block with a ramp on it that falls along x and stands nearer to one side than to the other."""
    a, b, c = rng.uniform(45, 75), rng.uniform(40, 65), rng.uniform(16, 28)
    near = rng.uniform(6, 10)
    far, ramp, up = near + rng.uniform(0.3, 0.45) * b, rng.uniform(0.55, 0.85) * a, rng.uniform(14, 28)
    corners = np.array(
        [(0, 0, 0), (a, 0, 0), (a, b, 0), (0, b, 0), (0, 0, c), (a, 0, c), (a, b, c), (0, b, c),
         (0, near, c), (0, far, c), (ramp, near, c), (ramp, far, c), (0, near, c + up), (0, far, c + up)])  # fmt: skip
    rings: Rings = [
        (3, 2, 1, 0), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (4, 5, 6, 7, 9, 11, 10, 8),
        (0, 4, 8, 12, 13, 9, 7, 3), (8, 10, 12), (9, 13, 11), (10, 11, 13, 12)]  # fmt: skip
    return Drawing(corners, rings, (corners[:8], corners[8:]))


def _leaning_prism(rng: np.random.Generator) -> Drawing:
    """A prism over a triangle of three unlike sides, which leans."""
    base = np.array([(0, 0), (rng.uniform(50, 68), 0), (rng.uniform(8, 20), rng.uniform(34, 46))])
    lean = rng.uniform(8, 16) * np.array([np.cos(t := rng.uniform(-np.pi, np.pi)), np.sin(t)])
    height = rng.uniform(28, 45)
    return convex(np.vstack([np.column_stack([base, np.zeros(3)]), np.column_stack([base + lean, np.full(3, height)])]))


def _in_mirror(draw: Callable[[np.random.Generator], Drawing]) -> Callable[[np.random.Generator], Pair]:
    def pair(rng: np.random.Generator) -> Pair:
        one = draw(rng)
        return one, mirrored(one)

    return pair


def _in_sizes(draw: Callable[[np.random.Generator], Drawing]) -> Callable[[np.random.Generator], Pair]:
    def pair(rng: np.random.Generator) -> Pair:
        one = draw(rng)
        return one, scaled(one, LARGER)

    return pair


def _and_cut(rng: np.random.Generator) -> Pair:
    whole = _of_shop(SHOP_CUT, rng)
    return whole, cut(whole.corners, int(rng.integers(len(whole.corners))), rng.uniform(0.25, 0.5, 3))


def _leaning_box(sides: Array, angles_rad: Array) -> Drawing:
    """A parallelepiped; angles between the second and third side, the third and first, the first and second."""
    alpha, beta, gamma = np.cos(angles_rad)
    sine = np.sin(angles_rad[2])
    y = (alpha - beta * gamma) / sine
    ways = np.array([[1, 0, 0], [gamma, sine, 0], [beta, y, np.sqrt(1 - beta * beta - y * y)]])
    return convex(_box(np.ones(3)) @ (sides[:, None] * ways))


def _rhombohedra(rng: np.random.Generator) -> Pair:
    """Six times the same rhombus: drawn out, and pressed flat."""
    sides, angles = np.full(3, rng.uniform(34, 55)), np.full(3, np.radians(rng.uniform(70, 80)))
    return _leaning_box(sides, angles), _leaning_box(sides, np.pi - angles)


def _leaning_boxes(rng: np.random.Generator) -> Pair:
    sides, angles = _unequal(rng, 32, 62, 4.0), np.radians(rng.uniform(70, 82, 3))
    return _leaning_box(sides, angles), _leaning_box(sides, np.pi - angles)


def _cap_and_pit(rng: np.random.Generator) -> Pair:
    """A block with a pyramid on it, and one with the same pyramid taken out."""
    a, height, up = rng.uniform(38, 58), rng.uniform(32, 52), rng.uniform(9, 20)
    low, high = (_box(np.array([a, a, height]))[[k, 4 + k, 6 + k, 2 + k]] for k in (0, 1))
    middle = [a / 2, a / 2, 0.0]
    rings: Rings = [(3, 2, 1, 0), *((k, (k + 1) % 4, (k + 1) % 4 + 4, k + 4) for k in range(4)),
                    *((k + 4, (k + 1) % 4 + 4, 8) for k in range(4))]  # fmt: skip
    cap, pit = (np.vstack([low, high, [a / 2, a / 2, height + way * up]]) for way in (1, -1))
    quarters = tuple(np.vstack([pit[[k, (k + 1) % 4, k + 4, (k + 1) % 4 + 4, 8]], middle]) for k in range(4))
    return Drawing(cap, rings, (cap,)), Drawing(pit, rings, quarters)


def _one_side_more(sides: int) -> Callable[[np.random.Generator], Pair]:
    def pair(rng: np.random.Generator) -> Pair:
        radius, height = rng.uniform(24, 38), rng.uniform(26, 65)
        one, other = (prism(regular(n, 2 * radius * np.sin(np.pi / n)), height) for n in (sides, sides + 1))
        return Drawing(*one, (one[0],)), Drawing(*other, (other[0],))

    return pair


CHIRAL = {
    "cut_block": _cut_block,
    "screw": _screw,
    "slanted_l": _slanted_l,
    "stepped_wedge": _stepped_wedge,
    "leaning_prism": _leaning_prism,
}
FAMILIES: dict[str, dict[str, Callable[[np.random.Generator], Pair]]] = {
    "mirror": {name: _in_mirror(draw) for name, draw in CHIRAL.items()},
    "size": {name: _in_sizes(partial(_of_shop, (name,))) for name in SHOP_SIZED}
    | {name: _in_sizes(draw) for name, draw in CHIRAL.items()},
    "cut": {"corner_cut": _and_cut},
    "dihedral": {"rhombohedron": _rhombohedra, "leaning_box": _leaning_boxes, "cap_or_pit": _cap_and_pit},
    "sides": {f"prism_{n}_or_{n + 1}": _one_side_more(n) for n in (5, 6, 7, 8)},
}
