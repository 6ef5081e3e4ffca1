"""From where to look at the board, so that lens, eyes and hand-eye can be told apart. Pure: poses in, poses out.

Turning about two axes fixes the hand-eye, tilt and distance fix the lens, the board in the corners of the image fixes
its distortion. Poses are chosen one by one, each as unlike all before as the arm can reach.
"""

from __future__ import annotations

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
"""Where the board's centre comes to lie beside the cameras' axis, x and y in the cyclopean frame."""
MM_A_RADIAN = 300.0
"""A turn of one radian counts as much as this way: what a point at working distance moves."""


def looks_at(world_from_board: Array, centre: Array, upright: Array) -> list[Array]:
    """Candidates for world_from_cyclopean (4, 4) that look at the board's centre (3,), board frame, from above it.

    upright: (3,) world direction that the cameras' x axis keeps to, before they are rolled.
    """
    middle = frames.apply(world_from_board, centre)
    normal = -world_from_board[:3, 2]
    side = upright - normal * float(upright @ normal)
    side /= np.linalg.norm(side)
    across = np.cross(normal, side)
    found = []
    for tilt, step, roll, distance, aim in product(TILTS_DEG, range(HEADINGS), ROLLS_DEG, DISTANCES_MM, AIMS_MM):
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


def spread_out(poses: Sequence[Array], count: int, allowed: Callable[[Array], bool], first: Array) -> list[Array]:
    """At most `count` poses that are allowed, each the farthest from all chosen before and from `first` (farthest-point
    sampling over way and turn). allowed is asked only of poses that are about to be taken."""
    left = list(poses)
    gaps = np.array([_gap(p, first) for p in left])
    chosen: list[Array] = []
    while left and len(chosen) < count:
        k = int(np.argmax(gaps))
        pose = left[k]
        if not allowed(pose):
            del left[k]
            gaps = np.delete(gaps, k)
            continue
        chosen.append(pose)
        gaps = np.minimum(gaps, [_gap(p, pose) for p in left])
        del left[k]
        gaps = np.delete(gaps, k)
    return chosen


def in_order(poses: Sequence[Array], start: Array) -> list[Array]:
    """The same poses so that the way from one to the next is short (nearest next)."""
    left, ordered, here = list(poses), list[Array](), start
    while left:
        k = int(np.argmin([_gap(p, here) for p in left]))
        here = left.pop(k)
        ordered.append(here)
    return ordered


def _gap(a: Array, b: Array) -> float:
    return float(np.linalg.norm(a[:3, 3] - b[:3, 3])) + MM_A_RADIAN * frames.angle_between(a, b)
