"""Detect a calibration board in an image, or say why not. Pure: image in, corners out.

Where the image shows another board than the named one, the message names it, by its markers or its squares.
"""

from collections.abc import Iterator
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from daemon.arrays import Array
from daemon.calibration.board import Board, BoardError, DetectedBoard, dictionary_named, marker_squares
from daemon.calibration.corners import NEIGHBOURS, WORST_MISFIT, FittedCorners, fit_corners, nearest_px

Grey = NDArray[np.uint8]

MIN_CORNERS = 8
SMALLEST_SQUARE_PX = 8.0
MIN_MODULE_PX = 2.0
"""A marker is read where its modules are so wide; where the image is sharp narrower ones, too."""
SHARP_ENOUGH_PX = 2.5
"""Widest blur (sigma of the black-white edge) of usable corners."""
SCALES = (1, 2)
"""The image is enlarged by the second factor where its markers are too small to read."""
SHARES = (0.5, 0.55, 0.6, 0.625, 0.65, 0.7, 0.75, 0.8, 0.85)
"""Usual widths of a marker as shares of a square."""
LARGEST_SHARE = SHARES[-1]
FITS_WELL = 0.05
"""Median misfit above which other marker sizes are tried."""
FAMILIES = (
    ("DICT_4X4_50", "DICT_4X4_100", "DICT_4X4_250", "DICT_4X4_1000"),
    ("DICT_5X5_50", "DICT_5X5_100", "DICT_5X5_250", "DICT_5X5_1000"),
    ("DICT_6X6_50", "DICT_6X6_100", "DICT_6X6_250", "DICT_6X6_1000"),
    ("DICT_7X7_50", "DICT_7X7_100", "DICT_7X7_250", "DICT_7X7_1000"),
    ("DICT_ARUCO_ORIGINAL",),
    ("DICT_APRILTAG_36h11",),
    ("DICT_APRILTAG_25h9",),
    ("DICT_ARUCO_MIP_36h12",),
)
"""Dictionaries that extend each other, the smallest first: a marker of the smallest is in all of its family."""
MIN_MARKERS = 6
MAX_BOARD_CORNERS = 23
"""Largest number of corners of a row or a column of the boards that are tried."""
MAX_MARKERS = (MAX_BOARD_CORNERS + 1) ** 2 // 2
OUTLIER_PASSES = 100
"""Passes of the search for outliers: of MIN_AGREEING four are picked together long before; OpenCV's 2,000 take most
of a search that finds nothing."""
OFF_SQUARES = 0.2
"""Largest distance, in squares, of a marker from its place in a layout."""
MIN_AGREEING = 0.8
"""Share of the markers in view that must fit a layout for the board to be of it."""
BESIDE = 0.6
"""Distance, in squares along rows and columns, of the middle of a marker from a corner of its square."""
MIN_SQUARES = 3
"""Squares of a row that must be in view for the row to count as printed, or as blank."""


def find_board(image: Grey, board: Board) -> DetectedBoard:
    """Find the board's corners to sub-pixel. Raises BoardError: not in view, partly in view, too small, blurred,
    mirrored, or another board than named."""
    return _find_charuco(image, board) if board.kind == "charuco" else _find_chessboard(image, board)


def _find_chessboard(image: Grey, board: Board) -> DetectedBoard:
    corners = _chessboard_corners(image, board.columns, board.rows)
    if corners is None:
        other = _named_by_markers(image, board) or _named_by_squares(image, board)
        missing = f"no {board.columns}x{board.rows} board in view: all its inner corners must show, and a white rim"
        raise BoardError(other or missing)
    grid = corners.reshape(board.rows, board.columns, 2)
    if _upside_down(image, grid, board):
        corners = corners[::-1].copy()
    grid = corners.reshape(board.rows, board.columns, 2)
    first, next_ = grid[:2, :2].mean(axis=(0, 1)), grid[:2, 1:3].mean(axis=(0, 1))
    white = _brightness(image, first) > _brightness(image, next_)
    fitted = _fitted(image, corners, np.arange(len(corners)), board, white)
    return _seen(image, np.arange(len(corners)), fitted, board)


