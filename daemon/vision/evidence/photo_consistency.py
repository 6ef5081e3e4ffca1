"""Whether both cameras show the same print on the faces of a part: what is flat and there looks alike in both.

Where it does not, and would if the faces lay nearer or farther, the calibration is off in depth. Faces without print
say nothing, and no more do places where a hole is in the face or the part itself is before it: what shows there is not
flat. Source: plane-induced homography (Hartley and Zisserman, section 13.1).
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from daemon import frames
from daemon.arrays import Array, Flags
from daemon.vision.geometry import PlanarShape, Polyhedron, apart2, in_sight, inside
from daemon.vision.image import StereoImages

SPACING_MM, MARGIN_PX, LEAST_FACING = 1.5, 5.0, 0.3
FEWEST, ENOUGH = 12, 1600
"""Places on a face: fewer say nothing, and on a large face more need not be asked."""
NEARLY, AGREES, MUCH_LESS = 0.7, 0.96, 0.35
"""How alike print is where edges have it that are a little off: what is less alike is something else; how alike where
it is; and by how much less it may differ there. Of pairs of a real printed cube with a camera turned in by .2 to .5
degrees, where no name is given, half say so; of pairs as calibrated, and of 112 rendered scenes, none."""
TRIED_PX = (-6.0, -4.5, -3.0, -2.0, -1.0, 1.0, 2.0, 3.0, 4.5, 6.0)
LEAST_PRINT = 25.0
"""Mean square of what is left of a face's grey levels without its shading, in sigmas of the noise: less is no print."""


def face_consistency(solid: Polyhedron, pose: Array, images: StereoImages, apart_px: float = 0.0) -> float | None:
    """Return how alike the print is that both cameras show on the faces of a part at cyclopean_from_part (4, 4): 1 the
    same, 0 nothing in common; None where there is no print to speak of. apart_px: by how much farther apart than there,
    along epipolar lines, the cameras have it."""
    total = apart = count = 0.0
    most = np.array(images.rig.image_size) - 1
    for index in np.flatnonzero(solid.facing(pose) > LEAST_FACING).tolist():
        on_face = places_on_face(solid, index)
        ring, places = (frames.apply(pose, mm) for mm in (solid.corners_mm[solid.rings[index]], on_face))
        borders, seen = (_seen(points, images, apart_px) for points in (ring, places))
        within = [
            (PlanarShape.of(own).depth(px) > MARGIN_PX) & ((px > 0) & (px < most)).all(1)
            for px, own in zip(seen, borders, strict=True)
        ]
        keep = np.all(within, axis=0)
        if keep.sum() >= FEWEST:
            keep[keep] = bare_places(solid, index, on_face[keep], pose, images)
        if keep.sum() < FEWEST:
            continue
        left, right = (_print(view.grainless, px[keep]) for view, px in zip(images.views, seen, strict=True))
        total += float(left @ left + right @ right) / 2
        apart += float((left - right) @ (left - right)) / 2
        count += len(left)
    return None if total <= LEAST_PRINT * count else 1.0 - apart / total


def print_apart_px(solid: Polyhedron, pose: Array, images: StereoImages) -> float:
    """Disparity difference, px, between print on the faces of a part and its edges at a pose (4, 4); 0 if they agree,
    or if nothing can be said."""
    here = face_consistency(solid, pose, images)
    if here is None or not NEARLY < here < AGREES:
        return 0.0
    there = [(face_consistency(solid, pose, images, by) or 0.0, by) for by in TRIED_PX]
    most, by = max(there)
    return by if most > AGREES and 1 - most < MUCH_LESS * (1 - here) else 0.0


def _seen(points: Array, images: StereoImages, apart_px: float) -> tuple[Array, Array]:
    """Project points (N, 3), that are so much farther apart in both cameras, into either, (N, 2) px each."""
    geometry = images.geometry
    left, right = geometry.project(points)
    shift = np.array([apart_px / geometry.right.focal_px, 0.0])
    return geometry.left.pixels(left), geometry.right.pixels(right + shift)


def places_on_face(solid: Polyhedron, index: int) -> Array:
    """(N, 3) places about a facet, in its plane, in the solid's frame."""
    flat_from_part = solid.flat_from_solid[index]
    flat = frames.apply(flat_from_part, solid.corners_mm[solid.rings[index]])[:, :2]
    spacing_mm = max(SPACING_MM, float(np.sqrt(np.prod(np.ptp(flat, axis=0)) / ENOUGH)))
    steps = (np.arange(low, high, spacing_mm) for low, high in zip(flat.min(0), flat.max(0), strict=True))
    places = np.stack(np.meshgrid(*steps, 0.0), -1).reshape(-1, 3)
    return frames.apply(frames.inverse(flat_from_part), places)


def bare_places(solid: Polyhedron, index: int, places: Array, pose: Array, images: StereoImages) -> Flags:
    """(N,) whether both cameras see the facet itself at and about places (N, 3) on it, in the solid's frame: no hole in
    it, and nothing of the part before it."""
    flat_from_part = solid.flat_from_solid[index]
    flat = frames.apply(flat_from_part, places)
    broken = np.zeros(len(places), bool)
    for hole in solid.holes:
        if hole.facet == index:
            broken |= inside(flat[:, :2], frames.apply(flat_from_part, hole.ring_mm)[None, :, :2])[0]
    for viewpoint_mm in images.geometry.cameras_mm:
        broken |= ~in_sight(solid, places, pose, viewpoint_mm)
    if not broken.any():
        return ~broken
    away_mm = float(np.linalg.norm(frames.apply(pose, solid.centres_mm[index][None])))
    margin_mm = SPACING_MM + MARGIN_PX * away_mm / images.geometry.left.focal_px
    return np.asarray(apart2(flat, flat[broken]).min(1) > margin_mm**2)


def _print(grey: NDArray[np.float32], px: Array) -> Array:
    """Grey levels (N,) at places (N, 2) px, in sigmas of the noise, without what shading and highlights make: a
    parabola of the place."""
    x, y = px.T.astype(np.float32)
    found = cv2.remap(grey, x[None], y[None], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)[0].astype(float)
    u, v = ((c - c.mean()) / max(float(np.ptp(c)), 1.0) for c in px.T)
    terms = np.stack([np.ones_like(u), u, v, u * u, u * v, v * v], 1)
    return np.asarray(found - terms @ np.linalg.lstsq(terms, found, rcond=None)[0])
