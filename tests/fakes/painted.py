"""Stereo pairs painted from exact geometry: flat facets of different grey, blur and noise. For tests only.

Not a renderer: no shadows, no shading within a facet. What matters is that every edge is where geometry says.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from daemon import frames
from daemon.arrays import Array
from daemon.vision.geometry import Polyhedron
from daemon.vision.geometry.rig import Camera, StereoRig
from tests.fakes.rigs import rig
from tests.fakes.solids import Body

FINER = 4
IN_HOLES = 60.0
GREYS = (95.0, 165.0, 110.0, 185.0, 140.0, 205.0, 125.0)  # one a facet, in turn, so that neighbours differ


def paint_pair(
    bodies: Sequence[tuple[Body | Polyhedron, Array]], rng: np.random.Generator, cameras: StereoRig | None = None
) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Left and right image (480, 640) uint8 of bodies at their cyclopean_from_part, farther ones first; holes of
    a solid are dark."""
    cameras = cameras or rig()
    return _paint(bodies, cameras.left, cameras.image_size, rng), _paint(bodies, cameras.right, cameras.image_size, rng)


def _paint(
    bodies: Sequence[tuple[Body | Polyhedron, Array]], camera: Camera, size: tuple[int, int], rng: np.random.Generator
) -> NDArray[np.uint8]:
    image = np.full((size[1] * FINER, size[0] * FINER), 45.0, np.float32)
    for body, pose in bodies:
        corners = frames.apply(pose, body.corners_mm)
        for index, ring in enumerate(body.facets):
            p = corners[list(ring)]
            normal = np.cross(p - p[0], np.roll(p, -1, axis=0) - p[0]).sum(0)
            normal /= np.linalg.norm(normal)
            if normal @ (camera.cyclopean_from_camera[:3, 3] - p.mean(0)) > 0:
                cv2.fillPoly(image, [_border(p, camera)], GREYS[index % len(GREYS)], cv2.LINE_8, 4)
                for hole in body.holes if isinstance(body, Polyhedron) else ():
                    if hole.facet == index:
                        rim = frames.apply(pose, hole.ring_mm)
                        cv2.fillPoly(image, [_border(rim, camera)], IN_HOLES, cv2.LINE_8, 4)
    small = cv2.resize(cv2.GaussianBlur(image, (0, 0), 0.6 * FINER), size, interpolation=cv2.INTER_AREA)
    noisy = np.asarray(small, float) + rng.normal(0, 2.0, small.shape)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


def _border(corners: Array, camera: Camera) -> NDArray[np.int32]:
    """The facet's outline in the finer image, 1/16 px, with points along each side so that the lens may bow it."""
    following = np.roll(corners, -1, axis=0)
    steps = np.linspace(0, 1, 12, endpoint=False)[:, None]
    points = np.concatenate([a + steps * (b - a) for a, b in zip(corners, following, strict=True)])
    px = (camera.project(points) + 0.5) * FINER - 0.5
    return np.rint(px * 16).astype(np.int32)
