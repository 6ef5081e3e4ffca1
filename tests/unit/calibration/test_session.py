"""What looks from new poses say of a calibration. In earnest: tests/cell/test_cell_calibrates.py."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from daemon import frames
from daemon.arrays import Array
from daemon.calibration.board import SeenBoard
from daemon.calibration.board_detection import find_board
from daemon.calibration.file import Calibration
from daemon.calibration.hand_eye import LEAST_TURN_DEG, diversity_deg
from daemon.calibration.session import (
    EPIPOLAR_LIMIT_PX,
    LENGTH_LIMIT_MM,
    SPREAD_LIMIT_MM,
    BoardView,
    SessionError,
    _plan,
    verify,
)
from daemon.calibration.stereo import Pair
from daemon.vision.geometry import Camera
from tests.fakes.boards import BOARD, drawn_board
from tests.fakes.rigs import unlike_rig


def test_one_eye_that_was_nowhere_far_enough_from_where_it_was_says_so() -> None:
    seen = find_board(drawn_board(), BOARD)
    views = [BoardView(np.eye(4), Pair(f"pose {k}", seen, None)) for k in range(4)]
    calibration = replace(Calibration(unlike_rig(), np.eye(4)), alone="left")
    with pytest.raises(SessionError, match="far enough apart"):
        verify(views, BOARD, calibration)


TOOL_FROM_CYCLOPEAN = frames.rigid(
    frames.rotation_from_vector(np.array([0.2, -0.1, 1.5])), np.array([-75.0, 3.0, -110.0])
)
WORLD_FROM_BOARD = frames.rigid(frames.rotation_from_vector(np.array([3.1, 0.05, 0.1])), np.array([520.0, 0, -300.0]))
CALIBRATION = Calibration(unlike_rig(), TOOL_FROM_CYCLOPEAN)


def seen_by(camera: Camera, cyclopean_from_board: Array) -> SeenBoard:
    points = BOARD.points_mm()
    return SeenBoard(np.arange(len(points)), camera.project(frames.apply(cyclopean_from_board, points)), 0.5)


def views_of_the_board(count: int = 6, stretched: float = 1.0, arm_mm: float = 0.0) -> list[BoardView]:
    """Looks without noise, a step of 40 mm apart; stretched: how much larger the board is than its description; arm_mm:
    how far the arm is from where it says that it is, to and fro along x."""
    found, centre = [], np.append(BOARD.points_mm()[:, :2].mean(axis=0), 0.0)
    for k in range(count):
        turn = frames.rotation_from_vector(np.array([0.3 * np.sin(k), 0.3 * np.cos(k), 0.0]))
        at = frames.rigid(turn, np.array([40.0 * (k % 3 - 1), 0.0, 300.0]) - turn @ centre)
        world_from_tool = WORLD_FROM_BOARD @ frames.inverse(at) @ frames.inverse(TOOL_FROM_CYCLOPEAN)
        told = frames.perturb(world_from_tool, np.array([arm_mm * (-1) ** k, 0, 0, 0, 0, 0]))
        at[:3, :3] *= stretched
        eyes = (seen_by(camera, at) for camera in (unlike_rig().left, unlike_rig().right))
        found.append(BoardView(told, Pair(f"pose {k}", *eyes)))
    return found


def failing(views: list[BoardView], calibration: Calibration = CALIBRATION) -> set[str]:
    return {failure.split()[0] for failure in verify(views, BOARD, calibration).failures}


def test_a_true_calibration_passes_and_of_one_that_is_wrong_each_figure_fails_from_its_limit_on() -> None:
    assert verify(views_of_the_board(), BOARD, CALIBRATION).passed
    half_a_board_mm = float(np.sqrt(np.mean(np.square(lengths_across_the_board()))))
    for share, fails in ((0.9, False), (1.1, True)):
        assert (
            "length" in failing(views_of_the_board(stretched=1 + share * LENGTH_LIMIT_MM / half_a_board_mm))
        ) is fails
        assert ("spread" in failing(views_of_the_board(arm_mm=share * SPREAD_LIMIT_MM))) is fails
        focal_px = float(unlike_rig().right.matrix[0, 0])
        turned = frames.perturb(unlike_rig().right.cyclopean_from_camera, turn_about_x(share / focal_px))
        rig = replace(unlike_rig(), right=replace(unlike_rig().right, cyclopean_from_camera=turned))
        gaps = verify(views_of_the_board(), BOARD, replace(CALIBRATION, rig=rig)).epipolar_px / share
        turned = frames.perturb(
            unlike_rig().right.cyclopean_from_camera, turn_about_x(share * EPIPOLAR_LIMIT_PX / gaps / focal_px)
        )
        rig = replace(rig, right=replace(rig.right, cyclopean_from_camera=turned))
        assert ("epipolar" in failing(views_of_the_board(), replace(CALIBRATION, rig=rig))) is fails


def lengths_across_the_board() -> Array:
    points = BOARD.points_mm()
    half = len(points) // 2
    return np.linalg.norm(points[half:] - points[: len(points) - half], axis=1)


def turn_about_x(angle_rad: float) -> Array:
    return np.array([0.0, 0.0, 0.0, angle_rad, 0.0, 0.0])


def test_fewer_than_four_poses_verify_nothing() -> None:
    with pytest.raises(SessionError, match="3 poses show the board, 4 are needed"):
        verify(views_of_the_board(3), BOARD, CALIBRATION)


def test_one_camera_that_the_arm_moves_verifies_as_a_pair() -> None:
    views = [replace(view, pair=replace(view.pair, right=None)) for view in views_of_the_board()]
    told = verify(views, BOARD, replace(CALIBRATION, alone="left"))
    assert told.passed
    assert told.length_mm < 0.01


def planned(count: int, allowed: Callable[[Array], bool]) -> list[Array]:
    reach = SimpleNamespace(allows=allowed)
    supervisor = SimpleNamespace(mover=SimpleNamespace(reach=reach))
    session: Any = SimpleNamespace(calibration=CALIBRATION, board=BOARD, supervisor=supervisor)
    return _plan(session, views_of_the_board(1)[0], count)


@pytest.mark.parametrize(("count", "reached", "enough"), [(12, 12, True), (12, 8, True), (12, 7, False), (4, 3, False)])
def test_a_tour_of_too_few_poses_is_refused_and_none_is_of_one_pose_over_and_over(
    count: int, reached: int, enough: bool
) -> None:
    left = iter(range(reached))
    if not enough:
        with pytest.raises(SessionError, match=f"the arm reaches only {reached} poses around the board"):
            planned(count, lambda _: next(left, None) is not None)
        return
    poses = planned(count, lambda _: next(left, None) is not None)
    assert len({pose.tobytes() for pose in poses}) == reached
    assert diversity_deg(poses) > LEAST_TURN_DEG
