"""What the machine did, and when: written down by the machine as it does it, read by the judge and by witnesses.

Values only, in the controller's seconds. Nobody who talks to the controller can change them.
"""

from __future__ import annotations

from dataclasses import dataclass

from drivers.simcell.arm import Motion
from drivers.simcell.rigid import Array


@dataclass(frozen=True, eq=False)
class Leg:
    """One motion of the arm, as it was begun or, after a halt, as it was cut short.

    by: the typed line it came of. speed_percent (of CAL: 0), flange_from_tool (4, 4) mm, hand_closed: what was in force
    at its start.
    """

    motion: Motion
    by: str
    speed_percent: float
    flange_from_tool: Array
    hand_closed: bool

    @property
    def began_s(self) -> float:
        """When the arm set out."""
        return self.motion.started_s


@dataclass(frozen=True)
class Stop:
    """The controller was told to stop. by: the line, or control-C."""

    began_s: float
    by: str


@dataclass(frozen=True)
class HandAct:
    """The jaws were driven."""

    began_s: float
    by: str
    closed: bool


@dataclass(frozen=True)
class Drop:
    """A part was let go. fell_mm: how far its lowest corner hung above the table; over_bin: whether it fell in."""

    began_s: float
    by: str
    label: str
    fell_mm: float
    over_bin: bool


Event = Leg | Stop | HandAct | Drop
