"""What is wrong with the images themselves (light, lens, cable, mounting), and what they hint at of the calibration.

Nothing here says anything of parts.
"""

from daemon.vision.health.clues import AXES, Clue, clue_of, health_fields
from daemon.vision.health.examine import Finding, drift, examine, findings_json, misleading, sharpness, troubles

__all__ = [
    "AXES",
    "Clue",
    "Finding",
    "clue_of",
    "drift",
    "examine",
    "findings_json",
    "health_fields",
    "misleading",
    "sharpness",
    "troubles",
]
