"""From a group of facets to the pattern ART compares: types, who touches whom, the matrix, and what the nodes answer.

In: facets, taught nodes. Out: activation, modified match and match ratio by node and by label. No lengths, no poses.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from daemon.arrays import Array, Flags
from daemon.art.rotation import Recall, RotationLayer
from daemon.vision.model.facet_types import FacetLibrary, type_facet
from daemon.vision.values import Facet


@dataclass(frozen=True)
class Answer:
    """What one label's best node says of a view: activation, modified match (5.2), share of its facets in view."""

    label: str
    node: int
    activation: float
    modified: float
    match_ratio: float


def typed(facet: Facet, library: FacetLibrary) -> Facet:
    """The facet with its most particular type."""
    kind = type_facet(facet.corners_mm, facet.covariance_mm2, library)[0]
    return replace(facet, type=kind.name, type_number=kind.number)


def recall(layer: RotationLayer, numbers: Array, touching: Flags) -> Recall:
    """All nodes' answers to a view, each at its best numbering. A view with more facets than slots keeps the first."""
    slots = layer.taught.slots
    matrix = np.where(touching, numbers[:, None], 0.0)
    return layer.recall(matrix[:slots, :slots])


def by_label(answers: Recall, labels: Sequence[str]) -> tuple[Answer, ...]:
    """The best node of each label: exact matches first, then by activation. Best label first."""
    best: dict[str, Answer] = {}
    for node in answers.ranking():
        label, modified = labels[node], float(answers.match[node])
        answer = Answer(label, int(node), float(answers.activation[node]), modified, float(answers.match_ratio[node]))
        known = best.get(label)
        if known is None or (modified == 1.0 and known.modified < 1.0):
            best[label] = answer
    return tuple(sorted(best.values(), key=lambda a: (a.modified < 1.0, -a.activation)))
