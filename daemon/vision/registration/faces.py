"""Whether both eyes show the same print on the faces of a part: what is flat and there looks alike in both.

A guess that has the edges by chance lays its faces through thin air, and what shows there lies elsewhere in the other
eye. Faces without print say nothing. Source: plane-induced homography (Hartley and Zisserman, section 13.1).
"""

from __future__ import annotations

import cv2
import numpy as np

from daemon import frames
from daemon.arrays import Array
from daemon.vision.geometry import Polyhedron
from daemon.vision.image import Eyes, OneEye
from daemon.vision.registration.different import pixels

SPACING_MM, INSET, LEAST_FACING = 1.0, 0.82, 0.3
FEWEST = 24
LEAST_PRINT = 20.0
"""Mean square of what is left of a face's grey levels without its shading, in sigmas of the noise: less is no print."""


def likeness(solid: Polyhedron, pose: Array, eyes: Eyes) -> float | None:
    """How alike the print is that both eyes show on the faces of a part at cyclopean_from_part (4, 4): 1 the same, 0
    nothing in common; None where there is no print to speak of."""
    corners = frames.apply(pose, solid.corners_mm)
    total = apart = count = 0.0
    for index in np.flatnonzero(solid.facing(pose) > LEAST_FACING).tolist():
        places = _inside(corners[solid.rings[index]])
        if len(places) < FEWEST:
            continue
        left, right = (_print(view, px) for view, px in zip(eyes.views, pixels(places, eyes.geometry), strict=True))
        total += float(left @ left + right @ right) / 2
        apart += float((left - right) @ (left - right)) / 2
        count += len(places)
    return None if total <= LEAST_PRINT * count else 1.0 - apart / total


def _inside(ring: Array) -> Array:
    """(N, 3) places on a facet with corners (K, 3), not near its border."""
    middle = ring.mean(0)
    x = ring[1] - ring[0]
    x = x / np.linalg.norm(x)
    normal = np.cross(x, ring[2] - ring[1])
    y = np.cross(normal / np.linalg.norm(normal), x)
    flat = INSET * (ring - middle) @ np.stack([x, y], 1)
    low, high = flat.min(0), flat.max(0)
    across = np.stack(np.meshgrid(*(np.arange(a, b, SPACING_MM) for a, b in zip(low, high, strict=True))), -1).reshape(-1, 2)
    way = np.roll(flat, -1, 0) - flat
    to = across[:, None] - flat
    inside = (way[:, 0] * to[..., 1] - way[:, 1] * to[..., 0] > 0).all(1)
    return np.asarray(middle + across[inside] @ np.stack([x, y]))


def _print(view: OneEye, px: Array) -> Array:
    """Grey levels (N,) at places (N, 2) px, in sigmas of the noise, without what shading and highlights make: a
    parabola of the place."""
    x, y = px.T.astype(np.float32)
    grey = cv2.remap(view.smooth, x[None], y[None], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)[0].astype(float)
    u, v = ((c - c.mean()) / max(float(np.ptp(c)), 1.0) for c in px.T)
    terms = np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], 1)
    return np.asarray(grey - terms @ np.linalg.lstsq(terms, grey, rcond=None)[0])
