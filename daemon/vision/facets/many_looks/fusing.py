"""What several looks from different places measured of one thing -> one partial polyhedron in the base frame. Pure.

Each look's place is free within what the arm errs anew, all share one error of hand-eye and cameras, which looks from
several sides tell, and a facet's corners lie in one plane. Nothing is named; from where to look next is not asked.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from daemon import frames
from daemon.arrays import Array, Flags, Index
from daemon.vision.facets.grouping import connected
from daemon.vision.facets.many_looks.association import (
    OF_SHORTEST,
    Pieces,
    Ring,
    connected_by_marks,
    drop_contradicted,
    match_corners,
    match_facets,
)
from daemon.vision.facets.many_looks.looks_adjustment import (
    MIN_MM2,
    FusedCorners,
    LookCorners,
    adjust_looks,
    shared_motion,
)
from daemon.vision.facets.many_looks.outlining import MIN_SINE, Plane, assumed_plane, fit_facet_plane, outlines
from daemon.vision.geometry import Polyhedron, StereoRig, area_vector, planarity, sides_of
from daemon.vision.values import Facet, Group

WELD_MM = 1.5  # how far a measured corner may lie from where the planes meet in it


@dataclass(frozen=True, eq=False)
class LookFacets:
    """What one look measured of a thing, and from where. groups: facets in the cyclopean frame, with the covariance of
    the pixels alone; base_from_cyclopean (4, 4) as the arm says; covariance (6, 6) of what errs in it anew each time;
    focal_px, baseline_mm: the rig's, for what an error of all looks does in this one."""

    groups: tuple[Group, ...]
    base_from_cyclopean: Array
    covariance: Array
    focal_px: float
    baseline_mm: float


@dataclass(frozen=True, eq=False)
class FusedLooks:
    """What is known of a thing from the looks so far.

    looks: as they were given; base_from_cyclopean (L, 4, 4): their places as all looks together have them; polyhedron:
    the facets, corners welded once, in the base frame, untyped, open where nothing was seen; covariance_mm2
    (3 K, 3 K) of all its corners together, everything in it; seen_mm2 (L, F): how much of each facet's plane each look
    outlined, 0 where it did not see it; looks_at (K,): from how many looks each corner was
    measured, 0 where planes alone say where it is; misfit: rms of
    what is left, sigmas.
    """

    looks: tuple[LookFacets, ...]
    base_from_cyclopean: Array
    polyhedron: Polyhedron
    covariance_mm2: Array
    outlined_mm2: Array
    looks_at: Index
    misfit: float

    @property
    def seen(self) -> Flags:
        """(L, F) which look saw which facet."""
        return np.asarray(self.outlined_mm2 > 0)

    @property
    def hidden(self) -> Array:
        """(L, F) which share of each facet a look left hidden."""
        whole = np.linalg.norm(self.polyhedron.areas_mm2, axis=1)
        return np.asarray(np.clip(1.0 - self.outlined_mm2 / np.maximum(whole, 1e-9), 0.0, 1.0))

    @property
    def confirmed(self) -> Flags:
        """(F,) the facets that were seen from two places or more."""
        return np.asarray(self.seen.sum(0) > 1)

    def connected_facets(self) -> list[list[int]]:
        """Facets that hang together by shared edges."""
        return connected(self.polyhedron.touching)

    def only(self, facets: Sequence[int]) -> FusedLooks:
        """Return the same looks with some of the facets, by number, and their corners."""
        corners = self.polyhedron.corners_of(facets)
        at = (3 * corners[:, None] + np.arange(3)).ravel()
        return replace(
            self,
            polyhedron=self.polyhedron.only(facets),
            covariance_mm2=self.covariance_mm2[np.ix_(at, at)],
            outlined_mm2=self.outlined_mm2[:, list(facets)],
            looks_at=self.looks_at[corners],
        )


