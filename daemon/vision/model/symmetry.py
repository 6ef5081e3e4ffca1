"""Turns that take solids onto themselves, of many solids at once: a thousand taught parts are prepared in a fraction of
a second.

In: solids. Out: for each, which corner takes each one's place, and the turn. A turn is given by where it takes one
side of one facet and the corner before it; those whose lengths allow it are tried on all corners and facets.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple, TypeVar

import cv2
import numpy as np

from daemon import frames
from daemon.arrays import Array, Flags, Index
from daemon.vision.geometry import Hole, OutlineArc, Polyhedron, apart2, axes_in, basis, circle_along, exact

T = TypeVar("T")

EXACT_MM = 0.01
"""Largest distance, mm, between corners that a drawing made the same."""
SAME_RIM_MM = 0.15
"""Largest distance, mm, between rims of holes that are the same: the corners of a round one need not lie on each
other."""
ROUND_FLOOR = 0.1
"""Share of its radius by which a round floor, kept as an octagon around it, may stand out of its bore."""
MAX_AT_ONCE = 2_000_000
"""Distances between corners that are held at once."""
KEPT_MM, MAX_MIRRORED = 2.0, 12
"""Largest distance, mm, of a corner of a solid's mirror image from one that is taken for it; largest number of ways to
lay it that are kept."""


class Turns(NamedTuple):
    """Of one solid: corners (S, K), which corner takes each one's place; motions (S, 4, 4) that take it there. The
    first is none."""

    corners: Index
    motions: Array


@lru_cache(maxsize=4096)
def symmetries(solid: Polyhedron) -> Turns:
    """The turns that take a solid onto itself, its holes onto holes, to EXACT_MM. A solid that was measured has no
    other than none: its turns differ by what its corners differ by."""
    return turns_onto_themselves((solid,), EXACT_MM)[0]


@lru_cache(maxsize=1024)
def turns_but_for_holes(solid: Polyhedron) -> Array:
    """(S, 4, 4) the motions that take a solid onto itself wherever its holes, and the facets in them, come to lie, one
    of those that differ by one of its symmetries; the first is none."""
    outside = replace(solid.only(_outside_of_holes(solid)), holes=())
    own, found = symmetries(solid).motions, list[Array]()
    for motion in symmetries(outside).motions:
        if not any(np.abs(frames.inverse(one) @ motion - own).max((1, 2)).min() < SAME_RIM_MM for one in found):
            found.append(motion)
    return np.array(found)


@lru_cache(maxsize=1024)
def facet_turns(solid: Polyhedron, facet: int) -> Array:
    """(S, 4, 4) the motions that lay a facet of a solid where another of its facets is, corner on corner."""
    rings = [solid.corners_mm[ring] for ring in solid.rings]
    own, found = rings[facet], list[Array]()
    longest = int(np.linalg.norm(np.roll(own, -1, 0) - own, axis=1).argmax())
    own = np.roll(own, -longest, 0)
    own_from_solid = frames.inverse(_frame_at(own))
    for other, ring in enumerate(rings):
        for shift in range(len(own) if other != facet and len(ring) == len(own) else 0):
            there = np.roll(ring, -shift, 0)
            motion = _frame_at(there) @ own_from_solid
            if np.abs(frames.apply(motion, own) - there).max() < KEPT_MM:
                found.append(motion)
    return np.reshape(found, (-1, 4, 4))


class Axis(NamedTuple):
    """point_mm (3,) on it, and way (3,), unit, in the frame of a solid."""

    point_mm: Array
    direction: Array


@lru_cache(maxsize=1024)
def axis_of_revolution(solid: Polyhedron) -> Axis | None:
    """The axis about which a solid looks the same in every turn: all edges that show, and all rims of holes, are
    circles about it; None where one is not."""
    if not len(solid.lines[0]) or not solid.circles[:, 3].all():
        return None
    way, point = solid.normals[0], solid.circles[0, :3]
    rims = [circle_along(hole.ring_mm, way) for hole in solid.holes]
    centres = np.array([*solid.circles[:, :3], *(centre for centre, _, _ in rims)]) - point
    beside_mm = np.linalg.norm(centres - (centres @ way)[:, None] * way, axis=1).max()
    tilted = np.linalg.norm(np.cross(solid.normals, way), axis=1).max() > EXACT_MM
    return None if tilted or max(beside_mm, *(off for *_, off in rims), 0.0) > SAME_RIM_MM else Axis(point, way)


def _outside_of_holes(solid: Polyhedron) -> list[int]:
    """The facets that are no hole's floor or wall."""
    within = np.zeros(len(solid.facets), bool)
    for hole in solid.holes:
        normal = solid.normals[hole.facet]
        across = axes_in(normal)
        ring = (hole.ring_mm @ across.T).astype(np.float32)
        room = -SAME_RIM_MM - ROUND_FLOOR * np.ptp(ring, axis=0).min() / 2
        inside = np.array([cv2.pointPolygonTest(ring, p, True) > room for p in solid.corners_mm @ across.T])
        inside &= (solid.corners_mm - hole.ring_mm[0]) @ normal < SAME_RIM_MM
        within |= [bool(inside[facet].all()) for facet in solid.rings]
    return np.flatnonzero(~within).tolist()


