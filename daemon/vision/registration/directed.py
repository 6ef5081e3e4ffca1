"""How much of the edges that a part would show in each of many poses lies on segments of the same direction.

In: segments of both eyes, poses of a taught solid. Out: evidence for each. A segment that is there by chance speaks for
less where segments of that direction abound, as in a patterned table. Maps lie in ideal coordinates, where edges are
straight and to project is to divide.
Source: directional chamfer matching (Liu, Tuzel, Veeraraghavan and Chellappa 2010), counted as in an a contrario test
(Desolneux, Moisan and Morel 2000) instead of summed as distances.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from daemon.arrays import Array
from daemon.vision.geometry import Baseline, Polyhedron
from daemon.vision.image import OneEye

SHRINK = 2
"""A pixel of a map is as wide as so many of the camera's."""
DIRECTIONS, NEAR = 12, (-1.0, -0.5, 0.5, 1.0)
"""How many directions half a turn is cut into; a segment counts for those so many steps from its own."""
REACH_PX, FARTHEST_PX = 5.0, 7.5
"""Half of the first off, an edge still lies on a segment; by the second, no more."""
PLACES, SPACING_PX = 10, 5.0
"""Where along an edge is looked, and how far apart places are that say something of their own."""
SHOWS, LEAST_CHANCE, MOST_CHANCE = 0.75, 0.02, 0.7
"""How much of an edge that is there shows as segments; limits of what a picture's own chance is taken for."""
GLANCED, GLANCE_NATS, MOST_PROMISING = (0.2, 0.5, 0.8), 25.0, 600
"""Shares of an edge at which many poses are looked at first, in one eye, what must speak for one of them to be looked
at in earnest (half of what chosen ones ever had), and how many may."""
SIZES, PARALLEL = (0.75, 0.8, 0.85, 0.9, 1.1, 1.15, 1.2, 1.25), 0.98
LEAST_FACING = 0.08
"""Cosine below which a facet is too thin in the image to be looked for."""


@dataclass(frozen=True, eq=False)
class DirectedMap:
    """near (D, H, W): how near a segment of about each direction is, 255 on it, 0 out of reach or outside the image;
    chance (D,): how often one is there. Map pixels are scale times ideal coordinates less the origin (2,).
    """

    near: NDArray[np.uint8]
    chance: Array
    scale: float
    origin: Array


def directed_map(view: OneEye) -> DirectedMap:
    """Maps of what an eye sees."""
    found, eye, shape = view.segments, view.eye, view.grey.shape
    scale = eye.focal_px / SHRINK
    rim = eye.ideal(np.array([[x, y] for x in (0.0, shape[1] - 1.0) for y in (0.0, shape[0] - 1.0)]))
    origin = rim.min(0) - 1 / scale
    width, height = np.ceil((rim.max(0) - origin) * scale).astype(int) + 2
    ends = ((eye.ideal(np.concatenate([found.start, found.end])) - origin) * scale).reshape(2, -1, 2)
    way = ends[1] - ends[0]
    direction = np.arctan2(way[:, 1], way[:, 0]) / np.pi * DIRECTIONS
    fixed = np.round(ends.transpose(1, 0, 2) * 16).astype(np.int32)
    near = np.zeros((DIRECTIONS, height, width), np.uint8)
    wanted = np.stack([np.round(direction + step).astype(int) % DIRECTIONS for step in NEAR])
    reach = FARTHEST_PX / SHRINK
    for k in range(DIRECTIONS):
        own = fixed[(wanted == k).any(0)]
        if len(own):
            none = np.full((height, width), 255, np.uint8)
            cv2.polylines(none, list(own[:, :, None]), False, 0, 1, cv2.LINE_8, 4)
            away = cv2.distanceTransform(none, cv2.DIST_L2, 3)
            near[k] = np.clip(255 * (1 - away / reach), 0, 255)
    near[:, [0, -1]] = 0
    near[:, :, [0, -1]] = 0
    chance = (near > 255 * (1 - REACH_PX / FARTHEST_PX)).mean((1, 2))
    return DirectedMap(near, np.clip(chance, LEAST_CHANCE, MOST_CHANCE), scale, origin)


def in_view(solid: Polyhedron, poses: Array) -> NDArray[np.bool_]:
    """(P, F) which facets are turned to the cameras in each pose (P, 4, 4) cyclopean_from_part."""
    return np.asarray(solid.facing(poses) > LEAST_FACING)


def evidence(
    solid: Polyhedron, poses: Array, geometry: Baseline, maps: tuple[DirectedMap, DirectedMap]
) -> tuple[Array, Array]:
    """(P,) log likelihood ratio of the part being there against chance, nats, and (P,) what it would be if every edge
    were found; poses (P, 4, 4) cyclopean_from_part.
    """
    shown = _Shown.of(solid, poses)
    along = (np.arange(PLACES) + 0.5) / PLACES
    left, right = (
        _of_one_eye(shown, ideal, seen, along)
        for ideal, seen in zip(geometry.project(shown.corners_mm), maps, strict=True)
    )
    return left[0] + right[0], left[1] + right[1]


