"""Boards in pictures: found, numbered, refused with the reason."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from daemon import frames
from daemon.calibration.board import DICTIONARIES, MAX_CORNERS, Board, BoardError, marker_squares, parse_board
from daemon.calibration.board_detection import (
    FAMILIES,
    MIN_CORNERS,
    best_layout,
    corners_beside,
    find_board,
    markers_agreeing,
    smallest_dictionary,
)
from tests.fakes.boards import BOARD, Painter, drawn_board, tilted
from tests.fakes.chosen import few
from tests.fakes.rigs import rig


def blurred(image: np.ndarray, sigma_px: float) -> np.ndarray:
    return cv2.GaussianBlur(image, (0, 0), sigma_px)


def test_corners_are_numbered_from_the_black_end_however_the_board_is_turned() -> None:
    upright, turned = find_board(drawn_board(), BOARD), find_board(drawn_board(turned=True), BOARD)
    np.testing.assert_allclose(upright.corners_px[0], [155.5, 135.5], atol=0.05)
    np.testing.assert_allclose(turned.corners_px[0], [639 - 155.5, 479 - 135.5], atol=0.05)
    assert upright.blur_px == pytest.approx(0.8, abs=0.25)


def test_a_blurred_and_a_half_hidden_board_each_get_their_reason() -> None:
    with pytest.raises(BoardError, match="blurred"):
        find_board(blurred(drawn_board(), 4.0), BOARD)
    half = drawn_board()
    half[:, 300:] = 230
    with pytest.raises(BoardError, match="no 9x6 board in view"):
        find_board(half, BOARD)


@pytest.mark.parametrize("text", ["9", "9x", "x6", "2x6", "9x2", "9x6x3", "-9x6", f"{MAX_CORNERS + 1}x6"])
def test_a_malformed_board_size_says_what_was_expected(text: str) -> None:
    with pytest.raises(BoardError, match="expected COLUMNSxROWS"):
        parse_board(text, 10.0)


def test_the_least_and_the_largest_board_are_boards_and_a_square_without_a_length_is_none() -> None:
    assert MAX_CORNERS == 100, "as facetctl's page says"
    assert parse_board(f"3X{MAX_CORNERS}", 1e-3) == Board(3, MAX_CORNERS, 1e-3)
    assert all(name.startswith("DICT_") for name in DICTIONARIES)
    for square_mm in (0.0, -1.0, np.nan):
        with pytest.raises(BoardError, match="expected a length above 0"):
            parse_board("9x6", square_mm)


def test_a_board_needs_as_many_markers_as_its_dictionary_has() -> None:
    assert parse_board("9x9", 10.0, ["charuco", "4x4_50"]).dictionary == "DICT_4X4_50"  # 50 of 100 squares
    with pytest.raises(BoardError, match="55 markers, DICT_4X4_50 has only 50"):
        parse_board("10x9", 10.0, ["charuco", "4x4_50"])


RIG = rig(centres_px=((322.7, 241.0), (316.8, 237.4)))


@pytest.mark.parametrize(
    ("board", "distance_mm", "blur_px"),
    few(
        [
            (Board(9, 7, 16.0), 450.0, 1.2),
            (Board(9, 6, 16.0, "charuco"), 330.0, 0.6),
            (Board(9, 6, 16.0, "charuco", 0.5), 400.0, 0.9),  # modules 2 px wide
            (Board(8, 5, 16.0, "charuco", 0.6, legacy=True), 360.0, 0.7),
            (Board(9, 6, 16.0, "charuco", 0.8, "DICT_5X5_100"), 360.0, 0.7),
            (Board(9, 6, 16.0, "charuco", 0.5), 300.0, 0.9),
            (Board(9, 6, 16.0), 300.0, 0.5),
        ],
        5,
    ),
    ids=str,
)
def test_corners_are_where_they_are_whatever_is_printed_beside_them(
    board: Board, distance_mm: float, blur_px: float, capfd: pytest.CaptureFixture[str]
) -> None:
    rng = np.random.default_rng(4)
    painter = Painter(RIG.left, board, blur_px=blur_px)
    pose = tilted(board, rng, distance_mm)
    named = replace(board, marker_share=0.75)  # nobody says how large its markers are
    image = painter.picture(pose, rng)
    capfd.readouterr()
    seen = find_board(image, named)
    assert capfd.readouterr() == ("", ""), "OpenCV prints what it thinks of a marker's size"
    true_px = RIG.left.project(frames.apply(pose, board.points_mm()))[seen.corner_ids]
    off = seen.corners_px - true_px
    assert len(seen.corner_ids) > 0.6 * board.columns * board.rows
    assert np.sqrt((off**2).mean()) < 0.02
    assert np.abs(off.mean(axis=0)).max() < 0.006
    assert seen.blur_px == pytest.approx(blur_px, abs=0.15)


def picture(board: Board, distance_mm: float = 360.0) -> np.ndarray:
    rng = np.random.default_rng(1)
    return Painter(RIG.left, board).picture(tilted(board, rng, distance_mm), rng)


@pytest.mark.parametrize(
    ("printed", "named", "offered"),
    few(
        [
            (Board(8, 5, 16.0, "charuco", legacy=True), Board(8, 5, 16.0, "charuco"), "8x5 16 charuco legacy"),
            (
                Board(9, 6, 16.0, "charuco", dictionary="DICT_5X5_50"),
                Board(9, 6, 16.0, "charuco"),
                "9x6 16 charuco DICT_5X5_50",
            ),
            (Board(7, 5, 16.0, "charuco"), Board(9, 6, 16.0, "charuco"), "7x5 16 charuco"),
            (Board(9, 6, 16.0, "charuco"), Board(9, 6, 16.0), "9x6 16 charuco"),
            (Board(7, 6, 16.0), Board(9, 6, 16.0), "7x6 inner corners"),
            (Board(7, 5, 16.0), Board(9, 6, 16.0, "charuco"), "a chessboard without markers; give `7x5 16`"),
            (Board(9, 9, 12.0, "charuco"), Board(9, 6, 12.0, "charuco"), "9x9 12 charuco"),
            (Board(9, 6, 12.0, "charuco"), Board(9, 9, 12.0, "charuco"), "9x6 12 charuco"),
            (Board(9, 9, 12.0, "charuco"), Board(9, 8, 12.0, "charuco"), "9x9 12 charuco"),
        ],
        8,
    ),
    ids=str,
)
def test_a_board_that_is_another_than_was_named_is_named(printed: Board, named: Board, offered: str) -> None:
    with pytest.raises(BoardError) as error:
        find_board(picture(printed), named)
    assert offered in str(error.value)
    assert "mirrored" not in str(error.value)


def test_a_charuco_board_too_far_away_to_read_is_not_called_a_chessboard() -> None:
    printed = Board(9, 6, 16.0, "charuco")
    with pytest.raises(BoardError, match="bring it nearer until each marker is 12 px wide"):
        find_board(picture(printed, 1200.0), printed)


@pytest.mark.parametrize(("markers", "dictionary"), [(50, "4X4_50"), (51, "4X4_100"), (1000, "4X4_1000")])
def test_the_dictionary_of_a_board_that_nobody_named_is_the_smallest_that_has_its_markers(
    markers: int, dictionary: str
) -> None:
    (family,) = (names for names in FAMILIES if "DICT_4X4_50" in names)
    assert smallest_dictionary(family, markers, "") == [f"DICT_{dictionary}"]
    assert smallest_dictionary(family, 1001, "") == []


@pytest.mark.parametrize("legacy", few([True, False], 1))
def test_a_board_of_more_rows_is_another_even_where_its_markers_exceed_the_named_dictionary(legacy: bool) -> None:
    """9x9 has all 50 markers of its dictionary: what goes on beyond it are squares."""
    named = Board(9, 9, 9.0, "charuco", legacy=legacy)
    printed = Board(9, 11, 9.0, "charuco", dictionary="DICT_4X4_100", legacy=legacy)
    with pytest.raises(BoardError, match="another board"):
        find_board(picture(printed), named)
    assert len(find_board(picture(named), named).corner_ids) > MIN_CORNERS


def test_a_board_of_which_one_row_is_covered_with_paper_is_named_as_what_shows() -> None:
    """Its corners would be where they are; a person who covers none, or names what shows, gets on."""
    board = Board(9, 6, 16.0, "charuco")
    drawn = np.pad(board.charuco().generateImage((400, 280)), 40, constant_values=255)
    image = blurred(drawn, 0.7)
    assert len(find_board(image, board).corner_ids) == 54
    image[280:] = 255
    with pytest.raises(BoardError, match="give `9x5 16 charuco`"):
        find_board(image, board)
    image[280:] = 20  # a dark sleeve
    assert len(find_board(image, board).corner_ids) >= 40


def test_only_a_mirrored_picture_is_called_mirrored() -> None:
    board = Board(9, 6, 16.0, "charuco")
    image = picture(board)
    assert len(find_board(image, board).corner_ids) == 54
    with pytest.raises(BoardError, match="mirrored"):
        find_board(np.ascontiguousarray(image[:, ::-1]), board)
    with pytest.raises(BoardError, match="only 0 of its corners"):
        find_board(np.full_like(image, 128), board)


@pytest.mark.parametrize(("columns", "rows", "legacy"), [(8, 7, True), (8, 7, False), (12, 5, True), (5, 11, False)])
def test_the_smallest_layout_that_numbers_the_markers_in_view_is_found_as_by_trying_every_one(
    columns: int, rows: int, legacy: bool
) -> None:
    squares = marker_squares(columns, rows, legacy)
    ids = np.arange(5, len(squares) - 3)
    middles = squares[ids] @ [[7.0, 2.0], [-2.0, 7.0]] + 100.0
    middles[2] += 60.0  # of 20 or more one is misread
    named = Board(9, 6, 16.0, "charuco")
    every = [(c, r, old) for c in range(3, 14) for r in range(3, 14) for old in (False, True)]
    agreeing = [markers_agreeing(ids, middles, *one) for one in every]
    assert max(agreeing) == len(ids) - 1
    assert best_layout(ids, middles, named) == every[int(np.argmax(agreeing))]


@pytest.mark.parametrize("seed", few([0, 4, 6], 1))
def test_where_few_markers_are_wide_enough_the_others_are_read_in_the_enlarged_image(seed: int) -> None:
    """Eight corners were enough to look no further, and then one of them was not clear."""
    board, rng = Board(9, 6, 16.0, "charuco"), np.random.default_rng(seed)
    image = Painter(RIG.left, board, blur_px=0.6).picture(tilted(board, rng, 800.0), rng)
    assert len(find_board(image, board).corner_ids) >= 44


def test_three_by_three_corners_of_any_pattern_are_no_board_of_that_size() -> None:
    """OpenCV finds so many in noise, and by its own dice a row or two more: thrown so, 4 x 3."""
    noise = np.random.default_rng(3).integers(0, 255, (480, 640)).astype(np.uint8)
    noise = np.asarray(cv2.resize(noise, (1280, 960), interpolation=cv2.INTER_CUBIC), np.uint8)
    cv2.setRNGSeed(23758)
    with pytest.raises(BoardError, match="no 9x6 board in view: all its inner corners must show"):
        find_board(noise, Board(9, 6, 16.0))


def test_a_charuco_board_whose_markers_hide_most_corners_of_a_chessboard_is_named() -> None:
    printed = Board(9, 6, 16.0, "charuco", dictionary="DICT_5X5_100")
    rng = np.random.default_rng(12)
    pose = tilted(printed, rng, rng.uniform(260, 420))
    with pytest.raises(BoardError, match="give `9x6 16 charuco DICT_5X5_50`"):
        find_board(Painter(RIG.left, printed).picture(pose, rng), Board(9, 6, 16.0))


@pytest.mark.parametrize("legacy", [False, True])
@pytest.mark.parametrize(("columns", "rows"), [(9, 6), (6, 9), (7, 5), (4, 4)])
def test_markers_in_view_agree_with_the_layout_that_numbers_them_and_no_other(
    columns: int, rows: int, legacy: bool
) -> None:
    """The layout is OpenCV's own; the picture turned, smaller, and with a marker that is misread."""
    printed = Board(columns, rows, 1.0, "charuco", legacy=legacy).charuco()
    middles = np.array([np.asarray(corners)[:, :2].mean(axis=0) for corners in printed.getObjPoints()])
    ids, middles = np.arange(len(middles)), middles @ [[7.0, 2.0], [-2.0, 7.0]] + 100.0
    assert markers_agreeing(ids, middles, columns, rows, legacy) == len(ids)
    assert markers_agreeing(ids[2:7], middles[2:7], columns, rows, legacy) == 5
    misread = np.concatenate([ids[:-3], ids[-2:], ids[-3:-2]])
    assert markers_agreeing(misread, middles, columns, rows, legacy) == len(ids) - 3
    assert markers_agreeing(ids, middles * [-1.0, 1.0], columns, rows, legacy) == 0
    assert markers_agreeing(ids, middles, columns, rows - 1, legacy) == 0  # of more markers than the board has
    assert markers_agreeing(np.append(ids, ids[0]), np.vstack([middles, middles[:1]]), columns, rows, legacy) == 0
    assert markers_agreeing(ids, middles, columns + 1, rows, legacy) < len(ids)
    assert (markers_agreeing(ids, middles, columns, rows, not legacy) == len(ids)) is (rows % 2 == 0)


