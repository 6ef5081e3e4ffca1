"""The collision shapes of a PUMA 560, its grippers and its cameras: capsules and points. Pure.

A gripper's shape follows from its dimensions; the guard does not distinguish kinds of gripper.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from daemon import frames
from daemon.arm.body import Capsule, Point, point_of
from daemon.arrays import Array

PALM_MM, PALM_BEHIND_MM = 36.0, 35.0
"""Radius of the palm that carries a gripper, and the distance of its axis behind the gripper."""
PALM_IN_MM = 20.0
"""Distance of the ends of the palm's axis from the inner faces of the open fingers."""


@dataclass(frozen=True)
class HandBody:
    """The collision shape of a gripper, tool frame, mm: capsules, and points for corners that capsules round off."""

    capsules: tuple[Capsule, ...]
    points_mm: tuple[Point, ...]

    def seen_from(self, new_from_old: Array) -> HandBody:
        """The same shape in another tool frame; new_from_old: (4, 4) mm."""

        def moved(point: Point) -> Point:
            return point_of(frames.apply(new_from_old, np.array(point)[None])[0])

        capsules = tuple(replace(c, from_mm=moved(c.from_mm), to_mm=moved(c.to_mm)) for c in self.capsules)
        return HandBody(capsules, tuple(map(moved, self.points_mm)))


def two_fingers(
    opening_mm: float = 90.0, width_mm: float = 15.0, thick_mm: float = 8.0, back_mm: float = 50.0, tip_mm: float = 10.0
) -> HandBody:
    """Two open fingers that close along tool y, from back_mm behind the tool centre point to tip_mm before it."""
    half, off_axis = width_mm / 2, (opening_mm + thick_mm) / 2
    palm, behind = max(opening_mm / 2 - PALM_IN_MM, 0.0), -back_mm - PALM_BEHIND_MM
    return HandBody(
        (
            Capsule("palm", "tool", (0.0, -palm, behind), (0.0, palm, behind), PALM_MM),
            Capsule("left finger", "tool", (0.0, off_axis, -back_mm), (0.0, off_axis, tip_mm - half), half),
            Capsule("right finger", "tool", (0.0, -off_axis, -back_mm), (0.0, -off_axis, tip_mm - half), half),
        ),
        tuple((x, y, tip_mm) for y, x in product((opening_mm / 2, -opening_mm / 2), (half, -half))),
    )


def suction_cup(radius_mm: float, length_mm: float) -> HandBody:
    """A suction cup on a tube: its lip is at the tool centre point, the palm length_mm behind it."""
    behind, low = -length_mm - PALM_BEHIND_MM, -min(radius_mm, length_mm)
    around = np.linspace(0.0, 2.0 * np.pi, 8, endpoint=False)
    rim = radius_mm * np.column_stack([np.cos(around), np.sin(around), np.zeros(len(around))])
    return HandBody(
        (
            Capsule("palm", "tool", (0.0, 0.0, behind), (0.0, 0.0, behind), PALM_MM),
            Capsule("suction cup", "tool", (0.0, 0.0, -length_mm), (0.0, 0.0, low), radius_mm),
        ),
        tuple(map(point_of, rim)),
    )


CAMERA_POINTS_MM: tuple[Point, ...] = (
    (-85.0, 50.0, -80.0),
    (-85.0, -50.0, -80.0),
    (-100.0, 50.0, -110.0),
    (-100.0, -50.0, -110.0),
)
"""The corners of the camera bar, tool frame."""
CAMERAS_ON_HAND: tuple[Capsule, ...] = (
    Capsule("camera arm", "tool", (0.0, 0.0, -95.0), (-90.0, 0.0, -95.0), 15.0),
    Capsule("camera bar", "tool", (-90.0, -50.0, -95.0), (-90.0, 50.0, -95.0), 20.0),
)
"""The bracket of the cameras of etc/ on the gripper; not used where the cameras are fixed in the world."""
CAMERAS = HandBody(CAMERAS_ON_HAND, CAMERA_POINTS_MM)

ARM_LINKS: tuple[Capsule, ...] = (
    Capsule("shoulder", "upper_arm", (-520.0, 0.0, 218.5), (-340.0, 0.0, 218.5), 186.0),
    Capsule("upper arm", "upper_arm", (-340.0, 0.0, 218.5), (0.0, 0.0, 218.5), 135.0),
    Capsule("elbow", "forearm", (0.0, 0.0, -149.0), (0.0, 0.0, 150.0), 88.0),
    Capsule("forearm", "forearm", (0.0, 0.0, 150.0), (0.0, 0.0, 431.8), 72.0),
    Capsule("wrist", "wrist", (0.0, 0.0, 0.0), (0.0, 0.0, 56.0), 45.0),
)
"""A PUMA 560 without a gripper: bounds of the robotics toolbox's meshes of it (UNIMATE/puma560: link 2 from 228 mm
behind the shoulder to 63 beyond the elbow, 304 x 135 mm, tapering to 158 x 135; link 3 from 149 behind the elbow,
150 x 92 mm, tapering to 90 x 92; links 4 to 6 within 45 mm of the wrist's axis; the flange 56 mm out)."""
ARM_LENGTHS_MM = 431.8, 150.05, 431.8
"""a2, d3 and d4 of a PUMA 560 (drivers/puma560.py)."""
ARM: tuple[Capsule, ...] = (*ARM_LINKS, *two_fingers().capsules, *CAMERAS_ON_HAND)
"""A PUMA 560 with the gripper and cameras of etc/, which the simulated cell has too."""
BODY_MM: tuple[Point, ...] = (*two_fingers().points_mm, *CAMERA_POINTS_MM)
"""The corner points of that gripper and those cameras."""


def links_like(a2_mm: float, d3_mm: float, d4_mm: float) -> tuple[Capsule, ...]:
    """ARM_LINKS scaled to an arm of the same shape with other lengths: along each link by that link's length, sideways
    by the shoulder's offset with its sign; radii by the largest of these factors."""
    a2, side, d4 = (np.array([abs(a2_mm), d3_mm, abs(d4_mm)]) / ARM_LENGTHS_MM).tolist()
    thick = max(a2, abs(side), d4)
    along = {"upper_arm": (a2, thick, side), "forearm": (thick, thick, d4), "wrist": (thick, thick, thick)}

    def scaled(capsule: Capsule) -> Capsule:
        start, end = (point_of(np.array(end) * along[capsule.link]) for end in (capsule.from_mm, capsule.to_mm))
        return Capsule(capsule.name, capsule.link, start, end, capsule.radius_mm * thick)

    return tuple(map(scaled, ARM_LINKS))
