"""Whether a camera holds its exposure, gain and focus, and whether it exposes row after row (rolling shutter). Pure.

In: successive images of one camera, at rest or in motion, as many as possible. A still scene shows changes of
brightness and focus. An image in motion is sheared by a rolling shutter: the shift of a row then depends on the speed
at that moment, not on the way alone (which differs from row to row too, as near things move more).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from daemon.arrays import Array
from daemon.vision.image import SATURATED

Image = NDArray[np.uint8]
Array32 = NDArray[np.float32]

MAX_IMAGES = 48
WIDTH_PX, BANDS = 320, 6
"""Images are measured at this width, in bands of rows one above the other."""
STILL_PX, MOVING_PX = 0.3, 1.5
"""Shift from image to image below which the scene is still, and above which it moves, at WIDTH_PX."""
MIN_SIMILARITY = 0.15
"""Least response of the phase correlation of two images for their shift to count."""
BRIGHTNESS_CHANGE, FOCUS_CHANGE = 0.05, 0.06
"""Changes, as shares, beyond which exposure and focus are not held; noise alone stays below a tenth of each."""
STEEP_PERCENT = 99.5
"""Pixels steeper than so many of 100 show the focus: in a scene of few parts most of an image is plain."""
UNMOVED = 0.95
"""Brightness, as a share of before, above which a shortened exposure has had no lasting effect."""
MIN_SPEED_CHANGE_PX = 0.3
"""Least spread of the changes of speed, px an image, that separates a rolling shutter's shear from perspective."""
ROLLING_S, SURE = 0.004, 4.0
"""Readout time from which a shutter is called rolling, and by how many standard errors."""
BLACK = 16.0


@dataclass(frozen=True)
class Steadiness:
    """brightness, focus: largest change in a still scene, as shares (nan: not still); readout_s: from the first row to
    the last, with its standard error (nan: nothing moved, or at one speed)."""

    brightness: float
    focus: float
    readout_s: float
    readout_error_s: float

    @property
    def shutter(self) -> str | None:
        """The way the camera exposes its rows, for people; None: not measured."""
        if np.isnan(self.readout_s):
            return None
        ms, error_ms = 1000 * self.readout_s, 1000 * self.readout_error_s
        if self.readout_s > max(ROLLING_S, SURE * self.readout_error_s):
            return (
                f"rolling shutter: the last row is exposed {ms:.0f} ms after the first; facetd looks with the arm at "
                "rest; let nothing else move in view"
            )
        return f"global shutter: the last row is exposed {abs(ms):.0f} +- {error_ms:.0f} ms from the first"

    def faults(self) -> list[str]:
        """Return what is wrong, a line each with the remedy."""
        lines = []
        if self.brightness > BRIGHTNESS_CHANGE:
            lines.append(
                f"brightness changes by {self.brightness:.0%} in a still scene: automatic exposure or gain that is not "
                "held (set exposure_us and gain in cameras.controls), or a lamp that flickers (expose for whole "
                "mains periods)"
            )
        if self.focus > FOCUS_CHANGE:
            lines.append(
                f"sharpness changes by {self.focus:.0%} in a still scene: autofocus that is not held (set focus in "
                "cameras.controls; each focus needs its own calibration)"
            )
        return lines


def measure_steadiness(images: Sequence[Image], taken_s: Sequence[float]) -> Steadiness:
    """Measure successive images (H, W) of one camera, taken at the moments taken_s."""
    small = [_small(image) for image in images]
    steps, like = _steps(small)
    size = np.linalg.norm(np.median(steps, axis=1), axis=1) if len(steps) else np.zeros(0)
    still = bool(len(size)) and bool((size < STILL_PX).all())
    brightness = focus = np.nan
    if still:
        brightness = _spread([float(np.mean(np.maximum(image - BLACK, 0)) + 1.0) for image in small])
        focus = _spread([_sharpness(image) for image in small])
    readout_s, error_s = _readout(steps, like, size, np.asarray(taken_s, float))
    return Steadiness(brightness, focus, readout_s, error_s)


