"""Draw facets with characters, for terminals without graphics. Pure: corners in, text out."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from daemon.arrays import Array

COLUMNS, ROWS = 60, 16
CELL_ASPECT = 2.0  # a character cell is about twice as high as wide


def sketch(outlines: Sequence[tuple[Array, str]], columns: int) -> str:
    """Draw closed outlines (N, 2) px, each with a short name in its middle, as large as a terminal's width allows."""
    if not outlines:
        return ""
    columns = min(columns - 1, COLUMNS)
    every = np.concatenate([corners for corners, _ in outlines])
    low, span = every.min(axis=0), np.maximum(np.ptp(every, axis=0), 1e-9)
    scale = min((columns - 1) / span[0], (ROWS - 1) * CELL_ASPECT / span[1])
    canvas = np.full((ROWS, columns), " ")
    for corners, _ in outlines:
        at = _cells(corners, low, scale)
        for start, end in zip(at, np.roll(at, -1, axis=0), strict=True):
            _draw_line(canvas, start, end)
    for corners, name in outlines:
        column, row = np.rint(_cells(corners, low, scale).mean(axis=0)).astype(int)
        column = max(0, min(column, columns - len(name)))
        canvas[row, column : column + len(name)] = list(name)
    lines = ["".join(row).rstrip() for row in canvas]
    return "\n".join(lines).strip("\n")


def _cells(corners: Array, low: Array, scale: float) -> Array:
    return (corners - low) * scale / [1.0, CELL_ASPECT]


def _draw_line(canvas: NDArray[np.str_], start: Array, end: Array) -> None:
    across, down = end - start
    slope = abs(down) * CELL_ASPECT / max(abs(across), 1e-9)
    stroke = "-" if slope < 0.4 else "|" if slope > 2.5 else "\\" if across * down > 0 else "/"
    steps = int(max(abs(across), abs(down))) + 1
    for column, row in np.rint(np.linspace(start, end, steps + 1)).astype(int):
        canvas[row, column] = stroke
    for column, row in np.rint([start, end]).astype(int):
        canvas[row, column] = "+"
