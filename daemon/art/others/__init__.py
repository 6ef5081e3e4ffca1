"""The rest of the ART family: ART 1 (for the thesis's silhouettes), Fuzzy ART and ARTMAP, Gaussian ARTMAP, voting, and
the rotation layer on plain matrices as in the thesis. The memory does not use them: they are what it is compared with
(docs/THESIS.md, tests/bench/art.py, tests/bench/thesis/).
"""

from daemon.art.errors import ArtError, InputError, NotTrainedError, ParameterError
from daemon.art.others.art1 import ART1
from daemon.art.others.artmap import ARTMAP
from daemon.art.others.fuzzy_art import FuzzyART
from daemon.art.others.fuzzy_artmap import FuzzyARTMAP
from daemon.art.others.gaussian import GaussianRule
from daemon.art.others.gaussian_art import GaussianART, GaussianARTMAP
from daemon.art.others.rotation import (
    LayerRecall,
    RotationLayer,
    RotationMatch,
    RotationVerdict,
    best_numbering,
    choose,
    modified_match,
    padded,
    padded_weights,
)
from daemon.art.others.voting import Voting
from daemon.art.others.winners import Answers

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
    "LayerRecall",
    "NotTrainedError",
    "ParameterError",
    "RotationLayer",
    "RotationMatch",
    "RotationVerdict",
    "Voting",
    "best_numbering",
    "choose",
    "modified_match",
    "padded",
    "padded_weights",
]
