"""What is wrong with the images themselves (light, lens, cable, mounting), what they hint at of the calibration, and
why a part in them has no name. Nothing here names a part.
"""

from daemon.vision.health.cause import ADVICE, cause_of_nothing, depth_doubt, with_causes
from daemon.vision.health.clues import AXES, Clue, clue_of, health_fields
from daemon.vision.health.examination import (
    MEASURES,
    Finding,
    drift,
    examine,
    findings_json,
    misleading,
    sharpness,
    troubles,
)
from daemon.vision.health.exposure import Pictures, exposure_factors
from daemon.vision.health.steadiness import MAX_IMAGES, Steadiness, measure_steadiness, overridden
