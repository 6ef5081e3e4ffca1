"""What a single outline in a single eye could be: taught facets in the poses that would look like it.

In: corners in one image, taught metric models. Out: guesses, to be laid onto both images (edge_pose.py). A guess is no
recognition: four corners fit many things.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from daemon import frames
from daemon.vision.geometry.facet_measures import newell_normal
from daemon.vision.geometry.p3p import p3p_poses
from daemon.vision.geometry.rectified import Baseline
from daemon.vision.model.model import Model

Array = NDArray[np.float64]
REPROJECTION_PX = 2.5  # rms; an outline that fits a facet no better is another facet
SAME_PX = 3.0  # corners this close are the same
NEAREST_MM, FARTHEST_MM = 120.0, 1500.0


@dataclass(frozen=True, eq=False)
class PoseGuess:
    """A part and where it could be: label, cyclopean_from_part (4, 4) mm."""

    label: str
    pose: Array


def guesses_from_outline(corners_px: Array, eye: str, geometry: Baseline, model: Model) -> list[PoseGuess]:
    """Every taught facet with as many corners, in every turn, where it would look like this outline.

    corners_px (N, 2), anticlockwise as seen, in the eye called `left` or `right`. Source: perspective-n-point of a
    plane (Collins and Bartoli's two solutions; Grunert's up to four for a triangle).
    """
    one = geometry.right if eye == "right" else geometry.left
    ideal = one.ideal(corners_px)
    found = []
    for label, metric in model.metric.items():
        for ring in metric.solid.facets:
            if len(ring) != len(corners_px):
                continue
            for turn in range(len(ring)):
                corners = metric.solid.corners_mm[list(ring[turn:] + ring[:turn])]
                for pose, error in _solutions(corners, ideal):
                    if error * one.focal_px < REPROJECTION_PX and NEAREST_MM < pose[2, 3] < FARTHEST_MM:
                        found.append(PoseGuess(label, _cyclopean(pose, eye, geometry)))
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
        found += [PoseGuess(label, pose) for pose in _cyclopean(poses[near], eye, geometry)]
    return found


def _solutions(corners_mm: Array, ideal: Array) -> list[tuple[Array, float]]:
    """Poses (4, 4) eye_from_part that project the corners onto the ideal coordinates, with their rms error there."""
    flat_from_part = _laid_flat(corners_mm)
    points = frames.apply(flat_from_part, corners_mm) * [1.0, 1.0, 0.0]
    seen = np.ascontiguousarray(ideal[:, None, :])
    try:
        if len(corners_mm) == 3:
            _, turns, shifts = cv2.solveP3P(points, seen, np.eye(3), np.zeros(4), cv2.SOLVEPNP_P3P)
        else:
            _, turns, shifts, _ = cv2.solvePnPGeneric(points, seen, np.eye(3), np.zeros(4), flags=cv2.SOLVEPNP_IPPE)
    except cv2.error:
        return []
    found = []
    for turn, shift in zip(turns, shifts, strict=True):
        pose = frames.rigid(frames.rotation_from_vector(np.ravel(turn)), np.ravel(shift)) @ flat_from_part
        there = frames.apply(pose, corners_mm)
        if (there[:, 2] > 1.0).all():
            off = there[:, :2] / there[:, 2:] - ideal
            found.append((pose, float(np.sqrt((off**2).sum(1).mean()))))
    return found


def _laid_flat(corners_mm: Array) -> Array:
    """(4, 4) the motion that lays a plane facet (N, 3) into z = 0."""
    z = newell_normal(corners_mm)
    x = corners_mm[1] - corners_mm[0]
    x = x - z * (x @ z)
    x = x / np.linalg.norm(x)
    turn = np.stack([x, np.cross(z, x), z])
    return frames.rigid(turn, -turn @ corners_mm.mean(0))


def _cyclopean(eye_from_part: Array, eye: str, geometry: Baseline) -> Array:
    """The same poses (..., 4, 4) in the cyclopean frame: the eyes sit half the baseline off its middle."""
    moved = eye_from_part.copy()
    moved[..., 0, 3] += (0.5 if eye == "right" else -0.5) * geometry.length_mm
    return np.asarray(frames.rigid(geometry.cyclopean_from_baseline, geometry.middle_mm) @ moved)
