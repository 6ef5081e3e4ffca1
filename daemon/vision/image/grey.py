"""From whatever a camera gave to a checked grey image and its noise. Nothing here knows of edges or parts."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from daemon.arrays import Array, Index
from daemon.errors import FacetdError

Grey = NDArray[np.uint8]
Fine = NDArray[np.uint16]
"""Values (H, W) in steps of 1 / FINE: half the memory of float32, and cv2.remap reads between its pixels as exactly."""

SMALLEST_PX = 32
SATURATED = 250
BLOCK_PX = 8
FINE = 32
_BIN = 8
_SIZES = 256
_FEWEST = 40
_EVERY = 4
_USED = np.array([[k & 1, k & 2, k & 4] for k in range(1, 8)], bool)
"""All choices of which of the three coefficients of the noise are not zero."""
_BOTH_USED, _UNIT, _UP_TO_SQUARE = _USED[:, :, None] & _USED[:, None], np.eye(3), np.arange(3)
_POWERS = (np.arange(256) / 100.0)[:, None] ** _UP_TO_SQUARE
_LEVELS_OF_NINE = (np.arange(9 * 255 + 1) + 4) // 9
_BAND_OF_NINE = _SIZES * np.where(_LEVELS_OF_NINE >= SATURATED, 255 // _BIN + 1, _LEVELS_OF_NINE // _BIN)
"""_SIZES times the band of grey levels that so large a sum of nine pixels lies in; saturated ones have their own."""


class VisionError(FacetdError, ValueError):
    """An image, or a pair, cannot be used: the message says what is wrong with it and what was expected."""


def as_grey(image: NDArray[Any], name: str = "image") -> Grey:
    """Any ordinary camera image as (H, W) uint8 grey.

    image: (H, W) grey, (H, W, 1) grey, (H, W, 3) BGR or (H, W, 4) BGRA; uint8, or uint16 which is scaled by its
    upper byte. Raises VisionError for another shape or type, and for an image smaller than 32 px either way.
    """
    if not isinstance(image, np.ndarray):
        raise VisionError(f"{name}: expected an array of pixels, found {type(image).__name__}")
    if image.ndim not in (2, 3) or (image.ndim == 3 and image.shape[2] not in (1, 3, 4)):
        raise VisionError(f"{name}: expected height x width (x 1, 3 or 4), found shape {image.shape}")
    if min(image.shape[:2]) < SMALLEST_PX:
        raise VisionError(f"{name}: expected at least {SMALLEST_PX} x {SMALLEST_PX} px, found {_size(image)}")
    if image.dtype == np.uint16:
        image = (image >> 8).astype(np.uint8)
    if image.dtype != np.uint8:
        raise VisionError(f"{name}: expected 8- or 16-bit unsigned pixels, found {image.dtype}")
    if image.ndim == 3 and image.shape[2] > 1:
        code = cv2.COLOR_BGR2GRAY if image.shape[2] == 3 else cv2.COLOR_BGRA2GRAY
        return np.asarray(cv2.cvtColor(image, code), np.uint8)
    return np.ascontiguousarray(image.reshape(image.shape[:2]))


def check_size(image: Grey, expected: tuple[int, int], name: str = "image") -> None:
    """Raise VisionError unless the image is of the (width, height) px the rig was calibrated for."""
    if (image.shape[1], image.shape[0]) != tuple(expected):
        raise VisionError(f"{name}: expected {expected[0]}x{expected[1]} px as calibrated, found {_size(image)}")


def _size(image: NDArray[Any]) -> str:
    return f"{image.shape[1]}x{image.shape[0]} px"


def block_means(image: Grey) -> Array:
    """(H, W) grey -> (H // 8, W // 8) means of 8x8 px blocks: noise averages out in one, an edge still shows."""
    rows, columns = (n // BLOCK_PX for n in image.shape)
    cut = image[: rows * BLOCK_PX, : columns * BLOCK_PX].astype(np.float32)
    return np.asarray(cv2.resize(cut, (columns, rows), interpolation=cv2.INTER_AREA), float)


@dataclass(frozen=True, eq=False)
class Noise:
    """How strongly pixels of each grey level flicker: sigma (256,) grey levels, and stretch (256,) float32.

    Sent through `stretch`, an image has noise of sigma 1 everywhere, so that one threshold fits all of it.
    """

    sigma: Array
    stretch: NDArray[np.float32]

    def at(self, level: Array) -> Array:
        """Sigma in grey levels at these grey levels (any shape)."""
        return np.asarray(self.sigma.take(level.astype(np.intp), mode="clip"))


@dataclass(frozen=True, eq=False)
class NoiseOfMany:
    """The noise of several images, at places (R,) of which each is in one: sigma (images, 256), first (R,) where that
    image's begin among all.
    """

    sigma: Array
    first: Index

    def at(self, level: Array) -> Array:
        """Sigma in grey levels at these grey levels (..., R)."""
        return np.asarray(self.sigma.take(level.clip(0.0, 255.0).astype(np.intp) + self.first))


def noise_of_many(noises: Sequence[Noise], counts: Index) -> NoiseOfMany:
    """The noise at so many places in each image, one image after the other."""
    return NoiseOfMany(np.array([n.sigma for n in noises]), (256 * np.arange(len(noises))).repeat(counts))


def measure_noise(image: Grey) -> Noise:
    """Noise sigma as a function of grey level: sigma^2 = read + photon * I + granular * I^2, none below zero.

    The residual of the product of two second differences is blind to straight edges and shading (Immerkaer 1996);
    its median size in each band of grey levels gives a variance, and the three coefficients are fitted to those.
    """
    counts = np.bincount(_residuals(image), minlength=(255 // _BIN + 2) * _SIZES).reshape(-1, _SIZES)[:-1]
    below = np.cumsum(counts, 1)
    size = below[:, -1]
    known = np.flatnonzero(size >= _FEWEST)
    half = size[known, None] / 2
    k = np.argmax(below[known] >= half, 1)
    within = (half[:, 0] - below[known, k] + counts[known, k]) / np.maximum(counts[known, k], 1)
    median = np.maximum(k - 0.5 + within, 0.1) / 6
    rows = np.stack([(known + 0.5) * _BIN, (1.4826 * median) ** 2, size[known]], 1)
    sigma = np.sqrt(np.maximum(_variance_curve(rows), 0.3**2))
    stretch = np.concatenate([[0.0], np.cumsum(2.0 / (sigma[1:] + sigma[:-1]))])
    return Noise(sigma, stretch.astype(np.float32))


def _residuals(image: Grey) -> Index:
    """Return at every few pixels the size of the product of second differences (6 sigma for noise sigma), plus _SIZES
    times the band of grey levels."""
    rows, columns = ((n - 3) // _EVERY * _EVERY + 1 for n in image.shape)  # so that each has its eight neighbours
    above, here, below = (image[r : rows + r : _EVERY].astype(np.int16) for r in range(3))
    bend, total = above - 2 * here + below, above + here + below
    left, middle, right = (np.s_[:, c : columns + c : _EVERY] for c in range(3))
    size = np.minimum(np.abs(bend[left] - 2 * bend[middle] + bend[right]), _SIZES - 1)
    return np.asarray(_BAND_OF_NINE.take(total[left] + total[middle] + total[right]) + size).ravel()


def _variance_curve(rows: Array) -> Array:
    """rows (N, 3): level, variance, count -> variance (256,) of the best non-negative quadratic."""
    if len(rows) == 0:
        return np.ones(256)
    x, variance = rows[:, 0] / 100.0, np.maximum(rows[:, 1], 1e-2)
    weight = rows[:, 2] / variance**2
    design = x[:, None] ** _UP_TO_SQUARE
    normal, right = (design.T * weight) @ design, (design.T * weight) @ variance
    own = np.where(_BOTH_USED, normal, _UNIT)  # each with the rest of its unknowns zero
    wanted = right * _USED
    factors = np.linalg.solve(own + 1e-9 * own * _UNIT, wanted[:, :, None])[..., 0]
    # Of a least-squares fit, less a constant.
    error = np.where((factors < 0).any(1), np.inf, -(factors * wanted).sum(1))
    if not np.isfinite(error.min()):
        return np.full(256, float(np.median(variance)))
    return np.asarray(_POWERS @ factors[np.argmin(error)])