def _chessboard_corners(image: Grey, columns: int, rows: int) -> Array | None:
    """(rows * columns, 2) px, roughly; None where such a chessboard does not show as a whole."""
    flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
    found, corners = cv2.findChessboardCorners(image, (columns, rows), flags=flags)
    return np.asarray(corners, float).reshape(-1, 2) if found else None


def _find_charuco(image: Grey, board: Board) -> DetectedBoard:
    ids, corners = _charuco_corners(image, board)
    if len(ids) < MIN_CORNERS:
        marker_px = MIN_MODULE_PX * (dictionary_named(board.dictionary).markerSize + 2)
        missing = (
            f"only {len(ids)} of its corners in view, {MIN_CORNERS} are needed: show more of it, or bring it nearer "
            f"until each marker is {marker_px:g} px wide"
        )
        raise BoardError(_named_by_markers(image, board) or _named_as_chessboard(image, board) or missing)
    fitted = _fitted(image, corners, ids, board)
    if np.median(fitted.misfit) > FITS_WELL:
        fitted = _fitted(image, corners, ids, _of_its_markers_size(image, corners, ids, board))
    sound = fitted.misfit < WORST_MISFIT
    if sound.any() and (other := _of_other_rows(image, fitted.corners_px[sound], ids[sound], board)) is not None:
        raise BoardError(other)
    return _seen(image, ids, fitted, board)