def fuse(looks: Sequence[LookFacets], shared: Array, table_mm: float | None = None) -> FusedLooks | None:
    """Everything the looks measured, as one; None where they measured nothing.

    One more look is one more in the sequence: the answer is that of all of them, whatever their order. shared (9, 9):
    covariance of what errs in every look alike: hand-eye (6) in the cyclopean frame, then u, v and disparity, px;
    table_mm: the height, base, of the table that it lies on.
    """
    rings = [_rings(one.groups) for one in looks]
    if not any(rings):
        return None
    seen = [_corners(one) for one in looks]
    places, error, owner = [one.base_from_cyclopean for one in looks], np.zeros(9), list[Index]()
    moved, spread, facets = list[Array](), list[Array](), list[Pieces]()
    whole: FusedCorners | None = None
    for doubted in (True, False):
        moved = [_based(one, place, error) for one, place in zip(seen, places, strict=True)]
        spread = [place[:3, :3] @ one.covariance_mm2 @ place[:3, :3].T for one, place in zip(seen, places, strict=True)]
        wide = [c + _doubt(one, shared) for c, one in zip(spread, seen, strict=True)] if doubted else spread
        owner, facets = match_corners(moved, wide, rings), match_facets(moved, spread, rings)
        seen = [replace(one, owner=numbers) for one, numbers in zip(seen, owner, strict=True)]
        if doubted:
            whole = adjust_looks(seen, _planes(facets, rings, owner), shared)
            places, error = list(whole.places), whole.error
    assert whole is not None
    facets = drop_contradicted(facets, moved, rings, whole.places[:, :3, 3])
    groups = [[k for k, group in enumerate(one.groups) for _ in group.facets] for one in looks]
    pieces = _Measured(rings, groups, owner, facets, moved, spread)
    floor = () if table_mm is None else (assumed_plane(np.array([0.0, 0.0, table_mm]), np.array([0.0, 0.0, 1.0])),)
    shapes = _shapes(pieces, floor)
    often = [ring for ring, k in shapes if pieces.looks(k) > 1] or [ring for ring, _ in shapes]
    shapes = _shapes(pieces, (*floor, *_behind(*_numbered(pieces, often))))
    numbered, corners = _numbered(pieces, [ring for ring, _ in shapes])
    unseen = corners[1 + max(int(numbers.max()) for numbers in owner if len(numbers)) :]
    flat = _planes(facets, rings, owner, [(k, ring) for (_, k), ring in zip(shapes, numbered, strict=True)])
    final = adjust_looks(seen, flat, shared, unseen)
    return _fused(looks, final, pieces, [(k, ring) for (_, k), ring in zip(shapes, numbered, strict=True)])


@dataclass(frozen=True, eq=False)
class _Measured:
    """What the looks saw, by look: rings of corners, the group of each, what number each corner has, where it is in the
    base (N, 3), and its covariance (N, 3, 3); facets: which (look, ring) are one facet."""

    rings: list[list[Ring]]
    groups: list[list[int]]
    owner: list[Index]
    facets: list[Pieces]
    moved: list[Array]
    spread: list[Array]

    def marks(self, look: int, ring: int) -> list[tuple[int, int]]:
        """Return the marks of a piece, which connect it with others: (-1, number of a corner), (look, group)."""
        return [
            (look, self.groups[look][ring]),
            *((-1, int(n)) for n in self.owner[look][list(self.rings[look][ring])]),
        ]

    def outlines(self, facet: int) -> list[Array]:
        """Return the outlines (N, 3) mm, base frame, of one facet."""
        return [self.moved[k][list(self.rings[k][f])] for k, f in self.facets[facet]]

    def looks(self, facet: int) -> int:
        """Return how many looks saw any of the pieces of a facet."""
        return len({k for k, _ in self.facets[facet]})

    def doubts(self, facet: int) -> list[Array]:
        """Return the root of the trace of the covariance, mm, of each corner (N,) of those outlines."""
        spreads = [self.spread[k][list(self.rings[k][f])] for k, f in self.facets[facet]]
        return [np.sqrt(np.trace(spread, axis1=1, axis2=2) + MIN_MM2) for spread in spreads]


def _shapes(pieces: _Measured, unseen: Sequence[Plane]) -> list[tuple[Array, int]]:
    """Outlines (N, 3) base of all facets, and which set of pieces each is of. unseen: planes that may bound them."""
    found = []
    marks = [{mark for k, f in one for mark in pieces.marks(k, f)} for one in pieces.facets]
    for members in connected_by_marks(marks):
        planes = [fit_facet_plane(pieces.outlines(k), pieces.doubts(k), pieces.looks(k)) for k in members]
        found += [(ring, k) for k, rings in zip(members, outlines(planes, unseen), strict=True) for ring in rings]
    return found


def _behind(rings: Sequence[Ring], places: Array) -> list[Plane]:
    """Planes that may lie beyond what was seen: each through two edges, of two facets, that meet and have nothing on
    their other side."""
    edges = {(a, b): k for k, ring in enumerate(rings) for a, b in sides_of(ring)}
    after = {edge: k for edge, k in edges.items() if edge[::-1] not in edges}
    found = []
    for (a, b), (c, d) in combinations(after, 2):
        middle = {a, b} & {c, d}
        if after[a, b] == after[c, d] or len(middle) != 1:
            continue
        at = places[middle.pop()]
        normal = np.cross(places[b] - places[a], places[d] - places[c])
        size = np.linalg.norm(places[b] - places[a]) * np.linalg.norm(places[d] - places[c])
        if np.linalg.norm(normal) > MIN_SINE * size:
            found.append(assumed_plane(at, normal))
    return found


def _numbered(pieces: _Measured, shapes: Sequence[Array]) -> tuple[list[Ring], Array]:
    """The outlines' corners by number: that of the measured corner which lies there, else a new one; and where all
    are, (K, 3)."""
    numbers = np.concatenate(pieces.owner)
    count = int(numbers.max()) + 1
    known = np.zeros((count, 3))
    np.add.at(known, numbers, np.concatenate(pieces.moved))
    places = [*(known / np.bincount(numbers, minlength=count)[:, None])]
    found = list[Ring]()
    for shape in shapes:
        side = float(np.linalg.norm(np.roll(shape, -1, axis=0) - shape, axis=1).min())
        ring, taken = list[int](), set[int]()
        for corner in shape:
            apart = np.linalg.norm(np.array(places) - corner, axis=1)
            apart[list(taken)] = np.inf
            k = int(np.argmin(apart))
            if apart[k] > min(WELD_MM, OF_SHORTEST * side):
                k = len(places)
                places.append(corner)
            taken.add(k)
            ring.append(k)
        found.append(tuple(ring))
    return found, np.array(places)


