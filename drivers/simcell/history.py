"""History of the simulated machine: its motions, stops, gripper actions and drops. The motion monitor reads it.

Values only, in the controller's seconds; nothing typed at the controller can change them.
"""

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import islice
from threading import Lock

from drivers.arrays import Array
from drivers.simcell.arm import Motion


@dataclass(frozen=True, eq=False)
class MotionRecord:
    """One motion of the arm, as started or, after a halt, as cut short.

    by: the typed line that caused it; received_s: when the controller had received all of it (or the answer to a
    question). speed_percent (0 for CAL): in force at its start. by_others: somebody other than the daemon ended that
    line, or moved the arm by the pendant.
    """

    motion: Motion
    by: str
    received_s: float
    speed_percent: float
    by_others: bool = False

    @property
    def began_s(self) -> float:
        return self.motion.started_s


CONTROL_C = "control-C"


@dataclass(frozen=True)
class StopRecord:
    """A stop command to the controller. by: the line, or CONTROL_C; by_others: see MotionRecord."""

    began_s: float
    by: str
    by_others: bool = False


@dataclass(frozen=True)
class GripperRecord:
    """An action of the gripper. by, received_s, by_others: see MotionRecord."""

    began_s: float
    by: str
    received_s: float
    closed: bool
    by_others: bool = False


@dataclass(frozen=True, eq=False)
class GraspRecord:
    """The jaws hold a part from now on. corners_mm (N, 3): of its hull, in the true tool frame."""

    began_s: float
    by: str
    label: str
    corners_mm: Array


@dataclass(frozen=True)
class ReleaseRecord:
    """The gripper lost its part: it opened, the part slipped out, or somebody took it."""

    began_s: float
    by: str


@dataclass(frozen=True)
class DropRecord:
    """The gripper released a part. fell_mm: height of its lowest corner above the table; over_bin: whether it fell into
    the bin; by_others: see MotionRecord."""

    began_s: float
    by: str
    label: str
    fell_mm: float
    over_bin: bool
    by_others: bool = False


HistoryRecord = MotionRecord | StopRecord | GripperRecord | GraspRecord | ReleaseRecord | DropRecord

KEPT = 4000
"""Number of events kept; a straight motion takes some 7 kB, and a cell may run for weeks."""


class History:
    """The newest events, oldest first, each with a permanent number from 0. Thread-safe."""

    def __init__(self) -> None:
        self._events: deque[HistoryRecord] = deque(maxlen=KEPT)
        self._count = 0
        self._lock = Lock()

    def __iter__(self) -> Iterator[HistoryRecord]:
        return iter(self.since(0)[1])

    def add(self, event: HistoryRecord) -> None:
        with self._lock:
            self._events.append(event)
            self._count += 1

    def since(self, number: int) -> tuple[int, tuple[HistoryRecord, ...]]:
        """The kept events from a number on, and the number of the first of these."""
        with self._lock:
            first = max(number, self._count - len(self._events))
            return first, tuple(islice(self._events, len(self._events) - (self._count - first), None))

    def cut(self, now_s: float, braking: float) -> None:
        """Brake the last motion from now_s on."""
        with self._lock:
            for back in range(1, len(self._events) + 1):
                event = self._events[-back]
                if isinstance(event, MotionRecord):
                    self._events[-back] = replace(event, motion=event.motion.cut(now_s, braking))
                    return
