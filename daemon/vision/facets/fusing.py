"""What several looks from different places measured of one thing -> one partial polyhedron in the base frame. Pure.

Each look's place is free within what the arm errs anew, all share one error of hand-eye and cameras, which looks from
several sides tell, and a facet's corners lie in one plane. Nothing is named; from where to look next is not asked.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from daemon import frames
from daemon.arrays import Array
from daemon.vision.facets.association import Ring, one_corner, one_facet
from daemon.vision.facets.grouping import connected
from daemon.vision.facets.looks_adjustment import Adjusted, LookCorners, adjusted, shared_motion
from daemon.vision.geometry import Polyhedron, StereoRig, area_vector, planarity
from daemon.vision.values import Facet, Group

Index = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class SeenFrom:
    """What one look measured of a thing, and from where. groups: facets in the cyclopean frame, with the covariance of
    the pixels alone; base_from_cyclopean (4, 4) as the arm says; covariance (6, 6) of what errs in it anew each time;
    focal_px, baseline_mm: the rig's, for what an error of all looks does in this one."""

    groups: tuple[Group, ...]
    base_from_cyclopean: Array
    covariance: Array
    focal_px: float
    baseline_mm: float


@dataclass(frozen=True, eq=False)
class Fused:
    """What is known of a thing from the looks so far.

    looks: as they were given; base_from_cyclopean (L, 4, 4): their places as all looks together have them; polyhedron:
    the facets, corners welded once, in the base frame, untyped, open where nothing was seen; covariance_mm2
    (3 K, 3 K) of all its corners together, everything in it; seen_mm2 (L, F): how much of each facet's plane each look
    outlined, 0 where it did not see it; looks_at (K,): from how many looks each corner was measured; misfit: rms of
    what is left, sigmas.
    """

    looks: tuple[SeenFrom, ...]
    base_from_cyclopean: Array
    polyhedron: Polyhedron
    covariance_mm2: Array
    seen_mm2: Array
    looks_at: Index
    misfit: float

    @property
    def seen(self) -> NDArray[np.bool_]:
        """(L, F) which look saw which facet."""
        return np.asarray(self.seen_mm2 > 0)

    @property
    def hidden(self) -> Array:
        """(L, F) which share of each facet a look left hidden."""
        whole = np.linalg.norm(self.polyhedron.areas_mm2, axis=1)
        return np.asarray(np.clip(1.0 - self.seen_mm2 / np.maximum(whole, 1e-9), 0.0, 1.0))

    @property
    def confirmed(self) -> NDArray[np.bool_]:
        """(F,) the facets of which every corner was measured from two places or more: a corner that is none, where one
        facet hides part of another, moves as the eye does."""
        return np.array([bool((self.looks_at[ring] > 1).all()) for ring in self.polyhedron.rings], bool)

    def things(self) -> list[list[int]]:
        """Facets that hang together by shared edges."""
        return connected(self.polyhedron.touching)


def fuse(looks: Sequence[SeenFrom], shared: Array) -> Fused | None:
    """Everything the looks measured, as one; None where they measured nothing.

    One more look is one more in the sequence: the answer is that of all of them, whatever their order. shared (9, 9):
    covariance of what errs in every look alike: hand-eye (6) in the cyclopean frame, then u, v and disparity, px.
    """
    outlines = [_rings(one.groups) for one in looks]
    if not any(outlines):
        return None
    seen = [_corners(one) for one in looks]
    places, error = [one.base_from_cyclopean for one in looks], np.zeros(9)
    for doubted in (True, False):
        moved = [_based(one, place, error) for one, place in zip(seen, places, strict=True)]
        spread = [place[:3, :3] @ one.covariance_mm2 @ place[:3, :3].T for one, place in zip(seen, places, strict=True)]
        if doubted:
            spread = [c + _doubt(one, shared) for c, one in zip(spread, seen, strict=True)]
        owner = one_corner(moved, spread, outlines)
        facets = one_facet(moved, outlines, owner)
        seen = [replace(one, owner=numbers) for one, numbers in zip(seen, owner, strict=True)]
        planes = [np.unique(np.concatenate([owner[k][list(outlines[k][f])] for k, f in one])) for one in facets]
        whole = adjusted(seen, [p for p in planes if len(p) > 3], shared)
        places, error = list(whole.places), whole.error
    return _fused(looks, whole, outlines, owner, facets, moved)


