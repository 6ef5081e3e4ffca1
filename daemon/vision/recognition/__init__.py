"""A group of facets and a model -> label, pose, confidence; or unknown, with the reason. No image."""

from daemon.vision.recognition.confidence import kinds_of
from daemon.vision.recognition.fits import PoseEvidence, fitted, places_of, recalled
from daemon.vision.recognition.group_recognition import (
    CandidatePose,
    Recognised,
    joined,
    recognise,
    recognise_group,
    recognised,
    standing,
    suspected,
    typed_as,
    without_name,
)
