"""Where taught parts would be that have such corners as both eyes see in space, the likeliest guesses of all parts.

In: corners in space, maps of segments, taught solids. Out: poses, to be laid onto both images. A guess is no
recognition. The second edge of a corner lies in the left eye's plane at the angle that the taught corner has, and is
borne out by the right eye. How much of both edges shows, and that neither goes on beyond its taught length, is reckoned
once for all parts that have such an edge: few guesses are worth a pose, whatever was taught.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from daemon.arrays import Array, Flags, Image32, Index
from daemon.vision.geometry import Baseline, Polyhedron
from daemon.vision.image import runs
from daemon.vision.registration.directed import DirectedMap, Rays
from daemon.vision.registration.posed import Posed, Solids
from daemon.vision.registration.space_corners import ANGLE, SpaceCorners, angle, basis, sorted_by_kind, taught_corners

OFF = np.radians(7.0)  # by how much a corner's arm may point elsewhere in the right eye than the taught angle says
MOST_ASKED = 0.03  # by how much of its cosine no direction in the plane has the taught angle
MOST_COUNTED = 6000  # guesses of one part and side of the plane that count as such
MOST_GUESSES, MOST_OF_ONE = (4000, 200), (16, 1)
"""Of all parts, and at one corner in space, those for whose two edges most speaks: so many, or so many for each taught
part where that is more; at a corner its share of all, where corners are few. In 57 rendered looks with four parts
taught the first good guess was among the first 500 of some 10,000 in nineteen of twenty. With 64 taught, 4,000 and 16
named 37 of 57 parts on hard tables, these 46; twice as many at a corner named no more."""
LENGTH_MM = 1.0
"""Edges whose lengths round to the same in this are one kind."""
LEAST_NATS = 20.0  # that must speak for two edges in both eyes together


@dataclass(frozen=True, eq=False)
class Kinds:
    """The corners of several solids, sorted by kind: part (K,), corner_from_part (K, 4, 4) and cosine (K,) of each, and
    about (K,), the number of its angle among cosines (U,). First edges have lengths first_mm (A,); second ones
    second_mm (Q,), at angles at (Q,). kinds (T, 2): which first and which second edge; begins (T + 1,): where the
    corners of each begin.
    """

    part: Index
    corner_from_part: Array
    cosine: Array
    about: Index
    cosines: Array
    first_mm: Array
    second_mm: Array
    at: Index
    kinds: Index
    begins: Index


@lru_cache(maxsize=8)
def corner_kinds(shapes: tuple[Polyhedron, ...]) -> Kinds:
    """All corners of solids; lengths and angles are of a kind that round to the same."""
    each = [taught_corners(shape) for shape in shapes]
    part = np.repeat(np.arange(len(each)), [len(found[1]) for found in each])
    from_part, cosines, lengths = (np.concatenate([found[k] for found in each]) for k in range(3))
    angles, which = np.unique((np.arccos(np.clip(cosines, -1, 1)) / ANGLE).round(), return_inverse=True)
    first_mm, first = np.unique((lengths[:, 0] / LENGTH_MM).round() * LENGTH_MM, return_inverse=True)
    second_mm = (lengths[:, 1] / LENGTH_MM).round() * LENGTH_MM
    seconds, second = np.unique(np.stack([which, second_mm], 1), axis=0, return_inverse=True)
    kinds, order, begins = sorted_by_kind(np.stack([first, second.reshape(-1)], 1))
    return Kinds(
        part[order], from_part[order], cosines[order], which[order], np.cos(angles * ANGLE), first_mm,
        seconds[:, 1], seconds[:, 0].astype(np.intp), kinds.astype(np.intp), begins,
    )  # fmt: skip


def guesses_from_space(
    corners: SpaceCorners, geometry: Baseline, maps: tuple[DirectedMap, DirectedMap], solids: Solids
) -> tuple[Posed, Array, int]:
    """Taught corners laid onto corners in space whose arms could make their angle, those MOST_GUESSES for which most
    speaks; about which line each could be turned and show nearly the same two edges to the left eye, a point of it and
    its direction (G, 2, 3) cyclopean; and how many could."""
    kinds = corner_kinds(solids.shapes) if solids.shapes else None
    if kinds is None or not len(kinds.part) or not len(corners.at):
        return Posed(solids, np.zeros(0, np.intp), np.zeros((0, 4, 4))), np.zeros((0, 2, 3)), 0
    could, other = _could_be(corners, kinds.cosines[:, None])
    counts = np.minimum(
        [np.bincount(kinds.part, could[side].sum(1)[kinds.about]) for side in (0, 1)], MOST_COUNTED
    ).sum()
    nats = _nats(corners, geometry, maps, kinds, could, other)
    where, side, which = _likeliest(nats, kinds, *_most(len(solids.labels), len(corners.at)))
    cyclopean_from_corner = np.zeros((len(which), 4, 4))
    turn = geometry.cyclopean_from_baseline
    seconds = _second_edges(corners.chosen(where), kinds.cosine[which])[side, np.arange(len(which))]
    cyclopean_from_corner[:, :3, :3] = turn @ basis(corners.firm[where], seconds)
    middle = corners.at - [geometry.length_mm / 2, 0.0, 0.0]
    cyclopean_from_corner[:, :3, 3] = middle[where] @ turn.T + geometry.middle_mm
    cyclopean_from_corner[:, 3, 3] = 1.0
    about = _hinge(corners.at[where], corners.firm[where], seconds) @ turn.T
    hinges = np.stack([cyclopean_from_corner[:, :3, 3], about], 1)
    return Posed(solids, kinds.part[which], cyclopean_from_corner @ kinds.corner_from_part[which]), hinges, int(counts)


def _most(taught: int, corners: int) -> tuple[int, int]:
    """Guesses in all, and at one of so many corners."""
    most, of_one = (max(least, each * taught) for least, each in (MOST_GUESSES, MOST_OF_ONE))
    return most, max(of_one, most // corners)


def _hinge(ray: Array, one: Array, other: Array) -> Array:
    """(G, 3) unit directions about which corners at rays (G, 3) from an eye turn so that both of their edges, along one
    and other (G, 3), stay in their planes with the eye and keep their angle."""
    one, other = (ray - edge * (edge * ray).sum(1, keepdims=True) for edge in (one, other))
    found = np.cross(one, other)
    return np.asarray(found / np.maximum(np.linalg.norm(found, axis=1, keepdims=True), 1e-9))


def _second_edges(corners: SpaceCorners, cosines: Array) -> Array:
    """(2, ..., 3) directions in which the second arms of corners make angles of cosines (...), on either side."""
    along = corners.firm - (corners.firm * corners.plane).sum(1, keepdims=True) * corners.plane
    size = np.linalg.norm(along, axis=1)
    along = along / np.maximum(size, 1e-9)[:, None]
    share = np.clip(cosines / np.maximum(size, 1e-9), -1.0, 1.0)[..., None]
    aside = np.sqrt(1 - share * share) * np.cross(corners.plane, along)
    return np.stack([share * along + aside, share * along - aside])


def _could_be(corners: SpaceCorners, cosines: Array) -> tuple[Flags, Array]:
    """(2, U, C) whether the second arm of each corner could make an angle of each cosine (U, 1), on either side, and
    its direction (2, U, C, 3)."""
    other = _second_edges(corners, cosines)
    in_left = other[..., :2] - (corners.at[:, :2] / corners.at[:, 2:]) * other[..., 2:]
    ahead = (in_left * corners.other[0]).sum(-1) > 0
    off = angle(other[..., :2] - corners.right * other[..., 2:], corners.other[1])
    asked = (corners.firm * other).sum(-1) - cosines  # of a direction in the plane, more than there is
    return ahead & (off < OFF) & (np.abs(asked) < MOST_ASKED), other


def _nats(
    corners: SpaceCorners, geometry: Baseline, maps: tuple[DirectedMap, DirectedMap], kinds: Kinds,
    could: Flags, other: Array,
) -> Image32:  # fmt: skip
    """(C, 2, T) what speaks in both eyes for the two edges of every kind of corner at every corner in space, its second
    edge on either side; minus infinity where that could not be."""
    count = len(corners.at)
    begin = np.nonzero(could)[2]
    ray = np.cumsum(could.reshape(-1)).reshape(could.shape) - 1
    side, second, where = np.nonzero(could[:, kinds.at])
    every = np.repeat(np.arange(count), len(kinds.first_mm))
    lengths = np.tile(kinds.first_mm.astype(np.float32), count)
    first = np.zeros(len(every), np.float32)
    rest = np.zeros(len(where), np.float32)
    for eye_x_mm, seen in zip((0.0, geometry.length_mm), maps, strict=True):
        first += Rays.of(corners.at, corners.firm, eye_x_mm, seen).of_edges(every, lengths)
        rays = Rays.of(corners.at[begin], other[could], eye_x_mm, seen)
        rest += rays.of_edges(ray[side, kinds.at[second], where], kinds.second_mm[second].astype(np.float32))
    seconds = np.full((count, 2, len(kinds.at)), -np.inf, np.float32)
    seconds[where, side, second] = rest
    return np.asarray(first.reshape(count, 1, -1)[:, :, kinds.kinds[:, 0]] + seconds[:, :, kinds.kinds[:, 1]])


def _likeliest(nats: Image32, kinds: Kinds, most: int, most_of_one: int) -> tuple[Index, Index, Index]:
    """Corner in space, side and taught corner of the guesses for which most speaks, of nats (C, 2, T), a few at each
    corner in space, the likeliest first; (N,) each."""
    every = nats.reshape(len(nats), -1)
    few = min(most_of_one, every.shape[1])
    best = np.argpartition(-every, few - 1, axis=1)[:, :few]
    order = np.argsort(-np.take_along_axis(every, best, 1), axis=1, kind="stable")
    best = np.take_along_axis(best, order, 1)
    value = np.take_along_axis(every, best, 1)
    side, kind = np.divmod(best, nats.shape[2])
    each = np.diff(kinds.begins)[kind]
    where, rank = np.nonzero((value > LEAST_NATS) & (np.cumsum(each, 1) - each < most_of_one))
    order = np.argsort(-value[where, rank], kind="stable")
    place = where[order], rank[order]
    each, kind = each[place], kind[place]
    of, which = (one[:most] for one in runs(kinds.begins[kind], each))
    return place[0][of], side[place][of], which
