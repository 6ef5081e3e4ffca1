"""Rigid transforms and the way uncertainty moves through them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from daemon import frames
from daemon.arrays import Array

vectors = arrays(np.float64, 3, elements=st.floats(-3.0, 3.0))


def pose(turn: Array, shift: Array) -> Array:
    return frames.rigid(frames.rotation_from_vector(turn), 100.0 * shift)


@given(vectors, vectors)
def test_a_transform_and_its_inverse_cancel(turn: Array, shift: Array) -> None:
    t = pose(turn, shift)
    np.testing.assert_allclose(frames.inverse(t) @ t, np.eye(4), atol=1e-9)


@given(vectors, vectors)
def test_the_rotation_vector_comes_back_through_the_matrix(turn: Array, shift: Array) -> None:
    r = frames.rotation_from_vector(turn)
    np.testing.assert_allclose(frames.rotation_from_vector(frames.vector_from_rotation(r)), r, atol=1e-6)


@pytest.mark.parametrize("axis", [[1.0, 0, 0], [0, 1.0, 0], [0.6, 0, 0.8], [-0.6, 0.48, 0.64]])
def test_half_a_turn_has_an_axis_and_the_angle_pi(axis: list[float]) -> None:
    r = frames.rotation_from_vector(np.pi * np.array(axis))
    vector = frames.vector_from_rotation(r)
    assert np.linalg.norm(vector) == pytest.approx(np.pi)
    assert abs(vector @ np.array(axis)) == pytest.approx(np.pi)


@given(vectors, vectors, vectors, vectors)
def test_difference_undoes_perturb(turn: Array, shift: Array, dt: Array, dr: Array) -> None:
    motion = np.concatenate([dt, 0.3 * dr])
    t = pose(turn, shift)
    np.testing.assert_allclose(frames.difference(frames.perturb(t, motion), t), motion, atol=1e-6)


def test_composed_covariance_is_what_sampling_shows() -> None:
    rng = np.random.default_rng(1)
    a, b = pose(np.array([0.3, -0.5, 1.0]), np.array([1.0, -2, 0.5])), pose(np.array([-1.0, 0.2, 0.4]), np.ones(3))
    cov_a = np.diag([0.1, 0.2, 0.3, 1e-3, 2e-3, 1e-3]) ** 2
    cov_b = np.diag([0.3, 0.1, 0.2, 2e-3, 1e-3, 3e-3]) ** 2
    of_a, of_b = (rng.multivariate_normal(np.zeros(6), cov, 8000) for cov in (cov_a, cov_b))
    draws = np.array([
        frames.difference(frames.perturb(a, da) @ frames.perturb(b, db), a @ b)
        for da, db in zip(of_a, of_b, strict=True)
    ])  # fmt: skip
    predicted = frames.transport_covariance(a, cov_b) + frames.lever_covariance(b, cov_a, a)
    scale = np.sqrt(np.outer(np.diag(predicted), np.diag(predicted)))
    np.testing.assert_allclose(np.cov(draws.T) / scale, predicted / scale, atol=0.04)


def test_fusing_weighs_each_pose_by_what_it_knows() -> None:
    truth = pose(np.array([0.1, 0.2, -0.3]), np.ones(3))
    good, poor = np.eye(6) * 1e-4, np.eye(6) * 1e-2
    off = frames.perturb(truth, np.full(6, 0.1))
    mean, covariance = frames.fuse([truth, off], [good, poor])
    np.testing.assert_allclose(frames.difference(mean, truth), np.full(6, 0.1 / 101), atol=2e-5)
    np.testing.assert_allclose(np.diag(covariance), 1 / (1e4 + 1e2))


def test_fusing_nothing_is_refused() -> None:
    with pytest.raises(ValueError, match="no poses"):
        frames.fuse([], [])


@given(vectors, vectors)
def test_the_nearest_rotation_to_a_rotation_and_a_little_is_that_rotation(turn: Array, noise: Array) -> None:
    r = frames.rotation_from_vector(turn)
    found = frames.nearest_rotation(np.stack([r, 3.0 * r, r + 1e-3 * frames.cross_matrices(noise) @ r]))
    np.testing.assert_allclose(found[:2], [r, r], atol=1e-9)
    assert frames.angle_between(found[2], r) < 1e-2
    assert [frames.not_a_rotation(one, 1e-9) for one in found] == [None] * 3


def test_the_nearest_rotation_to_a_mirror_is_no_mirror() -> None:
    assert frames.not_a_rotation(frames.nearest_rotation(np.diag([3.0, 2.0, -1.0])), 1e-9) is None


@pytest.mark.parametrize(
    ("matrix", "told"),
    [
        (np.diag([1.0, -1.0, 1.0, 1.0]), "mirrored"),
        (np.eye(4) * 1.01, "one off by 0.02"),
        (np.eye(4) * 1e200, "one off by inf"),
        (np.vstack([np.eye(4)[:3], [0.0, 0.0, 0.5, 1.0]]), "last row"),
        (np.full((4, 4), np.nan), "4x4 finite"),
        (np.eye(3), "4x4"),
    ],
)
def test_what_is_no_rigid_transform_is_told_in_words(matrix: Array, told: str) -> None:
    assert told in str(frames.not_rigid(matrix))
    assert frames.not_rigid(np.eye(4)) is None


@pytest.mark.parametrize("turned", [-2.0, -0.3, 0.0, 1.2, 3.0])
def test_the_turn_about_an_axis_is_the_nearest_to_a_rotation_of_all_turns_about_it(turned: float) -> None:
    axis, aside = np.array([0.6, 0.0, 0.8]), frames.rotation_from_vector(np.array([0.0, 0.2, 0.0]))
    about = frames.rotation_from_vector(axis * turned)
    assert frames.turn_about(axis, about) == pytest.approx(turned)
    rotation = about @ aside
    tried = np.linspace(-np.pi, np.pi, 2001)
    apart = [frames.angle_between(frames.rotation_from_vector(axis * angle), rotation) for angle in tried]
    assert abs(frames.turn_about(axis, rotation) - tried[int(np.argmin(apart))]) < 2e-3


def test_the_rms_angle_is_over_all_axes_together() -> None:
    assert frames.rms_deg(np.diag(np.radians([3.0, 4.0, 12.0]) ** 2)) == pytest.approx(13.0)
