"""What a pick asks of the mounted gripper, whatever its kind: its body, its grasps, how long it works, how it shows.

A kind is a value of facetd.yaml with these methods: TwoFingers (two_fingers.py), SuctionCup (suction.py). Pure.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from daemon.arm import HandBody
from daemon.arrays import Array
from daemon.vision.geometry import Polyhedron


@dataclass(frozen=True, eq=False)
class PlannedGrasp:
    """world_from_tool (4, 4) with the hand at the part; tilt_deg from straight down; blocked: a neighbour is near."""

    world_from_tool: Array
    tilt_deg: float
    blocked: bool = False

    @property
    def risk(self) -> float:
        """How near it is to what the gripper can just hold: 0, surely held, to 1."""
        raise NotImplementedError

    @property
    def any_turn(self) -> bool:
        """Whether it holds the part however that is turned about the vertical."""
        return False

    @property
    def description(self) -> str:
        raise NotImplementedError

    @property
    def figures(self) -> Mapping[str, float]:
        """The grasp in figures, for the record of the decision."""
        raise NotImplementedError


class Grasps(NamedTuple):
    """All grasps that hold, best first; why: what keeps each from holding, where there is none."""

    found: Sequence[PlannedGrasp]
    why: str = ""


class HoldingVolume(NamedTuple):
    """Where a gripper may touch a held part: within half of width_mm of the line from back_mm behind the tool centre
    point to tip_mm before it."""

    back_mm: float
    tip_mm: float
    width_mm: float


class Gripper(Protocol):
    """A kind of gripper with its dimensions."""

    @property
    def body(self) -> HandBody:
        """Its body for collision checks."""

    @property
    def by_vacuum(self) -> bool:
        """Whether a vacuum holds the part: the valves may be at outputs of the controller."""

    @property
    def tip_mm(self) -> float:
        """How far it reaches beyond the tool centre point."""

    @property
    def outside(self) -> tuple[str, float]:
        """The key of its width in facetd.yaml, and how far it reaches to either side, mm."""

    @property
    def holding_volume(self) -> HoldingVolume:
        """Where it may touch a held part."""

    @property
    def widest_mm(self) -> float | None:
        """The widest part that it can hold; None: its width does not matter."""

    @property
    def empty(self) -> Polyhedron | None:
        """Its shape when closed without a part, tool frame; None: no look can show that."""

    @property
    def turning(self) -> "Gripper | None":
        """The same gripper with every lean at which it may take a part that is to lie on another side than before;
        None: it turns no part over."""

    def work_time_s(self, closed: bool) -> float:
        """How long it needs to take hold or to let go, by its own settings."""

    def grasps(
        self,
        shape: Polyhedron,
        world_from_part: Array,
        table_z_mm: float,
        error_mm: float,
        neighbours: Sequence[Array] = (),
        near: Array | None = None,
    ) -> Grasps:
        """Grasps of a part in this pose. error_mm: how far the part may be from it;
        neighbours: (M, 3) world corners of other parts on the table; near (3, 3): only grasps whose tool is turned
        nearly like it. Raises ValueError where the shape's corners span no volume."""

    def takes(self, shape: Polyhedron, error_mm: float) -> str:
        """By what the gripper can grasp a part in any pose, as text; empty: that depends on the pose. error_mm: see
        grasps."""

    def sweeps(self, world_from_tool: Array, neighbour: Array) -> bool:
        """Whether a neighbour (M, 3) reaches into the room that it sweeps on the last stretch to a grasp."""
