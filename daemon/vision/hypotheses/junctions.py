"""3-D junctions: where two straight edges meet in space, and where taught solids with such corners would be.

In: segment corners of both cameras, maps of segments, taught solids. Out: junctions in space; the likeliest poses of
all parts, to be registered on both images: a hypothesis is no recognition. Two rays meet in a junction's place, and two
planes in the firmer of its edges. The second edge lies in the left camera's plane, at the angle that the taught corner
has; the right camera verifies it. How much of both edges shows, and that neither goes on beyond its taught length, is
counted once for all parts that have such an edge, so that few hypotheses are worth a pose, whatever was taught.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from daemon import frames
from daemon.arrays import Array, Flags, Image32, Index
from daemon.vision.facets import FARTHEST_MM, NEAREST_MM
from daemon.vision.geometry import Baseline, Polyhedron, RectifiedCamera, SolidBatch, apart2, basis, sides_of
from daemon.vision.hypotheses.directional_edge_map import GLANCED, DirectionalEdgeMap, Rays
from daemon.vision.hypotheses.pose_batch import PoseBatch
from daemon.vision.image import SegmentCorners, pairs_within, runs
from daemon.vision.model import turns_onto_themselves

ROW_PX = 2.0  # how far apart the rows may be in which two cameras see a corner
MOST_MET = 800  # of corners seen by both cameras those with the longest arms: each is a guess for every taught corner
TURNED = np.radians(28.0)  # by how much a corner's arm may point elsewhere in the other camera
FIRM = np.sin(np.radians(1.2))  # of the angle between the planes of an edge; less, and its direction is anyone's
ANGLE = np.radians(2.0)  # taught corners are of a kind whose angles round to the same in this
ALIKE_MM = 1.5  # corners of a solid this near to others' places after a turn make the turn one of its symmetries


@dataclass(frozen=True, eq=False)
class Junctions3D:
    """Corners that both cameras see: at (C, 3) mm from the left camera; firm (C, 3), the unit direction of the arm
    whose planes meet at the larger angle; plane (C, 3), the unit normal of the left camera's plane through the other
    arm, all along the axes of the baseline; other (2, C, 2), where that arm points in the left and the right camera;
    right (C, 2), the corner there, both in ideal coordinates.
    """

    at: Array
    firm: Array
    plane: Array
    other: Array
    right: Array

    def chosen(self, which: Index) -> Junctions3D:
        """Some of them."""
        return Junctions3D(self.at[which], self.firm[which], self.plane[which], self.other[:, which], self.right[which])


@dataclass(frozen=True, eq=False)
class CameraJunctions:
    """Corners in one camera, in ideal coordinates: at (C, 2), arms (C, 2, 2) from it, sign (C, 2)."""

    at: Array
    arms: Array
    sign: Array

    @classmethod
    def of(cls, found: SegmentCorners, camera: RectifiedCamera) -> CameraJunctions:
        ideal = camera.ideal(np.concatenate([found.at, found.arms.reshape(-1, 2)]))
        at, ends = np.split(ideal, [len(found.at)])
        return cls(at, ends.reshape(-1, 2, 2) - at[:, None], found.sign)

    def chosen(self, which: Index, swapped: bool = False) -> CameraJunctions:
        """Some of them, their arms the other way round or not."""
        order = [1, 0] if swapped else [0, 1]
        return CameraJunctions(self.at[which], self.arms[which][:, order], self.sign[which][:, order])

    def longer_first(self) -> CameraJunctions:
        """Return the same junctions, the longer arm of each first."""
        each, longer = np.arange(len(self.at)), np.linalg.norm(self.arms, axis=2).argmax(1)
        order = np.stack([longer, 1 - longer], 1)
        return CameraJunctions(self.at, self.arms[each[:, None], order], self.sign[each[:, None], order])

    def planes(self) -> Array:
        """(C, 2, 3) unit normals of the planes through the camera and each arm."""
        ray = np.concatenate([self.at, np.ones((len(self.at), 1))], 1)
        normal = np.cross(ray[:, None], np.concatenate([self.arms, np.zeros((*self.arms.shape[:2], 1))], 2))
        return np.asarray(normal / np.linalg.norm(normal, axis=2, keepdims=True))


def meet(left: SegmentCorners, right: SegmentCorners, geometry: Baseline) -> Junctions3D:
    """Every two corners, one in each camera, that could be one."""
    in_left, in_right = CameraJunctions.of(left, geometry.left), CameraJunctions.of(right, geometry.right)
    i, j = pairs_within(in_left.at[:, 1], in_right.at[:, 1], ROW_PX / geometry.left.focal_px)
    apart = in_left.at[i, 0] - in_right.at[j, 0]
    near = (apart * FARTHEST_MM > geometry.length_mm) & (apart * NEAREST_MM < geometry.length_mm)
    i, j = i[near], j[near]
    pairs = []
    for swapped in (False, True):
        one, other = in_left.chosen(i), in_right.chosen(j, swapped)
        good = np.flatnonzero((angle(one.arms, other.arms) < TURNED).all(1) & (one.sign == other.sign).all(1))
        pairs.append((one.chosen(good), other.chosen(good)))
    one, other = (_joined([pair[k] for pair in pairs]) for k in (0, 1))
    planes = one.planes()
    line = np.cross(planes, other.planes())
    sine = np.linalg.norm(line, axis=2)
    firm = sine.argmax(1)
    every = np.flatnonzero(sine.max(1, initial=0.0) > FIRM)
    if len(every) > MOST_MET:
        reach = np.minimum(*(np.linalg.norm(seen.arms[every], axis=2).min(1) for seen in (one, other)))
        every = every[np.sort(np.argpartition(-reach, MOST_MET)[:MOST_MET])]
    firm = firm[every]
    one, other = one.chosen(every), other.chosen(every)
    each = np.arange(len(every))
    direction = line[every, firm] / sine[every, firm, None]
    shown = direction[:, :2] - one.at * direction[:, 2:]
    direction = direction * np.sign((shown * one.arms[each, firm]).sum(1))[:, None]
    depth = geometry.length_mm / (one.at[:, 0] - other.at[:, 0])
    ray = np.stack([one.at[:, 0], (one.at[:, 1] + other.at[:, 1]) / 2, np.ones(len(every))], 1)
    arms = np.stack([one.arms[each, 1 - firm], other.arms[each, 1 - firm]])
    return Junctions3D(depth[:, None] * ray, direction, planes[every, 1 - firm], arms, other.at)


def _joined(parts: list[CameraJunctions]) -> CameraJunctions:
    return CameraJunctions(*(np.concatenate([getattr(p, name) for p in parts]) for name in ("at", "arms", "sign")))


@dataclass(frozen=True, eq=False)
class TaughtJunctions:
    """Every two edges at every corner of several solids, in either order, those left out that a turn of the solid makes
    of others: part (N,), the number of the solid; corner_from_part (N, 4, 4), x along the first edge, the second in
    x y; cosine (N,) between them; lengths_mm (N, 2) of both; outline_mm (N, 2, 4, 3), in the corner's frame: the far
    ends of both, and to where the outline between both goes on from each, as it is seen where the first runs clockwise
    of the second, and anticlockwise.
    """

    part: Index
    corner_from_part: Array
    cosine: Array
    lengths_mm: Array
    outline_mm: Image32


@lru_cache(maxsize=4)
def taught_junctions(shapes: tuple[Polyhedron, ...]) -> TaughtJunctions:
    """The corners of solids, and where the straight edges would meet that an arc joins; of a part that was not taught
    from all round the sides that nobody knows tell its turns apart."""
    part, points = list[Index](), list[Array]()
    for number, (shape, turns) in enumerate(zip(shapes, turns_onto_themselves(shapes, ALIKE_MM), strict=True)):
        every, count = _edge_pairs(shape), len(shape.corners_mm)
        codes = (turns.corners[:, every] * (count**2, count, 1)).sum(2)
        own = every[np.sort(np.unique(codes.min(0), return_index=True)[1])]
        rounded = _turned_apart(_rounded_pairs(shape), turns.motions)
        points += [shape.corners_mm[np.concatenate([own, _onward(shape, own)], 1)], rounded[:, [0, 1, 2, 1, 2, 1, 2]]]
        part.append(np.full(len(own) + len(rounded), number))
    every = np.concatenate([np.zeros((0, 7, 3)), *points])
    from_corner, cosine, lengths = _corner_frames(*every[:, :3].transpose(1, 0, 2))
    outline = (every[:, [1, 2, 3, 4, 1, 2, 5, 6]] - every[:, :1]) @ from_corner[:, :3, :3]
    return TaughtJunctions(
        np.concatenate([np.zeros(0, np.intp), *part]), frames.inverse(from_corner), cosine, lengths,
        outline.reshape(-1, 2, 4, 3).astype(np.float32),
    )  # fmt: skip


def _onward(solid: Polyhedron, pairs: Index) -> Index:
    """(N, 4) to which corners the outline between two edges at a corner (N, 3) goes on from their far ends, the first
    edge clockwise of the second, and anticlockwise; where no facet is there, to none farther."""
    count = len(solid.corners_mm)
    after = np.tile(np.arange(count), (count, 1))
    before = after.T.copy()
    for ring in solid.facets:
        for place, end in enumerate(ring):
            after[ring[place - 1], end], before[ring[place - 1], end] = ring[(place + 1) % len(ring)], ring[place - 2]
    at, one, other = pairs.T
    return np.stack([after[at, one], before[other, at], before[one, at], after[at, other]], 1)


def _edge_pairs(solid: Polyhedron) -> Index:
    """(N, 3) every corner with the far ends of two of its edges, in either order."""
    ends = np.concatenate([solid.lines[0], solid.lines[0][:, ::-1]])
    one, other = np.nonzero((ends[:, :1] == ends[:, 0]) & ~np.eye(len(ends), dtype=bool))
    return np.column_stack([ends[one], ends[other, 1]])


def _rounded_pairs(solid: Polyhedron) -> Array:
    """(N, 3, 3) where two straight edges of a facet would meet that an arc of its outline joins, and their far ends, in
    either order: pictures show both edges, and the place is where their lines meet there as well."""
    if not solid.arcs:
        return np.zeros((0, 3, 3))
    radii = dict(zip(map(tuple, solid.lines[0].tolist()), solid.circles[:, 3].tolist(), strict=True))
    found = list[Array]()
    for ring in solid.facets:
        sides = list(sides_of(ring))
        round_ = [radii.get((min(side), max(side)), -1.0) for side in sides]  # a side that does not show is no edge
        straight = [k for k, radius in enumerate(round_) if radius == 0]
        for k, after in zip(straight, straight[1:] + straight[:1], strict=True):
            between = [round_[(k + step) % len(sides)] for step in range(1, (after - k) % len(sides))]
            if between and min(between) > 0:
                (far, near), (begin, end) = (solid.corners_mm[list(sides[one])] for one in (k, after))
                one, other = near - far, end - begin
                (ahead, before), *_ = np.linalg.lstsq(np.stack([one, other], 1), begin - near, rcond=None)
                if ahead > 0 and before > 0:
                    at = near + ahead * one
                    found += [np.stack([at, far, end]), np.stack([at, end, far])]
    return np.array(found).reshape(-1, 3, 3)


def _turned_apart(points: Array, motions: Array) -> Array:
    """Remove triples of points (N, 3, 3) that a symmetry (S, 4, 4) maps onto an earlier one."""
    moved = points @ motions[:, None, :3, :3].swapaxes(2, 3) + motions[:, None, None, :3, 3]
    kept = list[int]()
    for k in range(len(points)):
        if all(np.abs(moved[:, k] - points[one]).max((1, 2)).min() > ALIKE_MM for one in kept):
            kept.append(k)
    return points[kept]


def _corner_frames(at: Array, one: Array, other: Array) -> tuple[Array, Array, Array]:
    """Return of corners at points (N, 3) with edges to others (N, 3): part_from_corner (N, 4, 4), the cosine (N,)
    between both edges, and how long they are (N, 2), mm."""
    lengths = np.stack([np.linalg.norm(end - at, axis=1) for end in (one, other)], 1)
    x, to = ((end - at) / lengths[:, k, None] for k, end in enumerate((one, other)))
    return frames.rigid(basis(x, to), at), (x * to).sum(1), lengths


@lru_cache(maxsize=1024)
def indistinguishable_turns(solid: Polyhedron, seen: tuple[int, ...]) -> Array:
    """(S, 4, 4) the turns after which every corner that is seen lies where a corner of the solid was, as far as that is
    known; the first is none. Where all are seen, these are the solid's symmetries."""
    pairs = _edge_pairs(solid)
    every = _corner_frames(*solid.corners_mm[pairs].transpose(1, 0, 2))[0]
    of_seen = np.flatnonzero(np.isin(pairs[:, 0], seen))
    if not len(of_seen):  # along a rounding a corner may have no two edges that show
        return np.eye(4)[None]
    own = of_seen[0]
    turns = np.delete(every, own, 0) @ frames.inverse(every[own])
    moved = solid.corners_mm[list(seen)] @ turns[:, :3, :3].transpose(0, 2, 1) + turns[:, None, :3, 3]
    near = apart2(moved, solid.corners_mm).min(2).max(1) < ALIKE_MM**2
    return np.concatenate([np.eye(4)[None], turns[near]])


