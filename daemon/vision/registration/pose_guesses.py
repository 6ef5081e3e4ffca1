"""What a single outline in a single eye could be: taught facets in the poses that would look like it.

In: corners in one image, taught metric models. Out: guesses, to be laid onto both images (edge_pose.py). A guess is no
recognition: four corners fit many things.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from daemon import frames
from daemon.arrays import Array
from daemon.vision.geometry import Baseline, p3p_poses
from daemon.vision.model import Model

REPROJECTION_PX = 2.5  # rms; an outline that fits a facet no better is another facet
SAME_PX = 3.0  # corners this close are the same
NEAREST_MM, FARTHEST_MM = 120.0, 1500.0


@dataclass(frozen=True, eq=False)
class PoseGuess:
    """A part and where it could be: label, cyclopean_from_part (G, 4, 4) mm."""

    label: str
    poses: Array


def guesses_from_outline(corners_px: Array, eye: str, geometry: Baseline, model: Model) -> list[PoseGuess]:
    """Every taught facet with as many corners, in every turn, where it would look like this outline.

    corners_px (N, 2), anticlockwise as seen, in the eye called `left` or `right`. Source: perspective-n-point of a
    plane (Collins and Bartoli's two solutions; Grunert's up to four for a triangle).
    """
    one = geometry.right if eye == "right" else geometry.left
    ideal, count = one.ideal(corners_px), len(corners_px)
    found = []
    for label, metric in model.metric.items():
        solid, poses = metric.solid, list[Array]()
        for ring, flat_from_part in zip(solid.rings, solid.laid_flat, strict=True):
            if len(ring) == count:
                corners = solid.corners_mm[ring]
                for turn in range(count):
                    poses += _solutions(
                        np.roll(corners, -turn, 0), ideal, flat_from_part, REPROJECTION_PX / one.focal_px
                    )
        if poses:
            found.append(PoseGuess(label, _cyclopean(np.array(poses), eye, geometry)))
    return found


def guesses_from_corners(outlines: list[tuple[Array, str]], geometry: Baseline, model: Model) -> list[PoseGuess]:
    """The same from any three neighbouring corners of outlines (corners (N, 2) px, eye) whose others may be wrong.

    Two faces in the same light have one outline, and a faint edge makes a wrong corner.
    """
    found = []
    for eye in ("left", "right"):
        triples = [c[(k + np.arange(3)) % len(c)] for c, own in outlines if own == eye for k in range(len(c))]
        if triples:
            found += _p3p(_different(np.array(triples)), eye, geometry, model)
    return found


def _different(triples: Array) -> Array:
    """Of corners (T, 3, 2) px, three at a time, those that do not repeat earlier ones."""
    apart = np.abs(triples[:, None] - triples[None]).max((2, 3))
    return np.asarray(triples[np.argmax(apart < SAME_PX, 1) == np.arange(len(triples))])


def _p3p(triples: Array, eye: str, geometry: Baseline, model: Model) -> list[PoseGuess]:
    """Poses of all taught facets of which any three neighbouring corners would look like any of these (T, 3, 2) px."""
    one = geometry.right if eye == "right" else geometry.left
    ideal = one.ideal(triples.reshape(-1, 2)).reshape(-1, 3, 2)
    found = []
    for label, metric in model.metric.items():
        rings = [ring[k:] + ring[:k] for ring in metric.solid.facets for k in range(len(ring))]
        taught = metric.solid.corners_mm[np.array([ring[:3] for ring in rings])]
        points, seen = np.tile(taught, (len(ideal), 1, 1)), np.repeat(ideal, len(taught), axis=0)
        poses, solved = p3p_poses(points, seen)
        near = solved & (poses[:, 2, 3] > NEAREST_MM) & (poses[:, 2, 3] < FARTHEST_MM)
        found.append(PoseGuess(label, _cyclopean(poses[near], eye, geometry)))
    return found


def _solutions(corners_mm: Array, ideal: Array, flat_from_part: Array, most: float) -> list[Array]:
    """Poses (4, 4) eye_from_part, as far off as parts may be, that project the corners of a facet onto the ideal
    coordinates, to within so much rms there."""
    points = frames.apply(flat_from_part, corners_mm) * [1.0, 1.0, 0.0]
    seen = np.ascontiguousarray(ideal[:, None, :])
    try:
        if len(corners_mm) == 3:
            _, turns, shifts = cv2.solveP3P(points, seen, np.eye(3), np.zeros(4), cv2.SOLVEPNP_P3P)
            errors = [0.0] * len(turns)
        else:
            _, turns, shifts, off = cv2.solvePnPGeneric(points, seen, np.eye(3), np.zeros(4), flags=cv2.SOLVEPNP_IPPE)
            if off is None:  # corners that no pose projects so, as of an outline that crosses itself
                return []
            errors = (np.sqrt(2) * np.ravel(off)).tolist()  # the solver's are those of a coordinate
    except cv2.error:
        return []
    found = []
    for turn, shift, error in zip(turns, shifts, errors, strict=True):
        if error < most:
            pose = frames.rigid(frames.rotation_from_vector(np.ravel(turn)), np.ravel(shift)) @ flat_from_part
            if NEAREST_MM < pose[2, 3] < FARTHEST_MM and (frames.apply(pose, corners_mm)[:, 2] > 1.0).all():
                found.append(pose)
    return found


def _cyclopean(eye_from_part: Array, eye: str, geometry: Baseline) -> Array:
    """The same poses (..., 4, 4) in the cyclopean frame: the eyes sit half the baseline off its middle."""
    moved = eye_from_part.copy()
    moved[..., 0, 3] += (0.5 if eye == "right" else -0.5) * geometry.length_mm
    return np.asarray(frames.rigid(geometry.cyclopean_from_baseline, geometry.middle_mm) @ moved)
