"""ART 1: what it promises beyond the thesis's figures."""

from __future__ import annotations

import numpy as np
import pytest

from daemon.art import InputError, ParameterError
from daemon.art.others import ART1


def test_learning_keeps_what_patterns_share_and_sets_the_bottom_up_weights():
    network = ART1(rho=0.5, L=2.0, uncommitted="last").fit([[1, 1, 1, 0], [1, 1, 0, 0]])
    assert network.top_down.tolist() == [[1, 1, 0, 0]]
    assert network.bottom_up == pytest.approx(np.array([[2 / 3, 2 / 3, 0, 0]]))


def test_a_pattern_that_shares_nothing_gets_a_node_of_its_own_even_without_vigilance():
    network = ART1(rho=0.0, uncommitted="last").fit([[1, 1, 0, 0], [0, 0, 1, 1]])
    assert network.n_categories == 2


def test_when_all_nodes_are_taken_a_new_pattern_stays_outside():
    network = ART1(rho=0.9, capacity=1)
    assert network.learn([[1, 1, 0, 0], [0, 0, 1, 1]]).tolist() == [0, -2]
    assert network.predict([[0, 0, 1, 1]]).tolist() == [-1]


def test_a_small_l_prefers_the_node_contained_in_the_pattern():
    patterns = [[1, 1, 0, 0, 0], [1, 1, 1, 1, 0]]
    network = ART1(rho=0.9, L=1.01).fit(patterns)
    assert network.predict([[1, 1, 0, 0, 0]]).tolist() == [0]
    assert network.predict([[1, 1, 1, 1, 0]]).tolist() == [1]


def test_art1_survives_the_way_through_arrays():
    network = ART1(rho=0.9).fit([[1, 0, 1], [0, 1, 0]])
    assert ART1(rho=0.9).restore(network.state()).predict([[0, 1, 0]]).tolist() == [1]


@pytest.mark.parametrize(("pattern", "words"), [([[0, 0]], "row 0 is empty"), ([[0.5, 1]], "expected 0 or 1")])
def test_patterns_that_are_not_binary_or_empty_are_refused(pattern, words):
    with pytest.raises(InputError, match=words):
        ART1().fit(pattern)


@pytest.mark.parametrize("options", [{"L": 1.0}, {"rho": 2.0}, {"capacity": 0}])
def test_art1_refuses_parameters_out_of_range(options):
    with pytest.raises(ParameterError, match=next(iter(options))):
        ART1(**options)
