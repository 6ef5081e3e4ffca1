"""Edges fainter than the noise of a pixel, and the guesses that they confirm or refute."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from daemon import frames
from daemon.arrays import Array
from daemon.vision.geometry.p3p import p3p_poses
from daemon.vision.geometry.polygon_batch import different
from daemon.vision.geometry.polyhedron import exact
from daemon.vision.image.both_eyes import open_eyes
from daemon.vision.image.edge_lines import edge_sigmas
from daemon.vision.registration.chamfer import chamfer_px, edge_map
from daemon.vision.registration.verify import EDGE_SIGMAS
from tests.worlds.painted import paint_pair
from tests.worlds.rigs import rig
from tests.worlds.solids import CUBE, PYRAMID, pose

LINE = np.array([[20.0, 60.0]]), np.array([[140.0, 60.0]])


def smoothed(picture: Array, seed: int) -> NDArray[np.float32]:
    """A picture with noise of one, smoothed as the finder does."""
    noisy = picture + np.random.default_rng(seed).normal(0, 1, picture.shape)
    return np.asarray(cv2.GaussianBlur(noisy.astype(np.float32), (7, 7), 1.0), np.float32)


def step(height: float) -> Array:
    picture = np.zeros((120, 160))
    picture[60:] = height
    return picture


def test_an_edge_of_one_and_a_half_sigmas_of_a_pixel_is_sure_over_its_length() -> None:
    found = [edge_sigmas([(smoothed(step(1.5), seed), 1)], *LINE)[0] for seed in range(30)]
    assert min(found) > 4.0


def test_noise_alone_hardly_ever_looks_like_an_edge() -> None:
    start = np.stack(np.meshgrid(np.arange(30.0, 130, 5), np.arange(15.0, 105, 5)), -1).reshape(-1, 2)
    turn = np.random.default_rng(1).uniform(0, np.pi, len(start))
    end = start + 60 * np.stack([np.cos(turn), np.sin(turn)], 1)
    found = np.concatenate(
        [edge_sigmas([(smoothed(np.zeros((180, 220)), seed), len(start))], start, end) for seed in range(6)]
    )
    assert np.mean(found > 4.0) < 0.01


def test_an_edge_that_only_crosses_the_line_is_none_of_its_own() -> None:
    picture = np.zeros((120, 160))
    picture[:, 80:] = 20.0
    assert edge_sigmas([(smoothed(picture, 0), 1)], *LINE)[0] < 4.0


def test_grain_beside_a_line_counts_against_it() -> None:
    rng = np.random.default_rng(2)
    grain = cv2.GaussianBlur(rng.normal(0, 1, (120, 160)), (0, 0), 2.5) * 40
    bare, grainy = (edge_sigmas([(smoothed(step(4.0) + g, 3), 1)], *LINE)[0] for g in (0.0, grain))
    assert grainy < bare / 3


@given(st.integers(0, 10_000))
@settings(max_examples=60, deadline=None)
def test_three_corners_look_from_the_poses_found_as_they_were_seen(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = np.array([[0.0, 0, 0], [50, 0, 0], [rng.uniform(-20, 70), rng.uniform(25, 60), 0]])
    tilt = np.array([*rng.uniform(-0.6, 0.6, 2), rng.uniform(-3, 3)])
    true = frames.rigid(frames.rotation_from_vector(tilt), np.array([*rng.uniform(-60, 60, 2), rng.uniform(250, 600)]))
    there = frames.apply(true, points)
    seen = there[:, :2] / there[:, 2:]
    poses, solved = p3p_poses(points[None], seen[None])
    assert poses.shape == (2, 4, 4)
    for found in poses[solved]:
        again = frames.apply(found, points)
        assert np.abs(again[:, :2] / again[:, 2:] - seen).max() < 2e-3  # some 1.4 px


def test_most_triples_of_corners_are_solved() -> None:
    rng = np.random.default_rng(0)
    points = rng.uniform(-30, 30, (500, 3, 3))
    there = (
        points
        + np.stack([rng.uniform(-60, 60, 500), rng.uniform(-60, 60, 500), rng.uniform(250, 600, 500)], 1)[:, None]
    )
    poses, solved = p3p_poses(points, there[:, :, :2] / there[:, :, 2:])
    moved = np.einsum("tij,tkj->tki", poses[:, :3, :3], np.tile(points, (2, 1, 1))) + poses[:, None, :3, 3]
    right = solved & (np.abs(moved - np.tile(there, (2, 1, 1))).max((1, 2)) < 0.1)
    assert np.mean(right[:500] | right[500:]) > 0.98


@pytest.mark.parametrize("body", [CUBE, PYRAMID])
def test_the_true_pose_costs_less_than_poses_beside_it(body: object) -> None:
    where = pose(np.array([0.75, 0.25, 0.6]), 0.3, 340.0)
    eyes = open_eyes(*paint_pair([(body, where)], np.random.default_rng(4)), rig())  # type: ignore[list-item]
    solid = exact(body.corners_mm, body.facets)
    beside = [
        frames.perturb(where, np.array(m)) for m in ([9.0, 0, 0, 0, 0, 0], [0, 9, 0, 0, 0, 0], [0, 0, 0, 0.2, 0, 0])
    ]
    maps = edge_map(eyes.left.scale(2), EDGE_SIGMAS), edge_map(eyes.right.scale(2), EDGE_SIGMAS)
    costs = chamfer_px(solid, np.stack([where, *beside]), eyes.geometry, maps)
    assert costs[0] < 1.0
    assert costs[0] < costs[1:].min() / 1.5


def test_sides_that_several_outlines_share_are_counted_once_whichever_way_they_run() -> None:
    start = np.array([[0.0, 0], [50, 0], [50.2, 0.1], [0, 0]])
    end = np.array([[50.0, 0], [50, 40], [0.1, 0.2], [50, 3]])
    kept, which, turned = different(start, end, 0.6)
    assert kept.tolist() == [0, 1, 3]
    assert which.tolist() == [0, 1, 0, 2]
    assert turned.tolist() == [False, False, True, False]
