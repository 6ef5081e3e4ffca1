"""Flat facets in space that share corners: what is seen of a part, what was taught of it, what a drawing says of it;
and many of them side by side in arrays, so that what is done to each is done to all at once.

Solids side by side differ in how many corners, facets and edges they have; what one has less of than another is filled
up with its first corner, with facets of no area that are turned to nobody, and with edges beside none.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daemon import frames
from daemon.arrays import Array, Flags, Image32, Index
from daemon.vision.geometry.facet_measures import circle_along
from daemon.vision.geometry.polygon import sides_of

FLAT_MM = 0.5  # so far before a facet's plane lie corners that are measured, not exact
CHORD_MM, BESIDE_ARC = 0.7, 0.3
"""Largest distance from the points along an arc, mm, of the ends of a chord, and, as a share of its length, of its
middle."""
PARALLEL = 0.98
"""Cosine from which on two directions of a solid are one."""
SURE_MM2 = 1e-9  # keeps the weight of a corner known exactly finite


@dataclass(frozen=True, eq=False)
class Hole:
    """The rim of a hole in a facet of a solid: the number of the facet, and ring_mm (N, 3), its corners one after the
    other, in the solid's frame. Where the rim is round they lie on it, close to each other."""

    facet: int
    ring_mm: Array


@dataclass(frozen=True, eq=False)
class OutlineArc:
    """An arc in the outline of a facet of a solid: the number of the facet, and points_mm (N, 3) along it, from end to
    end, in the solid's frame. The facet's own corners there are of a few chords, half in, half out of the arc."""

    facet: int
    points_mm: Array


