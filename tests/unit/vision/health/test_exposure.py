"""By how much the exposure of each camera is wrong, from what it sees where the parts are."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from daemon.vision.health import exposure_factors
from daemon.vision.values import Facet, Part, Recognition

Image = NDArray[np.uint8]
SQUARE = np.array([[300.0, 200], [300, 280], [380, 280], [380, 200]])
TABLE, FACE = 40.0, 170.0


def picture(exposure: float, seed: int = 0) -> Image:
    """A dark table with one bright face on it, as a linear sensor shows them."""
    levels = np.full((480, 640), TABLE)
    levels[200:281, 300:381] = FACE
    noise = np.random.default_rng(seed).normal(0, 2, levels.shape)
    return np.clip(levels * exposure + noise, 0, 255).astype(np.uint8)


def part() -> Part:
    facet = Facet(np.eye(4, 3), np.zeros((4, 3, 3)), SQUARE, SQUARE, np.zeros(4), 0.0, "square", 0.5)
    return Part(Recognition("cube", 0.9, 1, 1, None, False, "fits"), (facet,), np.eye(4), np.eye(6), 0.1)


def mended(left: float, right: float, parts: tuple[Part, ...]) -> tuple[float, float]:
    """The exposures it ends with, as often as it asks for others."""
    for k in range(4):
        factors = exposure_factors((picture(left, k), picture(right, k + 10)), parts)
        if factors is None:
            return left, right
        left, right = left * factors[0], right * factors[1]
    raise AssertionError(f"it goes on: {left}, {right}")


@pytest.mark.parametrize("exposure", [0.6, 1.0, 1.35])
def test_light_that_will_do_is_left_alone(exposure: float) -> None:
    assert exposure_factors((picture(exposure), picture(exposure * 0.95, 1)), (part(),)) is None


@pytest.mark.parametrize(("left", "right"), [(1.3, 0.95), (0.7, 1.2), (1.0, 0.4)])
def test_the_brighter_camera_is_brought_to_the_darker_one(left: float, right: float) -> None:
    now = mended(left, right, (part(),))
    assert now[0] / now[1] == pytest.approx(1.0, abs=0.06)


@pytest.mark.parametrize("exposure", [0.05, 0.2, 2.0, 6.0])
def test_parts_in_the_dark_or_burnt_out_end_where_their_edges_show(exposure: float) -> None:
    left, right = mended(exposure, exposure * 1.05, (part(),))
    assert 0.38 < left < 1.45
    assert left / right == pytest.approx(1.0, abs=0.1)


def test_a_burnt_out_part_is_seen_where_most_of_the_picture_is_well_lit() -> None:
    assert exposure_factors((picture(1.7), picture(1.7, 1)), ()) is None, "the face is a hundredth of the picture"
    assert exposure_factors((picture(1.7), picture(1.7, 1)), (part(),)) is not None


def test_a_dark_table_with_nothing_on_it_is_left_dark_and_one_in_the_dark_is_not() -> None:
    table, night = (np.full((480, 640), level, np.uint8) for level in (35, 6))
    assert exposure_factors((table, table), ()) is None
    factors = exposure_factors((night, night), ())
    assert factors == pytest.approx((8.0, 8.0)), "no step is longer than that"
