"""Findings of the motion monitor of a cell in another process, and when arm and gripper set out, as lines of a file.

For whoever started that process and knows what was allowed when: a line {"set_out_s", "by"} for each motion and each
act of the hand, a line {"rule", "at_s", "by", "text"} for each violation that needs no such knowledge. Times are those
of time.monotonic, which all processes share.
"""

from __future__ import annotations

import contextlib
import json
import threading
from collections.abc import Callable
from pathlib import Path

from drivers.simcell.history import GripperRecord, History, MotionRecord
from drivers.simcell.motion_monitor import MotionMonitor

EVERY_S = 0.1
NEEDS_WORDS = ("not allowed", "after a stop")
"""Rules that only somebody can judge who knows what operators said."""


class VerdictFile:
    """Judges in a thread of its own until closed."""

    def __init__(
        self,
        path: Path,
        motion_monitor: MotionMonitor,
        history: History,
        now_s: Callable[[], float],
        real_s: Callable[[float], float],
    ) -> None:
        """now_s: the cell's time; real_s: the moment of time.monotonic that a moment of the cell is."""
        self._motion_monitor, self._history, self._now_s, self._real_s = motion_monitor, history, now_s, real_s
        self._read = self._told = 0
        motion_monitor.may_move(now_s(), True)
        self._file = path.open("a", encoding="utf-8", buffering=1)
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, name="motion-monitor", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Judge what is left, and end; safe to call twice."""
        self._over.set()
        self._thread.join(5.0)

    def _run(self) -> None:
        while not self._over.wait(EVERY_S):
            self._look()
        self._look()
        self._file.close()

    def _look(self) -> None:
        first, events = self._history.since(self._read)
        self._read = first + len(events)
        for event in events:
            if isinstance(event, MotionRecord | GripperRecord):
                self._write({"set_out_s": self._real_s(event.began_s), "by": event.by})
        found = [v for v in self._motion_monitor.violations(self._now_s()) if v.rule not in NEEDS_WORDS]
        for violation in found[self._told :]:
            at_s = self._real_s(violation.at_s)
            self._write({"rule": violation.rule, "at_s": at_s, "by": violation.by, "text": violation.text})
        self._told = max(self._told, len(found))

    def _write(self, line: dict[str, object]) -> None:
        with contextlib.suppress(OSError):  # a full disk is none of the arm's doing
            self._file.write(json.dumps(line) + "\n")
