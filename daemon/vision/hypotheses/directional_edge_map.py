"""How much of the edges that a part would show in each of many poses lies on segments of the same direction.

In: segments of both cameras, poses of a taught solid. Out: evidence for each. A segment that is there by chance speaks
for less where segments of that direction abound, as in a patterned table. Maps lie in ideal coordinates, where edges
are straight and to project is to divide. Source: directional chamfer matching (Liu, Tuzel, Veeraraghavan and Chellappa
2010), counted as in an a contrario test (Desolneux, Moisan and Morel 2000) instead of summed as distances.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from daemon.arrays import Array, Image32, Index, Real
from daemon.vision.geometry import Baseline, Polyhedron, SolidBatch, exact
from daemon.vision.hypotheses.pose_batch import PoseBatch, ideal
from daemon.vision.image import CameraImage

SHRINK = 2
"""A pixel of a map is as wide as so many of the camera's."""
DIRECTIONS, NEAR = 12, (-1.0, -0.5, 0.5, 1.0)
"""How many directions half a turn is cut into; a segment counts for those so many steps from its own."""
_NEARBY = np.ones((5, 5), np.uint8)
_NEARBY[::4, ::4] = 0
RIM = 3
"""Pixels of a map this near to a segment's lie on it: less surely from 2 on, the mean of a pixel's neighbours, and no
more from 4 on."""
ROOM = RIM + 2  # about the outermost segments
MOST_COLUMNS = MOST_ROWS = 32000  # of what cv2.remap takes
LARGEST = 2.0
"""Of the image's own area at SHRINK, that a map of it may have: where cameras look askew, ideal coordinates stretch
what is far aside, and its map is coarser."""
PLACES, SPACING_PX = 10, 5.0
"""Where along an edge is looked, and how far apart places are that say something of their own."""
_ALONG = np.asarray((np.arange(PLACES) + 0.5) / PLACES, np.float32)
SHOWS, LEAST_CHANCE, MOST_CHANCE = 0.75, 0.02, 0.7
"""How much of an edge that is there shows as segments; limits of what a picture's own chance is taken for."""
GLANCED, GLANCE_NATS = np.array((0.2, 0.5, 0.8), np.float32), 25.0
"""Shares of an edge at which many poses are looked at first, in one camera, and what must speak for one of them to be
looked at in earnest: half of what chosen ones ever had."""
FARTHEST = 0.75, 1.25
"""So many times as long are the other sizes of a part that leaves a picture."""
ASIDE, NOT_ASIDE, FAR_ASIDE = 3, 9, 48
"""Pixels of a map: steps by which a part is shifted over the picture to see what speaks for it elsewhere, from which
shift on that is another place, and the farthest."""
STEP, STEPS, BEYOND = 4, 34, (1, 3)
"""Along a ray is looked so many pixels of a map apart, so often; an edge that goes on this many steps past its end, to
that many, is another."""


@dataclass(frozen=True, eq=False)
class DirectionalEdgeMap:
    """hit (D, H, W): how surely a place lies on a segment of about each direction, 255 near it, 0 out of reach or
    outside the image; chance (D,): how often one is there. Map pixels are scale times ideal coordinates less the
    origin (2,).
    """

    hit: NDArray[np.uint8]
    chance: Array
    scale: float
    origin: Array

    @cached_property
    def nats(self) -> tuple[Image32, Image32]:
        """(D,), (D,) log likelihood ratio of an edge that is there against chance where a segment of its direction is
        near, and where none is."""
        chance = self.chance
        return np.log(SHOWS / chance).astype(np.float32), np.log((1 - SHOWS) / (1 - chance)).astype(np.float32)

    def hits(self, way: Image32, x: Real, y: Real) -> tuple[NDArray[np.uint8], Index]:
        """(M, N) how surely, of 255, segments of the directions of ways (N, 2) lie at (M, N), (M, N) px of the map; and
        the number of each direction (N,). Long rows are read out faster than many."""
        which = np.rint(np.arctan2(way[:, 1], way[:, 0]) * np.float32(DIRECTIONS / np.pi)).astype(np.intp) % DIRECTIONS
        _, height, width = self.hit.shape
        every = self.hit.reshape(-1, width)
        y = y.clip(0, height - 1) + (which * height).astype(np.float32)
        found = np.empty(x.shape, np.uint8)
        for k in range(0, len(way), MOST_COLUMNS):
            own = np.s_[:, k : k + MOST_COLUMNS]
            found[own] = cv2.remap(every, x[own], y[own], cv2.INTER_NEAREST, None, cv2.BORDER_CONSTANT, 0)
        return found, which

    def of_lines(self, start: Image32, way: Image32, along: Image32) -> tuple[Image32, Image32]:
        """(N,) nats for lines that begin at start (N, 2) and end way (N, 2) farther, px of the map, looked at at shares
        along (M,) of them; and the most there could be."""
        hits, which = self.hits(way, *(start[:, k] + along[:, None] * way[:, k] for k in (0, 1)))
        hit = hits.sum(0, dtype=np.uint16) * np.float32(1 / 255 / len(along))
        there, missing = self.nats
        length = np.hypot(way[:, 0], way[:, 1]) * np.float32(SHRINK / SPACING_PX)
        return length * (hit * there[which] + (1 - hit) * missing[which]), length * there[which]


