"""What looks say together: covariance that is honest, disagreements that are blamed rightly."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daemon import frames
from daemon.arm import OnHand
from daemon.pick import pose_fusion
from daemon.pick.grippers.two_fingers import tool_rotation
from daemon.pick.pose_fusion import CHI_SQUARE_6, Doubt
from tests.fakes.fake_cell import TOOL_FROM_CYCLOPEAN

DOUBT = Doubt()
TRUE = frames.rigid(frames.rotation_from_vector(np.array([0.1, -0.2, 0.7])), np.array([520.0, 10.0, -275.0]))
ROTATION = tool_rotation(np.array([0.0, 1.0, 0.0]), 0.4)


def looked(rng, distance, shared, doubt=DOUBT, knocked=None):
    """A sighting of TRUE from a distance, with errors as doubted: shared (9,) the same for all looks."""
    at = OnHand(TOOL_FROM_CYCLOPEAN).look_pose(ROTATION, TRUE[:3, 3], distance)
    cyclopean_from_part = frames.inverse(at @ TOOL_FROM_CYCLOPEAN) @ TRUE
    sigma = distance / 1000.0
    covariance = np.diag([0.1, 0.1, 0.4, 0.002, 0.002, 0.002]) ** 2 * sigma**2
    one = pose_fusion.sighting(at, TOOL_FROM_CYCLOPEAN, cyclopean_from_part, covariance, doubt, 700.0, 60.0)
    error = rng.multivariate_normal(np.zeros(6), one.covariance) + one.shared @ shared
    if knocked is not None:
        error = error + knocked
    return replace(one, world_from_part=frames.perturb(one.world_from_part, error))


def test_the_predicted_error_is_the_error_made():
    rng = np.random.default_rng(0)
    squares, predicted = [], 0.0
    for _ in range(400):
        shared = rng.multivariate_normal(np.zeros(9), DOUBT.shared())
        looks = [looked(rng, d, shared) for d in (450.0, 300.0, 200.0)]
        estimate = pose_fusion.fuse(looks, DOUBT)
        motion = frames.difference(estimate.world_from_part, TRUE)
        squares.append(motion[:3] @ motion[:3] + np.trace(DOUBT.arm()[:3, :3]))
        predicted = estimate.predicted_mm
    assert np.sqrt(np.mean(squares)) == pytest.approx(predicted, rel=0.1)


def test_what_all_looks_share_does_not_shrink_by_looking_again_from_the_same_place():
    rng = np.random.default_rng(1)
    looks = [looked(rng, 300.0, np.zeros(9)) for _ in range(50)]
    assert pose_fusion.fuse(looks, DOUBT).predicted_mm > np.sqrt(3) * DOUBT.hand_eye_mm


def test_however_well_a_part_is_known_the_arm_errs_once_more_on_its_way_to_the_grasp():
    doubt = replace(DOUBT, arm_mm=0.3, arm_deg=0.2)
    rng = np.random.default_rng(4)
    known = [replace(looked(rng, 300.0, np.zeros(9), doubt), covariance=1e-9 * np.eye(6)) for _ in range(3)]
    surely = [replace(one, shared=np.zeros((6, 9))) for one in known]
    estimate = pose_fusion.fuse(surely, doubt)
    assert estimate.predicted_mm == pytest.approx(np.sqrt(3) * 0.3, rel=1e-3)
    assert estimate.predicted_deg == pytest.approx(np.sqrt(3) * 0.2, rel=1e-3)


def test_looks_from_several_distances_tell_a_disparity_offset_from_depth():
    rng = np.random.default_rng(2)
    shared = np.array([0, 0, 0, 0, 0, 0, 0, 0, 0.5])
    looks = [looked(rng, d, shared) for d in (450.0, 300.0, 200.0)]
    alone = np.linalg.norm(frames.difference(looks[-1].world_from_part, TRUE)[:3])
    together = np.linalg.norm(frames.difference(pose_fusion.fuse(looks, DOUBT).world_from_part, TRUE)[:3])
    assert together < 0.6 * alone


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_two_honest_looks_agree_whatever_they_share(seed):
    rng = np.random.default_rng(seed)
    shared = rng.multivariate_normal(np.zeros(9), DOUBT.shared())
    pair = looked(rng, 450.0, shared), looked(rng, 300.0, shared)
    assert pose_fusion.disagreement(*pair, DOUBT) < 2 * CHI_SQUARE_6


def test_false_alarms_are_as_rare_as_said():
    rng = np.random.default_rng(3)
    alarms = 0
    for _ in range(2000):
        shared = rng.multivariate_normal(np.zeros(9), DOUBT.shared())
        pair = looked(rng, 450.0, shared), looked(rng, 300.0, shared)
        alarms += pose_fusion.disagreement(*pair, DOUBT) > CHI_SQUARE_6
    assert alarms <= 8


def test_a_part_that_moved_three_millimetres_is_noticed():
    rng = np.random.default_rng(4)
    zero = np.zeros(9)
    moved = looked(rng, 300.0, zero, knocked=np.array([3.0, 0, 0, 0, 0, 0]))
    assert pose_fusion.disagreement(looked(rng, 450.0, zero), moved, DOUBT) > CHI_SQUARE_6


@pytest.mark.parametrize(
    ("others", "who"),
    [([1.0, 2.0], "part"), ([100.0, 80.0], "hand-eye"), ([100.0, 2.0], "hand-eye"), ([], "unclear")],
)
def test_the_suspect_is_named(others, who):
    assert pose_fusion.suspect(others) == who


def test_an_arm_that_is_turned_moves_a_part_by_its_distance_from_the_tool() -> None:
    """Cameras are mounted behind the tool: a part 300 mm before them and 190 mm before the tool moves as the latter."""
    doubt = replace(Doubt(), arm_mm=0.0, arm_deg=1.0)
    behind = frames.rigid(np.eye(3), np.array([0.0, 0.0, -110.0]))
    part = frames.rigid(np.eye(3), np.array([0.0, 0.0, 300.0]))
    found = pose_fusion.sighting(np.eye(4), behind, part, np.zeros((6, 6)), doubt, 700.0, 60.0).covariance
    np.testing.assert_allclose(np.sqrt(np.diag(found))[:3], [190.0 * np.radians(1.0)] * 2 + [0.0], atol=1e-9)
