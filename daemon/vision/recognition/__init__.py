"""A group of facets and a model -> label, pose, confidence; or unknown, with the reason. No image."""

from daemon.vision.recognition.hypotheses import hypotheses, made_ready
from daemon.vision.recognition.recognise import (
    Recognised,
    Standing,
    joined,
    left_open,
    recognise,
    recognise_group,
    recognised,
    standing,
    suspected,
    typed_as,
)

__all__ = [
    "Recognised",
    "Standing",
    "hypotheses",
    "joined",
    "left_open",
    "made_ready",
    "recognise",
    "recognise_group",
    "recognised",
    "standing",
    "suspected",
    "typed_as",
]
