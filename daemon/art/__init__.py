"""The ART family as a small numpy library: arrays in, values out; knows nothing of vision, files or clocks."""

from daemon.art.art1 import ART1
from daemon.art.artmap import ARTMAP
from daemon.art.errors import ArtError, InputError, NotTrainedError, ParameterError
from daemon.art.fuzzy_art import FuzzyART
from daemon.art.fuzzy_artmap import FuzzyARTMAP
from daemon.art.gaussian import GaussianRule
from daemon.art.gaussian_art import GaussianART, GaussianARTMAP
from daemon.art.relation_artmap import Recall as RelationRecall
from daemon.art.relation_artmap import RelationalView, RelationARTMAP
from daemon.art.rotation import (
    Match,
    Recall,
    RotationLayer,
    Verdict,
    best_numbering,
    choose,
    modified_match,
    padded,
    padded_weights,
)
from daemon.art.voting import Voting
from daemon.art.winners import Answers

__all__ = [
    "ART1",
    "ARTMAP",
    "Answers",
    "ArtError",
    "FuzzyART",
    "FuzzyARTMAP",
    "GaussianART",
    "GaussianARTMAP",
    "GaussianRule",
    "InputError",
    "Match",
    "NotTrainedError",
    "ParameterError",
    "Recall",
    "RelationARTMAP",
    "RelationRecall",
    "RelationalView",
    "RotationLayer",
    "Verdict",
    "Voting",
    "best_numbering",
    "choose",
    "modified_match",
    "padded",
    "padded_weights",
]
