"""The ART family as a small numpy library: arrays in, values out; knows nothing of vision, files or clocks."""

from daemon.art.errors import ArtError, InputError, NotTrainedError, ParameterError
from daemon.art.fuzzy_art import FuzzyART
from daemon.art.fuzzy_artmap import FuzzyARTMAP
from daemon.art.match import Match, modified_match
from daemon.art.relations import padded, padded_weights
from daemon.art.rotation import Recall, RotationLayer, best_numbering

__all__ = [
    "ArtError",
    "FuzzyART",
    "FuzzyARTMAP",
    "InputError",
    "Match",
    "NotTrainedError",
    "ParameterError",
    "Recall",
    "RotationLayer",
    "best_numbering",
    "modified_match",
    "padded",
    "padded_weights",
]
