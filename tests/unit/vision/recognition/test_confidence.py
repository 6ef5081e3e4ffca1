"""How far a fit is believed: a probability that falls with the misfit, with rivals and with how little is seen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon.vision.geometry.polyhedron import Polyhedron, exact
from daemon.vision.recognition.confidence import coincidence, label_odds, probability
from daemon.vision.recognition.hypotheses import Hypothesis
from tests.worlds.solids import CUBE


def cube(facets: int) -> Polyhedron:
    """A corner of a cube: its first side facets, typed."""
    order = [2, 3, 1, 4][:facets]
    whole = exact(CUBE.corners_mm, [CUBE.facets[f] for f in order])
    return replace(whole, types=("square",) * facets)


def fitted(label: str, chi2: float, dof: int = 15, astray: int = -1) -> Hypothesis:
    return Hypothesis(label, (0, 1, 2), np.arange(7), np.eye(4), np.eye(6), chi2, dof, 0.1, astray)


@given(st.floats(5, 80), st.floats(0.1, 40))
def test_the_worse_the_fit_the_less_it_is_believed(chi2: float, more: float) -> None:
    good, bad = (probability(cube(3), [fitted("cube", c)], "cube") for c in (chi2, chi2 + more))
    assert 0 <= bad < good <= 1


@given(st.lists(st.floats(0, 60), min_size=2, max_size=5))
def test_the_labels_share_what_strangers_leave_and_never_more_than_one(chi2: list[float]) -> None:
    best = [fitted(f"part {k}", c) for k, c in enumerate(chi2)]
    shares = [probability(cube(2), best, h.label) for h in best]
    assert 0 < sum(shares) < 1
    assert shares[chi2.index(min(chi2))] == pytest.approx(max(shares))


def test_two_parts_that_fit_alike_halve_the_belief_in_either() -> None:
    alone = probability(cube(3), [fitted("cube", 10.0)], "cube")
    both = probability(cube(3), [fitted("cube", 10.0), fitted("box", 10.0)], "cube")
    assert alone > 0.99
    assert both == pytest.approx(0.5, abs=0.01)


def test_a_single_facet_may_be_anybody_s() -> None:
    told = [coincidence(cube(n)) for n in (1, 2, 3)]
    assert told[0] > 10 * told[1] > 10 * told[2]
    assert probability(cube(1), [fitted("cube", 1.0, 6)], "cube") < probability(cube(3), [fitted("cube", 10.0)], "cube")


def test_a_fit_that_leaves_a_corner_out_counts_a_twentieth() -> None:
    whole, astray = label_odds([fitted("cube", 10.0)])["cube"], label_odds([fitted("cube", 10.0, astray=3)])["cube"]
    assert astray == pytest.approx(whole / 20)


def test_a_label_nothing_fits_has_no_probability() -> None:
    assert probability(cube(3), [fitted("cube", 10.0)], "pyramid") == 0.0
