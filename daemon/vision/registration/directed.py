"""How much of the edges that a part would show in each of many poses lies on segments of the same direction.

In: segments of both eyes, poses of a taught solid. Out: evidence for each. A segment that is there by chance speaks for
less where segments of that direction abound, as in a patterned table.
Source: directional chamfer matching (Liu, Tuzel, Veeraraghavan and Chellappa 2010), counted as in an a contrario test
(Desolneux, Moisan and Morel 2000) instead of summed as distances.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from daemon.arrays import Array
from daemon.vision.geometry import Baseline, Polyhedron
from daemon.vision.image import Segments

SHRINK = 2
DIRECTIONS = 12
REACH_PX = 5.0
SPACING_PX = 5.0
PLACES = 10
SHOWS = 0.75
LEAST_CHANCE = 0.02


LEAST_FACING = 0.08
"""Cosine below which a facet is too thin in the image to be looked for."""


@dataclass(frozen=True, eq=False)
class DirectedMap:
    """away (D, H, W) float32: px to the nearest segment of about each direction; chance (D,): how often one is in
    reach."""

    away: NDArray[np.float32]
    chance: Array


def directed_map(found: Segments, shape: tuple[int, ...]) -> DirectedMap:
    """Maps of an image of the shape (H, W)."""
    height, width = (n // SHRINK for n in shape)
    none = np.full((DIRECTIONS, height, width), 255, np.uint8)
    way = found.end - found.start
    bin_ = np.arctan2(way[:, 1], way[:, 0]) / np.pi * DIRECTIONS
    ends = (np.stack([found.start, found.end], 1) + 0.5) / SHRINK - 0.5
    fixed = np.round(ends * 16).astype(np.int32)
    for near in (-0.5, 0.5, -1, 1):
        which = np.round(bin_ + near).astype(int) % DIRECTIONS
        for k in range(DIRECTIONS):
            own = fixed[which == k]
            if len(own):
                cv2.polylines(none[k], list(own.reshape(-1, 2, 1, 2)), False, 0, 1, cv2.LINE_8, 4)
    away = np.stack([cv2.distanceTransform(one, cv2.DIST_L2, 3) if one.min() == 0 else np.full((height, width), 99, np.float32) for one in none]) * SHRINK
    chance = (away < REACH_PX).mean((1, 2))
    return DirectedMap(np.asarray(away, np.float32), np.clip(chance, LEAST_CHANCE, 0.7))


def in_view(solid: Polyhedron, poses: Array) -> NDArray[np.bool_]:
    """(P, F) which facets are turned to the cameras in each pose (P, 4, 4) cyclopean_from_part."""
    return np.asarray(solid.facing(poses) > LEAST_FACING)


def evidence(solid: Polyhedron, poses: Array, geometry: Baseline, maps: tuple[DirectedMap, DirectedMap]) -> tuple[Array, Array]:
    """(P,) log likelihood ratio of the part being there against chance, nats, and (P,) what it would be if every edge
    were found; poses (P, 4, 4) cyclopean_from_part."""
    pairs, bounds = solid.lines
    total, most = np.zeros(len(poses)), np.full(len(poses), 1e-9)
    shows = in_view(solid, poses)
    pose, edge = np.nonzero(shows @ bounds)
    if not len(pose):
        return total, most
    corners = solid.corners_mm @ poses[:, :3, :3].transpose(0, 2, 1) + poses[:, None, :3, 3]
    projected = geometry.project(corners.reshape(-1, 3))
    along = (np.arange(PLACES) + 0.5) / PLACES
    for eye, ideal, seen in zip((geometry.left, geometry.right), projected, maps, strict=True):
        px = eye.pixels(ideal).reshape(corners.shape[0], -1, 2)
        start, way = px[pose, pairs[edge, 0]], px[pose, pairs[edge, 1]] - px[pose, pairs[edge, 0]]
        length = np.hypot(way[:, 0], way[:, 1])
        which = np.round(np.arctan2(way[:, 1], way[:, 0]) / np.pi * DIRECTIONS).astype(int) % DIRECTIONS
        at = ((start[:, None] + along[:, None] * way[:, None] + 0.5) / SHRINK - 0.5 + 0.5).astype(np.int32)
        _, height, width = seen.away.shape
        inside = (at[..., 0] >= 0) & (at[..., 1] >= 0) & (at[..., 0] < width) & (at[..., 1] < height)
        x, y = np.clip(at[..., 0], 0, width - 1), np.clip(at[..., 1], 0, height - 1)
        away = np.where(inside, seen.away[which[:, None], y, x], 99.0)
        hit = np.clip(1.5 - away / REACH_PX, 0.0, 1.0).mean(1)
        chance = seen.chance[which]
        count = length / SPACING_PX
        total += np.bincount(pose, count * hit * np.log(SHOWS / chance), len(poses))
        total += np.bincount(pose, count * (1 - hit) * np.log((1 - SHOWS) / (1 - chance)), len(poses))
        most += np.bincount(pose, count * np.log(SHOWS / chance), len(poses))
    return total, most
