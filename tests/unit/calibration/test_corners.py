"""Where a corner lies is fitted through a mapping of the squares round it, as an image shows them there."""

from __future__ import annotations

import numpy as np

from daemon.arrays import Array
from daemon.calibration.corners import NEIGHBOURS, local_mappings


def bent(squares: Array) -> Array:
    """Squares 20 px wide, seen through a lens that bends lines."""
    flat = 20.0 * (squares - squares.mean(axis=0))
    return flat * (1.0 + 2e-6 * (flat**2).sum(axis=1, keepdims=True)) + [320.0, 240.0]


def mapped(mapping: Array, square: Array) -> Array:
    x, y, w = mapping @ [*square, 1.0]
    return np.array([x, y]) / w


def test_a_corner_is_mapped_by_its_neighbours_where_a_lens_bends_the_whole() -> None:
    x, y = np.meshgrid(np.arange(12.0), np.arange(9.0))
    squares = np.column_stack([x.ravel(), y.ravel()])
    seen = bent(squares)
    off_px = [
        float(np.linalg.norm(mapped(one, at) - px))
        for one, at, px in zip(local_mappings(seen, squares), squares, seen, strict=True)
    ]
    assert max(off_px) < 0.5


def test_a_corner_whose_neighbours_lie_in_one_row_but_for_one_is_mapped_by_all_there_are() -> None:
    """Of a board that is covered but for two rows and a corner: that one tells badly what lies across the row."""
    along = np.arange(3.0 * NEIGHBOURS)
    rows = [np.column_stack([along, np.full(len(along), y)]) for y in (0.0, 4.0 * NEIGHBOURS)]
    squares = np.concatenate([*rows, [[0.0, 1.0]]])

    def true(at: Array) -> Array:
        return np.asarray(5.0 * at + [10.0, 20.0])

    seen = true(squares) + np.random.default_rng(4).normal(0.0, 0.2, squares.shape)
    across = squares + np.array([0.0, 3.0])
    off_px = [
        float(np.linalg.norm(mapped(one, at) - true(at)))
        for one, at in zip(local_mappings(seen, squares), across, strict=True)
    ]
    assert max(off_px) < 1.0