@dataclass(frozen=True, eq=False)
class Polyhedron:
    """corners_mm (K, 3), in any one frame; facets: corner indices of each, anticlockwise from outside; covariance_mm2
    (K, 3, 3) of the corners; types: the facet library's name of each facet, empty where none was typed; smooth: sides
    of facets that do not show, as the surface goes on smoothly into a curved one, by their corners, smaller first;
    covers (N, 4, 3): what else of the surface hides what lies behind it, as quadrilaterals that run as facets do;
    holes: the rims of bores, slots and pockets in its facets. They are no sides of the facets; arcs: those in the
    facets' outlines that show.
    """

    corners_mm: Array
    facets: tuple[tuple[int, ...], ...]
    covariance_mm2: Array
    types: tuple[str, ...] = ()
    smooth: frozenset[tuple[int, int]] = frozenset()
    covers: Array = field(default_factory=lambda: np.zeros((0, 4, 3)))
    holes: tuple[Hole, ...] = ()
    arcs: tuple[OutlineArc, ...] = ()

    @cached_property
    def rings(self) -> tuple[Index, ...]:
        """The facets as arrays, to index corners with."""
        return tuple(np.array(f, np.intp) for f in self.facets)

    @cached_property
    def ring_table(self) -> Index:
        """(F, S) the same in one array, the last corner of each as often as needed."""
        most = max(map(len, self.facets), default=1)
        return np.array([ring + ring[-1:] * (most - len(ring)) for ring in self.facets], np.intp).reshape(-1, most)

    @cached_property
    def edges(self) -> dict[tuple[int, int], tuple[int, int]]:
        """{(corner, next corner): (facet, place of the corner in it)}."""
        return {
            side: (f, place) for f, corners in enumerate(self.facets) for place, side in enumerate(sides_of(corners))
        }

    @cached_property
    def across(self) -> dict[tuple[int, int], tuple[int, int]]:
        """{(facet, place of an edge in it): the same of the facet beyond that edge}, where there is one."""
        return {place: self.edges[b, a] for (a, b), place in self.edges.items() if (b, a) in self.edges}

    @property
    def open_edges(self) -> int:
        """Edges with a facet on one side only; 0: closed."""
        return len(self.edges) - len(self.across)

    @property
    def size_mm(self) -> float:
        """Largest distance between two corners."""
        return float(np.linalg.norm(self.corners_mm[:, None] - self.corners_mm, axis=2).max())

    @cached_property
    def seams(self) -> tuple[tuple[int, int], ...]:
        """Pairs of facets that share an edge (run through in opposite directions), the smaller index first."""
        pairs = {(f, self.edges[b, a][0]) for (a, b), (f, _) in self.edges.items() if (b, a) in self.edges}
        return tuple(sorted((f, g) for f, g in pairs if f < g))

    @cached_property
    def touching(self) -> Flags:
        """(F, F) which facets share an edge."""
        touching = np.zeros((len(self.facets), len(self.facets)), dtype=bool)
        for f, g in self.seams:
            touching[f, g] = touching[g, f] = True
        return touching

    @cached_property
    def lines(self) -> tuple[Index, Flags]:
        """Every edge that shows once, by its two corners (E, 2), and which facets it bounds (F, E)."""
        shown = (pair for pair in dict.fromkeys((min(e), max(e)) for e in self.edges) if pair not in self.smooth)
        number = {pair: k for k, pair in enumerate(shown)}
        bounds = np.zeros((len(self.facets), len(number)), bool)
        for (a, b), (facet, _) in self.edges.items():
            if (min(a, b), max(a, b)) in number:
                bounds[facet, number[min(a, b), max(a, b)]] = True
        return np.array(list(number), np.intp).reshape(-1, 2), bounds

    @cached_property
    def line_numbers(self) -> dict[tuple[int, int], int]:
        """{(corner, other corner): the number of the line between them}, the smaller first."""
        return {(a, b): k for k, (a, b) in enumerate(self.lines[0].tolist())}

    @cached_property
    def circles(self) -> Array:
        """(E, 4) the centre and the radius, mm, of the circle that each of the lines is a chord of; zeros where it is
        straight."""
        ends, bounds = self.lines
        found = np.zeros((len(ends), 4))
        a, b = self.corners_mm[ends[:, 0]], self.corners_mm[ends[:, 1]]
        for arc in self.arcs:
            normal = self.normals[arc.facet]
            on_axis, radius, _ = circle_along(arc.points_mm, normal)
            centre = on_axis + float((arc.points_mm @ normal).mean()) * normal
            off = np.array([np.linalg.norm(own - centre, axis=1) - radius for own in (a, b)])
            middle = np.linalg.norm(((a + b) / 2)[:, None] - arc.points_mm, axis=2).min(1)
            near = (np.abs(off) < CHORD_MM).all(0) & (middle < BESIDE_ARC * np.linalg.norm(b - a, axis=1))
            # The chord that closes a segment has the corners of the arc's own chords on the arc's side.
            ring = self.corners_mm[self.rings[arc.facet]] - centre
            ring = ring[np.abs(np.linalg.norm(ring, axis=1) - radius) < CHORD_MM]
            out = a + b - 2 * centre
            ends_out = np.maximum(((a - centre) * out).sum(1), ((b - centre) * out).sum(1))
            closes = (ring @ out.T > ends_out + 1e-6).any(0)
            found[bounds[arc.facet] & near & ~closes] = [*centre, radius]
        return found

    @cached_property
    def walls(self) -> Array:
        """(E, 3) unit normals, out of the part, of the curved surface beyond each of the lines that bounds one facet:
        beyond the chord of an arc, as that surface is square to the facet; beyond a straight line in which a flat cuts
        a cylinder, by the arcs that end where it does; zeros where there is none."""
        ends, facet = self.lines[0], self.beside[:, 0]
        open_, round_ = self.beside[:, 1] < 0, self.circles[:, 3] > 0
        way = self.corners_mm[ends[:, 1]] - self.corners_mm[ends[:, 0]]
        along = np.where(self.sides_of_lines[:, 1] == facet, 1.0, -1.0)[:, None]
        away = np.cross(along * way, self.normals[facet])
        found = (round_ & open_)[:, None] * away / np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-12)
        arcs = np.flatnonzero(round_ & open_)
        for straight in np.flatnonzero(open_ & ~round_).tolist():
            unit = way[straight] / np.linalg.norm(way[straight])
            meets = (ends[arcs][:, :, None] == ends[straight]).any((1, 2))
            for arc in arcs[meets & (np.abs(self.normals[facet[arcs]] @ unit) > PARALLEL)].tolist():
                out = self.corners_mm[ends[straight, 0]] - self.circles[arc, :3]
                out -= (out @ unit) * unit
                found[straight] = np.sign(out @ found[arc]) * out / np.linalg.norm(out)
        return np.asarray(found)

    @cached_property
    def directions(self) -> Array:
        """(D, 3) unit: across its facets and along its edges, each once, but for those that are nearly another."""
        ends = self.lines[0]
        along = self.corners_mm[ends[:, 1]] - self.corners_mm[ends[:, 0]]
        ways = np.concatenate([self.normals, along / np.linalg.norm(along, axis=1)[:, None]])
        return ways[[bool((np.abs(ways[:k] @ way) < PARALLEL).all()) for k, way in enumerate(ways)]]

    @cached_property
    def beside(self) -> Index:
        """(E, 2) the facets that each of the lines bounds; -1 where it bounds one only."""
        bounds = self.lines[1]
        facets = np.argsort(~bounds, axis=0, kind="stable")[:2].T
        return np.where(np.arange(2) < bounds.sum(0)[:, None], facets, -1)

    @cached_property
    def sides_of_lines(self) -> Index:
        """(E, 2) the facets on either hand of each of the lines, seen from outside: first the one that runs against the
        line, then the one that runs along it; -1 where there is none."""
        pairs = self.lines[0].tolist()
        found = [[self.edges.get(side, (-1, 0))[0] for side in ((b, a), (a, b))] for a, b in pairs]
        return np.array(found, np.intp).reshape(-1, 2)

    @cached_property
    def bisectors(self) -> Array:
        """(E, 3) unit vectors out of the part, halfway between the normals on either hand of each of the lines; where
        one facet is not known it is taken for square to the other; zero along hollows."""
        known, ends = self.beside, self.lines[0]
        normals = np.vstack([self.normals, np.zeros(3)])[known]
        onward = self.sides_of_lines[:, 1] == known[:, 0]
        away = np.cross(self.corners_mm[ends[:, 1]] - self.corners_mm[ends[:, 0]], normals[:, 0])
        away = (
            np.where(onward, 1.0, -1.0)[:, None] * away / np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-12)
        )
        beyond = np.where(known[:, 1:] < 0, away, normals[:, 1])
        outward = (normals[:, 0] + beyond) * (np.sum(away * beyond, 1) > 0)[:, None]
        return np.asarray(outward / np.maximum(np.linalg.norm(outward, axis=1, keepdims=True), 1e-9))

    @cached_property
    def parallel_behind(self) -> tuple[tuple[int, Index, Array], ...]:
        """Facets that lie behind others that face the same way: the number of each, those of the lines (N,) that bound
        the others, and unit vectors (N, 3) away from these others in their planes."""
        levels, (ends, bounds), found = (self.normals * self.centres_mm).sum(1), self.lines, []
        way = self.corners_mm[ends[:, 1]] - self.corners_mm[ends[:, 0]]
        for facet, normal in enumerate(self.normals):
            before = (self.normals @ normal > PARALLEL) & (levels - levels[facet] > FLAT_MM)
            lines, others = np.nonzero(bounds[before].T)
            if len(lines):
                other = np.flatnonzero(before)[others]
                onward = np.where(self.sides_of_lines[lines, 1] == other, 1.0, -1.0)[:, None]
                aside = np.cross(onward * way[lines], self.normals[other])
                found.append((facet, lines, aside / np.linalg.norm(aside, axis=1, keepdims=True)))
        return tuple(found)

    @cached_property
    def steps(self) -> tuple[Index, Index, Index]:
        """Facet after facet, its corners (N,) and the next of each (N,); and where each facet begins (F,)."""
        here, after = np.array([side for ring in self.facets for side in sides_of(ring)], np.intp).reshape(-1, 2).T
        return here, after, np.cumsum([0, *(len(ring) for ring in self.facets)])[:-1]

    @cached_property
    def areas_mm2(self) -> Array:
        """(F, 3) outward area vectors of the facets."""
        here, after, first = self.steps
        if not len(first):
            return np.zeros((0, 3))
        ways = self.corners_mm - self.corners_mm[0]  # far from the origin the products would lose digits
        return np.asarray(np.add.reduceat(np.cross(ways[here], ways[after]), first) / 2)

    @cached_property
    def normals(self) -> Array:
        """(F, 3) outward unit normals of the facets."""
        return np.asarray(self.areas_mm2 / np.maximum(np.linalg.norm(self.areas_mm2, axis=1, keepdims=True), 1e-12))

    @cached_property
    def convex(self) -> bool:
        """Whether no corner lies before the plane of a facet: nothing of the solid then hides another part of it. A
        solid with covers is none."""
        if len(self.covers):
            return False
        levels = (self.normals * self.centres_mm).sum(1)
        return bool((self.corners_mm @ self.normals.T - levels < FLAT_MM).all())

    @cached_property
    def centres_mm(self) -> Array:
        """(F, 3) means of the facets' corners."""
        here, _, first = self.steps
        if not len(first):
            return np.zeros((0, 3))
        sides = np.diff(first, append=len(here))
        return np.asarray(np.add.reduceat(self.corners_mm[here], first) / sides[:, None])

    @cached_property
    def flat_from_solid(self) -> Array:
        """(F, 4, 4) the motions that lay each facet into z = 0, its middle at the origin, its first side along x."""
        sides = np.array([self.corners_mm[ring[1]] - self.corners_mm[ring[0]] for ring in self.rings]).reshape(-1, 3)
        x = sides - self.normals * np.sum(sides * self.normals, 1, keepdims=True)
        x = x / np.linalg.norm(x, axis=1, keepdims=True)
        turns = np.stack([x, np.cross(self.normals, x), self.normals], 1)
        return frames.rigid(turns, -(turns @ self.centres_mm[..., None])[..., 0])

    def corners_of(self, facets: Sequence[int]) -> Index:
        """(K,) the corners that some facets have, by their numbers."""
        return np.array(sorted({k for f in facets for k in self.facets[f]}), np.intp)

    def only(self, facets: Sequence[int]) -> Polyhedron:
        """Some facets, in this order, with their corners (corners_of)."""
        kept = self.corners_of(facets)
        place = {int(k): n for n, k in enumerate(kept)}
        return Polyhedron(
            self.corners_mm[kept],
            tuple(tuple(place[k] for k in self.facets[f]) for f in facets),
            self.covariance_mm2[kept],
            tuple(self.types[f] for f in facets) if self.types else (),
            frozenset((place[a], place[b]) for a, b in self.smooth if a in place and b in place),
            holes=tuple(Hole(k, one.ring_mm) for k, f in enumerate(facets) for one in self.holes if one.facet == f),
            arcs=tuple(
                OutlineArc(k, arc.points_mm) for k, f in enumerate(facets) for arc in self.arcs if arc.facet == f
            ),
        )

    def facing(self, poses: Array, viewpoint: Array | tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Array:
        """(..., F) cosines between each facet's outward normal and the way from its middle to a camera (3,), which sees
        its front where they are above 0; poses (..., 4, 4) take the corners to the camera's frame.
        """
        turned = np.swapaxes(poses[..., :3, :3], -1, -2)
        rays = np.asarray(viewpoint) - (self.centres_mm @ turned + poses[..., None, :3, 3])
        return np.asarray(np.sum(self.normals @ turned * rays, -1) / np.linalg.norm(rays, axis=-1))


def exact(corners_mm: Array, facets: Iterable[Iterable[int]]) -> Polyhedron:
    """A polyhedron whose corners (K, 3) are known without error, its facets not typed."""
    rings = tuple(tuple(int(k) for k in ring) for ring in facets)
    return Polyhedron(corners_mm, rings, np.zeros((len(corners_mm), 3, 3)))


def with_rings(corners_mm: Array, rings: Sequence[Sequence[int]]) -> Polyhedron:
    """Return a solid without measuring errors, as `exact` does, of those of the corners (K, 3) that the rings have."""
    used = sorted({k for ring in rings for k in ring})
    place = {k: n for n, k in enumerate(used)}
    return exact(corners_mm[used], [[place[k] for k in ring] for ring in rings])


def united(rings: Sequence[Sequence[int]], points_mm: Array, covariance_mm2: Array, types: Iterable[str]) -> Polyhedron:
    """Facets as they were measured one by one, made one polyhedron: points_mm (N, 3), ring after ring, with covariance
    (N, 3, 3); points with one number in the rings are one corner.

    A corner is the weighted mean of its points; its covariance stays that of one facet, because neighbours measure the
    same edges in the same pixels, and grows by how far the points lie apart.
    """
    order = {number: k for k, number in enumerate(dict.fromkeys(n for ring in rings for n in ring))}
    owner = np.array([order[number] for ring in rings for number in ring])
    count = len(order)
    information = np.linalg.inv(covariance_mm2 + SURE_MM2 * np.eye(3))
    total, weighted, shares = np.zeros((count, 3, 3)), np.zeros((count, 3)), np.bincount(owner).astype(float)
    np.add.at(total, owner, information)
    np.add.at(weighted, owner, (information @ points_mm[..., None])[..., 0])
    spread = np.linalg.inv(total)
    corners = (spread @ weighted[..., None])[..., 0]
    off = points_mm - corners[owner]
    scatter = np.zeros((count, 3, 3))
    np.add.at(scatter, owner, off[:, :, None] * off[:, None, :])
    facets = tuple(tuple(order[number] for number in ring) for ring in rings)
    covariance = spread * shares[:, None, None] + scatter / shares[:, None, None]
    return Polyhedron(corners, facets, covariance, tuple(types))


@dataclass(frozen=True, eq=False)
class SolidBatch:
    """P solids: corners_mm (P, K, 3), and own (P, K), which of these are a solid's; middles_mm (P, 3); planes
    (P, 2 F, 3): outward unit normals of the facets, then their middles; rings (P, F, S), the corners of each facet;
    ends (P, E, 2), the corners of each edge, beside (P, E, 2), the facets that it bounds, F where there is none, and
    bisectors (P, E, 3), circles (P, E, 4) and walls (P, E, 3) as Polyhedron has them.
    """

    shapes: tuple[Polyhedron, ...]
    corners_mm: Array
    own: Flags
    middles_mm: Array
    planes: Image32
    rings: Index
    ends: Index
    beside: Index
    bisectors: Array
    circles: Array
    walls: Array

    @classmethod
    def of(cls, shapes: Sequence[Polyhedron]) -> SolidBatch:
        """Solids side by side; made once of the same ones."""
        return _side_by_side(tuple(shapes))

    @property
    def first_corners(self) -> Index:
        """(P,) the number of each solid's first corner among all."""
        return np.asarray(np.arange(len(self.shapes)) * self.corners_mm.shape[1], np.intp)

    def corners_of(self, number: int) -> slice:
        """The corners of one solid among all."""
        first = number * self.corners_mm.shape[1]
        return slice(first, first + len(self.shapes[number].corners_mm))


@lru_cache(maxsize=64)
def _side_by_side(shapes: tuple[Polyhedron, ...]) -> SolidBatch:
    corners = _filled([s.corners_mm for s in shapes], 3, 0.0)
    own = np.arange(corners.shape[1]) < np.array([len(s.corners_mm) for s in shapes], np.intp)[:, None]
    normals = _filled([s.normals for s in shapes], 3, np.float32(0))
    centres = _filled([s.centres_mm for s in shapes], 3, np.float32(0))
    facets, sides = normals.shape[1], max((s.ring_table.shape[1] for s in shapes), default=1)
    tables = [s.ring_table[:, np.arange(sides).clip(max=s.ring_table.shape[1] - 1)] for s in shapes]
    return SolidBatch(
        shapes,
        np.where(own[..., None], corners, corners[:, :1]),
        own,
        np.array([s.corners_mm.mean(0) for s in shapes]).reshape(-1, 3),
        np.concatenate([normals, centres], 1),
        _filled(tables, sides, 0),
        _filled([s.lines[0] for s in shapes], 2, 0),
        _filled([np.where(s.beside < 0, facets, s.beside) for s in shapes], 2, facets),
        _filled([s.bisectors for s in shapes], 3, 0.0),
        _filled([s.circles for s in shapes], 4, 0.0),
        _filled([s.walls for s in shapes], 3, 0.0),
    )


def _filled(rows: Sequence[NDArray[Any]], width: int, fill: Any) -> NDArray[Any]:
    """(P, M, width) arrays (m, width) one beside the other, filled up."""
    found = np.full((len(rows), max(map(len, rows), default=0), width), fill)
    for own, row in zip(found, rows, strict=True):
        own[: len(row)] = row
    return found


def thickness(rings_px: Array) -> Array:
    """(...,) area of facets by length of their border, both halved round, of which the corners are seen at (..., S, 2)
    px, the last as often as needed: the width of a long one; negative where it is seen from behind (it then runs
    clockwise)."""
    after = rings_px.take(np.arange(1, rings_px.shape[-2] + 1), -2, mode="wrap")  # numpy's roll is several times slower
    x, y, u, v = rings_px[..., 0], rings_px[..., 1], after[..., 0], after[..., 1]
    return np.asarray((y * u - x * v).sum(-1) / np.maximum(np.hypot(u - x, v - y).sum(-1), 1e-9))
