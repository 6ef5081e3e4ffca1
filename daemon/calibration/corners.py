"""Sub-pixel corners of a printed board: each is where the board's own drawing fits the image best. Pure.

What lies beside a corner (the markers of a ChArUco board, an eighth of a square away) draws a saddle-point search to
itself, alike in every view, so that focal length and baseline come out short while the residual stays small. Here it is
part of what is fitted: around each corner the drawing is projected, blurred as the lens blurs, and shifted until it and
the image agree, with the light's level, contrast and slope left free.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from daemon.arrays import Array

Drawing = Callable[[Array], NDArray[np.bool_]]
"""Where the board is white, at (..., 2) places in squares from the first inner corner."""

PARTS = 5
"""A pixel of the drawing is the mean of PARTS x PARTS places."""
REACH_SQUARES = 0.5
LEAST_REACH_PX, MOST_REACH_PX = 4, 8
NEIGHBOURS = 12
LEAST_PIXELS = 25
"""Of the image, about a corner that is fitted."""
FEWEST_ROUNDS, MOST_ROUNDS, STEPS = 2, 6, 2
SETTLED_BLUR_PX = 0.1
BLUR_PX = (0.3, 3.0)
"""Blur is sought between these."""
WORST_MISFIT = 0.2
"""Of the contrast between black and white: a corner that fits worse is covered, glares, or is none."""


@dataclass(frozen=True, eq=False)
class FittedCorners:
    """corners_px (N, 2); misfit (N,): rms difference of drawing and image as a share of the contrast; blur_px: sigma of
    the lens's spread."""

    corners_px: Array
    misfit: Array
    blur_px: float


@dataclass(frozen=True, eq=False)
class _Drawn:
    """The drawing around one corner, PARTS samples a pixel, its middle the corner: inside (P,) which pixels of the
    patch count."""

    samples: NDArray[np.float32]
    inside: NDArray[np.bool_]


def fit_corners(image: NDArray[np.uint8], corners_px: Array, squares: Array, drawing: Drawing) -> FittedCorners:
    """Fit the drawing around each corner: corners_px (N, 2) to a pixel or so, squares (N, 2) where they are on it.

    Gauss-Newton on shift, level, contrast, slope of the light and blur; the blur that most corners have is everyone's.
    """
    fitted, misfit, blur = corners_px.astype(float).copy(), np.full(len(corners_px), np.inf), 0.8
    reach = int(np.clip(np.ceil(REACH_SQUARES * np.median(nearest_px(fitted))), LEAST_REACH_PX, MOST_REACH_PX))
    rim = 3 * reach
    grey = np.pad(image.astype(np.float32), rim, constant_values=np.nan)
    for round_ in range(MOST_ROUNDS):
        drawn = [_drawn(h, at, reach, drawing) for h, at in zip(_mappings(fitted, squares), squares, strict=True)]
        sharper = np.zeros(len(fitted))
        for k, one in enumerate(drawn):
            blurred = _blurred(one.samples, blur)
            for _ in range(STEPS):
                fitted[k], misfit[k], sharper[k] = _step(grey, blurred, one.inside, fitted[k], corners_px[k], rim)
        before, blur = blur, float(np.clip(np.sqrt(max(blur**2 + np.median(sharper), 0.0)), *BLUR_PX))
        if round_ + 1 >= FEWEST_ROUNDS and abs(blur - before) < SETTLED_BLUR_PX:
            break
    return FittedCorners(fitted, misfit, blur)


def nearest_px(corners_px: Array) -> Array:
    """(N,) how far the nearest other corner is."""
    gaps = np.linalg.norm(corners_px[:, None] - corners_px[None], axis=2) + 1e9 * np.eye(len(corners_px))
    nearest: Array = gaps.min(axis=1)
    return nearest


def _mappings(corners_px: Array, squares: Array) -> list[Array]:
    """image_from_squares (3, 3) about each corner, by its neighbours: what the lens bends is straight so near."""
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
    half = (reach + 2) * PARTS
    fine = np.arange(-half, half + 1) / PARTS
    samples = drawing(_through(squares_from_image, middle + np.stack(np.meshgrid(fine, fine), axis=-1).reshape(-1, 2)))
    whole = np.arange(-reach, reach + 1)
    there = _through(squares_from_image, middle + np.stack(np.meshgrid(whole, whole), axis=-1).reshape(-1, 2))
    inside = np.abs(there - at).max(axis=1) <= REACH_SQUARES
    return _Drawn(samples.reshape(len(fine), len(fine)).astype(np.float32), inside)


def _through(homography: Array, points: Array) -> Array:
    mapped = points @ homography[:, :2].T + homography[:, 2]
    return np.asarray(mapped[:, :2] / mapped[:, 2:], float)


def _blurred(samples: NDArray[np.float32], blur_px: float) -> NDArray[np.float32]:
    """As a pixel (its own square) behind a lens (a Gaussian) sees the drawing."""
    seen = cv2.GaussianBlur(cv2.blur(samples, (PARTS, PARTS)), (0, 0), blur_px * PARTS)
    return np.asarray(seen, np.float32)


def _step(
    grey: NDArray[np.float32],
    drawn: NDArray[np.float32],
    inside: NDArray[np.bool_],
    corner_px: Array,
    start_px: Array,
    rim: int,
) -> tuple[Array, float, float]:
    """One step: where the corner is, misfit, and by how much the blur's variance is larger (px^2)."""
    reach = (int(np.sqrt(len(inside))) - 1) // 2
    whole = np.round(corner_px).astype(int)
    x, y = np.clip(whole + rim, reach, np.array(grey.shape[::-1]) - reach - 1)
    seen = grey[y - reach : y + reach + 1, x - reach : x + reach + 1].ravel()[inside]
    shift = corner_px - whole
    there = np.isfinite(seen)
    if there.sum() < LEAST_PIXELS:
        return corner_px, np.inf, 0.0
    seen = seen[there]
    matrix = np.column_stack([a.ravel()[inside][there] for a in _columns(drawn, shift, reach)])
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


def _columns(drawn: NDArray[np.float32], shift: Array, reach: int) -> list[NDArray[np.float32]]:
    """What the image is made of in each pixel: drawing, level, slope of the light (2), what a shift changes (2), and
    what blur does."""
    middle = (len(drawn) - 1) // 2
    size = 2 * reach + 1
    at = middle + PARTS * (np.arange(-reach, reach + 1)[None] - shift[:, None])
    x, y = (a.astype(np.float32) for a in np.meshgrid(at[0], at[1]))
    slope_x, slope_y = (cv2.Sobel(drawn, cv2.CV_32F, *order, ksize=1) * (PARTS / 2) for order in ((1, 0), (0, 1)))
    bend = cv2.Laplacian(drawn, cv2.CV_32F) * PARTS**2
    level, along_x, along_y, second = (
        np.asarray(cv2.remap(a, x, y, cv2.INTER_LINEAR), np.float32) for a in (drawn, slope_x, slope_y, bend)
    )
    across, down = np.meshgrid(np.arange(-reach, reach + 1), np.arange(-reach, reach + 1))
    ones = np.ones((size, size), np.float32)
    return [level, ones, across.astype(np.float32), down.astype(np.float32), -along_x, -along_y, second]