class MirrorImage(NamedTuple):
    """A solid in a mirror, laid where it keeps corners of the one it is of; kept (F,): which of its facets are that
    one's."""

    solid: Polyhedron
    kept: Flags


@lru_cache(maxsize=256)
def mirror_images(solid: Polyhedron) -> tuple[MirrorImage, ...]:
    """A solid in mirrors that keep at least two sides of one of its facets, those that keep most corners first; none
    where one keeps all, as the solid is then its own mirror image."""
    corners, (here, after, before, *_) = solid.corners_mm, _flags((solid,))
    a, b, c = (corners[which] for which in (here, after, before))
    lengths, turned = (
        np.linalg.norm(np.stack([one - a, other - a, one - other], 1), axis=2) for one, other in ((b, c), (c, b))
    )
    one, other = np.nonzero((np.abs(lengths[:, None] - turned) < 2 * KEPT_MM).all(2))
    flip = _frames(a, c, b)[other] @ np.diag([1.0, 1.0, -1.0]) @ _frames(a, b, c)[one].transpose(0, 2, 1)
    moved = (corners - a[one, None]) @ flip.transpose(0, 2, 1) + a[other, None]
    kept = apart2(moved, corners).min(2) < KEPT_MM**2
    if not len(kept) or kept.all(1).any():
        return ()
    found = list[int]()
    for k in np.argsort(-kept.sum(1), kind="stable").tolist():
        if len(found) == MAX_MIRRORED:
            break
        if all(np.abs(moved[k] - moved[same]).max() > KEPT_MM for same in found):
            found.append(k)
    facets = [ring[::-1] for ring in solid.facets]
    return tuple(
        MirrorImage(
            replace(exact(moved[k], facets), arcs=_flipped(solid, flip[k], a[one[k]], a[other[k]])),
            np.array([kept[k, ring].all() for ring in solid.rings]),
        )
        for k in found
    )


def _flipped(solid: Polyhedron, flip: Array, at: Array, there: Array) -> tuple[OutlineArc, ...]:
    """The arcs of a solid turned by a flip (3, 3) about a point (3,) that comes to lie there (3,)."""
    return tuple(replace(arc, points_mm=(arc.points_mm - at) @ flip.T + there) for arc in solid.arcs)


def turns_onto_themselves(shapes: Sequence[Polyhedron], within_mm: float) -> list[Turns]:
    """Return of each solid the turns after which every corner lies within so many mm of one, every facet on one, and
    every hole in one."""
    turns = in_batches(
        shapes, lambda count: MAX_AT_ONCE // (24 * count * count), lambda own: _of_as_many(own, within_mm)
    )
    rims_mm = max(within_mm, SAME_RIM_MM)
    return [_keeping_holes(shape.holes, own, rims_mm) for shape, own in zip(shapes, turns, strict=True)]


def in_batches(
    shapes: Sequence[Polyhedron], most: Callable[[int], int], of_as_many: Callable[[list[Polyhedron]], list[T]]
) -> list[T]:
    """Apply a function of solids that have as many corners as each other to several, as many together as `most` says of
    a number of corners; return what it says of each."""
    counts, found = np.array([len(shape.corners_mm) for shape in shapes], np.intp), dict[int, T]()
    for count in np.unique(counts).tolist():
        alike, each = np.flatnonzero(counts == count).tolist(), max(most(count), 1)
        for own in (alike[first : first + each] for first in range(0, len(alike), each)):
            found.update(zip(own, of_as_many([shapes[k] for k in own]), strict=True))
    return [found[k] for k in range(len(shapes))]


def _keeping_holes(holes: Sequence[Hole], turns: Turns, within_mm: float) -> Turns:
    """Keep those of the turns that take every hole onto one."""
    if not holes or len(turns.motions) == 1:
        return turns
    kept = [
        all(
            any(max(_off_rim_mm(rim, other.ring_mm), _off_rim_mm(other.ring_mm, rim)) < within_mm for other in holes)
            for rim in (frames.apply(motion, one.ring_mm) for one in holes)
        )
        for motion in turns.motions
    ]
    return Turns(turns.corners[kept], turns.motions[kept])


