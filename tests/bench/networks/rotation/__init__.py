"""The pattern rotation layer: a relation matrix laid onto taught ones in the numbering that fits best.

Matrices in, numberings and activations out; what the numbers mean, and who is believed, is said elsewhere.
"""

from tests.bench.networks.rotation.layer import LayerRecall, RotationLayer, best_numbering
from tests.bench.networks.rotation.match import RotationMatch, modified_match
from tests.bench.networks.rotation.matrices import padded, padded_weights
from tests.bench.networks.rotation.verdict import RotationVerdict, choose

__all__ = [
    "LayerRecall",
    "RotationLayer",
    "RotationMatch",
    "RotationVerdict",
    "best_numbering",
    "choose",
    "modified_match",
    "padded",
    "padded_weights",
]
