"""Facets of one thing from pieces of them that looks saw: where planes meet are its edges, whatever shadows and what
stood before it cut the pieces to. Pure.

In each facet's plane the lines where the other planes meet it, and such sides of its pieces as lie on none of them, cut
the plane into cells. A cell is the facet's where pieces cover most of it, or where the facets beyond its edges say so:
sides that are no edges thus vanish.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from daemon.arrays import Array
from daemon.vision.geometry import area_vector, axes_in, border_loops, inside, sides_of

LINE_MM, OF_WIDTH = 2.0, 0.15
"""A piece's side this near to a line lies on it, and so two sides to each other; less in a narrow facet."""
MIN_SINE = 0.12  # planes that meet at a smaller angle share no line that is known
COVERED, OF_LOOKS = 0.5, 0.3
"""Share of a cell that pieces cover where it is the facet's; and of the looks that saw the facet at all, how many must
agree: shadows and what hides a part of it leave the rest to some, a side that was measured wrongly is one look's."""
REACHED = 0.7
"""Share of a cell's edges beyond which facets were seen, where it is the facet's though no piece covers it."""
MARGIN = 0.8  # of the pieces' extent: what none of them shows may lie beyond them all
SAME_MM = 0.2
STRAIGHT = 0.05  # sine of the least turn at a corner
MIN_MM2 = 20.0
DEPTHS = (0.0, 0.35, 0.7, 0.95)
GRID = 12

_Side = tuple[Array, Array, Array]
"""Ends (2,) of a side of another facet's piece on a line in the plane, and which way the facet lies from it, (2,)."""
_Met = tuple[Array, list[_Side]]
"""A line (3,), unit normal a b and c with a x + b y = c, and the sides along it."""


@dataclass(frozen=True, eq=False)
class Plane:
    """A facet's plane: origin (3,), axes (2, 3) in it, outward normal (3,); pieces: outlines in it, (N, 2) mm each;
    doubts: how far each corner of those may be off, (N,) mm; solid: the pieces' corners in space, (N, 3); looks: how
    many saw any."""

    origin: Array
    axes: Array
    normal: Array
    pieces: tuple[Array, ...]
    doubts: tuple[Array, ...]
    solid: tuple[Array, ...]
    looks: int

    def down(self, points: Array) -> tuple[Array, Array]:
        """(N, 3) to (N, 2) in the plane, and (N,) how far they are off it."""
        return (points - self.origin) @ self.axes.T, (points - self.origin) @ self.normal

    def up(self, points: Array) -> Array:
        """(..., 2) in the plane to (..., 3)."""
        return points @ self.axes + self.origin


def fit_facet_plane(pieces: Sequence[Array], doubts: Sequence[Array], looks: int) -> Plane:
    """The plane of pieces of one facet: outlines (N, 3) mm, how far each corner may be off (N,) mm, and how many looks
    they are of."""
    points, weight = np.concatenate(pieces), np.concatenate(doubts) ** -2
    origin = weight @ points / weight.sum()
    outward = np.sum([area_vector(piece) for piece in pieces], axis=0)
    axes = np.linalg.svd((points - origin) * np.sqrt(weight)[:, None], full_matrices=False)[2]
    normal = axes[2] if axes[2] @ outward > 0 else -axes[2]
    x = axes[0]
    frame = np.stack([x, np.cross(normal, x)])
    level = tuple((piece - origin) @ frame.T for piece in pieces)
    return Plane(origin, frame, normal, level, tuple(doubts), tuple(pieces), looks)


def assumed_plane(origin: Array, normal: Array) -> Plane:
    """A plane that no piece was seen of: through a point (3,), with a normal (3,) of any length."""
    return Plane(origin, axes_in(normal), normal / np.linalg.norm(normal), (), (), (), 0)


def outlines(planes: Sequence[Plane], unseen: Sequence[Plane] = ()) -> list[list[Array]]:
    """Return for each plane the facets in it, outlines (N, 3) mm anticlockwise from outside; mostly one, none where the
    pieces cover nothing. unseen: planes that may bound them though no piece of those was seen. What one look alone saw
    bounds nothing that several did: those have sides of their own there."""
    return [
        _facets(plane, [k for k in (*planes, *unseen) if k is not plane and (k.looks != 1 or plane.looks == 1)])
        for plane in planes
    ]


