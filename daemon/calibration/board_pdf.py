"""A calibration board as a PDF page in true size, with marks that show whether the printer kept it.

In: a board and a paper. Out: a file of one page, of filled rectangles and lines of text (ISO 32000-1, 7.5 and 9.6.2).
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from daemon.arrays import Array
from daemon.calibration.board import Board, BoardError, parse_board
from daemon.quantities import decimal, within
from daemon.store.files import write_atomically
from daemon.store.outside import FileError

PAPERS_MM = {"a4": (210.0, 297.0), "a3": (297.0, 420.0), "a2": (420.0, 594.0), "letter": (215.9, 279.4)}
MARGIN_MM = 16.0
"""White round the board, at least: what printers cannot print, the marks, and the lines that name the board."""
MARK_MM, MARK_AWAY_MM, MARK_LONG_MM, LINE_MM = 100.0, 3.0, 4.0, 0.15
"""Distance of the two lines of a mark, their distance from the board, their length and width."""
POINTS_PER_MM = 72.0 / 25.4
TEXT_POINTS, TEXT_AWAY_MM, LINES_APART_MM = 7.0, 10.0, 3.0


def register(kinds: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add `facetctl calibrate board`."""
    parser = kinds.add_parser("board", help="a board to print, in true size")
    parser.add_argument("size", metavar="9x6", help="inner corners, columns x rows")
    parser.add_argument("square_mm", metavar="MM", type=within(decimal, 1, 1000), help="side of a square, mm")
    parser.add_argument("words", nargs="*", metavar="charuco", help="charuco, then legacy, a dictionary's name")
    parser.add_argument("--paper", choices=sorted(PAPERS_MM), default="a4", help="the paper (a4)")
    parser.add_argument("--out", type=Path, required=True, metavar="FILE", help="the PDF to write")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Write the PDF. Raises BoardError, FileError."""
    board = parse_board(args.size, args.square_mm, args.words)
    try:
        write_atomically(args.out, board_pdf(board, args.paper))
    except OSError as error:
        raise FileError(f"{args.out}: not written: {error.strerror or error}") from None
    print(f"written: {args.out}. Print it at 100 % (no `fit to page`) and glue it onto something flat and stiff.")
    print(f"Measure the marks with a caliper: {MARK_MM:g} mm each way. If both are M mm, the square to type is")
    print(f"{board.square_mm:g} * M / {MARK_MM:g}; if they differ from each other, print it with another printer.")
    return 0


def board_pdf(board: Board, paper: str) -> bytes:
    """The page, the board in its middle, the longer side along the paper's. Raises BoardError where it does not fit."""
    sheet = np.array(PAPERS_MM[paper])
    size = board.square_mm * np.array([board.columns + 1.0, board.rows + 1.0])
    if size[0] > size[1]:
        sheet = sheet[::-1]
    if (size > sheet - 2 * MARGIN_MM).any():
        most = np.min((sheet - 2 * MARGIN_MM) / (size / board.square_mm))
        raise BoardError(
            f"a board of {size[0]:g} x {size[1]:g} mm does not fit on {paper}; squares of {most:.1f} mm would"
        )
    corner = (sheet - size) / 2
    printed = np.vstack([black_mm(board), *marks_mm(size)]) + np.array([*corner, 0.0, 0.0])
    boxes = [f"{x:.4f} {sheet[1] - y - h:.4f} {w:.4f} {h:.4f} re" for x, y, w, h in printed]
    text = [
        f"{board} (inner corners, side of a square in mm). Print at 100 %.",
        f"The two pairs of marks are {MARK_MM:g} mm apart: measure them. If they are M mm apart, type "
        f"{board.square_mm:g} * M / {MARK_MM:g} as the side of a square.",
    ]
    font = f"/F1 {TEXT_POINTS / POINTS_PER_MM:.4f} Tf"
    starts = [f"{corner[0]:.2f} {corner[1] - TEXT_AWAY_MM - LINES_APART_MM * k:.2f} Td" for k in range(len(text))]
    escaped = [line.replace("(", "\\(").replace(")", "\\)") for line in text]
    lines = [f"BT {font} {start} ({line}) Tj ET" for start, line in zip(starts, escaped, strict=True)]
    scale = f"{POINTS_PER_MM:.10f} 0 0 {POINTS_PER_MM:.10f} 0 0 cm"
    return _file(sheet * POINTS_PER_MM, "\n".join([scale, "0 g", *boxes, "f", *lines]).encode("ascii"))


def black_mm(board: Board) -> Array:
    """(N, 4) mm, the black rectangles: x, y of the upper left corner from the board's, y down; width, height."""
    return board.square_mm * np.array([*_black_squares(board)])


def _black_squares(board: Board) -> Iterator[tuple[float, float, float, float]]:
    modules = 0 if board.kind == "chessboard" else board.charuco().getDictionary().markerSize + 2
    edge = (1 - board.marker_share) / 2
    step = board.marker_share / max(modules, 1)
    inside = edge + step * (np.arange(modules) + 0.5)
    for row, column in np.ndindex(board.rows + 1, board.columns + 1):
        first_corner = np.array([column - 1.0, row - 1.0])
        if not board.drawing(first_corner[None] + edge / 2)[0]:
            yield column, row, 1.0, 1.0
            continue
        for k, y in enumerate(inside):
            white = board.drawing(first_corner + np.column_stack([inside, np.full(modules, y)]))
            ends = np.flatnonzero(np.diff([1, *white.astype(int), 1]))
            for begin, end in ends.reshape(-1, 2):
                yield column + edge + step * begin, row + edge + step * k, step * (end - begin), step


def marks_mm(size: Array) -> Iterator[Array]:
    """(2, 4) each: the lines of the mark under the board, then of that beside it; as black_mm."""
    for along in (0, 1):
        if size[along] < MARK_MM:
            continue
        lines = np.zeros((2, 4))
        lines[:, along] = (size[along] - MARK_MM) / 2 + np.array([0.0, MARK_MM]) - LINE_MM / 2
        lines[:, 1 - along] = size[1 - along] + MARK_AWAY_MM
        lines[:, 2 + along], lines[:, 3 - along] = LINE_MM, MARK_LONG_MM
        yield lines


def _file(size_points: Array, content: bytes) -> bytes:
    """A PDF of one page of this size with this content."""
    objects = [
        b"<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>",
        b"<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
        b"<< /Type /Page /Parent 2 0 R /MediaBox [0 0 %.4f %.4f] /Contents 4 0 R " % tuple(size_points)
        + b"/Resources << /Font << /F1 5 0 R >> >> >>",
        b"<< /Length %d >>\nstream\n%s\nendstream" % (len(content), content),
        b"<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica >>",
    ]
    made, starts = bytearray(b"%PDF-1.4\n"), []
    for number, body in enumerate(objects, start=1):
        starts.append(len(made))
        made += b"%d 0 obj\n%s\nendobj\n" % (number, body)
    table = b"".join(b"%010d 00000 n \n" % start for start in starts)
    count = len(objects) + 1
    end = b"xref\n0 %d\n0000000000 65535 f \n%strailer\n<< /Size %d /Root 1 0 R >>\nstartxref\n%d\n%%%%EOF\n"
    return bytes(made + end % (count, table, count, len(made)))
