"""Stereo rigs with known truth: two converging cameras on one baseline, and the few that tests share.

Rigs of the rendered scenes are read from their files (rendered.py), the simulated cell's from its truth.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from daemon import frames
from daemon.vision.geometry.rig import Camera, StereoRig

BARREL = (-0.08, 0.03, 0.0004, -0.0003, 0.0)
STRAIGHT = (0.0,) * 5
Two = tuple[float, float]


def rig(
    base_mm: float = 60.0,
    turn_rad: float = 0.0855,
    focal_px: Two = (700.0, 700.0),
    centres_px: tuple[Two, Two] = ((320.0, 240.0), (320.0, 240.0)),
    distortion: tuple[float, ...] = BARREL,
    image_size: tuple[int, int] = (640, 480),
    raised_mm: float = 0.0,
) -> StereoRig:
    """Two cameras base_mm apart, each turned inwards by turn_rad: by default 640 x 480, 700 px, fixation at 350 mm,
    mild barrel distortion. focal_px, centres_px: left, right; raised_mm: the right camera's y, and the left one's
    -y."""
    cameras = []
    for side, focal, (cx, cy) in zip((-1.0, 1.0), focal_px, centres_px, strict=True):
        turn = frames.rotation_from_vector(np.array([0.0, -side * turn_rad, 0.0]))
        place = np.array([side * base_mm / 2, side * raised_mm, 0.0])
        matrix = np.array([[focal, 0, cx], [0, focal, cy], [0, 0, 1]])
        cameras.append(Camera(matrix, np.array(distortion), frames.rigid(turn, place)))
    return StereoRig(cameras[0], cameras[1], image_size)


def parallel_rig() -> StereoRig:
    """640 x 480, 700 px, 60 mm apart, parallel, no distortion."""
    return rig(turn_rad=0.0, centres_px=((319.5, 239.5), (319.5, 239.5)), distortion=STRAIGHT)


def unlike_rig() -> StereoRig:
    """As `rig`, with slightly different cameras, as real ones are."""
    return rig(turn_rad=np.arctan2(30, 350), focal_px=(699.0, 701.0), centres_px=((322.7, 241.0), (316.8, 237.4)))


def thesis_rig() -> StereoRig:
    """The thesis's: 200 mm apart, converging at 567 mm, 760 px, no distortion."""
    turn_rad, centre = np.arctan2(100.0, 567.0), (255.5, 239.5)
    return rig(200.0, turn_rad, (760.0, 760.0), (centre, centre), STRAIGHT, (512, 480))


def turned(rig: StereoRig, axis: int, degrees: float) -> StereoRig:
    """The rig with its right camera turned about its own x, y or z."""
    turn = np.zeros(3)
    turn[axis] = np.radians(degrees)
    rotation = frames.rigid(frames.rotation_from_vector(turn), np.zeros(3))
    return replace(rig, right=replace(rig.right, cyclopean_from_camera=rig.right.cyclopean_from_camera @ rotation))