def sorted_by_kind(rows: Index) -> tuple[Index, Index, Index]:
    """The kinds (U, M) of which rows of whole numbers (K, M) are, the order (K,) that sorts them by kind, and where
    each begins there (U + 1,)."""
    low = rows.min(0, initial=0)
    span = rows.max(0, initial=0) - low + 1
    code = (rows - low) @ np.append(np.cumprod(span[:0:-1])[::-1], 1)  # sorts as the rows do
    order = np.argsort(code, kind="stable")
    begins = np.flatnonzero(np.diff(code[order], prepend=-1))
    return rows[order[begins]], order, np.append(begins, len(rows))


def angle(one: Array, other: Array) -> Array:
    """Angles (...) between directions (..., 2)."""
    cross = one[..., 0] * other[..., 1] - one[..., 1] * other[..., 0]
    return np.asarray(np.abs(np.arctan2(cross, (one * other).sum(-1))))


OFF = np.radians(7.0)  # by how much a corner's arm may point elsewhere in the right camera than the taught angle says
MOST_ASKED = 0.03  # by how much of its cosine no direction in the plane has the taught angle
MOST_COUNTED = 6000  # guesses of one part and side of the plane that count as such
MOST_GUESSES, MOST_OF_ONE = (4000, 200), (16, 1)
"""Of all parts, and at one corner in space, those for whose two edges most speaks: so many, or so many for each taught
part where that is more; at a corner its share of all, where corners are few. In 57 rendered looks with four parts
taught the first good guess was among the first 500 of some 10,000 in nineteen of twenty. With 64 taught, 4,000 and 16
named 37 of 57 parts on hard tables, these 46; twice as many at a corner named no more."""
MOST_BY_OUTLINE = 1000
"""Of those, for whose two edges, and the two sides with which the outline between them goes on, most speaks. Of 40
rendered parts of a thousand taught the first good guess was among the first 1,000 for 37 so, for 22 by two edges."""
MOST_TAUGHT = 100
"""Taught parts for which more is guessed: of more each has a smaller share. With 254 taught 28 of 32 parts on factory,
printed, cluttered, shining and patterned scenes are named in 234 ms, and 27 in 382 where all have theirs; with 1,000
21 in 283 ms for 23 in 1,194, which is more than a look has."""
LENGTH_MM = 1.0
"""Edges whose lengths round to the same in this are one kind."""
LEAST_NATS = 20.0  # that must speak for two edges in both cameras together