def _planes(
    facets: list[Pieces],
    rings: list[list[Ring]],
    owner: list[Index],
    shapes: Sequence[tuple[int, Ring]] = (),
) -> list[Index]:
    """The corners of each plane: those of its pieces, and of its outlines (set of pieces, ring); of four and more."""
    found = []
    for number, one in enumerate(facets):
        corners = [owner[k][list(rings[k][f])] for k, f in one]
        corners += [np.array(ring, np.intp) for k, ring in shapes if k == number]
        found.append(np.unique(np.concatenate(corners)))
    return [plane for plane in found if len(plane) > 3]


def group_of(fused: FusedLooks, members: Sequence[int], cyclopean_from_base: Array, rig: StereoRig) -> Group:
    """Some facets of what is known as a look from there would have measured them, seen from there or not: what a
    recogniser takes. Each corner has its own covariance."""
    solid, facets = fused.polyhedron, []
    turn = cyclopean_from_base[:3, :3]
    for k in members:
        ring = solid.rings[k]
        corners = frames.apply(cyclopean_from_base, solid.corners_mm[ring])
        left, right = rig.left.project(corners), rig.right.project(corners)
        spread = turn @ solid.covariance_mm2[ring] @ turn.T
        facets.append(Facet(corners, spread, left, right, np.zeros(len(ring)), planarity(corners)))
    return Group(tuple(facets), tuple(solid.facets[k] for k in members))


def _rings(groups: Sequence[Group]) -> list[Ring]:
    """All facets of a look, their corners numbered through."""
    found, first = list[Ring](), 0
    for group in groups:
        found += [tuple(first + k for k in ring) for ring in group.polyhedron.facets]
        first += len(group.polyhedron.corners_mm)
    return found


def _corners(look: LookFacets) -> LookCorners:
    solids = [group.polyhedron for group in look.groups]
    points = np.concatenate([np.zeros((0, 3)), *(solid.corners_mm for solid in solids)])
    spread = np.concatenate([np.zeros((0, 3, 3)), *(solid.covariance_mm2 for solid in solids)])
    alone = np.arange(len(points))
    return LookCorners(
        points, spread, alone, look.base_from_cyclopean, look.covariance, look.focal_px, look.baseline_mm
    )


def _based(one: LookCorners, place: Array, error: Array) -> Array:
    """A look's corners (N, 3) in the base."""
    return frames.apply(place, one.points_mm + shared_motion(one.points_mm, one.focal_px, one.baseline_mm) @ error)


def _doubt(one: LookCorners, shared: Array) -> Array:
    """(N, 3, 3) base: what a look's place adds to its corners before the looks are held against each other."""
    turn = one.base_from_cyclopean[:3, :3]
    own = frames.point_motion(one.points_mm @ turn.T)
    alike = turn @ shared_motion(one.points_mm, one.focal_px, one.baseline_mm)
    return np.asarray(own @ one.covariance @ own.swapaxes(1, 2) + alike @ shared @ alike.swapaxes(1, 2))


def _fused(
    looks: Sequence[LookFacets], whole: FusedCorners, pieces: _Measured, shapes: Sequence[tuple[int, Ring]]
) -> FusedLooks:
    """shapes: (set of pieces, ring); of two that claim one side of an edge that which was seen oftener stays."""
    edges, kept = set[tuple[int, int]](), list[tuple[int, Ring]]()
    for k, ring in sorted(shapes, key=lambda shape: -len(pieces.facets[shape[0]])):
        own = set(sides_of(ring))
        if not own & edges:
            edges |= own
            kept.append((k, ring))
    seen = np.zeros((len(looks), len(kept)))
    middles = np.array([whole.corners_mm[list(ring)].mean(0) for _, ring in kept])
    for number, one in enumerate(pieces.facets):
        mine = [place for place, (k, _) in enumerate(kept) if k == number]
        for (k, _), outline in zip(one, pieces.outlines(number), strict=True):
            if mine:
                nearest = mine[int(np.argmin(np.linalg.norm(middles[mine] - outline.mean(0), axis=1)))]
                seen[k, nearest] += float(np.linalg.norm(area_vector(outline)))
    counts = np.bincount(np.concatenate([np.unique(numbers) for numbers in pieces.owner]))
    measured = np.zeros(len(whole.corners_mm), np.intp)
    measured[: len(counts)] = counts
    here = np.arange(len(whole.corners_mm))
    blocks = whole.covariance_mm2.reshape(len(here), 3, len(here), 3)[here, :, here, :]
    solid = Polyhedron(whole.corners_mm, tuple(ring for _, ring in kept), blocks)
    every = FusedLooks(tuple(looks), whole.places, solid, whole.covariance_mm2, seen, measured, whole.misfit)
    return every.only(range(len(kept)))
