"""A calibration board (chessboard or ChArUco): its size, its print, the positions of its corners. Pure.

Corner numbers run along the rows of inner corners. The board frame has its origin at the first inner corner, x along a
row, y along a column, z into the board, mm.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from daemon.arrays import Array
from daemon.errors import FacetdError
from daemon.quantities import shown, whole

MAX_CORNERS = 100
USUAL_DICTIONARY = "DICT_4X4_50"
DICTIONARIES = tuple(
    sorted(name for name in dir(cv2.aruco) if name.startswith("DICT_") and isinstance(getattr(cv2.aruco, name), int))
)
"""Names of OpenCV's predefined dictionaries."""


def dictionary_named(name: str) -> cv2.aruco.Dictionary:
    """Return one of DICTIONARIES by name."""
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))


class BoardError(FacetdError):
    """The board is not usable in this image; the message says why, and what to do."""


@dataclass(frozen=True)
class Board:
    """columns x rows inner corners; square_mm: side of a square. A ChArUco board has markers in its white squares and
    may be partly visible; marker_share: width of a marker as a share of a square's; legacy: OpenCV's layout before 4.6,
    in which a board with an even number of rows of squares begins with a white square."""

    columns: int
    rows: int
    square_mm: float
    kind: Literal["chessboard", "charuco"] = "chessboard"
    marker_share: float = 0.75
    dictionary: str = USUAL_DICTIONARY
    legacy: bool = False

    def __str__(self) -> str:
        """The arguments of `calibrate` for this board: `9x6 16 charuco legacy DICT_5X5_100`."""
        return " ".join([f"{self.columns}x{self.rows} {self.square_mm:g}", *self.charuco_words])

    @property
    def charuco_words(self) -> list[str]:
        """The arguments of `calibrate` behind the size: `charuco`, `legacy`, the dictionary."""
        if self.kind == "chessboard":
            return []
        dictionary = [] if self.dictionary == USUAL_DICTIONARY else [self.dictionary]
        return ["charuco", *(["legacy"] if self.legacy else []), *dictionary]

    @property
    def markers(self) -> int:
        """Number of markers of a ChArUco board of this size."""
        return (self.columns + 1) * (self.rows + 1) // 2

    def points_mm(self) -> Array:
        """(columns * rows, 3) inner corners in the board frame."""
        grid = np.mgrid[0 : self.columns, 0 : self.rows].T.reshape(-1, 2) * self.square_mm
        return np.column_stack([grid, np.zeros(len(grid))])

    def drawing(self, squares: Array) -> NDArray[np.bool_]:
        """Whether the board is white at (..., 2) positions, in squares from the first inner corner."""
        cell = np.floor(squares).astype(int)
        if self.kind == "chessboard":
            return np.asarray(cell.sum(axis=-1) % 2 == 1)
        which, bits = _markers(self)
        column, row = np.clip(cell + 1, 0, np.array(which.shape)[::-1] - 1).T
        marker = which[row, column]
        modules = bits.shape[1]
        inside = (squares - cell - (1 - self.marker_share) / 2) / self.marker_share * modules
        on_marker = (marker >= 0) & ((inside >= 0) & (inside < modules)).all(axis=-1)
        x, y = np.clip(inside.astype(int), 0, modules - 1).T
        return np.asarray(np.where(on_marker, bits[marker, y, x], marker >= 0))

    def charuco(self) -> cv2.aruco.CharucoBoard:
        """OpenCV's object for this ChArUco board."""
        size, marker_mm = (self.columns + 1, self.rows + 1), self.square_mm * self.marker_share
        board = cv2.aruco.CharucoBoard(size, self.square_mm, marker_mm, dictionary_named(self.dictionary))
        board.setLegacyPattern(self.legacy)
        return board


@lru_cache(maxsize=8)
def _markers(board: Board) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Marker number of each square (rows, columns), -1 in black squares; modules of each marker with its black border,
    (markers, modules, modules), True where white."""
    dictionary, squares = dictionary_named(board.dictionary), marker_squares(board.columns, board.rows, board.legacy)
    which = np.full((board.rows + 1, board.columns + 1), -1)
    which[squares[:, 1], squares[:, 0]] = np.arange(len(squares))
    modules = dictionary.markerSize + 2
    drawn = [cv2.aruco.generateImageMarker(dictionary, one, modules) > 127 for one in range(len(squares))]
    return which, np.array(drawn)


def marker_squares(columns: int, rows: int, legacy: bool) -> NDArray[np.int64]:
    """(M, 2) column and row of the white square of each marker of a ChArUco board, in the order of their numbers."""
    row, column = np.divmod(np.arange((columns + 1) * (rows + 1)), columns + 1)
    white = (row + column + (legacy and rows % 2 == 1)) % 2 == 1
    return np.column_stack([column[white], row[white]])


@dataclass(frozen=True, eq=False)
class DetectedBoard:
    """A board detected in one image: corner_ids (N,) into Board.points_mm, corners_px (N, 2), blur_px."""

    corner_ids: NDArray[np.int64]
    corners_px: Array
    blur_px: float


def parse_board(text: str, square_mm: float, words: Sequence[str] = ()) -> Board:
    """`9x6` and further arguments (`charuco`, then `legacy`, a dictionary's name) -> Board. Raises BoardError."""
    columns, _, rows = text.lower().partition("x")
    expected = f"--board {shown(text)}: expected COLUMNSxROWS of inner corners, 3x3 or more, such as 9x6"
    try:
        counts = whole(columns), whole(rows)
    except ValueError:
        raise BoardError(expected) from None
    if min(counts) < 3 or max(counts) > MAX_CORNERS:
        raise BoardError(expected)
    if not square_mm > 0:
        raise BoardError(f"--square-mm {square_mm:g}: expected a length above 0")
    if not words:
        return Board(*counts, square_mm)
    kind, *further = words
    names = [name for word in further for name in DICTIONARIES if name == f"DICT_{word.upper().removeprefix('DICT_')}"]
    legacy = [word for word in further if word == "legacy"]
    if kind != "charuco" or len(names) + len(legacy) != len(further) or len(names) > 1 or len(legacy) > 1:
        raise BoardError(
            f"{shown(' '.join(words))}: expected `charuco`, then `legacy` for a layout from before OpenCV 4.6, and a "
            f"dictionary's name where it is not {USUAL_DICTIONARY}"
        )
    board = Board(*counts, square_mm, "charuco", dictionary=(names or [USUAL_DICTIONARY])[0], legacy=bool(legacy))
    available = len(dictionary_named(board.dictionary).bytesList)
    if available < board.markers:
        raise BoardError(
            f"{text} charuco: {board.markers} markers, {board.dictionary} has only {available}; "
            "name the board's own dictionary"
        )
    return board
