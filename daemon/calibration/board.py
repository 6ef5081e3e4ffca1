"""A chessboard or ChArUco board, and where an image shows it. Pure: image in, corners out, or the reason why not.

Corner numbers run along the rows of inner corners; the board frame lies in the first inner corner, x along a row,
y along a column, z into the board, mm.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from daemon.arrays import Array
from daemon.errors import FacetdError
from daemon.quantities import shown, whole

Grey = NDArray[np.uint8]

MOST_CORNERS = 100
SHARP_ENOUGH_PX = 2.5
"""Widest blur (sigma of the black-white edge) of which corners are still trusted."""


class BoardError(FacetdError):
    """The board is not usable in this image; the message says why, and what to do."""


@dataclass(frozen=True)
class Board:
    """columns x rows inner corners, square_mm a side; a ChArUco board has markers of marker_share of a square in its
    white squares (dictionary DICT_4X4_50) and may be seen in part."""

    columns: int
    rows: int
    square_mm: float
    kind: Literal["chessboard", "charuco"] = "chessboard"
    marker_share: float = 0.75

    def points_mm(self) -> Array:
        """(columns * rows, 3) inner corners in the board frame."""
        grid = np.mgrid[0 : self.columns, 0 : self.rows].T.reshape(-1, 2) * self.square_mm
        return np.column_stack([grid, np.zeros(len(grid))])

    def charuco(self) -> cv2.aruco.CharucoBoard:
        """The board as OpenCV knows it."""
        dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
        size = (self.columns + 1, self.rows + 1)
        return cv2.aruco.CharucoBoard(size, self.square_mm, self.square_mm * self.marker_share, dictionary)


@dataclass(frozen=True, eq=False)
class SeenBoard:
    """What one image shows of a board: corner_ids (N,) into Board.points_mm, corners_px (N, 2), blur_px."""

    corner_ids: NDArray[np.int64]
    corners_px: Array
    blur_px: float


def parse_board(text: str, square_mm: float, kind: Literal["chessboard", "charuco"] = "chessboard") -> Board:
    """`9x6` -> Board. Raises BoardError with what was expected."""
    columns, _, rows = text.lower().partition("x")
    expected = f"--board {shown(text)}: expected COLUMNSxROWS of inner corners, 3x3 or more, such as 9x6"
    try:
        counts = whole(columns), whole(rows)
    except ValueError:
        raise BoardError(expected) from None
    if min(counts) < 3 or max(counts) > MOST_CORNERS:
        raise BoardError(expected)
    if not square_mm > 0:
        raise BoardError(f"--square-mm {square_mm:g}: expected a length above 0")
    return Board(*counts, square_mm, kind)


def find_board(image: Grey, board: Board) -> SeenBoard:
    """Find the board's corners to sub-pixel. Raises BoardError: not in view, in part, too small, blurred, mirrored."""
    sight = _find_charuco(image, board) if board.kind == "charuco" else _find_chessboard(image, board)
    if sight.blur_px > SHARP_ENOUGH_PX:
        raise BoardError(
            f"blurred: edges {sight.blur_px:.1f} px wide, {SHARP_ENOUGH_PX:g} is the most; hold it still, or focus"
        )
    return sight


def _find_chessboard(image: Grey, board: Board) -> SeenBoard:
    size = (board.columns, board.rows)
    flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
    found, raw = cv2.findChessboardCorners(image, size, flags=flags)
    if not found:
        raise BoardError(
            f"no {board.columns}x{board.rows} board in view: all its inner corners must show, and a white rim"
        )
    corners = _refined(image, np.asarray(raw, np.float32).reshape(-1, 2), board)
    grid = corners.reshape(board.rows, board.columns, 2)
    if _upside_down(image, grid, board):
        corners = corners[::-1].copy()
    return SeenBoard(np.arange(len(corners)), corners, edge_blur_px(image, grid))


