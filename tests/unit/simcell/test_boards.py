"""Calibration boards in rendered pictures."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from drivers.rigid import apply, rigid, turn
from drivers.simcell.boards import BoardPrint, rendered_board
from tests.fakes.pictures import TRUTH, looking, picture, projected


@pytest.mark.parametrize("charuco", [False, True])
def test_a_board_is_found_by_opencv_where_its_pose_says(charuco: bool) -> None:
    board, camera = BoardPrint(charuco=charuco), TRUTH.right.lens()
    axes = np.array([[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    world_from_board = rigid(axes @ turn([1, 0.5, 0], 0.3), [570.0, 85.0, -250.0])
    pose = looking([480.0, -20.0, 90.0], [520.0, 0.0, -280.0], 0.1)
    lighting = TRUTH.lighting
    image = picture([rendered_board(board, world_from_board)], pose, camera, lighting)
    grey = np.clip(cv2.GaussianBlur(image, (0, 0), TRUTH.sensor.blur_px), 0, 255).astype(np.uint8)
    if charuco:
        dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
        layout = cv2.aruco.CharucoBoard((10, 7), 16.0, 12.0, dictionary)
        found, numbers, _, _ = cv2.aruco.CharucoDetector(layout).detectBoard(grey)
        wanted = np.asarray(layout.getChessboardCorners(), float)[numbers.ravel()]
        assert len(wanted) == 54
    else:
        complete, found = cv2.findChessboardCorners(grey, (9, 6))
        assert complete
        x, y = np.meshgrid(np.arange(1, board.columns), np.arange(1, board.rows))
        wanted = board.square_mm * np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)]).astype(float)
        if np.linalg.norm(found[0] - projected(camera, pose, apply(world_from_board, wanted[:1]))) > 20:
            found = found[::-1]
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 50, 1e-4)
    found = cv2.cornerSubPix(grey, np.ascontiguousarray(found), (4, 4), (-1, -1), stop).reshape(-1, 2)
    off = found - projected(camera, pose, apply(world_from_board, wanted))
    assert np.linalg.norm(off.mean(axis=0)) < 0.03
    assert np.sqrt(np.mean(np.sum(off**2, axis=1))) < 0.08
