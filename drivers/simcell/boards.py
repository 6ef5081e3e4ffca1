"""Calibration boards to render: a chessboard or a ChArUco board, printed on a plate.

Board frame: origin at the outer corner of the first square, x along the row, y down the rows, z into the plate; mm.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from drivers.arrays import Array
from drivers.rigid import rigid
from drivers.simcell.optics import Array32
from drivers.simcell.parts import box, hull
from drivers.simcell.render import RenderedSolid
from drivers.simcell.textures import Pattern

WHITE, BLACK = 0.85, 0.06
PLATE_MM = 4.0
PIXELS_A_MODULE = 10
MARKER_MODULES = 6


@dataclass(frozen=True)
class BoardPrint:
    """The print: columns x rows squares of square_mm. charuco: with markers of DICT_4X4_50 in the white squares, three
    quarters of a square wide with their border.
    """

    columns: int = 10
    rows: int = 7
    square_mm: float = 16.0
    charuco: bool = False


def rendered_board(board: BoardPrint, world_from_board: Array) -> RenderedSolid:
    """The board as a plate with a white margin of one square. Raises cv2.error for a size ChArUco does not have."""
    margin = board.square_mm
    width, height = board.columns * board.square_mm, board.rows * board.square_mm
    plate = hull(box((-margin, -margin, 0.0), (width + margin, height + margin, PLATE_MM)))
    face = int(np.argmin(plate.normals[:, 2]))
    cells, cell_mm = _cells(board)
    return RenderedSolid(
        plate, world_from_board, WHITE, (Pattern(face, cells, cell_mm, rigid(np.eye(3), np.zeros(3))),)
    )


def _cells(board: BoardPrint) -> tuple[Array32, float]:
    """Albedo of each printed cell (rows, columns) and its size in mm."""
    if not board.charuco:
        row, column = np.indices((board.rows, board.columns))
        return np.where((row + column) % 2 == 0, BLACK, WHITE).astype(np.float32), board.square_mm
    modules = MARKER_MODULES * 4 // 3
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    charuco = cv2.aruco.CharucoBoard(
        (board.columns, board.rows), board.square_mm, board.square_mm * MARKER_MODULES / modules, dictionary
    )
    step = PIXELS_A_MODULE
    picture = charuco.generateImage((board.columns * modules * step, board.rows * modules * step), None, 0, 1)
    light = picture[step // 2 :: step, step // 2 :: step] > 127
    return np.where(light, WHITE, BLACK).astype(np.float32), board.square_mm / modules
