"""The rest of the ART family, which the memory is compared with: Fuzzy ART and ARTMAP, Gaussian ARTMAP, voting, and the
rotation layer on plain matrices as in the thesis (docs/THESIS.md, tests/bench/art.py, tests/bench/thesis/).
"""

from daemon.art.errors import ArtError, InputError, ParameterError
from tests.bench.networks.artmap import ARTMAP
from tests.bench.networks.errors import NotTrainedError
from tests.bench.networks.fuzzy_art import FuzzyART
from tests.bench.networks.fuzzy_artmap import FuzzyARTMAP
from tests.bench.networks.gaussian import GaussianRule
from tests.bench.networks.gaussian_art import GaussianART, GaussianARTMAP
from tests.bench.networks.rotation import (
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
from tests.bench.networks.voting import Voting
from tests.bench.networks.winners import Answers

__all__ = [
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