def edge_distances(view: CameraImage) -> DirectionalEdgeMap:
    """Maps of what a camera sees: as large as its segments need, of a chance as in all of its image."""
    found, camera, shape = view.segments, view.rectified, view.grey.shape
    rim = camera.ideal(np.array([[x, y] for x in (0.0, shape[1] - 1.0) for y in (0.0, shape[0] - 1.0)]))
    scale = map_scale(camera.focal_px / SHRINK, rim.max(0) - rim.min(0), shape)
    ends = (camera.ideal(np.concatenate([found.start, found.end])) - rim.min(0)) * scale
    low = (np.floor(ends.min(0)) if len(ends) else np.zeros(2)) - ROOM
    width, height = np.ceil(ends.max(0, initial=0.0) - low).astype(int) + ROOM
    ends = (ends - low).reshape(2, -1, 2)
    way = ends[1] - ends[0]
    direction = np.arctan2(way[:, 1], way[:, 0]) / np.pi * DIRECTIONS
    fixed = np.round(ends.transpose(1, 0, 2) * 16).astype(np.int32)
    wanted = np.stack([np.round(direction + step).astype(int) % DIRECTIONS for step in NEAR])
    hit, often = np.zeros((DIRECTIONS, height, width), np.uint8), np.zeros(DIRECTIONS)
    for k in range(DIRECTIONS):  # map by map, which a processor's cache holds
        own = fixed[(wanted == k).any(0)]
        if len(own):
            cv2.polylines(hit[k], list(own[:, :, None]), False, 255, 1, cv2.LINE_8, 4)
            cv2.blur(cv2.dilate(hit[k], _NEARBY), (3, 3), hit[k])
            often[k] = np.count_nonzero(hit[k] > 127)
    chance = often / np.prod((rim.max(0) - rim.min(0)) * scale)
    return DirectionalEdgeMap(hit, np.clip(chance, LEAST_CHANCE, MOST_CHANCE), scale, rim.min(0) + low / scale)


def map_scale(finest: float, size: Array, shape: tuple[int, ...]) -> float:
    """Pixels per unit of a map that is size (2,) wide and high, of an image (H, W): as fine as wanted, but for maps
    much larger than the image."""
    by_area = np.sqrt(LARGEST * np.prod(shape) / np.prod(size)) / SHRINK
    return float(min(finest, by_area, (MOST_ROWS / DIRECTIONS - ROOM) / size[1]))


@dataclass(frozen=True, eq=False)
class Rays:
    """What one camera shows along N straight lines in space that begin at points: nats (STEPS + 1, N) of a segment
    there against chance, summed from its beginning step by step; reach, fall (N,): how far along a line t mm show in
    the map, t reach / (1 + t fall) px."""

    nats: Image32
    reach: Image32
    fall: Image32

    @classmethod
    def of(cls, at: Array, way: Array, camera_x_mm: float, seen: DirectionalEdgeMap) -> Rays:
        """at, way (N, 3): points and unit directions, mm, in axes of the baseline; the camera lies camera_x_mm along
        it."""
        depth = at[:, 2:]
        ideal = (at[:, :2] - [camera_x_mm, 0.0]) / depth
        shift = ((way[:, :2] - ideal * way[:, 2:]) * (seen.scale / depth)).astype(np.float32)
        reach = np.hypot(shift[:, 0], shift[:, 1])
        unit = np.asarray(shift / np.maximum(reach, np.float32(1e-6))[:, None], np.float32)
        start = ((ideal - seen.origin) * seen.scale).astype(np.float32)
        far = np.asarray((np.arange(STEPS) + 0.5) * STEP, np.float32)[:, None]
        hit, which = seen.hits(unit, *(start[:, k] + far * unit[:, k] for k in (0, 1)))
        there, missing = (each[which] * np.float32(STEP * SHRINK / SPACING_PX) for each in seen.nats)
        nats = np.zeros((STEPS + 1, len(at)), np.float32)
        np.cumsum(missing + hit * ((there - missing) * np.float32(1 / 255)), 0, out=nats[1:])
        return cls(nats, reach, (way[:, 2] / at[:, 2]).astype(np.float32))

    def of_edges(self, ray: Index, length_mm: Image32) -> Image32:
        """(M,) nats of edges of so many mm that begin where rays (M,) do, less what goes on beyond their ends."""
        px = self.reach[ray] * length_mm / np.maximum(1 + self.fall[ray] * length_mm, np.float32(0.1))
        step = np.minimum(px * np.float32(1 / STEP) + np.float32(0.5), STEPS - BEYOND[1]).astype(np.intp)
        count = self.nats.shape[1]
        nats, place = self.nats.reshape(-1), step * count + ray
        beyond = nats[place + BEYOND[1] * count] - nats[place + BEYOND[0] * count]
        return np.asarray(nats[place] - np.maximum(beyond, np.float32(0)))