def _find_charuco(image: Grey, board: Board) -> SeenBoard:
    detector = cv2.aruco.CharucoDetector(board.charuco())
    raw, ids, *_ = detector.detectBoard(image)
    if ids is None or len(ids) < 8:
        seen = 0 if ids is None else len(ids)
        flipped, *_ = cv2.aruco.ArucoDetector(board.charuco().getDictionary()).detectMarkers(cv2.flip(image, 1))
        if len(flipped) > 2 * seen + 2:
            raise BoardError(
                "mirrored: its markers read backwards; unset the camera's flip, or the board was printed so"
            )
        raise BoardError(f"only {seen} of its corners in view, 8 are needed")
    order = np.argsort(ids.ravel())
    corners = _refined(image, np.asarray(raw, np.float32).reshape(-1, 2)[order], board)
    return SeenBoard(ids.ravel()[order].astype(np.int64), corners, _blur_at(image, corners))


def _refined(image: Grey, corners: NDArray[np.float32], board: Board) -> Array:
    """Sub-pixel corners; the window stays inside the squares next to each corner (saddle point, Foerstner)."""
    gaps = np.linalg.norm(corners[:, None] - corners[None], axis=2) + 1e9 * np.eye(len(corners), dtype=np.float32)
    nearest = float(np.median(gaps.min(axis=1)))
    if nearest < 8.0:
        raise BoardError(f"too small: its squares are {nearest:.0f} px wide, 8 is the least; bring it nearer")
    reach = int(np.clip(nearest * 0.3, 2, 7))
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 60, 1e-4)
    refined = cv2.cornerSubPix(image, corners.reshape(-1, 1, 2).copy(), (reach, reach), (-1, -1), criteria)
    return np.asarray(refined, float).reshape(-1, 2)


def _upside_down(image: Grey, grid: Array, board: Board) -> bool:
    """Whether the corners are numbered from the other end than a board with a black first square has them.

    Told by colour where the two ends differ (columns + rows odd); a symmetric board is numbered from the top left.
    """
    if (board.columns + board.rows) % 2 == 0:
        return bool(grid[0, 0].sum() > grid[-1, -1].sum())
    first, last = grid[:2, :2].mean(axis=(0, 1)), grid[-2:, -2:].mean(axis=(0, 1))
    return _brightness(image, first) > _brightness(image, last)


def _brightness(image: Grey, at_px: Array) -> float:
    return float(cv2.getRectSubPix(image, (3, 3), (float(at_px[0]), float(at_px[1]))).mean())


def edge_blur_px(image: Grey, grid: Array) -> float:
    """Sigma of the black-white edges between neighbouring corners (rows, columns, 2) px, median over the board."""
    middles = np.concatenate(
        [(grid[:, 1:] + grid[:, :-1]).reshape(-1, 2) / 2, (grid[1:] + grid[:-1]).reshape(-1, 2) / 2]
    )
    return _blur_at(image, middles, middle_of_edge=True)


def _blur_at(image: Grey, points_px: Array, middle_of_edge: bool = False) -> float:
    """Edge spread near points: range of grey over steepest slope, as the sigma of a Gaussian-blurred step.

    A step of height A blurred with sigma has slope A / (sigma sqrt(2 pi)) at its middle. At a corner all four edges
    meet, so the steepest slope around it is taken; either way the reach of the slope (variance 1/3) is taken out.
    """
    reach = 5 if middle_of_edge else 7
    sigmas = []
    for x, y in points_px:
        patch = cv2.getRectSubPix(image, (2 * reach + 1, 2 * reach + 1), (float(x), float(y))).astype(np.float32)
        slope = float(np.percentile(np.hypot(cv2.Sobel(patch, -1, 1, 0), cv2.Sobel(patch, -1, 0, 1)), 98)) / 8
        low, high = np.percentile(patch, (5, 95))
        if high - low > 15:
            sigmas.append((high - low) / max(slope, 1e-6) / np.sqrt(2 * np.pi))
    wide = float(np.median(sigmas)) if sigmas else np.inf
    return float(np.sqrt(max(wide**2 - 1 / 3, 0.0)))
