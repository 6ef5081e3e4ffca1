"""The one solver: what blocks say is found, outliers hardly pull, priors hold, many problems as each by itself."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon.vision.geometry.robust_least_squares import OUTLIER, robust_weight, solve, whitener

seeds = st.integers(0, 2**31)


def problem(rng, batch=1, blocks=20, size=2, number=6, noise=0.0):
    rows = rng.normal(size=(batch, blocks, size, number))
    truth = rng.normal(size=(batch, number))
    off = (rows @ truth[:, None, :, None])[..., 0] + noise * rng.normal(size=(batch, blocks, size))
    return rows, off, truth, np.ones((batch, blocks))


@given(seed=seeds, batch=st.integers(1, 4), size=st.integers(1, 3))
def test_what_all_blocks_say_together_is_found(seed, batch, size):
    rows, off, truth, use = problem(np.random.default_rng(seed), batch, size=size)
    found = solve(rows, off, use, 1e-12 * np.eye(6))
    assert found.unknowns == pytest.approx(truth, abs=1e-6)
    assert found.miss.max() < 1e-9


@given(seed=seeds)
def test_two_blocks_of_twenty_that_lie_by_far_hardly_pull(seed):
    rng = np.random.default_rng(seed)
    rows, off, truth, use = problem(rng, noise=0.1)
    off[0, rng.choice(20, 2, replace=False)] += 40.0
    plain = solve(rows, off, use, 1e-9 * np.eye(6)).unknowns
    robust = solve(rows, off, use, 1e-9 * np.eye(6), passes=20).unknowns
    assert np.linalg.norm(robust - truth) < max(0.3 * float(np.linalg.norm(plain - truth)), 0.5)


@given(seed=seeds, batch=st.integers(2, 5), passes=st.integers(1, 4))
def test_problems_side_by_side_are_solved_as_each_by_itself(seed, batch, passes):
    rows, off, _, use = problem(np.random.default_rng(seed), batch, noise=1.0)
    together = solve(rows, off, use, np.eye(6), passes=passes, spare=6)
    for k in range(batch):
        own = np.s_[k : k + 1]
        alone = solve(rows[own], off[own], use[own], np.eye(6), passes=passes, spare=6)
        for one, other in zip(together, alone, strict=True):
            assert one[own] == pytest.approx(other, rel=1e-6, abs=1e-9)


def test_a_block_of_no_use_says_nothing():
    rows, off, truth, use = problem(np.random.default_rng(1))
    off[0, 3] += 100.0
    use[0, 3] = 0.0
    assert solve(rows, off, use, 1e-12 * np.eye(6)).unknowns == pytest.approx(truth, abs=1e-6)


def test_what_no_block_says_is_left_to_the_prior_and_what_that_wants():
    wanted = np.arange(6.0)
    found = solve(np.zeros((1, 1, 1, 6)), np.zeros((1, 1, 1)), np.ones((1, 1)), 4 * np.eye(6), 4 * wanted)
    assert found.unknowns[0] == pytest.approx(wanted)
    assert found.held[0] == pytest.approx(4 * np.eye(6))
    assert not found.information.any()


def test_a_last_unknown_that_may_not_be_negative_is_held_to_nought():
    rows = np.eye(2)[None, :, None]
    off = np.array([[[1.0], [-2.0]]])
    assert solve(rows, off, np.ones((1, 2)), np.zeros((2, 2))).unknowns[0] == pytest.approx([1.0, -2.0])
    assert solve(rows, off, np.ones((1, 2)), np.zeros((2, 2)), grows=False).unknowns[0] == pytest.approx(
        [1.0, 0.0], abs=1e-6
    )


def test_misses_that_all_are_larger_than_their_doubt_says_are_no_outliers():
    rows, off, _, use = problem(np.random.default_rng(2), blocks=200, noise=6.0)
    alone, together = (solve(rows, off, use, np.eye(6), passes=3, spare=spare) for spare in (None, 6))
    assert together.excess[0] == pytest.approx(36.0, rel=0.4)
    assert together.trust.mean() > 0.6 > 0.2 > alone.trust.mean()


def test_a_block_counts_less_the_farther_it_is_off_and_a_quarter_at_the_outliers_limit():
    miss = np.array([0.0, 1.0, OUTLIER**2, 100.0, 1e6])
    weight = robust_weight(miss)
    assert weight[0] == 1.0
    assert weight[2] == pytest.approx(0.25)
    assert (np.diff(weight) < 0).all()


@given(seed=seeds)
def test_residuals_are_whitened_to_sigmas(seed):
    root = np.random.default_rng(seed).normal(size=(5, 3, 3)) + 3 * np.eye(3)
    covariance = root @ root.swapaxes(1, 2)
    white = whitener(covariance)
    assert white @ covariance @ white.swapaxes(1, 2) == pytest.approx(np.eye(3) + np.zeros((5, 3, 3)), abs=1e-6)


def test_a_covariance_that_rounding_has_made_indefinite_is_whitened_as_far_as_it_is_positive():
    found = whitener(np.array([np.diag([4.0, 1e-3, -1e-18]), np.eye(3)]))
    assert np.isfinite(found).all()
    assert np.abs(found[0] @ [2.0, 0.0, 0.0]).max() == pytest.approx(1.0)