def evidence(
    posed: PoseBatch, geometry: Baseline, maps: tuple[DirectionalEdgeMap, DirectionalEdgeMap]
) -> tuple[Array, Array]:
    """(G,) log likelihood ratio of each part being there against chance, nats, and (G,) what it would be if every edge
    were found."""
    left, right = (
        _of_one_camera(len(posed.part), *posed.edges(camera_mm), corners, seen, _ALONG)
        for camera_mm, corners, seen in zip(
            geometry.cameras_mm, ideal(posed.corners_mm(geometry), geometry), maps, strict=True
        )
    )
    return left[0] + right[0], left[1] + right[1]


def promising(
    posed: PoseBatch,
    geometry: Baseline,
    maps: tuple[DirectionalEdgeMap, DirectionalEdgeMap],
    further: Array | float = 0.0,
) -> tuple[Index, Array]:
    """Select which (Q,) of many poses a few places of the left camera, and further nats (G,), already speak for, and
    how many nats (Q,)."""
    left = ideal(posed.corners_mm(geometry), geometry)[0]
    edges = posed.edges(geometry.cameras_mm[0])
    nats, _ = _of_one_camera(len(posed.part), *edges, left, maps[0], GLANCED)
    nats = nats + further
    good = np.flatnonzero(nats > GLANCE_NATS)
    return good, nats[good]


def _of_one_camera(
    count: int, pose: Index, ends: Index, corners: Image32, seen: DirectionalEdgeMap, along: Image32
) -> tuple[Array, Array]:
    """(G,) nats, and (G,) the most there could be, that one camera gives to so many poses; pose (N,), ends (N, 2) of
    the edges that show; corners: all, in ideal coordinates; along (M,) shares of an edge at which is looked."""
    at = (corners - seen.origin.astype(np.float32)) * np.float32(seen.scale)
    start = at[ends[:, 0]]
    by_edge = seen.of_lines(start, at[ends[:, 1]] - start, along)
    nats, most = (np.asarray(np.bincount(pose, each, count), float) for each in by_edge)
    return nats, most


def self_similarity(solid: Polyhedron, pose: Array, geometry: Baseline, seen: DirectionalEdgeMap) -> float:
    """Return what the left camera's segments would give a part, shown as at this pose (4, 4), at another place nearby,
    over what they give it where it is: near 1 on a pattern that repeats itself, as a chessboard does."""
    one = PoseBatch(SolidBatch.of([solid]), np.zeros(1, np.intp), pose[None])
    _, ends = one.edges(geometry.cameras_mm[0])
    corners = ideal(one.corners_mm(geometry), geometry)[0]
    steps = np.arange(-FAR_ASIDE, FAR_ASIDE + 1, ASIDE)
    shift = np.stack(np.meshgrid(steps, steps), 2).reshape(-1, 2).astype(np.float32)
    each = np.arange(len(shift))
    nats, _ = _of_one_camera(
        len(shift),
        each.repeat(len(ends)),
        (each[:, None, None] * len(corners) + ends).reshape(-1, 2),
        (shift[:, None] / np.float32(seen.scale) + corners).reshape(-1, 2),
        seen,
        _ALONG,
    )
    aside = np.hypot(*shift.T)
    return float(nats[aside >= NOT_ASIDE].max() / max(nats[aside <= ASIDE * 1.5].max(), 1.0))


@lru_cache(maxsize=256)
def in_sizes(solid: Polyhedron) -> tuple[Polyhedron, ...]:
    """A solid FARTHEST times as long along an edge or across a face, either end of it staying where it is."""
    found = list[Polyhedron]()
    for way in solid.directions:
        height = solid.corners_mm @ way
        for end in (height.min(), height.max()):
            longer = [(factor - 1) * (height - end)[:, None] * way for factor in FARTHEST]
            found += [exact(solid.corners_mm + one, solid.facets) for one in longer]
    return tuple(found)
