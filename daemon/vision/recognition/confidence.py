"""How far a fit is believed: from coincidence and chi-square to a probability of being right.

Numbers in, a probability out. The reliability of these probabilities is measured in tests/bench/recognise.py.
"""

from __future__ import annotations

from collections.abc import Sequence

from daemon.vision.geometry import Polyhedron
from daemon.vision.recognition.hypotheses import Hypothesis

STRANGER = 0.25  # how often something never taught lies in view
SAME_TYPES = 0.3  # how often a stranger shows a given type at a given place
SAME_SIZE = 1 / 6  # how often one of a stranger's lengths is that of a taught part: people choose round numbers
SAME_ANGLE = 1 / 3  # how often one of its dihedral angles is: right angles are common
ASTRAY = 0.05  # how often a corner is measured quite wrongly
FREE_SIZES = {"square": 1, "equilateral_triangle": 1, "pentagon": 1, "rectangle": 2, "isosceles_triangle": 2}


def coincidence(seen: Polyhedron) -> float:
    """Probability that a part never taught looks like this view of a taught one: types, lengths and angles alike."""
    seams = len(seen.seams)
    sizes = max(sum(FREE_SIZES.get(t, 3) for t in seen.types) - seams, 1)
    angles = min(seams, max(2 * len(seen.facets) - 3, 0))
    return SAME_TYPES ** len(seen.facets) * SAME_SIZE**sizes * SAME_ANGLE**angles


def label_odds(best: Sequence[Hypothesis]) -> dict[str, float]:
    """Relative weight of each label, from the chi-square of its best hypothesis; 1 for a perfect fit.

    The weight is the tail probability of the chi-square: a right hypothesis has any tail with equal chance, a wrong
    one next to none.
    """
    return {h.label: h.tail * (ASTRAY if h.astray >= 0 else 1.0) for h in best}


def probability(seen: Polyhedron, best: Sequence[Hypothesis], label: str) -> float:
    """Probability that the view shows `label`: against all other labels that fit, and against strangers."""
    odds = label_odds(best)
    if label not in odds:
        return 0.0
    rivals = sum(w for other, w in odds.items() if other != label)
    stranger = STRANGER / (1 - STRANGER) * coincidence(seen) * len(best)
    return odds[label] / (odds[label] + rivals + stranger)
