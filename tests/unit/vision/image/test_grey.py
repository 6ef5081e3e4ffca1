"""What goes into seeing facets: images of every kind are read, or refused with a line that says what is wrong."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from daemon.vision.facets.one_look.reconstruct import find_facets
from daemon.vision.image.grey import VisionError, as_grey, measure_noise
from tests.fakes.rigs import rig

SIZE = (480, 640)


def some_noise(level: float, sigma: float, seed: int = 0) -> NDArray[np.uint8]:
    pixels = np.random.default_rng(seed).normal(level, sigma, SIZE)
    return np.clip(np.rint(pixels), 0, 255).astype(np.uint8)


def test_a_colour_image_becomes_grey() -> None:
    colour = np.zeros((*SIZE, 3), np.uint8)
    colour[..., 1] = 200
    grey = as_grey(colour)
    assert grey.shape == SIZE
    assert grey.dtype == np.uint8
    assert 100 < grey[0, 0] < 130


def test_a_16_bit_image_keeps_its_upper_byte() -> None:
    assert as_grey(np.full(SIZE, 0x80FF, np.uint16))[3, 4] == 0x80


@pytest.mark.parametrize(
    ("image", "words"),
    [
        (np.zeros((8, 640), np.uint8), "at least 32 x 32"),
        (np.zeros((0, 0), np.uint8), "at least 32 x 32"),
        (np.zeros(SIZE, np.float32), "8- or 16-bit"),
        (np.zeros((480, 640, 2), np.uint8), "shape"),
        (np.zeros(640 * 480, np.uint8), "shape"),
        (None, "array of pixels"),
    ],
)
def test_an_unusable_image_is_refused_by_name(image: Any, words: str) -> None:
    good = np.zeros(SIZE, np.uint8)
    with pytest.raises(VisionError, match=words) as problem:
        find_facets(good, image, rig())
    assert "right image" in str(problem.value)


def test_a_truncated_image_is_refused_with_both_sizes() -> None:
    with pytest.raises(VisionError, match="expected 640x480 px as calibrated, found 640x300"):
        find_facets(np.zeros((300, 640), np.uint8), np.zeros(SIZE, np.uint8), rig())


@pytest.mark.parametrize(
    "image",
    [
        np.zeros(SIZE, np.uint8),
        np.full(SIZE, 255, np.uint8),
        some_noise(100, 3.0),
        np.random.default_rng(1).integers(0, 256, SIZE, dtype=np.uint8),
        np.zeros((*SIZE, 3), np.uint8),
        np.zeros(SIZE, np.uint16),
    ],
    ids=["black", "white", "noise", "random", "black colour", "black 16 bit"],
)
def test_an_image_without_parts_gives_an_empty_view(image: Any) -> None:
    view = find_facets(image, image, rig())
    assert view.groups == ()


@pytest.mark.parametrize("sigma", [1.0, 2.0, 5.0])
def test_noise_is_measured_to_a_tenth(sigma: float) -> None:
    assert measure_noise(some_noise(120, sigma)).sigma[120] == pytest.approx(sigma, rel=0.1)


def test_noise_that_grows_with_brightness_is_told_apart() -> None:
    rng = np.random.default_rng(2)
    level = np.repeat([40.0, 90.0, 140.0, 200.0], 120)[:, None] * np.ones(640)
    pixels = rng.normal(level, np.sqrt(1 + 0.05 * level))
    noise = measure_noise(np.clip(np.rint(pixels), 0, 255).astype(np.uint8))
    assert noise.sigma[200] == pytest.approx(np.sqrt(11.0), rel=0.12)
    assert noise.sigma[40] == pytest.approx(np.sqrt(3.0), rel=0.15)
