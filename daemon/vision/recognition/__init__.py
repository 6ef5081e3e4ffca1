"""A group of facets and a model -> label, pose, confidence; or unknown, with the reason. No image."""

from daemon.vision.recognition.hypotheses import hypotheses
from daemon.vision.recognition.recognise import (
    Recognised,
    facet_hypotheses,
    joined,
    recognise,
    recognise_group,
    typed_as,
)

__all__ = [
    "Recognised",
    "facet_hypotheses",
    "hypotheses",
    "joined",
    "recognise",
    "recognise_group",
    "typed_as",
]
