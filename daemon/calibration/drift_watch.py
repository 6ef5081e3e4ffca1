"""The watch over the calibration in use: what each look hints at, added up; what an operator hears of it.

What a look offers is clues.py's, what the sum of it means is daemon/calibration/drift.py's. Looks come as the run log
has them.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from daemon.calibration.drift import Clue, Drift, Watch, Watching, fresh, observe

NAMES = ("pitch", "roll", "vergence")
"""As calibration.drift.AXES, in the fields <name>_deg and <name>_sigma_deg of a look's health."""


def health_fields(clue: Clue) -> dict[str, float]:
    """A look's clue as fields of its health; what the look says nothing of is left out."""
    fields: dict[str, float] = {}
    for name, turn, sigma in zip(NAMES, clue.turn, clue.sigma, strict=True):
        if np.isfinite(sigma):
            fields |= {f"{name}_deg": float(np.degrees(turn)), f"{name}_sigma_deg": float(np.degrees(sigma))}
    return fields


def clue_from(health: Mapping[str, Any], at: str) -> Clue:
    """The clue that health_fields wrote."""
    turn = [health.get(f"{name}_deg") or 0.0 for name in NAMES]
    sigma = [health.get(f"{name}_sigma_deg") or np.inf for name in NAMES]
    return Clue(np.radians(turn), np.radians(sigma), at)


class DriftWatch:
    """One calibration, watched. A new calibration gets a new one."""

    def __init__(self, settings: Watching | None = None) -> None:
        self.settings = settings or Watching()
        self.drift: Drift | None = None
        self._watch: Watch = fresh()

    def seen(self, health: Mapping[str, Any], at: str) -> Drift | None:
        """Take one look into account; the drift that stands, or None."""
        self._watch, self.drift = observe(self._watch, clue_from(health, at), self.settings)
        return self.drift