def _facets(plane: Plane, others: Sequence[Plane]) -> list[Array]:
    every = np.concatenate(plane.pieces)
    low, high = every.min(0), every.max(0)
    near_mm = min(LINE_MM, OF_WIDTH * float((high - low).min()))
    reach_mm = MARGIN * float((high - low).max())
    low, high = low - reach_mm, high + reach_mm
    met = _lines_met(plane, others, low, high, near_mm)
    lines = [line for line, _ in met]
    box = np.array([low, (high[0], low[1]), high, (low[0], high[1])])
    cells = [box]
    for line in (*lines, *_own_sides(plane, lines, near_mm)):
        cells = [half for cell in cells for half in _halves(cell, line)]
    if not cells:  # pieces of no extent
        return []
    shares = _covered(cells, plane)
    rims = np.array([bool(((cell < low + 1e-6) | (cell > high - 1e-6)).any()) for cell in cells])
    reached = np.array([_reached(cell, met) for cell in cells])
    taken = np.where(shares > COVERED, reached >= 0, (reached > REACHED) & ~rims)
    return [plane.up(ring) for ring in _united([cell for cell, one in zip(cells, taken, strict=True) if one])]


def _lines_met(plane: Plane, others: Sequence[Plane], low: Array, high: Array, near_mm: float) -> list[_Met]:
    """Lines where other planes meet this one near its pieces; with the sides of the others' pieces along each."""
    found = list[_Met]()
    for other in others:
        a = plane.axes @ other.normal
        sine = float(np.linalg.norm(a))
        if sine < MIN_SINE:
            continue
        line = np.array([*a, float((other.origin - plane.origin) @ other.normal)]) / sine
        ends = np.array([low, (high[0], low[1]), high, (low[0], high[1])]) @ line[:2] - line[2]
        if not ends.min() < 0 < ends.max():
            continue
        along = list[_Side]()
        for points in other.solid:
            level, off = plane.down(points)
            on = (np.abs(off) < LINE_MM) & (np.abs(level @ line[:2] - line[2]) < LINE_MM)
            rising = np.cross(other.normal, points - np.roll(points, 1, axis=0)) @ plane.normal
            along += [
                (level[k - 1], level[k], line[:2] * np.sign(rising[k]))
                for k in range(len(level))
                if on[k - 1] and on[k]
            ]
        known = next((sides for at, sides in found if _alike(line, at, low, high, near_mm)), None)
        if known is None:
            found.append((line, along))
        else:
            known += along
    return found


def _own_sides(plane: Plane, met: Sequence[Array], near_mm: float) -> list[Array]:
    """Lines of the pieces' sides that lie on none of those, the surest first; sides on one line are one."""
    sides = [
        (float(np.linalg.norm(piece[k] - piece[k - 1])), piece[[k - 1, k]], doubt[[k - 1, k]])
        for piece, doubt in zip(plane.pieces, plane.doubts, strict=True)
        for k in range(len(piece))
    ]
    found = list[Array]()
    for length, ends, doubt in sorted(sides, key=lambda side: float(side[2].max()) / max(side[0], 1e-9)):
        near = np.maximum(near_mm, 3 * doubt)
        if any((np.abs(ends @ line[:2] - line[2]) < near).all() for line in (*met, *found)):
            continue
        way = ends[1] - ends[0]
        normal = np.array([way[1], -way[0]]) / max(length, 1e-9)
        found.append(np.array([*normal, float(normal @ ends.mean(0))]))
    return found


def _reached(cell: Array, met: Sequence[_Met]) -> float:
    """Share of a cell's edges, of those beyond which anything was seen of the planes that meet there, on the right side
    of which it lies; -1 where it lies on the wrong side of any."""
    whole = reached = 0.0
    middle = cell.mean(0)
    steps = (np.arange(GRID) + 0.5) / GRID
    lines = np.array([line for line, _ in met]).reshape(-1, 3)
    on = np.abs(cell @ lines[:, :2].T - lines[:, 2]) <= 1e-6
    for k in range(len(cell)):
        a, b = cell[k - 1], cell[k]
        way = b - a
        length = float(np.linalg.norm(way))
        for n in np.flatnonzero(on[k - 1] & on[k]).tolist():
            sides = met[n][1]
            if not sides or length < SAME_MM:
                continue
            right, wrong = np.zeros(GRID, bool), np.zeros(GRID, bool)
            for start, end, inward in sides:
                low, high = sorted((float((start - a) @ way), float((end - a) @ way)))
                there = (low < steps * length**2) & (steps * length**2 < high)
                right |= there & (inward @ (middle - a) > 0)
                wrong |= there & (inward @ (middle - a) < 0)
            if wrong.mean() > 1 - REACHED:
                return -1.0
            whole += length
            reached += length * float(right.mean())
    return reached / whole if whole else 0.0