def overridden(before: Sequence[Image], after: Sequence[Image], factor: float) -> str | None:
    """Return what is wrong where images (H, W) after the exposure was multiplied by a factor below 1 are as bright as
    before; None where they are darker, or too dark or bright to tell."""
    was, now = (float(np.mean(np.maximum(images[-1].astype(np.float32) - BLACK, 0))) for images in (before, after))
    if factor > UNMOVED**2 or not BLACK < was < SATURATED - 2 * BLACK or now < UNMOVED * was:
        return None
    return (
        f"the exposure was set to {factor:.0%}, and images stay as bright: automatic exposure overrides it (set "
        "exposure_us and gain in cameras.controls; if the camera refuses them, it cannot be used)"
    )


def _small(image: Image) -> Array32:
    scale = WIDTH_PX / image.shape[1]
    return np.asarray(cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), np.float32)


def _spread(values: Sequence[float]) -> float:
    return max(values) / min(values) - 1.0


def _sharpness(image: Array32) -> float:
    """Mean slope of the steepest pixels of an image, relative to its brightness and without its noise."""
    smooth = cv2.GaussianBlur(image, (0, 0), 0.8)
    slope = np.hypot(*(cv2.Sobel(smooth, cv2.CV_32F, dx, 1 - dx, ksize=3) for dx in (1, 0)))
    steep = slope[slope >= np.percentile(slope, STEEP_PERCENT)]
    return float(max(steep.mean() - np.median(slope), 1e-3) / (np.mean(image) + 1.0))


def _steps(images: Sequence[Array32]) -> tuple[Array, Array]:
    """Shift (N - 1, BANDS, 2) px of each band from image to image, and how alike the two are."""
    steps, like = [], []
    for before, now in pairwise(images):
        whole = np.round(_shift(before, now)[0]).astype(int)
        most = np.array(before.shape[::-1]) // 2
        found = _band_shifts(before, now, np.clip(whole, -most, most))
        steps.append([shift for shift, _ in found])
        like.append([response for _, response in found])
    return np.array(steps, float).reshape(-1, BANDS, 2), np.array(like, float).reshape(-1, BANDS)


def _band_shifts(before: Array32, now: Array32, whole: NDArray[np.int64]) -> list[tuple[Array, float]]:
    """Shift of each band: the whole pixels of the image, and what is left in the band where both images show it."""
    (height, width), (x, y) = before.shape, (int(v) for v in whole)
    then = before[max(-y, 0) : height - max(y, 0), max(-x, 0) : width - max(x, 0)]
    here = now[max(y, 0) : height + min(y, 0), max(x, 0) : width + min(x, 0)]
    bands = zip(np.array_split(then, BANDS), np.array_split(here, BANDS), strict=True)
    return [(whole + shift, response) for shift, response in (_shift(a, b) for a, b in bands)]


def _shift(before: Array32, now: Array32) -> tuple[Array, float]:
    window = cv2.createHanningWindow(before.shape[::-1], cv2.CV_32F)
    shift, response = cv2.phaseCorrelate(before.copy(), now.copy(), window)  # it writes into what it is given
    return np.array(shift, float), float(response)


def _readout(steps: Array, like: Array, size: Array, taken_s: Array) -> tuple[float, float]:
    """Readout time and its standard error, s: each band's shift is a share of the way and its delay times the speed."""
    unknown = (float("nan"), float("nan"))
    if len(steps) < 4 or (size > MOVING_PX).sum() < 3:
        return unknown
    good = (like > MIN_SIMILARITY).mean(axis=0) > 0.8
    if good.sum() < 3:
        return unknown
    main = np.median(steps[:, good], axis=1)
    along = np.linalg.svd(main)[2][0]
    way = main @ along
    faster = np.diff(np.gradient(np.r_[0.0, np.cumsum(way)], taken_s))
    apart = faster - way * (way @ faster) / max(way @ way, 1e-9)
    if np.std(apart) * float(np.median(np.diff(taken_s))) < MIN_SPEED_CHANGE_PX:
        return unknown
    shape = np.column_stack([way, faster])
    delays_s = np.linalg.lstsq(shape, (steps @ along)[:, good], rcond=None)[0][1]
    rows = (np.flatnonzero(good) + 0.5) / BANDS
    line, residuals = (rows - rows.mean()), delays_s - delays_s.mean()
    slope = float(line @ residuals / (line @ line))
    left = residuals - slope * line
    return slope, float(np.sqrt(left @ left / max(len(rows) - 2, 1) / (line @ line)))
