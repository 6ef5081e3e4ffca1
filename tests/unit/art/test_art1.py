"""ART 1: what it promises beyond the thesis's figures."""

from __future__ import annotations

from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon.art import ART1, InputError, ParameterError


def test_learning_keeps_what_patterns_share():
    network = ART1(rho=0.5, L=2.0)
    assert network.learn([[1, 1, 1, 0], [1, 1, 0, 0]]).tolist() == [0, 0]
    assert network.top_down.tolist() == [[1, 1, 0, 0]]


def test_a_pattern_that_shares_nothing_gets_a_node_of_its_own_even_without_vigilance():
    assert ART1(rho=0.0).learn([[1, 1, 0, 0], [0, 0, 1, 1]]).tolist() == [0, 1]


def test_when_all_nodes_are_taken_a_new_pattern_stays_outside():
    network = ART1(rho=0.9, capacity=1)
    assert network.learn([[1, 1, 0, 0], [0, 0, 1, 1]]).tolist() == [0, -2]
    assert network.predict([[0, 0, 1, 1]]).tolist() == [-1]


def test_with_all_nodes_committed_no_uncommitted_one_competes():
    patterns = [[1, 1, 1, 1, 0, 0, 0, 0, 0, 0], [1, 1, 0, 0, 0, 0, 1, 1, 1, 1]]
    assert ART1(0.2, 2.0, capacity=1).learn(patterns).tolist() == [0, 0]


PATTERNS = st.lists(st.lists(st.integers(0, 1), min_size=7, max_size=7).filter(any), min_size=1, max_size=40)


@given(PATTERNS, st.integers(1, 6), st.sampled_from([(1, 5), (2, 5), (3, 4)]), st.sampled_from([(11, 10), (2, 1)]))
def test_any_sequence_is_learnt_as_exact_arithmetic_learns_it(patterns, capacity, rho, parameter):
    network = ART1(rho[0] / rho[1], parameter[0] / parameter[1], capacity=capacity)
    assert network.learn(patterns).tolist() == _exactly(patterns, capacity, Fraction(*rho), Fraction(*parameter))


def _exactly(patterns: list[list[int]], capacity: int, rho: Fraction, l_parameter: Fraction) -> list[int]:
    """Appendix A in fractions: the node of each pattern in order, -2 where none resonates and none is left."""
    nodes: list[set[int]] = []
    chosen = []
    for pattern in patterns:
        ones = {place for place, one in enumerate(pattern) if one}
        ranked = [
            (-l_parameter * len(ones & node) / (l_parameter - 1 + len(node)), index) for index, node in enumerate(nodes)
        ]
        if len(nodes) < capacity:
            ranked.append((-l_parameter * len(ones) / (l_parameter - 1 + len(pattern)), len(nodes)))
        fits = (
            index
            for _, index in sorted(ranked)
            if index == len(nodes) or (ones & nodes[index] and Fraction(len(ones & nodes[index]), len(ones)) >= rho)
        )
        index = next(fits, -2)
        if index == len(nodes):
            nodes.append(ones)
        elif index >= 0:
            nodes[index] = nodes[index] & ones
        chosen.append(index)
    return chosen


def test_a_small_l_prefers_the_node_contained_in_the_pattern():
    patterns = [[1, 1, 0, 0, 0], [1, 1, 1, 1, 0]]
    network = ART1(rho=0.9, L=1.01)
    network.learn(patterns)
    assert network.predict([[1, 1, 0, 0, 0]]).tolist() == [0]
    assert network.predict([[1, 1, 1, 1, 0]]).tolist() == [1]


@pytest.mark.parametrize(
    ("pattern", "words"),
    [([[0, 0]], "row 0 is empty"), ([[0.5, 1]], "expected 0 or 1"), ([1, 0], "expected \\(N, M\\)")],
)
def test_patterns_that_are_not_binary_or_empty_are_refused(pattern, words):
    with pytest.raises(InputError, match=words):
        ART1().learn(pattern)


@pytest.mark.parametrize("options", [{"L": 1.0}, {"rho": 2.0}, {"capacity": 0}])
def test_art1_refuses_parameters_out_of_range(options):
    with pytest.raises(ParameterError, match=next(iter(options))):
        ART1(**options)