def _alike(line: Array, other: Array, low: Array, high: Array, near_mm: float) -> bool:
    """Whether two lines are one as far as the box reaches."""
    cosine = float(line[:2] @ other[:2])
    middle = (low + high) / 2
    apart = abs((line[:2] @ middle - line[2]) - np.sign(cosine) * (other[:2] @ middle - other[2]))
    return abs(cosine) > 1 - STRAIGHT**2 / 2 and apart < near_mm


def _halves(cell: Array, line: Array) -> list[Array]:
    """Split a convex cell by a line into the parts on either side."""
    signed: Array = cell @ line[:2] - line[2]
    found = []
    for off in (signed.tolist(), (-signed).tolist()):
        if max(off) <= 1e-9:  # all of the cell is on the other side
            continue
        half = cell if min(off) > -1e-9 else _cut(cell, off)
        if len(half) > 2 and abs(_area(half)) > 1e-6:
            found.append(half)
    return found


def _cut(cell: Array, off: list[float]) -> Array:
    """The part of a convex cell whose corners lie so far on the one side of a line, and where its border crosses it."""
    ring = list[Array]()
    for k in range(len(cell)):
        here, after = off[k - 1], off[k]
        if here * after < 0 and min(abs(here), abs(after)) > 1e-9:
            ring.append(cell[k - 1] + (cell[k] - cell[k - 1]) * here / (here - after))
        if after > -1e-9:
            ring.append(cell[k])
    return np.array(ring).reshape(-1, 2)


def _covered(cells: Sequence[Array], plane: Plane) -> Array:
    """(C,) share of each convex cell that pieces of looks enough cover, by points between its middle and its border."""
    points, weights = list[Array](), list[Array]()
    for cell in cells:
        middle = cell.mean(0)
        rim = np.concatenate([cell, (cell + np.roll(cell, -1, axis=0)) / 2])
        points += [middle + depth * (rim - middle) for depth in DEPTHS]
        weights.append(np.repeat(np.maximum(DEPTHS, 0.05), len(rim)))
    most = max(len(piece) for piece in plane.pieces)
    rings = np.array([np.pad(piece, ((0, most - len(piece)), (0, 0)), mode="edge") for piece in plane.pieces])
    hit = inside(np.concatenate(points), rings).sum(0) >= OF_LOOKS * plane.looks
    begins = np.cumsum([0, *(len(one) for one in weights[:-1])])
    weight = np.concatenate(weights)
    return np.asarray(np.add.reduceat(weight * hit, begins) / np.add.reduceat(weight, begins))


def _united(cells: Sequence[Array]) -> list[Array]:
    """The outlines of cells that touch, anticlockwise; holes in them are not looked at."""
    corners = list[Array]()

    def number(point: Array) -> int:
        for k, known in enumerate(corners):
            if abs(known - point).max() < SAME_MM:
                return k
        corners.append(point)
        return len(corners) - 1

    edges = set[tuple[int, int]]()
    for cell in cells:
        ring = [number(point) for point in (cell if _area(cell) > 0 else cell[::-1])]
        for a, b in sides_of(ring):
            if (b, a) in edges:
                edges.discard((b, a))
            elif a != b:
                edges.add((a, b))
    rings = [_straightened(np.array([corners[k] for k in loop])) for loop in border_loops(sorted(edges))]
    return [ring for ring in rings if len(ring) > 2 and _area(ring) > MIN_MM2]


def _straightened(ring: Array) -> Array:
    """Remove corners at which the border goes straight on, or back."""
    kept, at = [*ring], 0
    while at < len(kept) and len(kept) > 2:
        one, two = kept[at] - kept[at - 1], kept[(at + 1) % len(kept)] - kept[at]
        size = float(np.linalg.norm(one) * np.linalg.norm(two))
        if size < 1e-9 or abs(one[0] * two[1] - one[1] * two[0]) < STRAIGHT * size:
            kept.pop(at)
            at = max(at - 1, 0)
        else:
            at += 1
    return np.array(kept)


def _area(ring: Array) -> float:
    x, y = ring.T
    return float(x[:-1] @ y[1:] - y[:-1] @ x[1:] + x[-1] * y[0] - y[-1] * x[0]) / 2