def promising(solid: Polyhedron, poses: Array, geometry: Baseline, maps: tuple[DirectedMap, DirectedMap]) -> Array:
    """The poses (Q, 4, 4) of many for which a few places of the left eye already speak, the likeliest where there are
    more than MOST_PROMISING."""
    shown = _Shown.of(solid, poses)
    nats, _ = _of_one_eye(shown, geometry.project(shown.corners_mm)[0], maps[0], np.array(GLANCED))
    good = np.flatnonzero(nats > GLANCE_NATS)
    if len(good) > MOST_PROMISING:
        good = good[np.argpartition(-nats[good], MOST_PROMISING)[:MOST_PROMISING]]
    return np.asarray(poses[good])


@dataclass(frozen=True, eq=False)
class _Shown:
    """The edges that a solid shows in each of P poses: pose, start, end (E,): the pose, and the places of both ends
    among corners_mm (P * K, 3), cyclopean."""

    poses: int
    pose: NDArray[np.intp]
    start: NDArray[np.intp]
    end: NDArray[np.intp]
    corners_mm: Array

    @classmethod
    def of(cls, solid: Polyhedron, poses: Array) -> _Shown:
        pairs, bounds = solid.lines
        pose, edge = np.nonzero(in_view(solid, poses) @ bounds)
        corners = solid.corners_mm @ poses[:, :3, :3].transpose(0, 2, 1) + poses[:, None, :3, 3]
        first = pose * len(solid.corners_mm)
        return cls(len(poses), pose, first + pairs[edge, 0], first + pairs[edge, 1], corners.reshape(-1, 3))


def _of_one_eye(shown: _Shown, ideal: Array, seen: DirectedMap, along: Array) -> tuple[Array, Array]:
    """(P,) nats, and (P,) the most there could be, that one eye gives; ideal: its corners; along (N,) shares of an edge
    at which is looked."""
    at = ((ideal - seen.origin) * seen.scale).astype(np.float32)
    start = at[shown.start]
    way = at[shown.end] - start
    which = np.round(np.arctan2(way[:, 1], way[:, 0]) * np.float32(DIRECTIONS / np.pi)).astype(np.intp) % DIRECTIONS
    _, height, width = seen.near.shape
    share = along.astype(np.float32)
    x = np.clip(start[:, :1] + share * way[:, :1] + 0.5, 0, width - 1).astype(np.intp)
    y = np.clip(start[:, 1:] + share * way[:, 1:] + 0.5, 0, height - 1).astype(np.intp)
    hit = seen.near.reshape(-1)[(which[:, None] * height + y) * width + x] / np.float32(255)
    hit = np.minimum(1.5 * hit, 1.0).mean(1)
    chance = seen.chance[which]
    count = np.hypot(way[:, 0], way[:, 1]) * (SHRINK / SPACING_PX)
    there, missing = np.log(SHOWS / chance), np.log((1 - SHOWS) / (1 - chance))
    by_edge = count * (hit * there + (1 - hit) * missing), count * there
    nats, most = (np.asarray(np.bincount(shown.pose, each, shown.poses), float) for each in by_edge)
    return nats, most


def other_sizes(solid: Polyhedron, pose: Array, geometry: Baseline, maps: tuple[DirectedMap, DirectedMap]) -> float:
    """How many times more speaks for a part of the same kind but another size at this pose (4, 4), in nats and in share
    of what there could be, whichever is less: longer or shorter by a tenth to a quarter along an edge or across a face,
    either end of it staying where it is."""
    nats, most = evidence(solid, pose @ np.concatenate([np.eye(4)[None], _stretches(solid)]), geometry, maps)
    share = nats / np.maximum(most, 1.0)
    return float(np.minimum(nats[1:] / max(nats[0], 1.0), share[1:] / max(share[0], 1e-3)).max())


@lru_cache(maxsize=256)
def _stretches(solid: Polyhedron) -> Array:
    """(S, 4, 4) affine maps of a solid."""
    pairs = solid.lines[0]
    edges = solid.corners_mm[pairs[:, 1]] - solid.corners_mm[pairs[:, 0]]
    ways = np.concatenate([solid.normals, edges / np.linalg.norm(edges, axis=1)[:, None]])
    maps = list[Array]()
    for k, way in enumerate(ways):
        if (np.abs(ways[:k] @ way) < PARALLEL).all():
            height = solid.corners_mm @ way
            for end in (height.min(), height.max()):
                for factor in SIZES:
                    map_ = np.eye(4)
                    map_[:3, :3] += (factor - 1) * np.outer(way, way)
                    map_[:3, 3] = (1 - factor) * end * way
                    maps.append(map_)
    return np.array(maps)
