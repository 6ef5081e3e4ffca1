"""A stereo calibration from boards whose truth is known."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from daemon import frames
from daemon.calibration.board import Board, BoardError, SeenBoard, find_board, parse_board
from daemon.calibration.least_squares import INTRINSICS, Match, stereo_problem
from daemon.calibration.recorded import read_pairs
from daemon.calibration.stereo import Pair, StereoError, calibrate_stereo
from daemon.vision.geometry.rig import Camera, StereoRig

Array = frames.Array
BOARD = Board(9, 6, 10.0)


def true_rig() -> StereoRig:
    """Baseline 60 mm, converging at 350 mm, mild barrel distortion, eyes a little unlike."""
    eyes = []
    for side, (cx, cy) in ((-1.0, (322.7, 241.0)), (1.0, (316.8, 237.4))):
        turn = frames.rotation_from_vector(np.array([0.0, -side * np.arctan2(30.0, 350.0), 0.0]))
        pose = frames.rigid(turn, np.array([side * 30.0, 0.0, 0.0]))
        matrix = np.array([[700.0 + side, 0, cx], [0, 700.0, cy], [0, 0, 1]])
        eyes.append(Camera(matrix, np.array([-0.08, 0.03, 0.0004, -0.0003, 0.0]), pose))
    return StereoRig(eyes[0], eyes[1], (640, 480))


def board_poses(rng: np.random.Generator, count: int) -> list[Array]:
    """Tilted, turned, near and far, about where the eyes look."""
    centre = np.append(BOARD.points_mm()[:, :2].mean(axis=0), 0.0)
    poses = []
    for _ in range(count):
        turn = frames.rotation_from_vector(rng.uniform(-0.5, 0.5, 3))
        place = np.array([*rng.uniform(-25, 25, 2), rng.uniform(250, 450)])
        poses.append(frames.rigid(turn, place - turn @ centre))
    return poses


def sights(seed: int, count: int = 20, noise_px: float = 0.1) -> list[Pair]:
    rng, rig = np.random.default_rng(seed), true_rig()
    pairs = []
    for k, pose in enumerate(board_poses(rng, count)):
        points = frames.apply(pose, BOARD.points_mm())
        ids = np.arange(len(points))
        seen = [eye.project(points) + rng.normal(0, noise_px, (len(points), 2)) for eye in (rig.left, rig.right)]
        pairs.append(Pair(f"view {k}", SeenBoard(ids, seen[0], 0.8), SeenBoard(ids, seen[1], 0.8)))
    return pairs


@pytest.mark.parametrize("seed", range(4))
def test_the_truth_lies_within_the_standard_deviations_that_are_given(seed: int) -> None:
    result, truth = calibrate_stereo(sights(seed), BOARD, (640, 480)), true_rig()
    assert result.stereo_rms_px == pytest.approx(0.1 * np.sqrt(2), rel=0.1)
    for side in ("left", "right"):
        eye, true_eye = getattr(result.rig, side), getattr(truth, side)
        assert abs(eye.matrix[0, 0] - true_eye.matrix[0, 0]) < 4 * result.sigmas[f"{side}.fx"]
        assert abs(eye.matrix[0, 2] - true_eye.matrix[0, 2]) < 4 * result.sigmas[f"{side}.cx"]
    assert abs(result.rig.baseline_mm - truth.baseline_mm) < 4 * result.sigmas["baseline_mm"]
    assert result.sigmas["baseline_mm"] < 0.2


def test_the_jacobian_is_the_slope_of_the_residuals() -> None:
    rng = np.random.default_rng(0)
    matches = [Match(BOARD.points_mm(), rng.normal(300, 50, (54, 2)), rng.normal(300, 50, (54, 2))) for _ in range(2)]
    eye = [700, 705, 320, 240, -0.1, 0.02, 0.001, 0.002, 0.01]
    x = np.array([*eye, *eye, 0.01, 0.15, 0.02, -60, 1, 2, 0.3, 0.2, 0.1, -50, -40, 400, -0.3, 0.2, 0.1, -30, -40, 350])
    problem = stereo_problem(matches)
    jacobian = problem(x)[1]
    for k in (0, 4, INTRINSICS + 8, 2 * INTRINSICS + 1, 2 * INTRINSICS + 4, 2 * INTRINSICS + 7, len(x) - 1):
        step = np.zeros(len(x))
        step[k] = 1e-6 * max(1.0, abs(x[k]))
        slope = (problem(x + step)[0] - problem(x - step)[0]) / (2 * step[k])
        np.testing.assert_allclose(jacobian[:, k], slope, atol=1e-4 * max(1.0, np.abs(slope).max()))


def test_a_misread_view_is_named_and_dropped() -> None:
    pairs = sights(7)
    rng = np.random.default_rng(1)
    spoilt = replace(pairs[5].left, corners_px=pairs[5].left.corners_px + rng.normal(0, 3, (54, 2)))
    pairs[5] = replace(pairs[5], left=spoilt)
    result = calibrate_stereo(pairs, BOARD, (640, 480))
    assert list(result.dropped) == ["view 5"]
    assert result.stereo_rms_px < 0.2


def test_swapped_eyes_are_told_as_such() -> None:
    with pytest.raises(StereoError, match="swap the cameras"):
        calibrate_stereo([Pair(p.name, p.right, p.left) for p in sights(3)], BOARD, (640, 480))


def test_one_mirrored_eye_is_told_as_such() -> None:
    def mirrored(seen: SeenBoard) -> SeenBoard:
        grid = (np.array([639.0, 0]) + seen.corners_px * (-1.0, 1.0)).reshape(6, 9, 2)[:, ::-1]
        return replace(seen, corners_px=grid.reshape(-1, 2))

    with pytest.raises(StereoError, match="mirrored"):
        calibrate_stereo([Pair(p.name, p.left, mirrored(p.right)) for p in sights(3)], BOARD, (640, 480))


def test_too_few_or_too_similar_views_are_refused() -> None:
    with pytest.raises(StereoError, match="3 usable pairs, 6 are needed"):
        calibrate_stereo(sights(3)[:3], BOARD, (640, 480))
    with pytest.raises(StereoError, match="too like each other"):
        calibrate_stereo([sights(3)[0]] * 10, BOARD, (640, 480))


def drawn_board(turned: bool = False, square_px: int = 36) -> np.ndarray:
    squares = np.add.outer(np.arange(7), np.arange(10)) % 2
    image = np.full((480, 640), 230, np.uint8)
    board = np.where(np.kron(squares, np.ones((square_px, square_px))) > 0, 230, 30).astype(np.uint8)
    image[100 : 100 + board.shape[0], 120 : 120 + board.shape[1]] = board
    image = cv2.GaussianBlur(image, (0, 0), 0.8)
    return image[::-1, ::-1].copy() if turned else image


def test_corners_are_numbered_from_the_black_end_however_the_board_is_turned() -> None:
    upright, turned = find_board(drawn_board(), BOARD), find_board(drawn_board(turned=True), BOARD)
    np.testing.assert_allclose(upright.corners_px[0], [155.5, 135.5], atol=0.05)
    np.testing.assert_allclose(turned.corners_px[0], [639 - 155.5, 479 - 135.5], atol=0.05)
    assert upright.blur_px == pytest.approx(0.8, abs=0.25)


def test_a_blurred_and_a_half_hidden_board_each_get_their_reason() -> None:
    with pytest.raises(BoardError, match="blurred"):
        find_board(cv2.GaussianBlur(drawn_board(), (0, 0), 4.0), BOARD)
    half = drawn_board()
    half[:, 300:] = 230
    with pytest.raises(BoardError, match="no 9x6 board in view"):
        find_board(half, BOARD)


def test_a_mirrored_charuco_board_is_told_as_such() -> None:
    board = parse_board("9x6", 10.0, "charuco")
    image = np.asarray(board.charuco().generateImage((600, 420), marginSize=20), np.uint8)
    assert len(find_board(image, board).corner_ids) == 54
    with pytest.raises(BoardError, match="mirrored"):
        find_board(np.ascontiguousarray(image[:, ::-1]), board)


@pytest.mark.parametrize("text", ["9", "9x", "x6", "2x6", "9x6x3", "-9x6"])
def test_a_malformed_board_size_says_what_was_expected(text: str) -> None:
    with pytest.raises(BoardError, match="expected COLUMNSxROWS"):
        parse_board(text, 10.0)


def test_a_picture_of_another_size_is_named_and_left_out(tmp_path: Path) -> None:
    """A glob that names the pictures names a thumbnail among them, too, and perhaps first."""
    files = []
    for number, scale in enumerate((0.5, 1.0, 1.0)):
        pair = tmp_path / f"left{number}.png", tmp_path / f"right{number}.png"
        for path in pair:
            cv2.imwrite(str(path), cv2.resize(drawn_board(), None, fx=scale, fy=scale))
        files.append(pair)
    pairs, unused, size = read_pairs(files, BOARD)
    assert [pair.name for pair in pairs] == ["left1.png, right1.png", "left2.png, right2.png"]
    assert size == drawn_board().shape[1::-1]
    assert "most are" in unused["left0.png, right0.png"]


def test_a_picture_that_cannot_be_read_is_named_with_what_is_wrong(tmp_path: Path) -> None:
    left, right = tmp_path / "left.png", tmp_path / "right.png"
    cv2.imwrite(str(left), drawn_board())
    with pytest.raises(BoardError, match=r"right\.png: No such file or directory"):
        read_pairs([(left, right)], BOARD)
    right.write_bytes(left.read_bytes()[:-20])
    with pytest.raises(BoardError, match=r"right\.png: not a picture, or cut short"):
        read_pairs([(left, right)], BOARD)
