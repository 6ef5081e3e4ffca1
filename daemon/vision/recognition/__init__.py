"""A group of facets and a model -> label, pose, confidence; or unknown, with the reason. No image."""

from daemon.vision.recognition.hypotheses import hypotheses
from daemon.vision.recognition.recognise import (
    Recognised,
    joined,
    recognise,
    recognise_group,
    suspected,
    typed_as,
)

__all__ = [
    "Recognised",
    "hypotheses",
    "joined",
    "recognise",
    "recognise_group",
    "suspected",
    "typed_as",
]
