"""One step of registration: corners move as their slopes say, and a planted motion is found among edges that lie."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon import frames
from daemon.vision.geometry.rig import Camera
from daemon.vision.refine.poses import across, corners_in, moved, off_places, solve

CUBE = np.array([[x, y, z] for x in (-20.0, 20) for y in (-20.0, 20) for z in (-20.0, 20)])
RING = [(0, 1), (1, 3), (3, 2), (2, 0), (4, 5), (5, 7), (7, 6), (6, 4), (0, 4), (1, 5), (3, 7), (2, 6)]


def eye(side: float) -> Camera:
    turn = frames.rotation_from_vector(np.array([0.01, -0.08 * side, 0.02]))
    matrix = np.array([[700.0, 0, 322], [0, 698.0, 238], [0, 0, 1]])
    return Camera(matrix, np.array([-0.1, 0.05, 1e-3, -5e-4, 0.01]), frames.rigid(turn, np.array([30.0 * side, 0, 0])))


poses = st.builds(
    lambda turn, place: frames.rigid(frames.rotation_from_vector(np.array(turn)), np.array(place)),
    st.tuples(*[st.floats(-2, 2)] * 3),
    st.tuples(st.floats(-60, 60), st.floats(-60, 60), st.floats(250, 500)),
)


@given(pose=poses, side=st.sampled_from([-1.0, 1.0]))
def test_corners_move_in_an_eye_as_their_slopes_say(pose, side):
    px, slope = corners_in(eye(side), pose, CUBE)
    assert px == pytest.approx(eye(side).project(frames.apply(pose, CUBE)), abs=1e-9)
    for k, step in enumerate(np.diag([0.01] * 3 + [1e-4] * 3)):
        ends = [corners_in(eye(side), frames.perturb(pose, way * step), CUBE)[0] for way in (1, -1)]
        assert slope[:, :, k] == pytest.approx((ends[0] - ends[1]) / (2 * step[k]), abs=1e-2)


@given(many=st.lists(poses, min_size=1, max_size=5), seed=st.integers(0, 2**31))
def test_poses_are_moved_side_by_side_as_each_by_itself(many, seed):
    motions = np.random.default_rng(seed).normal(size=(len(many), 6)) * ([5.0] * 3 + [0.3] * 3)
    motions[0, 3:] = 0.0
    each = np.stack([frames.perturb(pose, motion) for pose, motion in zip(many, motions, strict=True)])
    assert moved(np.stack(many), motions) == pytest.approx(each, abs=1e-9)


@given(pose=poses, way=st.integers(0, 2**31))
def test_a_planted_motion_is_found_though_some_edges_lie(pose, way):
    rng = np.random.default_rng(way)
    motion = rng.normal(size=6) * ([1.0] * 3 + [0.01] * 3)
    rows = []
    for camera in (eye(-1.0), eye(1.0)):
        px, slope = corners_in(camera, pose, CUBE)
        found, _ = corners_in(camera, frames.perturb(pose, motion), CUBE)
        a, b = np.array(RING).T
        normal = across(px[a], px[b])[:, None]
        rows.append(
            (off_places(px[a], px[b], found[a], found[b]), np.stack([(normal @ slope[k])[:, 0] for k in (a, b)], 1))
        )
    off, jacobian = (np.concatenate(each) for each in zip(*rows, strict=True))
    clear = np.ones(len(off))
    weight = np.tile(np.eye(2) / 0.3**2, (len(off), 1, 1))
    honest, _ = solve(off, jacobian, weight, clear, 1e-9 * np.eye(6), 40.0, 6)
    off[rng.choice(len(off), 2, replace=False)] += rng.choice([-40.0, 40.0])
    robust, _ = solve(off, jacobian, weight, clear, 1e-9 * np.eye(6), 40.0, 12)
    lever = np.array([1.0] * 3 + [30.0] * 3)
    assert np.linalg.norm((honest - motion) * lever) < 0.25
    assert np.linalg.norm((robust - motion) * lever) < 0.5
