"""The watch over the calibration in use: what each look hints at, added up; what an operator hears of it.

What a look offers is daemon/vision/health/clues.py's, what the sum of it means is drift.py's.
"""

from __future__ import annotations

from dataclasses import replace

from daemon.arm import EyeName
from daemon.calibration.drift import Drift, Watch, Watching, fresh, observe
from daemon.vision.health import Clue


class DriftWatch:
    """One calibration, watched. A new calibration gets a new one, and so do other eyes; alone: the one that looks."""

    def __init__(self, alone: EyeName | None = None) -> None:
        self.alone = alone
        self.drift: Drift | None = None
        self._watch: Watch = fresh()

    def seen(self, clue: Clue, at: str) -> Drift | None:
        """Take one look into account (at: when, for people); the drift that stands, or None."""
        self._watch, self.drift = observe(self._watch, replace(clue, at=at), Watching(), self.alone)
        return self.drift
