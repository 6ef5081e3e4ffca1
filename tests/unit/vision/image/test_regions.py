"""Closed regions among edges and specks."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from daemon.vision.image.grey import measure_noise
from daemon.vision.image.regions import Scale, closed_regions, hole_borders, largest_hole_borders, shrunk, unit_noise


@pytest.mark.parametrize("seed", range(4))
def test_regions_among_specks_have_the_borders_that_following_every_border_gives(seed: int) -> None:
    grain = cv2.GaussianBlur(np.random.default_rng(seed).random((90, 120)), (5, 5), 1.0)
    edges = (grain > 0.48).astype(np.uint8)
    edges[30:60, 40:80] = 0
    edges[28:62, 38:40] = edges[28:62, 80:82] = edges[28:30, 38:82] = edges[60:62, 38:82] = 1

    def large(borders: list[np.ndarray]) -> set[bytes]:
        return {np.asarray(b, np.int32).tobytes() for b in borders if cv2.contourArea(b) >= 30}

    every = large(hole_borders(edges, (0, 0)))
    assert len(every) > 1
    assert large(largest_hole_borders(edges, (0, 0), 12.0, 40)) == every


ALL = np.array([0, 0]), np.array([80, 60])


def test_a_region_open_to_the_rim_is_none() -> None:
    strength = np.zeros((60, 80), np.float32)
    strength[20:40, 30] = strength[20, 30:79] = strength[39, 30:79] = 9.0
    assert closed_regions(Scale(1, np.zeros(2), strength, 1.0), ALL, 5.0, 40.0, 1e9, 40) == []
    strength[20:40, 78] = 9.0
    found = closed_regions(Scale(1, np.zeros(2), strength, 1.0), ALL, 5.0, 40.0, 1e9, 40)
    assert len(found) == 1
    assert found[0].area_px == pytest.approx(19 * 48, rel=0.02)


@pytest.mark.parametrize("speckled", [False, True])
def test_a_region_is_where_it_is_in_the_image_whatever_part_of_that_is_searched(speckled: bool) -> None:
    strength = np.zeros((60, 80), np.float32)
    strength[20:40, 30:79] = 9.0
    strength[23:37, 33:76] = 0.0
    if speckled:
        strength[::2, :20] = strength[:16:2] = strength[44::2] = 9.0
    scale = Scale(2, np.full(2, 0.5), strength, 1.0)
    near = np.array([50, 30]), np.array([160, 90])
    (found,) = closed_regions(scale, near, 5.0, 40.0, 1e9, 40)
    everywhere = closed_regions(scale, (np.array([0, 0]), np.array([160, 120])), 5.0, 40.0, 1e9, 40)
    assert found.border.tolist() == everywhere[0].border.tolist()


@pytest.mark.parametrize("size", [(32, 32), (120, 160), (160, 120), (480, 640)])
@pytest.mark.parametrize("shrink", [2, 8, 16])
def test_a_picture_of_any_size_has_a_gradient_at_pixels_of_any_size(size: tuple[int, int], shrink: int) -> None:
    """Pixels of sixteen leave a small camera's picture too few to be told grain by, and a look ended with an error."""
    grey = np.random.default_rng(1).normal(120, 3, size).astype(np.uint8)
    scale = shrunk(unit_noise(grey, measure_noise(grey)), shrink)
    assert 1.0 <= scale.sigma <= 1.7
    assert np.isfinite(scale.strength).all()
