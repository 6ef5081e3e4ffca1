"""Chamfer distances of many poses at once: how far a part's edges would lie from the nearest edges of both images.

In: poses of one metric model, a map of distances to edges an eye. Out: a distance for each. What is worth laying onto
the images exactly (edge_pose.py) is chosen by it; nothing is decided here. Source: Barrow's chamfer matching.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from daemon.arrays import Array
from daemon.vision.geometry import Baseline, Polyhedron
from daemon.vision.image import Scale

FARTHEST_PX = 6.0  # an edge farther off than this is as good as none
PLACES = 10  # along each edge where the distance is read
LEAST_FACING = 0.08  # cosine below which a facet is too thin in the image to be looked for


@dataclass(frozen=True, eq=False)
class EdgeMap:
    """away (H, W): px from each pixel to the nearest edge, at most FARTHEST_PX; a pixel is `shrink` full-size ones."""

    away: NDArray[np.float32]
    shrink: int


def edge_map(scale: Scale, level: float) -> EdgeMap:
    """Distances to where the gradient exceeds so many sigmas."""
    none = (scale.strength < level * scale.sigma).astype(np.uint8)
    away = np.minimum(cv2.distanceTransform(none, cv2.DIST_L2, 3), FARTHEST_PX / scale.shrink)
    return EdgeMap(np.asarray(away * scale.shrink, np.float32), scale.shrink)


def in_view(solid: Polyhedron, poses: Array) -> NDArray[np.bool_]:
    """(P, F) which facets are turned to the cameras in each pose (P, 4, 4) cyclopean_from_part."""
    return np.asarray(solid.facing(poses) > LEAST_FACING)


def chamfer_px(solid: Polyhedron, poses: Array, geometry: Baseline, maps: tuple[EdgeMap, EdgeMap]) -> Array:
    """(P,) mean px between the edges that a part in each pose would show and the nearest that are seen."""
    pairs, bounds = solid.lines
    pose, edge = np.nonzero(in_view(solid, poses) @ bounds)
    corners = solid.corners_mm @ poses[:, :3, :3].transpose(0, 2, 1) + poses[:, None, :3, 3]
    cost, weight = np.zeros(len(poses)), np.full(len(poses), 1e-9)
    if not len(pose):
        return cost
    along = (np.arange(PLACES, dtype=np.float32) + 0.5) / PLACES
    projected = geometry.project(corners.reshape(-1, 3))
    for eye, ideal, seen in zip((geometry.left, geometry.right), projected, maps, strict=True):
        px = eye.pixels(ideal).reshape(corners.shape[0], -1, 2)
        start, chord = px[pose, pairs[edge, 0]], px[pose, pairs[edge, 1]] - px[pose, pairs[edge, 0]]
        first = ((start + 0.5) / seen.shrink - 0.5).astype(np.float32)
        way = (chord / seen.shrink).astype(np.float32)
        x, y = (first[:, None, k] + along * way[:, None, k] for k in (0, 1))
        away = _nearest(seen.away, x, y)
        length = np.hypot(chord[:, 0], chord[:, 1])
        cost += np.bincount(pose, length * away.mean(1), len(poses))
        weight += np.bincount(pose, length, len(poses))
    return np.asarray(cost / weight)


def _nearest(away: NDArray[np.float32], x: NDArray[np.float32], y: NDArray[np.float32]) -> NDArray[np.float32]:
    """The distances at places (N, M), to the nearest pixel; the farthest outside the image."""
    step = 32000  # cv2.remap takes maps of fewer than 32768 rows
    parts = [
        cv2.remap(
            away,
            x[k : k + step],
            y[k : k + step],
            cv2.INTER_NEAREST,
            borderMode=cv2.BORDER_CONSTANT,
            borderValue=FARTHEST_PX,
        )
        for k in range(0, len(x), step)
    ]
    return np.asarray(np.concatenate(parts), np.float32)