def group_of(fused: Fused, members: Sequence[int], cyclopean_from_base: Array, rig: StereoRig) -> Group:
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


def only(fused: Fused, members: Sequence[int]) -> Fused:
    """What is known, of some of its facets alone."""
    solid = fused.polyhedron
    kept = [solid.facets[k] for k in members]
    corners = np.array(sorted({k for ring in kept for k in ring}), np.intp)
    number = {int(k): n for n, k in enumerate(corners)}
    at = (3 * corners[:, None] + np.arange(3)).ravel()
    part = Polyhedron(
        solid.corners_mm[corners],
        tuple(tuple(number[k] for k in ring) for ring in kept),
        solid.covariance_mm2[corners],
    )
    return Fused(
        fused.looks,
        fused.base_from_cyclopean,
        part,
        fused.covariance_mm2[np.ix_(at, at)],
        fused.seen_mm2[:, list(members)],
        fused.looks_at[corners],
        fused.misfit,
    )


def _rings(groups: Sequence[Group]) -> list[Ring]:
    """All facets of a look, their corners numbered through."""
    found, first = list[Ring](), 0
    for group in groups:
        found += [tuple(first + k for k in ring) for ring in group.polyhedron.facets]
        first += len(group.polyhedron.corners_mm)
    return found


def _corners(look: SeenFrom) -> LookCorners:
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
    looks: Sequence[SeenFrom],
    whole: Adjusted,
    outlines: list[list[Ring]],
    owner: list[Index],
    facets: list[list[tuple[int, int]]],
    moved: list[Array],
) -> Fused:
    """Each facet with the outline most looks agree on, the largest of those; two that claim one side of an edge: the
    one seen oftener."""
    measured = np.bincount(np.concatenate([np.unique(numbers) for numbers in owner]), minlength=len(whole.corners_mm))
    chosen = list[tuple[tuple[int, float], Ring, list[tuple[int, int]]]]()
    for one in facets:
        rings = [_from_least(tuple(int(n) for n in owner[k][list(outlines[k][f])])) for k, f in one]
        rings = [ring for ring in rings if len(set(ring)) == len(ring)]
        if not rings:
            continue
        votes = Counter(rings)
        worth = {ring: (votes[ring], _area(whole.corners_mm, ring)) for ring in votes}
        best = max(worth, key=lambda ring: worth[ring])
        chosen.append((worth[best], best, one))
    edges, kept = set[tuple[int, int]](), list[tuple[Ring, list[tuple[int, int]]]]()
    for _, ring, one in sorted(chosen, key=lambda c: c[0], reverse=True):
        own = set(zip(ring, (*ring[1:], ring[0]), strict=True))
        if not own & edges:
            edges |= own
            kept.append((ring, one))
    seen = np.zeros((len(looks), len(kept)))
    for place, (_, one) in enumerate(kept):
        for k, f in one:
            seen[k, place] += _area(moved[k], outlines[k][f])
    here = np.arange(len(whole.corners_mm))
    blocks = whole.covariance_mm2.reshape(len(here), 3, len(here), 3)[here, :, here, :]
    solid = Polyhedron(whole.corners_mm, tuple(ring for ring, _ in kept), blocks)
    every = Fused(
        tuple(looks), whole.places, solid, whole.covariance_mm2, seen, np.asarray(measured, np.intp), whole.misfit
    )
    return only(every, range(len(kept)))


def _from_least(ring: Ring) -> Ring:
    """The ring begun at its least number."""
    at = ring.index(min(ring))
    return ring[at:] + ring[:at]


def _area(points: Array, ring: Sequence[int]) -> float:
    return float(np.linalg.norm(area_vector(points[list(ring)])))