def test_eight_corners_of_a_charuco_board_are_enough_and_four_are_not() -> None:
    board, square_px = Board(4, 6, 10.0, "charuco"), 40
    whole = np.pad(board.charuco().generateImage((5 * square_px, 7 * square_px)), square_px, constant_values=255)
    image = blurred(whole, 0.7)
    image[square_px * 5 // 2 + square_px :] = 60
    assert len(find_board(image, board).corner_ids) == 8
    image[square_px * 3 // 2 + square_px :] = 60
    with pytest.raises(BoardError, match="only 0 of its corners in view, 8 are needed"):
        find_board(image, board)


@pytest.mark.parametrize("legacy", [False, True])
def test_corners_are_sought_beside_markers_whatever_their_size_and_though_some_are_misread(legacy: bool) -> None:
    board = Board(9, 6, 16.0, "charuco", legacy=legacy)
    middles_mm = (
        np.array([np.asarray(corners)[:, :2].mean(axis=0) for corners in board.charuco().getObjPoints()]) - 16.0
    )

    def seen(points_mm: np.ndarray) -> np.ndarray:
        return np.asarray(points_mm @ [[1.2, 0.2], [-0.2, 1.2]] + [200.0, 150.0])

    rng = np.random.default_rng(2)
    markers, middles = np.arange(len(middles_mm)), seen(middles_mm) + rng.uniform(-0.3, 0.3, middles_mm.shape)
    middles[[4, 20]] += [9.0, -7.0]
    stray = np.append(markers, 40), np.vstack([middles, [[5.0, 5.0]]])  # 40 is not on the board
    ids, corners = corners_beside(*stray, board)
    assert list(ids) == list(range(54))
    assert np.linalg.norm(corners - seen(board.points_mm()[:, :2]), axis=1).max() < 1.5
    few, _ = corners_beside(markers[[0, 9, 10, 1]], middles[[0, 9, 10, 1]], board)
    assert 4 < len(few) < 16
    assert len(corners_beside(markers[:5], middles[:5], board)[0]) == 0, "markers in one row place nothing across it"


def test_a_corner_that_glare_covers_is_left_out_and_the_others_stay() -> None:
    board = Board(9, 6, 16.0)
    image = picture(board)
    whole = find_board(image, board)
    x, y = np.round(whole.corners_px[20]).astype(int)
    cv2.circle(image, (x + 4, y + 3), 5, 255, -1)
    seen = find_board(image, board)
    assert len(seen.corner_ids) < len(whole.corner_ids)
    both = np.isin(whole.corner_ids, seen.corner_ids)
    np.testing.assert_allclose(seen.corners_px, whole.corners_px[both], atol=0.1)


@pytest.mark.parametrize(
    "words", [["chess"], ["charuco", "legcy"], ["charuco", "DICT_4X4"], ["charuco", "4X4_50", "x"]]
)
def test_words_of_a_board_that_mean_nothing_are_told_with_what_was_expected(words: list[str]) -> None:
    with pytest.raises(BoardError, match="expected `charuco`"):
        parse_board("9x6", 10.0, words)
    assert parse_board("9x6", 10.0, ["charuco", "5x5_100", "legacy"]).dictionary == "DICT_5X5_100"
