"""What a pick is set to do: views, places, limits, the order of parts. Values and their meaning only; no behaviour."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Literal

import numpy as np
from msgspec import Meta

from daemon import frames
from daemon.arm import Arrival, Limits, Point, Settling
from daemon.arrays import Array
from daemon.pick import viewpoints
from daemon.pick.grasp import Gripper, tool_rotation
from daemon.pick.pose_fusion import Doubt, Stops
from daemon.quantities import Direction, Few, Lean, Length, Percent, Pixels


@dataclass(frozen=True)
class View:
    """From where to look at the table: the point looked at, how far the cameras are from it, and how the tool leans
    (heading: the horizontal direction it leans to, degrees from world x; tilt from straight down)."""

    centre_mm: Point = (520.0, 0.0, -280.0)
    distance_mm: Length = 480.0
    heading_deg: Direction = 0.0
    tilt_deg: Lean = 45.0

    def pose(self, tool_from_cyclopean: Array) -> Array:
        """world_from_tool (4, 4)."""
        rotation = tool_rotation(heading(self.heading_deg), float(np.radians(self.tilt_deg)))
        return viewpoints.look_pose(rotation, np.array(self.centre_mm), self.distance_mm, tool_from_cyclopean)


@dataclass(frozen=True)
class Place:
    """A taught place of the tool centre point, mm, leaning as a View does."""

    point_mm: Point
    heading_deg: Direction = 0.0
    tilt_deg: Lean = 0.0

    def pose(self) -> Array:
        """world_from_tool (4, 4)."""
        rotation = tool_rotation(heading(self.heading_deg), float(np.radians(self.tilt_deg)))
        return frames.rigid(rotation, np.array(self.point_mm))


@dataclass(frozen=True)
class Settings:
    """All of a pick. surveys: from where the table is looked at, until a part has a name; last_surveys: from where else
    before it is called empty; order: which part first; tries: how often one part is tried; views_of_doubtful: how often
    a part that cannot be named is looked at from another side; verify_mm: from how far the place is looked at
    afterwards; gone_mm: a part this near to where it lay still lies there; hand_s: what fingers need;
    epipolar_limit_px: beyond it a camera was knocked; auto_degrade: after a camera's fault an auto goes on with the
    other eye by itself, once an operator has allowed that since the daemon's start."""

    surveys: Annotated[tuple[View, ...], Meta(min_length=1)] = (
        View(heading_deg=50.0),
        View(heading_deg=-50.0),
        View(heading_deg=90.0),
    )
    last_surveys: tuple[View, ...] = (View(heading_deg=-90.0, tilt_deg=35.0), View(heading_deg=0.0, tilt_deg=20.0))
    home: Place = Place((420.0, 0.0, 60.0), tilt_deg=20.0)
    bin: Place = Place((250.0, 410.0, -150.0), heading_deg=58.0, tilt_deg=10.0)
    order: Literal["nearest", "surest"] = "surest"
    tries: Few = 2
    views_of_doubtful: Annotated[int, Meta(ge=0, le=100)] = 4
    travel_pct: Percent = 100.0
    near_pct: Percent = 30.0
    pregrasp_mm: Length = 50.0
    lift_mm: Length = 60.0
    verify_mm: Length = 300.0
    gone_mm: Length = 30.0
    epipolar_limit_px: Pixels = 1.0
    hand_s: Annotated[float, Meta(ge=0, le=60)] = 0.0
    auto_degrade: bool = False
    limits: Limits = field(default_factory=Limits)
    arrival: Arrival = field(default_factory=Arrival)
    stops: Stops = field(default_factory=Stops)
    doubt: Doubt = field(default_factory=Doubt)
    gripper: Gripper = field(default_factory=Gripper)
    settling: Settling = field(default_factory=Settling)


def heading(degrees: float) -> Array:
    """Unit horizontal direction (3,) at an angle from world x."""
    angle = np.radians(degrees)
    return np.array([np.cos(angle), np.sin(angle), 0.0])
