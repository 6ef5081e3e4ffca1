"""What differs between one controller of this kind and the next. Values only."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Manners:
    """How a controller and the people about it behave; times in the controller's seconds."""

    echo: bool = True
    line_editing: bool = True
    """Whether control-U, rubout and control-C do what they are for, or are characters like any other."""
    prompt_after_move: Literal["start", "end"] = "start"
    hand_s: float = 0.3
    calibration_s: float = 6.0
    arm_power_after_s: float | None = None
    """How long after CAL was refused for want of it somebody switches arm power on (None: nobody does)."""
