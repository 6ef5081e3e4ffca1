"""Which views of a hand-held board are still missing, as instructions for a person. Pure."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from daemon import frames
from daemon.arrays import Array

TILT_DEG = 15.0
RIM = 0.22
"""The board must come once within this share of the image of each image corner."""
DISTANCE_RATIO = 1.3
UNLIKE_MM = 40.0
"""A view is kept where its pose differs by this much from all others, translation plus rotation (1 rad = 300 mm)."""


@dataclass(frozen=True, eq=False)
class BoardPose:
    """One kept view: cyclopean_from_board (4, 4) mm, roughly; corners (N, 2), left camera, as shares of the image."""

    cyclopean_from_board: Array
    corners: Array


def is_new_view(views: Sequence[BoardPose], pose: Array) -> bool:
    """Whether a pose (4, 4) differs from those of all views."""
    return all(
        np.linalg.norm(v.cyclopean_from_board[:3, 3] - pose[:3, 3])
        + 300.0 * frames.angle_between(v.cyclopean_from_board, pose)
        > UNLIKE_MM
        for v in views
    )


def missing_views(views: Sequence[BoardPose]) -> list[str]:
    """Instructions for the views still missing, the most useful first; empty when none is."""
    steps = [
        *(f"tilt the board: its {side} away from the cameras" for side in _tilts_missing(views)),
        *(f"bring it into the {corner} of the image" for corner in _corners_missing(views)),
    ]
    distances = [float(v.cyclopean_from_board[2, 3]) for v in views]
    if not distances or max(distances) < DISTANCE_RATIO * min(distances):
        steps.append("hold it nearer, and then farther away")
    return steps


def _tilts_missing(views: Sequence[BoardPose]) -> list[str]:
    # The board's z points into it, away from the cameras; where its right side is farther, z leans to the left.
    leans = np.array([v.cyclopean_from_board[:2, 2] for v in views]).reshape(-1, 2)
    least = np.sin(np.radians(TILT_DEG))
    sides = {
        "right side": -leans[:, 0],
        "left side": leans[:, 0],
        "lower side": -leans[:, 1],
        "upper side": leans[:, 1],
    }
    return [name for name, lean in sides.items() if not (lean > least).any()]


def _corners_missing(views: Sequence[BoardPose]) -> list[str]:
    seen = np.concatenate([v.corners for v in views]) if views else np.zeros((0, 2))
    places = {"upper left": (0, 0), "upper right": (1, 0), "lower left": (0, 1), "lower right": (1, 1)}
    return [name for name, at in places.items() if not (np.abs(seen - np.array(at)) < RIM).all(axis=1).any()]
