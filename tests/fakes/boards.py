"""A calibration board of 9 x 6 corners, 10 mm apart, and a picture of one."""

from __future__ import annotations

import cv2
import numpy as np

from daemon.calibration.board import Board

BOARD = Board(9, 6, 10.0)


def drawn_board(turned: bool = False, square_px: int = 36) -> np.ndarray:
    squares = np.add.outer(np.arange(7), np.arange(10)) % 2
    image = np.full((480, 640), 230, np.uint8)
    board = np.where(np.kron(squares, np.ones((square_px, square_px))) > 0, 230, 30).astype(np.uint8)
    image[100 : 100 + board.shape[0], 120 : 120 + board.shape[1]] = board
    image = cv2.GaussianBlur(image, (0, 0), 0.8)
    return image[::-1, ::-1].copy() if turned else image
