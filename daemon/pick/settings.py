"""What a pick is set to do: views, places, limits, the order of parts; and the poses that follow from these values."""

from dataclasses import dataclass, field
from typing import Annotated, Literal

import numpy as np
from msgspec import Meta

from daemon import frames
from daemon.arm import Arrival, CameraMounting, Limits, Point, Settling
from daemon.arrays import Array
from daemon.pick.grippers import SuctionCup, TwoFingers, tool_rotation
from daemon.pick.pose_fusion import Doubt
from daemon.quantities import Direction, Few, Lean, Length, Percent, Pixels, Turn


@dataclass(frozen=True)
class SurveyView:
    """A place from which the cameras look at the table."""

    centre_mm: Point = (520.0, 0.0, -280.0)
    """Point that the cameras look at, world frame, mm."""
    distance_mm: Length = 480.0
    """Distance from that point to the cameras, mm."""
    heading_deg: Direction = 0.0
    """Horizontal direction that the tool leans to, degrees from world x."""
    tilt_deg: Lean = 45.0
    """How far the tool leans from straight down, degrees."""

    def pose(self, mounting: CameraMounting) -> Array:
        """world_from_tool (4, 4)."""
        rotation = tool_rotation(heading(self.heading_deg), float(np.radians(self.tilt_deg)))
        return mounting.look_pose(rotation, np.array(self.centre_mm), self.distance_mm)


@dataclass(frozen=True)
class ToolPosition:
    """A taught position of the tool centre point."""

    point_mm: Point
    """Tool centre point, world frame, mm."""
    heading_deg: Direction = 0.0
    """Horizontal direction that the tool leans to, degrees from world x."""
    tilt_deg: Lean = 0.0
    """How far the tool leans from straight down, degrees."""

    def pose(self) -> Array:
        rotation = tool_rotation(heading(self.heading_deg), float(np.radians(self.tilt_deg)))
        return frames.rigid(rotation, np.array(self.point_mm))


@dataclass(frozen=True)
class StandOffs:
    """Where the approach stops to look, and when it has looked enough."""

    stand_offs_mm: Annotated[tuple[Length, ...], Meta(min_length=1)] = (450.0, 300.0, 200.0)
    """Distances of the cameras from the part at which to stop and look, far to near, mm."""
    enough_mm: Length = 1.0
    """Predicted error at the grasp that is small enough, rms, mm."""
    enough_deg: Turn = 1.0
    """Predicted angular error at the grasp that is small enough, rms, degrees."""
    least_looks: Few = 1
    """Fewest looks before a grasp."""
    most_looks: Few = 5
    """Most looks at one part before it is left alone."""


@dataclass(frozen=True)
class Settings:
    """All settings of a pick."""

    surveys: Annotated[tuple[SurveyView, ...], Meta(min_length=1)] = (
        SurveyView(heading_deg=50.0),
        SurveyView(heading_deg=-50.0),
        SurveyView(heading_deg=90.0),
    )
    """Places from which to look at the table, in order, until a part has a name."""
    last_surveys: tuple[SurveyView, ...] = (SurveyView(heading_deg=-90.0, tilt_deg=35.0), SurveyView(tilt_deg=20.0))
    """Further places to look from before the table counts as empty."""
    home: ToolPosition = ToolPosition((420.0, 0.0, 60.0), tilt_deg=20.0)
    """Position where the arm waits. With fixed cameras (cameras.mounting: world) all looks are taken from here."""
    bin: ToolPosition = ToolPosition((250.0, 410.0, -150.0), heading_deg=58.0, tilt_deg=10.0)
    """Position over the bin where the gripper opens."""
    order: Literal["nearest", "surest"] = "surest"
    """Which part to take first: the one whose pose is best known, or the nearest."""
    tries: Few = 2
    """How often to try one part."""
    views_of_doubtful: Annotated[int, Meta(ge=0, le=100)] = 4
    """How often a part that cannot be named is observed from another side."""
    travel_pct: Percent = 100.0
    """Monitor speed away from parts, % of the controller's full speed."""
    near_pct: Percent = 30.0
    """Monitor speed near parts, % of the controller's full speed."""
    pregrasp_mm: Length = 50.0
    """Distance from which the last straight move to the grasp begins, mm."""
    lift_mm: Length = 60.0
    """How far the gripper lifts a part, mm."""
    verify_mm: Length = 300.0
    """Distance from which the place of the part is observed after the grasp, mm."""
    gone_mm: Length = 30.0
    """Distance within which a part counts as lying where it lay, mm."""
    epipolar_limit_px: Pixels = 1.0
    """Vertical disparity beyond which a camera counts as knocked, px."""
    hand_s: Annotated[float, Meta(ge=0, le=60)] = 0.0
    """Time that the gripper needs to open or close, s."""
    auto_degrade: bool = False
    """Whether, after a camera fault, an auto continues with the other camera by itself, once an operator has allowed
    that since the start."""
    limits: Limits = field(default_factory=Limits)
    """The limits that the guard keeps."""
    arrival: Arrival = field(default_factory=Arrival)
    """When a move counts as arrived, and when the arm counts as lost."""
    stops: StandOffs = field(default_factory=StandOffs)
    """Where to stop on the approach, and when to stop looking."""
    doubt: Doubt = field(default_factory=Doubt)
    """One-sigma uncertainties of the cell."""
    gripper: TwoFingers | SuctionCup = field(default_factory=TwoFingers)
    """The mounted gripper: its kind and dimensions."""
    settling: Settling = field(default_factory=Settling)
    """When the images count as still."""

    def hand_time_s(self, closed: bool) -> float:
        """How long the gripper needs to take hold, or to let go."""
        return max(self.hand_s, self.gripper.work_time_s(closed))


def heading(degrees: float) -> Array:
    """Unit horizontal direction (3,) at an angle from world x."""
    angle = np.radians(degrees)
    return np.array([np.cos(angle), np.sin(angle), 0.0])
