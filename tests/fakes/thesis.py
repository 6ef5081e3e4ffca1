"""What the thesis printed, as figures: its patterns of section 5.6, its silhouettes of 4.1 (drawn here), its table 5.7.

Source: D'Souza, sections 4.1, 5.1, 5.5, 5.6, figures 5.7, 5.20, 5.25, 5.26. Type numbers 0.3, 0.5, 0.75 and alpha 0.01
are not printed there; they are what makes the printed activations come out.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from daemon.arrays import Array

TRIANGLE, RECTANGLE, PENTAGON = 0.3, 0.5, 0.75
ALPHA = 0.01


def matrix(types: Sequence[float], touching: Sequence[tuple[int, int]]) -> Array:
    """Row r holds the type of facet r where it touches; in six slots."""
    result = np.zeros((6, 6))
    for p, q in touching:
        result[p, q], result[q, p] = types[p], types[q]
    return result


PRISM = matrix([TRIANGLE, RECTANGLE, RECTANGLE], [(0, 1), (0, 2), (1, 2)])
PENTAGONAL_PRISM_TWO_SIDES = matrix([RECTANGLE, RECTANGLE, PENTAGON], [(0, 1), (0, 2), (1, 2)])
PENTAGONAL_PRISM_THREE_SIDES = matrix(
    [PENTAGON, RECTANGLE, RECTANGLE, RECTANGLE], [(0, 1), (0, 2), (0, 3), (1, 2), (2, 3)]
)
NODES = np.stack([PRISM, PENTAGONAL_PRISM_THREE_SIDES, PENTAGONAL_PRISM_TWO_SIDES])
LABELS = ("triangular prism", "pentagonal prism", "pentagonal prism")
TWO_RECTANGLES = matrix([RECTANGLE, RECTANGLE], [(0, 1)])


class Printed(NamedTuple):
    """One view of figures 5.25 and 5.26: what was shown, and the prediction, activation and match ratio printed."""

    figure: str
    view: Array
    truth: str
    said: str
    activation: float
    ratio: float


PRINTED = (
    Printed("5.25 (a)", PRISM, LABELS[0], LABELS[0], 0.996, 1.0),
    Printed("5.25 (b)", matrix([TRIANGLE, RECTANGLE], [(0, 1)]), LABELS[0], LABELS[0], 0.31, 0.667),
    Printed("5.25 (c)", TWO_RECTANGLES, LABELS[0], LABELS[1], 0.285, 0.667),
    Printed("5.26 (d)", PENTAGONAL_PRISM_THREE_SIDES, LABELS[1], LABELS[1], 0.998, 1.0),
)

FIGURE_5_7 = {
    560: (-2.8, -3.4, -2.1), 600: (-2.1, -1.3, -1.6), 640: (-2.3, -1.7, 2.6), 680: (-2.4, -2.5, -5.5),
    720: (-2.3, 0.1, -5.2), 760: (-2.2, -1.8, -3.2), 800: (-3.1, -2.3, -4.7), 840: (-2.1, -0.8, -7.3),
    880: (-3.4, 0.6, -5.6), 920: (-1.7, -3.0, -9.8), 960: (-2.5, -0.6, -7.6), 1000: (-3.2, -0.7, -3.4),
}  # fmt: skip
"""Distance from the cameras, mm -> errors of the lengths A, B and C, mm."""


def silhouettes() -> Array:
    """(4, 400): a floppy disk, a round of cork, a pen and a screwdriver, as edges on 20 x 20 (section 4.1)."""
    grid = np.zeros((4, 20, 20))
    floppy, cork, pen, driver = grid
    floppy[[0, 19], :] = floppy[:, [0, 19]] = 1
    floppy[13, 4:16] = floppy[13:, [4, 15]] = floppy[1:6, [6, 13]] = floppy[6, 6:14] = 1
    rows, columns = np.mgrid[:20, :20]
    radius = np.hypot(rows - 9.5, columns - 9.5)
    cork[(radius > 8.6) & (radius < 9.9)] = 1
    pen[:17, [9, 11]] = 1
    pen[[0, 17, 18, 19], 10] = pen[4, 9:12] = 1
    driver[:9, [7, 12]] = driver[[0, 8], 7:13] = 1
    driver[9:19, [9, 10]] = driver[19, 8:12] = 1
    return grid.reshape(4, 400)
