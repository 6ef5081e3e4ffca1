"""The pattern rotation layer: a relation matrix laid onto taught ones in the numbering that fits best.

Matrices in, numberings and activations out; what the numbers mean, and who is believed, is said elsewhere.
"""

from daemon.art.others.rotation.layer import Recall, RotationLayer, best_numbering
from daemon.art.others.rotation.match import Match, modified_match
from daemon.art.others.rotation.matrices import padded, padded_weights
from daemon.art.others.rotation.verdict import Verdict, choose

__all__ = [
    "Match",
    "Recall",
    "RotationLayer",
    "Verdict",
    "best_numbering",
    "choose",
    "modified_match",
    "padded",
    "padded_weights",
]
