"""The grid: sums of coded values are exact, in any order."""

from __future__ import annotations

import numpy as np
import pytest

from tests.bench.networks.coding import grid_step, on_grid


@pytest.mark.parametrize("length", [1, 2, 3, 72, 200, 256, 257, 1000])
def test_sums_on_the_grid_are_exact_in_any_order(length):
    step = grid_step(length)
    values = on_grid(np.random.default_rng(length).random(length), step)
    whole = sum(int(value / step) for value in values.tolist())
    assert float(values.sum()) == float(values[::-1].sum()) == whole * step
    assert length / step <= 2**53
