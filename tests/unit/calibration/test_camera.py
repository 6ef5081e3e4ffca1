"""One camera from views of a board: what it is, how well that is known, and which views make none."""

from __future__ import annotations

import numpy as np
import pytest

from daemon import frames
from daemon.calibration.board import Board, DetectedBoard
from daemon.calibration.camera import calibrate_camera
from daemon.calibration.stereo import StereoError
from daemon.calibration.tour import choose_spread, viewpoints_around
from daemon.vision.geometry import Camera

BOARD = Board(9, 6, 16.0)
TRUE = Camera(
    np.array([[702.0, 0, 318.0], [0, 701.0, 242.0], [0, 0, 1]]), np.array([-0.08, 0.03, 4e-4, -3e-4, 0.0]), np.eye(4)
)


def views(count: int, sigma_px: float = 0.05, seed: int = 0) -> list[tuple[str, DetectedBoard]]:
    """Boards from all round, corners with noise."""
    rng, points = np.random.default_rng(seed), BOARD.points_mm()
    start = frames.rigid(np.eye(3), points.mean(axis=0) - np.array([0.0, 0.0, 330.0]))
    looks = viewpoints_around(np.eye(4), points.mean(axis=0), np.array([1.0, 0.0, 0.0]))
    found = []
    for k, look in enumerate(choose_spread(looks, count, lambda _: True, start)):
        px = TRUE.project(frames.apply(frames.inverse(look), points))
        found.append((f"pose {k}", DetectedBoard(np.arange(len(points)), px + rng.normal(0, sigma_px, px.shape), 0.7)))
    return found


def test_the_camera_is_found_within_what_is_said_of_it() -> None:
    result = calibrate_camera(views(16), BOARD, (640, 480))
    assert abs(result.camera.matrix[0, 0] - 702.0) < 4 * result.focal_sigma_px
    assert result.rms_px == pytest.approx(0.05 * np.sqrt(2), rel=0.2)
    assert np.allclose(result.camera.matrix[:2, 2], [318.0, 242.0], atol=1.0)
    assert not result.dropped
    assert result.camera.cyclopean_from_camera[0, 3] == -30.0


def test_a_view_in_which_the_board_moved_is_named_and_left_out() -> None:
    seen = views(14)
    name, board = seen[3]
    seen[3] = (
        name,
        DetectedBoard(board.corner_ids, board.corners_px + np.linspace(0, 4, len(board.corners_px))[:, None], 0.7),
    )
    result = calibrate_camera(seen, BOARD, (640, 480))
    assert list(result.dropped) == ["pose 3"]
    assert len(result.used) == 13


def test_views_that_all_look_alike_make_no_calibration() -> None:
    """Almost squarely and from one distance, a longer lens from farther away shows the same."""
    rng, points, seen = np.random.default_rng(0), BOARD.points_mm(), []
    for k in range(10):
        turn = frames.rotation_from_vector(rng.uniform(-0.02, 0.02, 3))
        away = np.array([*rng.uniform(-20, 20, 2), 330.0]) - points.mean(axis=0)
        px = TRUE.project(points @ turn.T + away)
        seen.append((f"pose {k}", DetectedBoard(np.arange(len(points)), px + rng.normal(0, 0.05, px.shape), 0.7)))
    with pytest.raises(StereoError, match=r"too similar: .* focal length .* tilt the board"):
        calibrate_camera(seen, BOARD, (640, 480))


def test_too_few_views_make_no_calibration() -> None:
    with pytest.raises(StereoError, match="5 usable views, 6 are needed"):
        calibrate_camera(views(5), BOARD, (640, 480))