@dataclass(frozen=True, eq=False)
class Kinds:
    """The corners of several solids, sorted by kind: part (K,), corner_from_part (K, 4, 4), cosine (K,) and outline_mm
    (K, 2, 4, 3) of each, and about (K,), the number of its angle among cosines (U,). First edges have lengths first_mm
    (A,); second ones second_mm (Q,), at angles at (Q,). kinds (T, 2): which first and which second edge; begins
    (T + 1,): where the corners of each begin.
    """

    part: Index
    corner_from_part: Array
    cosine: Array
    outline_mm: Image32
    about: Index
    cosines: Array
    first_mm: Array
    second_mm: Array
    at: Index
    kinds: Index
    begins: Index


@lru_cache(maxsize=4)
def junction_kinds(shapes: tuple[Polyhedron, ...]) -> Kinds:
    """All corners of solids; lengths and angles are of a kind that round to the same."""
    taught = taught_junctions(shapes)
    angles, which = np.unique((np.arccos(np.clip(taught.cosine, -1, 1)) / ANGLE).round(), return_inverse=True)
    first_mm, first = np.unique((taught.lengths_mm[:, 0] / LENGTH_MM).round(), return_inverse=True)
    second_mm = (taught.lengths_mm[:, 1] / LENGTH_MM).round().astype(np.intp)
    seconds, second_order, second_begins = sorted_by_kind(np.stack([which, second_mm], 1))
    second = np.empty(len(which), np.intp)
    second[second_order] = np.repeat(np.arange(len(seconds)), np.diff(second_begins))
    kinds, order, begins = sorted_by_kind(np.stack([first, second], 1))
    return Kinds(
        taught.part[order], taught.corner_from_part[order], taught.cosine[order], taught.outline_mm[order],
        which[order], np.cos(angles * ANGLE), first_mm * LENGTH_MM, seconds[:, 1].astype(float) * LENGTH_MM,
        seconds[:, 0], kinds, begins,
    )  # fmt: skip


