"""How far inside a convex outline points lie, whichever way round it runs."""

from __future__ import annotations

import numpy as np
import pytest

from daemon.vision.geometry.polygon import PlanarShape

SQUARE = np.array([[10.0, 10.0], [30.0, 10.0], [30.0, 30.0], [10.0, 30.0]])


@pytest.mark.parametrize("corners", [SQUARE, SQUARE[::-1]])
def test_depth_is_the_way_to_the_nearest_side_and_negative_outside(corners: np.ndarray) -> None:
    points = np.array([[20.0, 20.0], [12.0, 25.0], [10.0, 20.0], [7.0, 20.0]])
    assert np.allclose(PlanarShape.of(corners).depth(points), [10.0, 2.0, 0.0, -3.0])


def test_of_no_points_there_are_no_depths() -> None:
    assert PlanarShape.of(SQUARE).depth(np.zeros((0, 2))).shape == (0,)
