"""Boards in pictures: found, numbered, refused with the reason."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from daemon.calibration.board import BoardError, find_board, parse_board
from tests.fakes.boards import BOARD, drawn_board


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
