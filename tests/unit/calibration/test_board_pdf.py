"""A printed board is the one that is looked for, in true size, and its file is one that a viewer opens."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from daemon.calibration.board import Board, BoardError, parse_board
from daemon.calibration.board_detection import find_board
from daemon.calibration.board_pdf import MARK_MM, PAPERS_MM, POINTS_PER_MM, black_mm, board_pdf, marks_mm
from daemon.ctl import main
from tests.fakes.chosen import few

PX_PER_MM = 6.0
BOARDS = [
    ("9x6", 24.0, ()),
    ("9x6", 24.0, ("charuco",)),
    ("8x5", 25.0, ("charuco", "legacy")),
    ("7x4", 30.0, ("charuco", "DICT_5X5_100")),
    ("5x8", 20.0, ("charuco", "DICT_APRILTAG_36H11")),
]


def boxes_of(page: bytes) -> np.ndarray:
    """(N, 4) x, y from the page's upper left corner, width, height, mm."""
    height = float(re.search(rb"/MediaBox \[0 0 \S+ (\S+)\]", page)[1]) / POINTS_PER_MM
    found = np.array([[float(x) for x in m.split()] for m in re.findall(rb"^(\S+ \S+ \S+ \S+) re$", page, re.M)])
    found[:, 1] = height - found[:, 1] - found[:, 3]
    return found


def drawn(boxes: np.ndarray, size_mm: np.ndarray) -> np.ndarray:
    """The page as a picture, black where it is printed, each pixel by how much of it is."""
    fine = 2
    width, height = np.ceil(size_mm * PX_PER_MM * fine).astype(int) // fine * fine
    image = np.full((height, width), 235.0)
    for x, y, w, h in np.round(boxes * PX_PER_MM * fine).astype(int):
        image[y : y + h, x : x + w] = 20.0
    return image.reshape(height // fine, fine, width // fine, fine).mean((1, 3)).astype(np.uint8)


@pytest.mark.parametrize(("size", "square", "words"), few(BOARDS, 3))
def test_a_printed_board_is_found_where_it_was_drawn(size: str, square: float, words: tuple[str, ...]) -> None:
    board = parse_board(size, square, words)
    page = board_pdf(board, "a3")
    sheet = np.array(PAPERS_MM["a3"])
    sheet = sheet[::-1] if board.columns > board.rows else sheet
    seen = find_board(drawn(boxes_of(page), sheet), board)
    assert len(seen.corner_ids) == board.columns * board.rows
    corner = (sheet - square * np.array([board.columns + 1, board.rows + 1])) / 2
    true_mm = board.points_mm()[seen.corner_ids, :2] + corner + square
    off_mm = (seen.corners_px + 0.5) / PX_PER_MM - true_mm
    if not words:  # a chessboard of 9 by 6 may be numbered from either end
        turned = board.points_mm()[::-1][seen.corner_ids, :2] + corner + square
        off_mm = min(off_mm, (seen.corners_px + 0.5) / PX_PER_MM - turned, key=lambda off: np.abs(off).max())
    assert np.abs(off_mm).max() < 0.1


@pytest.mark.parametrize(("size", "square", "words"), BOARDS)
def test_black_and_white_share_the_board_as_its_drawing_has_them(
    size: str, square: float, words: tuple[str, ...]
) -> None:
    board = parse_board(size, square, words)
    boxes = black_mm(board)
    rng = np.random.default_rng(0)
    at = rng.uniform(0, 1, (4000, 2)) * [board.columns + 1, board.rows + 1]
    low, high = boxes[:, :2] / square, (boxes[:, :2] + boxes[:, 2:]) / square
    black = np.any(np.all((at[:, None] >= low) & (at[:, None] < high), axis=2), axis=1)
    assert (black != board.drawing(at - 1)).all()


def test_the_marks_are_apart_as_they_say_and_off_the_board() -> None:
    size = np.array([240.0, 168.0])
    across, down = marks_mm(size)
    middle = np.stack([m[:, :2] + m[:, 2:] / 2 for m in (across, down)])
    assert np.diff(middle[0, :, 0]) == pytest.approx(MARK_MM)
    assert np.diff(middle[1, :, 1]) == pytest.approx(MARK_MM)
    assert across[:, 1].min() > size[1]
    assert down[:, 0].min() > size[0]
    assert [*marks_mm(np.array([90.0, 90.0]))] == []


def test_the_file_is_a_pdf_whose_table_leads_to_its_objects() -> None:
    page = board_pdf(Board(9, 6, 24.0), "a4")
    assert page.startswith(b"%PDF-1.4\n")
    assert page.endswith(b"%%EOF\n")
    start = int(re.search(rb"startxref\n(\d+)\n", page)[1])
    assert page[start : start + 4] == b"xref"
    offsets = [int(offset) for offset in re.findall(rb"^(\d{10}) 00000 n $", page, re.M)]
    assert [page[at : at + 7] for at in offsets] == [b"%d 0 obj" % number for number in range(1, 6)]
    length = int(re.search(rb"/Length (\d+)", page)[1])
    stream = page.index(b"stream\n") + 7
    assert page[stream + length : stream + length + 10] == b"\nendstream"
    width, height = re.search(rb"/MediaBox \[0 0 (\S+) (\S+)\]", page).groups()
    assert (float(width), float(height)) == pytest.approx((841.89, 595.28), abs=0.01)
    assert b"/PrintScaling /None" in page


def test_a_board_that_does_not_fit_is_refused_with_the_square_that_would() -> None:
    with pytest.raises(BoardError, match=r"300 x 210 mm does not fit on a4; squares of 25\.4 mm would"):
        board_pdf(Board(9, 6, 30.0), "a4")


def test_it_is_written_from_the_shell(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "board.pdf"
    assert main(["calibrate", "board", "9x6", "24", "charuco", "--out", str(out)]) == 0
    assert out.read_bytes() == board_pdf(parse_board("9x6", 24.0, ["charuco"]), "a4")
    assert "24 * M / 100" in capsys.readouterr().out
    assert main(["calibrate", "board", "9x6", "24", "--out", str(out / "board.pdf")]) != 0
    assert "board.pdf: not written: File exists" in capsys.readouterr().err