def _off_rim_mm(points: Array, ring: Array) -> float:
    """Return how far the farthest of points (N, 3) lies from the sides of a ring (M, 3), mm."""
    way = np.roll(ring, -1, 0) - ring
    to = points[:, None] - ring
    share = ((to * way).sum(2) / np.maximum((way * way).sum(1), 1e-12)).clip(0, 1)
    return float(np.linalg.norm(to - share[..., None] * way, axis=2).min(1).max())


def _of_as_many(shapes: Sequence[Polyhedron], within_mm: float) -> list[Turns]:
    """Return the turns, as `turns_onto_themselves` does, of solids that have as many corners as each other."""
    corners = np.stack([shape.corners_mm for shape in shapes])
    here, after, before, sides, facet, owner = _flags(shapes)
    a, b, c = (corners[owner, which] for which in (here, after, before))
    lengths = np.stack([np.linalg.norm(one - other, axis=1) for one, other in ((a, b), (a, c), (b, c))], 1)
    base = np.searchsorted(owner, np.arange(len(shapes)))[owner]
    may = np.flatnonzero((sides == sides[base]) & (np.abs(lengths - lengths[base]) < 2 * within_mm).all(1))
    axes = _frames(a, b, c)
    turn = axes[may] @ axes[base[may]].transpose(0, 2, 1)
    shift = a[may] - (turn @ a[base[may], :, None])[..., 0]
    whose = owner[may]
    moved = corners[whose] @ turn.transpose(0, 2, 1) + shift[:, None]
    off2 = apart2(moved, corners[whose])
    onto = off2.argmin(2)
    onto[may == base[may]] = np.arange(onto.shape[1])  # as it lies, also where two of its corners lie at one place
    near = np.take_along_axis(off2, onto[..., None], 2)[..., 0].max(1) < within_mm**2
    near &= (np.sort(onto, 1) == np.arange(onto.shape[1])).all(1)
    near[near] = _facets_onto_facets(onto[near], whose[near], here, facet, owner)
    motions = frames.inverse(frames.rigid(turn[near], shift[near]))
    ends = np.searchsorted(whose[near], np.arange(1, len(shapes)))
    return [Turns(*own) for own in zip(np.split(onto[near], ends), np.split(motions, ends), strict=True)]


def _flags(shapes: Sequence[Polyhedron]) -> tuple[Index, Index, Index, Index, Index, Index]:
    """Return arrays (N,) of every side of every facet, solid after solid: its corner, the next one, the one before, how
    many sides the facet has, the number of the facet among all, and of the solid."""
    sizes = np.array([len(ring) for shape in shapes for ring in shape.facets], np.intp)
    here, after = (np.concatenate([shape.steps[k] for shape in shapes]) for k in (0, 1))
    facet = np.repeat(np.arange(len(sizes)), sizes)
    first = (np.cumsum(sizes) - sizes)[facet]
    place = np.arange(len(here)) - first
    before = here[first + (place - 1) % sizes[facet]]
    owner = np.repeat(np.arange(len(shapes)), [len(shape.steps[0]) for shape in shapes])
    return here, after, before, sizes[facet], facet, owner


def _frames(a: Array, b: Array, c: Array) -> Array:
    """(N, 3, 3) rotations whose columns point from a (N, 3) to b, from there towards c, and across both."""
    return basis((b - a) / np.linalg.norm(b - a, axis=1, keepdims=True), c - a)


def _frame_at(ring: Array) -> Array:
    """(4, 4) at the first of the corners (N, 3) of a ring, along its first side."""
    return frames.rigid(_frames(*ring[:3, None])[0], ring[0])


def _facets_onto_facets(onto: Index, whose: Index, here: Index, facet: Index, owner: Index) -> Flags:
    """(T,) whether the corners of every facet come to lie on those of one, where corner k of the solid whose (T,) lies
    on the corner onto (T, K) of it. Facets are identified by sums of random numbers, one of each corner."""
    if not len(onto):
        return np.zeros(0, bool)
    number = np.random.default_rng(1).integers(1, 2**62, size=(onto.shape[1],))
    begin = np.searchsorted(owner, whose)
    count = np.searchsorted(owner, whose, side="right") - begin
    of = np.repeat(np.arange(len(onto)), count)
    flag = np.arange(len(of)) + np.repeat(begin - np.cumsum(count) + count, count)
    key = of * (int(facet[-1]) + 1) + facet[flag]
    first = np.flatnonzero(np.diff(key, prepend=-1))
    was = np.add.reduceat(number[here[flag]], first)
    now = np.add.reduceat(number[onto[of, here[flag]]], first)
    turn = of[first]
    same = was[np.lexsort((was, turn))] == now[np.lexsort((now, turn))]
    return np.asarray(np.logical_and.reduceat(same, np.flatnonzero(np.diff(turn, prepend=-1))))
