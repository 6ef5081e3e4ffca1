"""Corners move as their slopes say, poses side by side as each by itself, and edges are off as far as they moved."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon import frames
from daemon.vision.geometry.rig import Camera
from daemon.vision.refine.expected_edges import across, corners_in, moved, off_places

CUBE = np.array([[x, y, z] for x in (-20.0, 20) for y in (-20.0, 20) for z in (-20.0, 20)])


def camera(side: float) -> Camera:
    turn = frames.rotation_from_vector(np.array([0.01, -0.08 * side, 0.02]))
    matrix = np.array([[700.0, 0, 322], [0, 698.0, 238], [0, 0, 1]])
    return Camera(matrix, np.array([-0.1, 0.05, 1e-3, -5e-4, 0.01]), frames.rigid(turn, np.array([30.0 * side, 0, 0])))


poses = st.builds(
    lambda turn, place: frames.rigid(frames.rotation_from_vector(np.array(turn)), np.array(place)),
    st.tuples(*[st.floats(-2, 2)] * 3),
    st.tuples(st.floats(-60, 60), st.floats(-60, 60), st.floats(250, 500)),
)


@given(pose=poses, side=st.sampled_from([-1.0, 1.0]))
def test_corners_move_in_a_camera_as_their_slopes_say(pose, side):
    px, slope = (of_cameras[0] for of_cameras in corners_in([camera(side)], pose, CUBE))
    assert px == pytest.approx(camera(side).project(frames.apply(pose, CUBE)), abs=1e-9)
    for k, step in enumerate(np.diag([0.01] * 3 + [1e-4] * 3)):
        ends = [corners_in([camera(side)], frames.perturb(pose, way * step), CUBE)[0][0] for way in (1, -1)]
        assert slope[:, :, k] == pytest.approx((ends[0] - ends[1]) / (2 * step[k]), abs=1e-2)


@given(many=st.lists(poses, min_size=1, max_size=5), seed=st.integers(0, 2**31))
def test_poses_are_moved_side_by_side_as_each_by_itself(many, seed):
    motions = np.random.default_rng(seed).normal(size=(len(many), 6)) * ([5.0] * 3 + [0.3] * 3)
    motions[0, 3:] = 0.0
    each = np.stack([frames.perturb(pose, motion) for pose, motion in zip(many, motions, strict=True)])
    assert moved(np.stack(many), motions) == pytest.approx(each, abs=1e-9)


@given(turn=st.floats(-3, 3), aside=st.floats(-3, 3), along=st.floats(-3, 3))
def test_an_edge_is_off_by_what_it_moved_across_and_not_by_what_it_moved_along(turn, aside, along):
    way = np.array([np.cos(turn), np.sin(turn)])
    start, end = np.zeros((1, 2)), 40.0 * way[None]
    shift = aside * across(start, end)[0] + along * way
    assert off_places(start, end, start + shift, end + shift) == pytest.approx(np.full((1, 2), aside), abs=1e-9)