def poses_from_junctions(
    corners: Junctions3D, geometry: Baseline, maps: tuple[DirectionalEdgeMap, DirectionalEdgeMap], solids: SolidBatch
) -> tuple[PoseBatch, Array, int]:
    """Taught corners laid onto corners in space whose arms could make their angle, those MOST_BY_OUTLINE for which most
    speaks; about which line each could be turned and show nearly the same two edges to the left camera, a point of it
    and its direction (G, 2, 3) cyclopean; and how many could."""
    kinds = junction_kinds(solids.shapes) if solids.shapes else None
    if kinds is None or not len(kinds.part) or not len(corners.at):
        return PoseBatch(solids, np.zeros(0, np.intp), np.zeros((0, 4, 4))), np.zeros((0, 2, 3)), 0
    could, other = _could_be(corners, kinds.cosines[:, None])
    counts = np.minimum(
        [np.bincount(kinds.part, could[side].sum(1)[kinds.about]) for side in (0, 1)], MOST_COUNTED
    ).sum()
    nats = _nats(corners, geometry, maps, kinds, could, other)
    where, side, which, by_edges = _likeliest(nats, kinds, *most_guesses(len(solids.shapes), len(corners.at)))
    seconds = _second_edges(corners.chosen(where), kinds.cosine[which])[side, np.arange(len(which))]
    axes = basis(corners.firm[where], seconds)
    onward = _of_outline(corners.at[where], axes, kinds.outline_mm, which, geometry, maps)
    best = np.argsort(-by_edges - onward, kind="stable")[:MOST_BY_OUTLINE]
    where, which, seconds, axes = where[best], which[best], seconds[best], axes[best]
    turn = geometry.cyclopean_from_baseline
    middle = (corners.at[where] - [geometry.length_mm / 2, 0.0, 0.0]) @ turn.T + geometry.middle_mm
    cyclopean_from_corner = frames.rigid(turn @ axes, middle)
    about = _hinge(corners.at[where], corners.firm[where], seconds) @ turn.T
    posed = PoseBatch(solids, kinds.part[which], cyclopean_from_corner @ kinds.corner_from_part[which])
    return posed, np.stack([middle, about], 1), int(counts)


