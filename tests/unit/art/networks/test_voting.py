"""Votes of several networks taught in different orders."""

from __future__ import annotations

import numpy as np
import pytest

from daemon.art import ParameterError
from tests.bench.networks import FuzzyARTMAP, NotTrainedError, Voting


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
