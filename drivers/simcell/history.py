"""History of the machine: what it did and when. The machine writes it; the motion monitor and the witness read it.

Values only, in the controller's seconds. Nobody who talks to the controller can change them.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import islice
from threading import Lock

from drivers.arrays import Array
from drivers.simcell.arm import Motion


@dataclass(frozen=True, eq=False)
class MotionRecord:
    """One motion of the arm, as it was begun or, after a halt, as it was cut short.

    by: the typed line it came of, and given_s: when the controller had the whole of it (of a question: the answer).
    speed_percent (of CAL: 0), flange_from_tool (4, 4) mm, hand_closed: what was in force at its start.
    """

    motion: Motion
    by: str
    given_s: float
    speed_percent: float
    flange_from_tool: Array
    hand_closed: bool

    @property
    def began_s(self) -> float:
        """When the arm set out."""
        return self.motion.started_s


CONTROL_C = "control-C"


@dataclass(frozen=True)
class StopRecord:
    """The controller was told to stop. by: the line, or CONTROL_C."""

    began_s: float
    by: str


@dataclass(frozen=True)
class GripperRecord:
    """The jaws were driven. by, given_s: see Leg."""

    began_s: float
    by: str
    given_s: float
    closed: bool


@dataclass(frozen=True)
class DropRecord:
    """A part was let go. fell_mm: how far its lowest corner hung above the table; over_bin: whether it fell in."""

    began_s: float
    by: str
    label: str
    fell_mm: float
    over_bin: bool


HistoryRecord = MotionRecord | StopRecord | GripperRecord | DropRecord

KEPT = 4000
"""Events; a straight motion takes some 7 kB, and a cell may run for weeks."""


class History:
    """The newest events, oldest first; every event has a number, from 0 on, that stays its own. From any thread."""

    def __init__(self) -> None:
        self._events: deque[HistoryRecord] = deque(maxlen=KEPT)
        self._count = 0
        self._lock = Lock()

    def __iter__(self) -> Iterator[HistoryRecord]:
        return iter(self.since(0)[1])

    def add(self, event: HistoryRecord) -> None:
        """It happened now."""
        with self._lock:
            self._events.append(event)
            self._count += 1

    def since(self, number: int) -> tuple[int, tuple[HistoryRecord, ...]]:
        """What is kept of the events from a number on, and the number of the first of these."""
        with self._lock:
            first = max(number, self._count - len(self._events))
            return first, tuple(islice(self._events, len(self._events) - (self._count - first), None))

    def cut(self, now_s: float, braking: float) -> None:
        """The motion under way, if any, is braked from now on."""
        with self._lock:
            for back in range(1, len(self._events) + 1):
                event = self._events[-back]
                if isinstance(event, MotionRecord):
                    self._events[-back] = replace(event, motion=event.motion.cut(now_s, braking))
                    return