def _of_outline(
    at: Array, axes: Array, outline_mm: Image32, which: Index, geometry: Baseline,
    maps: tuple[DirectionalEdgeMap, DirectionalEdgeMap],
) -> Image32:  # fmt: skip
    """(N,) nats that both cameras show for the two sides with which the outline between both edges of taught corners
    (N,) at (N, 3), along axes (N, 3, 3), goes on."""
    away = ((axes[:, :, 2] * at).sum(1) > 0).astype(np.intp)
    points = outline_mm[which, away] @ axes.swapaxes(1, 2).astype(np.float32) + at[:, None].astype(np.float32)
    found = np.zeros(len(at), np.float32)
    for camera_x_mm, seen in zip((0.0, geometry.length_mm), maps, strict=True):
        shown = (points[..., :2] - np.array([camera_x_mm, 0.0], np.float32)) / points[..., 2:]
        shown = (shown - seen.origin.astype(np.float32)) * np.float32(seen.scale)
        start, end = shown[:, :2].reshape(-1, 2), shown[:, 2:].reshape(-1, 2)
        found += seen.of_lines(start, end - start, GLANCED)[0].reshape(-1, 2).sum(1)
    return found


def most_guesses(taught: int, corners: int) -> tuple[int, int]:
    """Guesses in all, and at one of so many corners."""
    most, of_one = (max(least, each * min(taught, MOST_TAUGHT)) for least, each in (MOST_GUESSES, MOST_OF_ONE))
    return most, max(of_one, most // corners)


def _hinge(ray: Array, one: Array, other: Array) -> Array:
    """(G, 3) unit directions about which corners at rays (G, 3) from a camera turn so that both of their edges, along
    one and other (G, 3), stay in their planes with the camera and keep their angle."""
    one, other = (ray - edge * (edge * ray).sum(1, keepdims=True) for edge in (one, other))
    found = np.cross(one, other)
    return np.asarray(found / np.maximum(np.linalg.norm(found, axis=1, keepdims=True), 1e-9))


def _second_edges(corners: Junctions3D, cosines: Array) -> Array:
    """(2, ..., 3) directions in which the second arms of corners make angles of cosines (...), on either side."""
    along = corners.firm - (corners.firm * corners.plane).sum(1, keepdims=True) * corners.plane
    size = np.linalg.norm(along, axis=1)
    along = along / np.maximum(size, 1e-9)[:, None]
    share = np.clip(cosines / np.maximum(size, 1e-9), -1.0, 1.0)[..., None]
    aside = np.sqrt(1 - share * share) * np.cross(corners.plane, along)
    return np.stack([share * along + aside, share * along - aside])


def _could_be(corners: Junctions3D, cosines: Array) -> tuple[Flags, Array]:
    """(2, U, C) whether the second arm of each corner could make an angle of each cosine (U, 1), on either side, and
    its direction (2, U, C, 3)."""
    other = _second_edges(corners, cosines)
    in_left = other[..., :2] - (corners.at[:, :2] / corners.at[:, 2:]) * other[..., 2:]
    ahead = (in_left * corners.other[0]).sum(-1) > 0
    off = angle(other[..., :2] - corners.right * other[..., 2:], corners.other[1])
    asked = (corners.firm * other).sum(-1) - cosines  # of a direction in the plane, more than there is
    return ahead & (off < OFF) & (np.abs(asked) < MOST_ASKED), other


def _nats(
    corners: Junctions3D, geometry: Baseline, maps: tuple[DirectionalEdgeMap, DirectionalEdgeMap], kinds: Kinds,
    could: Flags, other: Array,
) -> Image32:  # fmt: skip
    """(C, 2, T) what speaks in both cameras for the two edges of every kind of corner at every corner in space, its
    second edge on either side; minus infinity where that could not be."""
    count = len(corners.at)
    begin = np.nonzero(could)[2]
    ray = np.cumsum(could.reshape(-1)).reshape(could.shape) - 1
    side, second, where = np.nonzero(could[:, kinds.at])
    every = np.repeat(np.arange(count), len(kinds.first_mm))
    lengths = np.tile(kinds.first_mm.astype(np.float32), count)
    first = np.zeros(len(every), np.float32)
    rest = np.zeros(len(where), np.float32)
    for camera_x_mm, seen in zip((0.0, geometry.length_mm), maps, strict=True):
        first += Rays.of(corners.at, corners.firm, camera_x_mm, seen).of_edges(every, lengths)
        rays = Rays.of(corners.at[begin], other[could], camera_x_mm, seen)
        rest += rays.of_edges(ray[side, kinds.at[second], where], kinds.second_mm[second].astype(np.float32))
    seconds = np.full((count, 2, len(kinds.at)), -np.inf, np.float32)
    seconds[where, side, second] = rest
    return np.asarray(first.reshape(count, 1, -1)[:, :, kinds.kinds[:, 0]] + seconds[:, :, kinds.kinds[:, 1]])


def _likeliest(nats: Image32, kinds: Kinds, most: int, most_of_one: int) -> tuple[Index, Index, Index, Image32]:
    """Corner in space, side, taught corner and nats of the guesses for which most speaks, of nats (C, 2, T), a few at
    each corner in space, the likeliest first; (N,) each."""
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
    return place[0][of], side[place][of], which, value[place][of]
