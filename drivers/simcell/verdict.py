"""Write the motion monitor's findings and the starts of motions to a file, for the process that started the cell.

That process knows which motions were allowed when. A line {"started_s", "by"} for each motion and each gripper action;
a line {"rule", "at_s", "by", "text"} for each violation that needs no such knowledge. Times are of time.monotonic,
which all processes share.
"""

import contextlib
import json
import threading
from collections.abc import Callable
from pathlib import Path

from drivers.simcell.history import GripperRecord, History, MotionRecord
from drivers.simcell.motion_monitor import MotionMonitor

EVERY_S = 0.1
NEED_COMMANDS = ("not permitted", "motion after stop")
"""Rules that need the operators' commands, which this process does not know."""


class VerdictFile:
    """Writes violations in a thread of its own until closed."""

    def __init__(
        self,
        path: Path,
        motion_monitor: MotionMonitor,
        history: History,
        now_s: Callable[[], float],
        real_s: Callable[[float], float],
    ) -> None:
        """now_s: the cell's time; real_s: converts a time of the cell to time.monotonic."""
        self._motion_monitor, self._history, self._now_s, self._real_s = motion_monitor, history, now_s, real_s
        self._read = self._written = 0
        motion_monitor.motion_permitted(now_s(), True)
        self._file = path.open("a", encoding="utf-8", buffering=1)
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, name="motion-monitor", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Write the remaining findings and end; safe to call twice."""
        self._over.set()
        self._thread.join(5.0)

    def _run(self) -> None:
        while not self._over.wait(EVERY_S):
            self._update()
        self._update()
        self._file.close()

    def _update(self) -> None:
        first, events = self._history.since(self._read)
        self._read = first + len(events)
        for event in events:
            if isinstance(event, MotionRecord | GripperRecord):
                self._write({"started_s": self._real_s(event.began_s), "by": event.by})
        found = [v for v in self._motion_monitor.violations(self._now_s()) if v.rule not in NEED_COMMANDS]
        for violation in found[self._written :]:
            at_s = self._real_s(violation.at_s)
            self._write({"rule": violation.rule, "at_s": at_s, "by": violation.by, "text": violation.text})
        self._written = max(self._written, len(found))

    def _write(self, line: dict[str, object]) -> None:
        with contextlib.suppress(OSError):  # a full disk must not stop the cell
            self._file.write(json.dumps(line) + "\n")
