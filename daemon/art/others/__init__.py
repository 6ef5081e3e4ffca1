"""The rest of the ART family, which the daemon never runs: ART 1, Fuzzy ART and ARTMAP, Gaussian ARTMAP, voting, and
the
rotation layer over plain matrices as the thesis has it. Kept as what the memory is compared with (docs/THESIS.md) and
benchmarked (tests/bench/art.py, tests/bench/thesis/).
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