def _of_other_rows(image: Grey, corners: Array, ids: NDArray[np.int64], board: Board) -> str | None:
    """A message where the board in view has more or fewer rows than named: its markers are numbered alike, so only the
    squares beyond the last row tell. None where the rows are as named, or out of view."""
    found, _ = cv2.findHomography(board.points_mm()[ids, :2] / board.square_mm, corners)
    if found is None:
        return None
    squares_px = np.asarray(found, float)
    rows = [_row_levels(image, squares_px, board, row) for row in range(board.rows + 2)]
    seen = sorted({*(ids // board.columns), *(ids // board.columns + 1)})
    between = float(np.mean([np.median(np.concatenate([rows[row][k] for row in seen])) for k in (0, 1)]))
    for row in range(seen[-1] + 1, board.rows + 1):
        if len(rows[row][0]) >= MIN_SQUARES and (rows[row][0] > between).all():
            return _another(replace(board, rows=row - 1), f"its {row} rows of squares are those")
    black, white = rows[-1]
    if min(len(black), len(white)) >= MIN_SQUARES and (black < between).all() and (white > between).all():
        more = f"another board: its squares go on beyond the {board.rows + 1} rows of {board}; count its inner corners"
        return _named_by_markers(image, board) or more
    return None


def _row_levels(image: Grey, squares_px: Array, board: Board, row: int) -> tuple[Array, Array]:
    """Brightness in the middles of the black squares in view of a row, and of its white ones beside their markers."""
    column = np.arange(board.columns + 1)
    black = (column + row + (board.legacy and board.rows % 2 == 1)) % 2 == 0
    across = np.where(black, 0.5, (1 - LARGEST_SHARE) / 4) - 1
    px = cv2.perspectiveTransform(
        np.array([np.column_stack([column + across, np.full(len(column), row - 0.5)])]), squares_px
    )[0]
    x, y = np.round(px).astype(int).T
    inside = (x >= 0) & (y >= 0) & (x < image.shape[1]) & (y < image.shape[0])
    return image[y[inside & black], x[inside & black]], image[y[inside & ~black], x[inside & ~black]]


def _charuco_corners(image: Grey, board: Board) -> tuple[NDArray[np.int64], Array]:
    """Corner numbers (N,) and positions (N, 2) to a pixel, from the image or, where that shows too few, enlarged."""
    best: tuple[NDArray[np.int64], Array] = np.zeros(0, np.int64), np.zeros((0, 2))
    for scale in SCALES:
        markers, middles = _markers_in(_enlarged(image, scale), board.dictionary, board.markers)
        found = corners_beside(markers, (middles + 0.5) / scale - 0.5, board)
        if len(found[0]) > len(best[0]):
            best = found
        if len(best[0]) >= MIN_CORNERS and _readable(best[1], board):
            break
    return best


def _readable(corners: Array, board: Board) -> bool:
    """Whether the markers between these corners are wide enough for all of them to be read."""
    modules = dictionary_named(board.dictionary).markerSize + 2
    return float(np.median(nearest_px(corners))) * board.marker_share >= MIN_MODULE_PX * modules


def corners_beside(markers: NDArray[np.int64], middles: Array, board: Board) -> tuple[NDArray[np.int64], Array]:
    """Numbers (N,) of the corners next to a marker, and their positions by the middles (M, 2) px of the markers around
    them: independent of the markers' size, which is unknown, and of one misread marker."""
    squares_of = marker_squares(board.columns, board.rows, board.legacy)
    on_board = markers < len(squares_of)
    markers, px = markers[on_board], middles[on_board]
    ids, corners = list[int](), list[Array]()
    squares = squares_of[markers] - 0.5  # from the first inner corner to the middle of the square
    if len(squares) < 4 or np.linalg.svd(squares - squares.mean(axis=0), compute_uv=False)[-1] < 1.0:
        return np.zeros(0, np.int64), np.zeros((0, 2))
    as_named, other = (
        markers_agreeing(markers, px, board.columns, board.rows, one) for one in (board.legacy, not board.legacy)
    )
    if as_named < max(MIN_AGREEING * len(markers), other):
        return np.zeros(0, np.int64), np.zeros((0, 2))
    for k, corner in enumerate(board.points_mm()[:, :2] / board.square_mm):
        gaps = np.abs(squares - corner).max(axis=1)
        near = np.argsort(gaps, kind="stable")[:NEIGHBOURS]
        if gaps[near[0]] > BESIDE:
            continue
        found, _ = cv2.findHomography(squares[near], px[near], cv2.LMEDS)
        if found is not None:
            ids.append(k)
            corners.append(cv2.perspectiveTransform(corner[None, None], np.asarray(found, float))[0, 0])
    return np.array(ids, np.int64), np.array(corners, float).reshape(-1, 2)


def _enlarged(image: Grey, scale: int) -> Grey:
    if scale == 1:
        return image
    return np.asarray(cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC), np.uint8)


def _of_its_markers_size(image: Grey, corners: Array, ids: NDArray[np.int64], board: Board) -> Board:
    """The board with the marker size, of the usual ones, that fits some of the corners best."""
    some = np.unique(np.linspace(0, len(ids) - 1, MIN_CORNERS).astype(int))
    boards = [replace(board, marker_share=share) for share in SHARES]
    misfits = [np.median(_fitted(image, corners[some], ids[some], one).misfit) for one in boards]
    return boards[int(np.argmin(misfits))]


def _fitted(
    image: Grey, corners: Array, ids: NDArray[np.int64], board: Board, white_first: bool = False
) -> FittedCorners:
    """Sub-pixel corners; white_first: black and white are exchanged. Raises BoardError."""
    nearest = float(np.median(nearest_px(corners)))
    if nearest < SMALLEST_SQUARE_PX:
        raise BoardError(
            f"too small: its squares are {nearest:.0f} px wide, the minimum is {SMALLEST_SQUARE_PX:g}: bring it nearer"
        )

    def drawing(squares: Array) -> NDArray[np.bool_]:
        return board.drawing(squares) ^ white_first

    return fit_corners(image, corners, board.points_mm()[ids, :2] / board.square_mm, drawing)


def _seen(image: Grey, ids: NDArray[np.int64], fitted: FittedCorners, board: Board) -> DetectedBoard:
    """The corners that match the board's drawing. Raises BoardError."""
    if fitted.blur_px > SHARP_ENOUGH_PX:
        raise BoardError(
            f"blurred: edges {fitted.blur_px:.1f} px wide, the limit is {SHARP_ENOUGH_PX:g}: hold it still, or focus"
        )
    sound = fitted.misfit < WORST_MISFIT
    if (clear := int(sound.sum())) < MIN_CORNERS:
        few = f"only {clear} of its corners are clear, {MIN_CORNERS} are needed: glare, or covered?"
        raise BoardError(_named_by_markers(image, board) or few)
    return DetectedBoard(ids[sound], fitted.corners_px[sound], fitted.blur_px)


def _named_by_markers(image: Grey, board: Board) -> str | None:
    """A message that names the ChArUco board of the markers in view; None where there are too few, or it is the one
    named."""
    found = next((one for mirrored in (False, True) for one in _boards_in_view(image, board, mirrored)), None)
    if found is None:
        return None
    seen, mirrored, named = found
    if mirrored:
        return "mirrored: its markers read backwards; unset the camera's flip, or the board was printed so"
    if named == board:
        return None
    return _another(named, f"its {seen} markers are those")


def _another(named: Board, why: str) -> str:
    """The message that offers a ChArUco board."""
    options = {"legacy": "--legacy", "charuco": "--charuco"}
    shell = " ".join(options.get(word, f"--dictionary {word}") for word in named.charuco_words)
    layout = " in the layout from before OpenCV 4.6" if named.legacy else ""
    return (
        f"another board: {why} of a ChArUco board of {named.columns}x{named.rows} corners, "
        f"{named.dictionary}{layout}; give `{named}` (in a shell --board {named.columns}x{named.rows} {shell})"
    )


def _boards_in_view(image: Grey, board: Board, mirrored: bool) -> Iterator[tuple[int, bool, Board]]:
    """Boards that fit the markers in view, each with their number: the named one first, else the smallest."""
    picture = np.ascontiguousarray(image[:, ::-1]) if mirrored else image
    for family in FAMILIES:
        ids, middles = _markers_in(picture, family[-1], max(board.markers, MAX_MARKERS))
        if len(ids) < MIN_MARKERS:
            continue
        if (fit := best_layout(ids, middles, board)) is None:
            continue
        columns, rows, legacy = fit
        sized = replace(board, kind="charuco", columns=columns, rows=rows, legacy=legacy)
        for name in smallest_dictionary(family, sized.markers, board.dictionary):
            yield len(ids), mirrored, replace(sized, dictionary=name)


def best_layout(ids: NDArray[np.int64], middles: Array, board: Board) -> tuple[int, int, bool] | None:
    """Columns, rows, legacy of the layout that fits most markers, the named size first and then small ones."""
    sizes = [(board.columns, board.rows), (board.rows, board.columns)]
    for columns in range(3, MAX_BOARD_CORNERS + 1):
        # Further rows number the markers alike: the fewest that have all markers, or one more, where `legacy` counts.
        fewest = max(3, -(-2 * (int(ids.max()) + 1) // (columns + 1)) - 1)
        sizes += [(columns, rows) for rows in (fewest, fewest + 1) if rows <= MAX_BOARD_CORNERS]
    best, most = None, MIN_AGREEING * len(ids)
    for columns, rows in sizes:
        for legacy in (board.legacy, not board.legacy):
            agreeing = markers_agreeing(ids, middles, columns, rows, legacy)
            if agreeing > most:
                best, most = (columns, rows, legacy), agreeing
            if agreeing == len(ids):
                return best
    return best


def _markers_in(image: Grey, name: str, most: int) -> tuple[NDArray[np.int64], Array]:
    """Numbers (N,) and middles (N, 2) px of the markers in view, of the first `most` of a dictionary: to compare each
    candidate with more takes longer than all else."""
    # Of modules a few px wide only the middle is read: blur mixes the rim with the neighbours.
    parameters = cv2.aruco.DetectorParameters()
    parameters.perspectiveRemovePixelPerCell, parameters.perspectiveRemoveIgnoredMarginPerCell = 8, 0.3
    every = dictionary_named(name)
    dictionary = cv2.aruco.Dictionary(every.bytesList[:most], every.markerSize, every.maxCorrectionBits)
    detector = cv2.aruco.ArucoDetector(dictionary, parameters)
    corners, ids, _ = detector.detectMarkers(image)
    if ids is None:
        return np.zeros(0, np.int64), np.zeros((0, 2))
    return ids.ravel().astype(np.int64), np.array([np.reshape(c, (4, 2)).mean(axis=0) for c in corners], float)


def smallest_dictionary(family: tuple[str, ...], count: int, named: str) -> list[str]:
    """Return of a family of dictionaries the named one, or the smallest with so many markers."""
    if named in family:
        return [named]
    for name in family:
        if len(dictionary_named(name).bytesList) >= count:
            return [name]
    return []


def markers_agreeing(ids: NDArray[np.int64], middles: Array, columns: int, rows: int, legacy: bool) -> int:
    """Count the markers that fit a board of this size and layout, which numbers them along its white squares."""
    places = marker_squares(columns, rows, legacy)
    if ids.max() >= len(places) or len(np.unique(ids)) < len(ids):
        return 0
    squares_from_image, kept = cv2.findHomography(
        middles, places[ids].astype(float), cv2.RANSAC, OFF_SQUARES, maxIters=OUTLIER_PASSES
    )
    if squares_from_image is None or np.linalg.det(squares_from_image) <= 0:
        return 0
    return int(kept.sum())


def _named_by_squares(image: Grey, board: Board) -> str | None:
    """A message with the size of the chessboard in view; None where there is none, or it has the named size."""
    found = _squares_in_view(image)
    if found is None or sorted(found) == sorted((board.columns, board.rows)):
        return None
    columns, rows = found
    return (
        f"no {board.columns}x{board.rows} board in view, but one of {columns}x{rows} inner corners: count them along "
        "a row and a column; all must show, and a white rim"
    )


def _named_as_chessboard(image: Grey, board: Board) -> str | None:
    """A message that offers the chessboard in view; None where there is none, or its squares are not plain: a ChArUco
    board far away."""
    if (found := _squares_in_view(image)) is None:
        return None
    plain = Board(max(found), min(found), board.square_mm)
    try:
        clear = len(_find_chessboard(image, plain).corner_ids)
    except BoardError:
        return None
    if clear < plain.columns * plain.rows:
        return None
    shell = f"--board {plain.columns}x{plain.rows} without --charuco"
    return f"another board: a chessboard without markers; give `{plain}` (in a shell {shell})"


def _squares_in_view(image: Grey) -> tuple[int, int] | None:
    """Inner corners of the chessboard in view, along its rows and its columns. None where none shows: 3 x 3 of a larger
    board, or of any pattern, and in noise up to 3 x 5, are seen easily."""
    flags = cv2.CALIB_CB_LARGER | cv2.CALIB_CB_NORMALIZE_IMAGE
    found, _, meta = cv2.findChessboardCornersSBWithMeta(image, (3, 3), flags)
    if not found or meta is None or min(meta.shape[:2]) < 3 or meta.shape[:2] == (3, 3):
        return None
    rows, columns = meta.shape[:2]
    return None if _chessboard_corners(image, columns, rows) is None else (columns, rows)


def _upside_down(image: Grey, grid: Array, board: Board) -> bool:
    """Whether the corners are numbered from the wrong end: a board's first square is black.

    A board whose two ends have one colour (columns + rows even) is numbered from the top left.
    """
    if (board.columns + board.rows) % 2 == 0:
        return bool(grid[0, 0].sum() > grid[-1, -1].sum())
    first, last = grid[:2, :2].mean(axis=(0, 1)), grid[-2:, -2:].mean(axis=(0, 1))
    return _brightness(image, first) > _brightness(image, last)


def _brightness(image: Grey, at_px: Array) -> float:
    return float(cv2.getRectSubPix(image, (3, 3), (float(at_px[0]), float(at_px[1]))).mean())
