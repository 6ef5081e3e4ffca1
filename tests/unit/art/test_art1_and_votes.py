"""ART 1, ARTMAP with coded objects, and voting: what they promise beyond the thesis's figures."""

from __future__ import annotations

import numpy as np
import pytest

from daemon.art import ART1, ARTMAP, FuzzyART, FuzzyARTMAP, InputError, NotTrainedError, ParameterError, Voting


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


def test_an_object_code_taught_through_art_b_comes_back():
    views = np.array([[0.1, 0.2], [0.15, 0.2], [0.9, 0.8]])
    codes = np.array([[0, 0, 1], [0, 0, 1], [0, 1, 0]])
    network = ARTMAP(FuzzyARTMAP(0.9, rho_predict=0.9), FuzzyART(rho=1.0)).partial_fit(views, codes)
    predicted = network.predict([[0.1, 0.21], [0.9, 0.8], [0.5, 0.5]])
    assert predicted[:2].tolist() == [[0, 0, 1], [0, 1, 0]]
    assert np.isnan(predicted[2]).all()


def test_codes_that_are_not_one_a_sample_are_refused():
    with pytest.raises(InputError, match="one row a sample"):
        ARTMAP(FuzzyARTMAP(), FuzzyART(1.0)).partial_fit([[0.1]], [[0, 1], [1, 0]])


def test_five_voters_make_fewer_mistakes_than_one():
    rng = np.random.default_rng(0)
    samples, asked = rng.random((800, 2)), rng.random((2000, 2))

    def inside(points):
        return ((points - 0.5) ** 2).sum(axis=1) < 1 / (2 * np.pi)

    one = FuzzyARTMAP().fit(samples, inside(samples)).score(asked, inside(asked))
    vote = Voting(FuzzyARTMAP, voters=5, seed=1).fit(samples, inside(samples))
    assert np.mean(vote.predict(asked) == inside(asked)) > one


def test_a_vote_depends_on_the_seed_alone():
    rng = np.random.default_rng(0)
    samples, labels = rng.random((100, 2)), rng.integers(0, 3, 100)
    votes = [Voting(FuzzyARTMAP, seed=7).fit(samples, labels).votes(samples).tolist() for _ in range(2)]
    assert votes[0] == votes[1]


def test_a_tie_goes_to_the_earliest_voter_and_abstentions_do_not_count():
    class Says:
        def __init__(self, label):
            self.label = label

        def partial_fit(self, X, y):
            return self

        def predict(self, X):
            return np.array([self.label] * len(X), dtype=object)

    def vote(*labels):
        voters = iter(labels)
        return Voting(lambda: Says(next(voters)), voters=len(labels)).fit([[0.5]], ["x"]).predict([[0.5]]).tolist()

    assert vote("b", "a") == ["b"]
    assert vote(None, "a", None) == ["a"]
    assert vote(None, None) == [None]


def test_a_vote_without_teaching_or_voters_is_refused():
    with pytest.raises(NotTrainedError):
        Voting(FuzzyARTMAP).predict([[0.5]])
    with pytest.raises(ParameterError, match="voters"):
        Voting(FuzzyARTMAP, voters=0)
