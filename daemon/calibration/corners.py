"""Sub-pixel corners of a printed board: fit the board's drawing to the image around each corner. Pure.

The markers of a ChArUco board, an eighth of a square away, attract a saddle-point search, alike in every view: focal
length and baseline come out short while the residual stays small. Therefore the fit includes them: the drawing around
each corner is projected, blurred like the lens, and shifted until it matches the image; level, contrast and slope of
the light are free.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from daemon.arrays import Array

Drawing = Callable[[Array], NDArray[np.bool_]]
"""Whether the board is white at (..., 2) positions, in squares from the first inner corner."""

PARTS = 5
"""A pixel of the drawing is the mean of PARTS x PARTS samples."""
REACH_SQUARES = 0.5
MIN_REACH_PX, MAX_REACH_PX = 4, 8
NEIGHBOURS = 12
MIN_PIXELS = 25
"""Fewest image pixels around a corner that is fitted."""
MIN_PASSES, MAX_PASSES, STEPS = 2, 6, 2
CONVERGED_BLUR_PX = 0.1
BLUR_PX = (0.3, 3.0)
"""Limits of the blur, sigma."""
WORST_MISFIT = 0.2
"""Share of the contrast between black and white: a corner that fits worse is covered, in glare, or not a corner."""


@dataclass(frozen=True, eq=False)
class FittedCorners:
    """corners_px (N, 2); misfit (N,): rms difference of drawing and image as a share of the contrast; blur_px: sigma of
    the lens blur."""

    corners_px: Array
    misfit: Array
    blur_px: float


@dataclass(frozen=True, eq=False)
class _Drawn:
    """The drawing centred on one corner, PARTS samples a pixel; inside (P,): which pixels of the patch count."""

    samples: NDArray[np.float32]
    inside: NDArray[np.bool_]


def fit_corners(image: NDArray[np.uint8], corners_px: Array, squares: Array, drawing: Drawing) -> FittedCorners:
    """Fit the drawing around each corner: corners_px (N, 2) to about a pixel, squares (N, 2) their positions on the
    board.

    Gauss-Newton on shift, level, contrast, slope of the light and blur; all corners share the median blur.
    """
    fitted, misfit, blur = corners_px.astype(float).copy(), np.full(len(corners_px), np.inf), 0.8
    reach = int(np.clip(np.ceil(REACH_SQUARES * np.median(nearest_px(fitted))), MIN_REACH_PX, MAX_REACH_PX))
    rim = 3 * reach
    grey = np.pad(image.astype(np.float32), rim, constant_values=np.nan)
    for pass_ in range(MAX_PASSES):
        drawn = [_drawn(h, at, reach, drawing) for h, at in zip(local_mappings(fitted, squares), squares, strict=True)]
        added_variance = np.zeros(len(fitted))
        for k, one in enumerate(drawn):
            model = _model(one.samples, blur)
            for _ in range(STEPS):
                fitted[k], misfit[k], added_variance[k] = _step(grey, model, one.inside, fitted[k], corners_px[k], rim)
        before, blur = blur, float(np.clip(np.sqrt(max(blur**2 + np.median(added_variance), 0.0)), *BLUR_PX))
        if pass_ + 1 >= MIN_PASSES and abs(blur - before) < CONVERGED_BLUR_PX:
            break
    return FittedCorners(fitted, misfit, blur)


def nearest_px(corners_px: Array) -> Array:
    """(N,) distance to the nearest other corner, px."""
    gaps = np.linalg.norm(corners_px[:, None] - corners_px[None], axis=2) + 1e9 * np.eye(len(corners_px))
    return np.asarray(gaps.min(axis=1))


def local_mappings(corners_px: Array, squares: Array) -> list[Array]:
    """image_from_squares (3, 3) around each corner, from its neighbours: so near, distortion is negligible."""
    whole = cv2.findHomography(squares, corners_px)[0]
    found = []
    for at in squares:
        near = np.argsort(np.abs(squares - at).max(axis=1), kind="stable")[:NEIGHBOURS]
        spread = np.linalg.svd(squares[near] - squares[near].mean(axis=0), compute_uv=False)
        one = cv2.findHomography(squares[near], corners_px[near])[0] if spread[-1] > 1.0 else None
        found.append(np.asarray(whole if one is None else one, float))
    return found


def _drawn(image_from_squares: Array, at: Array, reach: int, drawing: Drawing) -> _Drawn:
    middle = _through(image_from_squares, at[None])[0]
    squares_from_image = np.asarray(np.linalg.inv(image_from_squares), float)
    fine, whole = _grid((reach + 2) * PARTS), _grid(reach)
    samples = drawing(_through(squares_from_image, middle + fine.reshape(-1, 2) / PARTS))
    there = _through(squares_from_image, middle + whole.reshape(-1, 2))
    inside = np.abs(there - at).max(axis=1) <= REACH_SQUARES
    return _Drawn(samples.reshape(fine.shape[:2]).astype(np.float32), inside)


@cache
def _grid(reach: int) -> Array:
    """(2 * reach + 1, 2 * reach + 1, 2): x and y of the whole places up to reach from the middle."""
    whole = np.arange(-reach, reach + 1, dtype=float)
    grid = np.stack(np.meshgrid(whole, whole), axis=-1)
    grid.setflags(write=False)
    return grid


def _through(homography: Array, points: Array) -> Array:
    mapped = points @ homography[:, :2].T + homography[:, 2]
    return np.asarray(mapped[:, :2] / mapped[:, 2:], float)


def _model(samples: NDArray[np.float32], blur_px: float) -> NDArray[np.float32]:
    """(S, S, 4) of a drawing (S, S) as a pixel (a box) behind a lens (a Gaussian) images it: itself, its slopes a pixel
    along x and y, its second derivative."""
    drawn = cv2.GaussianBlur(cv2.blur(samples, (PARTS, PARTS)), (0, 0), blur_px * PARTS)
    slopes = (cv2.Sobel(drawn, cv2.CV_32F, *order, ksize=1) * (PARTS / 2) for order in ((1, 0), (0, 1)))
    return np.asarray(np.dstack([drawn, *slopes, cv2.Laplacian(drawn, cv2.CV_32F) * PARTS**2]), np.float32)


def _step(
    grey: NDArray[np.float32],
    model: NDArray[np.float32],
    inside: NDArray[np.bool_],
    corner_px: Array,
    start_px: Array,
    rim: int,
) -> tuple[Array, float, float]:
    """Make one Gauss-Newton step: (corner, misfit, increase of the blur's variance in px^2)."""
    reach = (int(np.sqrt(len(inside))) - 1) // 2
    whole = np.round(corner_px).astype(int)
    x, y = np.clip(whole + rim, reach, np.array(grey.shape[::-1]) - reach - 1)
    seen = grey[y - reach : y + reach + 1, x - reach : x + reach + 1].ravel()[inside]
    shift = corner_px - whole
    there = np.isfinite(seen)
    if there.sum() < MIN_PIXELS:
        return corner_px, np.inf, 0.0
    seen = seen[there]
    matrix = _columns(model, shift, reach)[inside][there]
    found = np.linalg.lstsq(matrix, seen, rcond=None)[0]
    contrast = found[0]
    if not contrast > 1.0:
        return corner_px, np.inf, 0.0
    step = np.clip(found[4:6] / contrast, -1.0, 1.0)
    misfit = float(np.sqrt(np.mean((seen - matrix @ found) ** 2)) / contrast)
    moved = corner_px + step
    if np.linalg.norm(moved - start_px) > reach:
        return corner_px, np.inf, 0.0
    return moved, misfit, float(2.0 * found[6] / contrast)


def _columns(model: NDArray[np.float32], shift: Array, reach: int) -> NDArray[np.float32]:
    """(P, 7) linear model of each pixel: drawing, level, slope of the light (2), derivatives by shift (2) and by the
    blur's variance."""
    whole, middle = _grid(reach), (len(model) - 1) // 2
    at = (middle + PARTS * (whole - shift)).astype(np.float32)
    here = np.asarray(cv2.remap(model, at[..., 0].copy(), at[..., 1].copy(), cv2.INTER_LINEAR)).reshape(-1, 4)
    found = np.ones((len(here), 7), np.float32)
    found[:, 0], found[:, 2:4], found[:, 4:6], found[:, 6] = here[:, 0], whole.reshape(-1, 2), -here[:, 1:3], here[:, 3]
    return found
