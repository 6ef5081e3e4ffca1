"""What the thesis printed, as figures: its patterns of section 5.6, its test views, its table 5.7.

Source: D'Souza, sections 4.4.1, 5.1, 5.2, 5.5, 5.6, figures 5.7, 5.20, 5.22 to 5.26. The numbers of rectangle, triangle
and pentagon are printed (4.3, 4.4.1, figure 4.25), and so is alpha 0.1 of the first system (5.2). Alpha 0.01 and a
vigilance of 0.98 make the activations and predictions of figures 5.25 and 5.26 come out. The square's number is not
printed; any that no other type has gives the same answers.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from daemon.arrays import Array

SQUARE, TRIANGLE, RECTANGLE, PENTAGON = 0.15, 0.3, 0.5, 0.75
ALPHA, RHO = 0.01, 0.98


def matrix(types: Sequence[float], touching: Sequence[tuple[int, int]]) -> Array:
    """Row r holds the type of facet r where it touches; in six slots."""
    result = np.zeros((6, 6))
    for p, q in touching:
        result[p, q], result[q, p] = types[p], types[q]
    return result


CUBE = matrix([SQUARE] * 3, [(0, 1), (0, 2), (1, 2)])
PYRAMID_FOUR_SIDES = matrix([TRIANGLE] * 4, [(0, 1), (1, 2), (2, 3), (3, 0)])
PYRAMID_BASE = matrix([SQUARE, TRIANGLE, TRIANGLE], [(0, 1), (0, 2), (1, 2)])
PRISM = matrix([TRIANGLE, RECTANGLE, RECTANGLE], [(0, 1), (0, 2), (1, 2)])
PENTAGONAL_PRISM_THREE_SIDES = matrix(
    [PENTAGON, RECTANGLE, RECTANGLE, RECTANGLE], [(0, 1), (0, 2), (0, 3), (1, 2), (2, 3)]
)
PENTAGONAL_PRISM_TWO_SIDES = matrix([RECTANGLE, RECTANGLE, PENTAGON], [(0, 1), (0, 2), (1, 2)])
NODES = np.stack(
    [CUBE, PYRAMID_FOUR_SIDES, PYRAMID_BASE, PRISM, PENTAGONAL_PRISM_THREE_SIDES, PENTAGONAL_PRISM_TWO_SIDES]
)
"""The six nodes of section 5.6, in its order."""
NODE_LABELS = ("cube", "pyramid", "pyramid", "triangular prism", "pentagonal prism", "pentagonal prism")
TWO_RECTANGLES = matrix([RECTANGLE, RECTANGLE], [(0, 1)])


def renumbered(view: Array, rng: np.random.Generator) -> Array:
    """The view with its facets numbered otherwise, in the same slots."""
    occupied = np.flatnonzero(view.any(1) | view.any(0))
    order = np.arange(len(view))
    order[occupied] = rng.permutation(occupied)
    return np.asarray(view[np.ix_(order, order)])


class Printed(NamedTuple):
    """One view of figures 5.23 to 5.26: what was shown, and the prediction, match ratio and activation printed (None
    where the text prints none). facets: those of the part in tests/fakes/solids.py that the view shows."""

    figure: str
    view: Array
    truth: str
    said: str
    ratio: float
    activation: float | None
    facets: tuple[int, ...]


_TRI, _PENT = "triangular prism", "pentagonal prism"
PRINTED = (
    Printed("5.23 (a)", CUBE, "cube", "cube", 1.0, None, (1, 2, 3)),
    Printed("5.23 (b)", matrix([SQUARE] * 2, [(0, 1)]), "cube", "cube", 0.67, None, (2, 3)),
    Printed("5.23 (c)", CUBE, "cube", "cube", 1.0, None, (0, 5, 4)),
    Printed("5.24 (a)", matrix([TRIANGLE] * 2, [(0, 1)]), "pyramid", "pyramid", 0.5, None, (1, 2)),
    Printed("5.24 (b)", matrix([SQUARE, TRIANGLE], [(0, 1)]), "pyramid", "pyramid", 0.67, None, (0, 1)),
    Printed("5.24 (c)", matrix([TRIANGLE, TRIANGLE, SQUARE], [(0, 1), (0, 2), (1, 2)]), "pyramid", "pyramid", 1.0, None,
            (3, 4, 0)),
    Printed("5.24 (d)", PYRAMID_FOUR_SIDES, "pyramid", "pyramid", 1.0, None, (3, 4, 1, 2)),
    Printed("5.25 (a)", matrix([RECTANGLE, RECTANGLE, TRIANGLE], [(0, 1), (0, 2), (1, 2)]), _TRI, _TRI, 1.0, 0.996,
            (4, 3, 0)),
    Printed("5.25 (b)", matrix([TRIANGLE, RECTANGLE], [(0, 1)]), _TRI, _TRI, 0.667, 0.31, (1, 2)),
    Printed("5.25 (c)", TWO_RECTANGLES, _TRI, _PENT, 0.667, 0.285, (2, 3)),
    Printed("5.26 (a)", matrix([RECTANGLE, PENTAGON, RECTANGLE], [(0, 1), (0, 2), (1, 2)]), _PENT, _PENT, 1.0, None,
            (2, 1, 3)),
    Printed("5.26 (b)", matrix([PENTAGON, RECTANGLE, RECTANGLE], [(0, 1), (0, 2), (1, 2)]), _PENT, _PENT, 1.0, None,
            (0, 5, 6)),
    Printed("5.26 (c)", TWO_RECTANGLES, _PENT, _PENT, 0.67, None, (2, 3)),
    Printed("5.26 (d)", PENTAGONAL_PRISM_THREE_SIDES, _PENT, _PENT, 1.0, 0.998, (0, 4, 5, 6)),
)  # fmt: skip

FIGURE_5_7 = {
    560: (-2.8, -3.4, -2.1), 600: (-2.1, -1.3, -1.6), 640: (-2.3, -1.7, 2.6), 680: (-2.4, -2.5, -5.5),
    720: (-2.3, 0.1, -5.2), 760: (-2.2, -1.8, -3.2), 800: (-3.1, -2.3, -4.7), 840: (-2.1, -0.8, -7.3),
    880: (-3.4, 0.6, -5.6), 920: (-1.7, -3.0, -9.8), 960: (-2.5, -0.6, -7.6), 1000: (-3.2, -0.7, -3.4),
}  # fmt: skip
"""Distance from the cameras, mm -> errors of the lengths A, B and C, mm."""
