"""A stereo calibration from boards whose truth is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from daemon import frames
from daemon.arrays import Array
from daemon.calibration.board import BoardError, DetectedBoard
from daemon.calibration.stereo import MIN_SHARED, Pair, StereoError, calibrate_stereo, match_corners
from tests.fakes.boards import BOARD
from tests.fakes.rigs import unlike_rig


def board_poses(rng: np.random.Generator, count: int) -> list[Array]:
    """Tilted, turned, near and far, about where the cameras look."""
    centre = np.append(BOARD.points_mm()[:, :2].mean(axis=0), 0.0)
    poses = []
    for _ in range(count):
        turn = frames.rotation_from_vector(rng.uniform(-0.5, 0.5, 3))
        place = np.array([*rng.uniform(-25, 25, 2), rng.uniform(250, 450)])
        poses.append(frames.rigid(turn, place - turn @ centre))
    return poses


def sights(seed: int, count: int = 12, noise_px: float = 0.1) -> list[Pair]:
    rng, rig = np.random.default_rng(seed), unlike_rig()
    pairs = []
    for k, pose in enumerate(board_poses(rng, count)):
        points = frames.apply(pose, BOARD.points_mm())
        ids = np.arange(len(points))
        seen = [camera.project(points) + rng.normal(0, noise_px, (len(points), 2)) for camera in (rig.left, rig.right)]
        pairs.append(Pair(f"view {k}", DetectedBoard(ids, seen[0], 0.8), DetectedBoard(ids, seen[1], 0.8)))
    return pairs


@pytest.mark.parametrize("seed", range(3))
def test_the_truth_lies_within_the_standard_deviations_that_are_given(seed: int) -> None:
    result, truth = calibrate_stereo(sights(seed), BOARD, (640, 480)), unlike_rig()
    assert result.stereo_rms_px == pytest.approx(0.1 * np.sqrt(2), rel=0.1)
    for side in ("left", "right"):
        camera, true_camera = getattr(result.rig, side), getattr(truth, side)
        assert abs(camera.matrix[0, 0] - true_camera.matrix[0, 0]) < 4 * result.sigmas[f"{side}.fx"]
        assert abs(camera.matrix[0, 2] - true_camera.matrix[0, 2]) < 4 * result.sigmas[f"{side}.cx"]
    assert abs(result.rig.baseline_mm - truth.baseline_mm) < 4 * result.sigmas["baseline_mm"]
    assert result.sigmas["baseline_mm"] < 0.2


def test_a_misread_view_is_named_and_dropped() -> None:
    pairs = sights(7)
    rng = np.random.default_rng(1)
    spoilt = replace(pairs[5].left, corners_px=pairs[5].left.corners_px + rng.normal(0, 3, (54, 2)))
    pairs[5] = replace(pairs[5], left=spoilt)
    result = calibrate_stereo(pairs, BOARD, (640, 480))
    assert list(result.dropped) == ["view 5"]
    assert result.stereo_rms_px < 0.2


def test_swapped_cameras_are_told_as_such() -> None:
    with pytest.raises(StereoError, match="swap the cameras"):
        calibrate_stereo([Pair(p.name, p.right, p.left) for p in sights(3)], BOARD, (640, 480))


def test_one_mirrored_camera_is_told_as_such() -> None:
    def mirrored(seen: DetectedBoard) -> DetectedBoard:
        grid = (np.array([639.0, 0]) + seen.corners_px * (-1.0, 1.0)).reshape(6, 9, 2)[:, ::-1]
        return replace(seen, corners_px=grid.reshape(-1, 2))

    with pytest.raises(StereoError, match="mirrored"):
        calibrate_stereo([Pair(p.name, p.left, mirrored(p.right)) for p in sights(3)], BOARD, (640, 480))


def test_too_few_or_too_similar_views_are_refused() -> None:
    with pytest.raises(StereoError, match="3 usable pairs, 6 are needed"):
        calibrate_stereo(sights(3)[:3], BOARD, (640, 480))
    with pytest.raises(StereoError, match="too similar"):
        calibrate_stereo([sights(3)[0]] * 10, BOARD, (640, 480))


def test_corners_are_matched_by_their_ids_and_must_be_enough() -> None:
    rng = np.random.default_rng(5)
    pair = sights(3, count=1)[0]
    for shared in range(MIN_SHARED - 2, MIN_SHARED + 3):
        ids = rng.permutation(54)
        of_left, of_right = np.sort(ids[: 20 + shared]), np.sort(ids[20:])
        some = Pair("view", only(pair.left, of_left), only(pair.right, of_right))
        if shared < MIN_SHARED:
            with pytest.raises(BoardError, match=f"share {shared} of its corners, {MIN_SHARED} are needed"):
                match_corners(some, BOARD)
            continue
        both = np.sort(ids[20 : 20 + shared])
        found = match_corners(some, BOARD)
        np.testing.assert_array_equal(found.points_mm, BOARD.points_mm()[both])
        np.testing.assert_array_equal(found.left_px, pair.left.corners_px[both])
        np.testing.assert_array_equal(found.right_px, pair.right.corners_px[both])
    with pytest.raises(StereoError, match="one camera saw the board"):
        match_corners(replace(pair, right=None), BOARD)


def only(seen: DetectedBoard, ids: np.ndarray) -> DetectedBoard:
    return DetectedBoard(ids, seen.corners_px[ids], seen.blur_px)
