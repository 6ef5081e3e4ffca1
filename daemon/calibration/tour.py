"""Poses from which to view the board, so that the views determine lens, stereo and hand-eye. Pure: poses in, poses out.

Rotation about two axes determines the hand-eye, tilt and distance the focal length, the board in the image corners the
distortion. Each pose is the reachable one that differs most from all before.
"""

from collections.abc import Callable, Sequence
from itertools import product

import numpy as np

from daemon import frames
from daemon.arrays import Array

TILTS_DEG = (8.0, 20.0, 32.0)
HEADINGS = 8
ROLLS_DEG = (-40.0, -15.0, 15.0, 40.0)
DISTANCES_MM = (270.0, 330.0, 400.0)
AIMS_MM = ((0.0, 0.0), (28.0, 20.0), (-28.0, 20.0), (28.0, -20.0), (-28.0, -20.0))
"""Offset of the board's centre from the cameras' axis, x and y in the cyclopean frame."""
FIXED_DISTANCES = (0.85, 1.0, 1.15)
"""Distances of a board in the gripper from fixed cameras, as shares of its first one."""
FIXED_ASIDE, FIXED_AIMS = 0.2, ((0, 0), (1, 1), (-1, 1), (1, -1), (-1, -1))
"""Offset of its centre from the cameras' axis, as a share of that, and to which sides."""
MM_A_RADIAN = 300.0
"""A rotation of one radian counts as this distance: how far a point at working distance moves."""


def viewpoints_around(
    world_from_board: Array,
    centre: Array,
    upright: Array,
    distances_mm: Sequence[float] = DISTANCES_MM,
    aims_mm: Sequence[tuple[float, float]] = AIMS_MM,
) -> list[Array]:
    """Candidate poses world_from_cyclopean (4, 4) above the board that look at its centre (3,), board frame.

    upright: (3,) world direction of the cameras' x axis before the roll; distances_mm, aims_mm: see the constants.
    """
    middle = frames.apply(world_from_board, centre)
    normal = -world_from_board[:3, 2]
    side = upright - normal * float(upright @ normal)
    side /= np.linalg.norm(side)
    across = np.cross(normal, side)
    found = []
    for tilt, step, roll, distance, aim in product(TILTS_DEG, range(HEADINGS), ROLLS_DEG, distances_mm, aims_mm):
        heading = 2 * np.pi * step / HEADINGS
        sideways = np.cos(heading) * side + np.sin(heading) * across
        away = np.cos(np.radians(tilt)) * normal + np.sin(np.radians(tilt)) * sideways
        x = upright - away * float(upright @ away)
        x /= np.linalg.norm(x)
        z = -away
        rotation = np.column_stack([x, np.cross(z, x), z]) @ frames.rotation_from_vector(
            np.array([0.0, 0.0, np.radians(roll)])
        )
        found.append(frames.rigid(rotation, middle - rotation @ np.array([*aim, distance])))
    return found


def choose_spread(poses: Sequence[Array], count: int, allowed: Callable[[Array], bool], first: Array) -> list[Array]:
    """Farthest-point sampling over translation and rotation: at most `count` allowed poses, each the farthest from
    `first` and all chosen before. Calls `allowed` only for a pose that it would choose next."""
    remaining, chosen = list(poses), list[Array]()
    gaps = [_gap(p, first) for p in remaining]
    while remaining and len(chosen) < count:
        k = int(np.argmax(gaps))
        pose = remaining.pop(k)
        del gaps[k]
        if allowed(pose):
            chosen.append(pose)
            gaps = [min(gap, _gap(p, pose)) for gap, p in zip(gaps, remaining, strict=True)]
    return chosen


def shortest_order(poses: Sequence[Array], start: Array) -> list[Array]:
    """Order the poses for short moves: always the nearest next."""
    remaining, ordered, here = list(poses), list[Array](), start
    while remaining:
        k = int(np.argmin([_gap(p, here) for p in remaining]))
        here = remaining.pop(k)
        ordered.append(here)
    return ordered


def _gap(a: Array, b: Array) -> float:
    return float(np.linalg.norm(a[:3, 3] - b[:3, 3])) + MM_A_RADIAN * frames.angle_between(a, b)
