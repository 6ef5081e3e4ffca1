"""Gaussian ART and Gaussian ARTMAP: moments, options, far samples. Figures against others are the benchmark's."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daemon.art import InputError, ParameterError
from tests.bench.networks import GaussianART, GaussianARTMAP, GaussianRule, NotTrainedError


@settings(deadline=None, max_examples=50)
@given(st.integers(0, 10**6), st.integers(2, 60))
def test_the_exact_variance_is_that_of_the_samples_and_the_initial_spread(seed, count):
    samples = np.random.default_rng(seed).normal(size=(count, 3))
    state = GaussianART(GaussianRule(gamma=0.5)).fit(samples).state()
    assert state["samples"].tolist() == [count]
    assert state["mean"][0] == pytest.approx(samples.mean(axis=0))
    assert state["variance"][0] == pytest.approx(samples.var(axis=0) + 0.25 / count)


def test_the_new_mean_understates_the_variance_and_the_old_one_overstates_it():
    samples = np.random.default_rng(0).normal(size=(20, 2))
    new, exact, old = (
        GaussianART(GaussianRule(gamma=0.1, variance=kind)).fit(samples).state()["variance"]
        for kind in ("new_mean", "exact", "old_mean")
    )
    assert (new < exact).all()
    assert (exact < old).all()


def test_a_category_never_gets_narrower_than_the_floor():
    state = GaussianART(GaussianRule(gamma=0.1, least_sigma=0.01)).fit(np.full((10000, 1), 0.5)).state()
    assert state["variance"][0, 0] == 0.01**2


def test_vigilance_by_unit_height_opens_a_category_for_a_far_sample():
    rule = GaussianRule(gamma=0.1, rho=0.01, match_by="unit_height")
    network = GaussianART(rule).fit([[0.0], [0.05], [5.0]])
    assert network.n_categories == 2
    assert network.predict([[0.02], [5.0], [2.5]]).tolist() == [0, 1, -1]


def test_by_density_a_narrow_category_matches_better_than_a_wide_one_at_its_centre():
    rule = GaussianRule(gamma=0.1, rho=0.0)
    samples = np.concatenate([np.zeros((50, 1)), np.random.default_rng(0).normal(0, 0.2, (5, 1))])
    assert GaussianART(rule).fit(samples).n_categories >= 1
    assert GaussianART(GaussianRule(gamma=0.1, rho=50.0)).fit([[0.0], [0.0]]).n_categories == 2


def test_labels_are_told_apart_where_their_gaussians_are():
    rng = np.random.default_rng(1)
    samples = np.concatenate([rng.normal(0, 1, (300, 2)), rng.normal(4, 1, (300, 2))])
    labels = ["low"] * 300 + ["high"] * 300
    order = rng.permutation(600)
    network = GaussianARTMAP(GaussianRule(gamma=1.0)).fit(samples[order], [labels[k] for k in order])
    assert np.mean(network.predict(samples) == np.array(labels)) > 0.98
    assert network.predict_proba(samples).sum(axis=1) == pytest.approx(1.0)


def test_several_weak_categories_outvote_the_strongest_one():
    rule = GaussianRule(gamma=1.0, rho=0.9, match_by="unit_height")
    samples = [[0.0, 0.0], [1.3, 0.0], [-1.3, 0.1], [0.0, 1.5], [0.2, -1.4]]
    labels = ["single", "many", "many", "many", "many"]
    by_sum = GaussianARTMAP(rule).fit(samples, labels)
    by_winner = GaussianARTMAP(rule, prediction="winner").fit(samples, labels)
    state = by_sum.state()
    assert by_sum.n_categories == 5
    asked = [[0.3, 0.05]]
    free = GaussianRule(gamma=1.0)
    assert GaussianARTMAP(free).restore(state, by_sum.classes).predict(asked).tolist() == ["many"]
    single = GaussianARTMAP(free, prediction="winner").restore(by_winner.state(), by_winner.classes)
    assert single.predict(asked).tolist() == ["single"]


def test_a_sample_far_from_everything_still_gets_the_nearest_label():
    network = GaussianARTMAP(GaussianRule(gamma=0.01)).fit([[0.0], [1.0]], ["left", "right"])
    assert network.predict([[1e6], [-1e6]]).tolist() == ["right", "left"]
    assert network.predict_proba([[1e6]]).tolist() == [[0.0, 1.0]]


def test_with_vigilance_a_sample_far_from_everything_is_not_named():
    rule = GaussianRule(gamma=0.1, rho=0.1, match_by="unit_height")
    network = GaussianARTMAP(rule).fit([[0.0], [1.0]], ["left", "right"])
    labels, match = network.predict_with_match([[0.01], [9.0]])
    assert labels.tolist() == ["left", None]
    assert match[0] == pytest.approx(np.exp(-0.5 * 0.1**2))
    assert match[1] == -np.inf


def test_match_tracking_opens_categories_until_every_training_sample_has_its_own_label():
    rng = np.random.default_rng(2)
    samples, labels = rng.random((200, 2)), rng.integers(0, 2, 200)
    network = GaussianARTMAP(GaussianRule(gamma=0.1), prediction="winner").fit(samples, labels)
    assert 2 < network.n_categories <= 200


def test_gaussians_taught_in_pieces_or_at_once_have_the_same_bytes():
    rng = np.random.default_rng(3)
    samples, labels = rng.random((60, 2)), rng.choice(["a", "b"], 60)
    whole = GaussianARTMAP().fit(samples, labels).state()
    pieces = GaussianARTMAP().partial_fit(samples[:17], labels[:17]).partial_fit(samples[17:], labels[17:]).state()
    assert all(whole[name].tobytes() == pieces[name].tobytes() for name in whole)


def test_forgetting_a_label_leaves_the_other_gaussians_alone():
    rng = np.random.default_rng(4)
    centres = {"a": [0.0, 0.0], "b": [3.0, 0.0], "c": [0.0, 3.0]}
    labels = rng.choice(list(centres), 90)
    samples = np.array([centres[label] for label in labels]) + 0.1 * rng.normal(size=(90, 2))
    network = GaussianARTMAP(GaussianRule(gamma=0.5)).fit(samples, labels)
    first = network.classes[0]
    before, kept = network.state(), [network.classes[k] != first for k in network.state()["stands_for"]]
    network.forget(first)
    assert network.state()["mean"].tobytes() == before["mean"][kept].tobytes()
    rest = labels != first
    assert network.predict(samples[rest]).tolist() == labels[rest].tolist()
    with pytest.raises(ParameterError, match="no such label"):
        network.forget(first)


@pytest.mark.parametrize("options", [{"gamma": 0.0}, {"least_sigma": 1.0}, {"variance": "old"}, {"match_by": "x"}])
def test_gaussian_parameters_out_of_range_are_refused_by_name(options):
    with pytest.raises(ParameterError, match=next(iter(options))):
        GaussianRule(**options)
    with pytest.raises(ParameterError, match="rho"):
        GaussianRule(match_by="unit_height", rho=2.0)


def test_gaussian_networks_refuse_what_they_cannot_use():
    with pytest.raises(InputError, match="row 0, column 0: expected a number of at most"):
        GaussianART().fit([[np.inf]])
    with pytest.raises(InputError, match="at most"):
        GaussianART().fit([[np.nan]])
    with pytest.raises(NotTrainedError):
        GaussianARTMAP().predict([[0.0]])
    network = GaussianART().fit([[0.0, 1.0]])
    with pytest.raises(InputError, match="expected 2 features"):
        network.predict([[0.0]])
    with pytest.raises(ParameterError, match="state"):
        GaussianART().restore({**network.state(), "variance": np.zeros((1, 2))})
