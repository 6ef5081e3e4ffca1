"""Convert lens models of other tools to k1 k2 p1 p2 k3, by least squares on rays over the image. Pure."""

from dataclasses import dataclass

import cv2
import numpy as np

from daemon.arrays import Array
from daemon.calibration.least_squares import INTRINSICS, camera_matrix, intrinsics_of, minimise, project
from daemon.errors import FacetdError

OURS = 5
"""Number of coefficients of our lens model: k1 k2 p1 p2 k3."""
POLYNOMIAL = (4, 5, 8, 12, 14)
"""Numbers of coefficients of OpenCV's pinhole models: radial and tangential; rational; thin prism; tilted sensor."""
FISHEYE = 4
WORST_PX = 0.1
"""Largest error of a refitted lens anywhere in the image."""
WIDEST = 3.0
"""Tangent of the widest angle off the axis at which a lens is judged."""
MARGIN = 1.2
"""Rays are tried so much wider than a lens without decentring needs for the image's corners."""
RAYS = 161
"""And so many along each axis."""


class LensError(FacetdError):
    """A lens model that cannot be used; the message says which, and what to do."""


@dataclass(frozen=True, eq=False)
class RefittedLens:
    """matrix (3, 3), distortion (5,) k1 k2 p1 p2 k3; off_px: largest error in the image, 0 where nothing was
    refitted."""

    matrix: Array
    distortion: Array
    off_px: float = 0.0


def refit_lens(matrix: Array, coefficients: Array, size: tuple[int, int], fisheye: bool = False) -> RefittedLens:
    """A lens as k1 k2 p1 p2 k3: unchanged where all further coefficients are 0, else fitted. fisheye: four coefficients
    of the angle (Kannala and Brandt, `equidistant`). Raises LensError."""
    values = np.ravel(coefficients).astype(float)
    if fisheye and len(values) != FISHEYE:
        raise LensError(f"a fisheye lens of {len(values)} coefficients: expected {FISHEYE}")
    if not fisheye and np.any(values) and len(values) not in POLYNOMIAL:
        raise LensError(f"{len(values)} distortion coefficients: expected {', '.join(map(str, POLYNOMIAL))} or none")
    if not fisheye and not np.any(values[OURS:]):
        return RefittedLens(matrix, np.concatenate([values[:OURS], np.zeros(max(0, OURS - len(values)))]))
    rays = rays_in_view(matrix, values, size, fisheye)
    px = _projected(rays, matrix, values, fisheye)
    start = intrinsics_of(matrix, np.zeros(OURS))
    seen = np.column_stack([rays, np.ones(len(rays))])

    def problem(x: Array) -> tuple[Array, Array]:
        there, _, by_lens = project(seen, np.zeros(6), x)
        return (there - px).ravel(), by_lens

    found, residuals, _ = minimise(problem, start)
    off_px = float(np.linalg.norm(residuals.reshape(-1, 2), axis=1).max())
    name = "fisheye" if fisheye else "rational or prism"
    if not off_px <= WORST_PX:
        raise LensError(
            f"its {name} lens cannot be written as k1 k2 p1 p2 k3: off by {off_px:.2g} px near the image's corners, "
            f"the limit is {WORST_PX:g}: calibrate these cameras here, with a board"
        )
    return RefittedLens(*camera_matrix(found[:INTRINSICS]), off_px)


def _projected(rays: Array, matrix: Array, values: Array, fisheye: bool) -> Array:
    points, project_points = np.column_stack([rays, np.ones(len(rays))])[:, None], cv2.projectPoints
    if fisheye:
        project_points = cv2.fisheye.projectPoints  # type: ignore[assignment]
    return np.asarray(project_points(points, np.zeros(3), np.zeros(3), matrix, values)[0], float).reshape(-1, 2)


def rays_in_view(matrix: Array, values: Array, size: tuple[int, int], fisheye: bool) -> Array:
    """Ray directions (N, 2) on the plane z = 1 whose image is inside the picture; none beyond where the model folds."""
    out = np.linspace(0.0, WIDEST, 600)
    centred = np.array([[matrix[0, 0], 0, 0], [0, matrix[1, 1], 0], [0, 0, 1.0]])
    away_px = _projected(np.column_stack([out, np.zeros_like(out)]), centred, values, fisheye)[:, 0]
    grows = np.append(np.diff(away_px) > 0, False)
    fold = int(np.argmin(grows))
    corners_px = np.array([[-0.5, -0.5], np.array(size) - 0.5]) - matrix[:2, 2]
    if away_px[fold] < np.abs(corners_px).min():
        raise LensError("its lens model folds back inside the image: wrong coefficients, or another image size")
    corner_px = np.linalg.norm(np.abs(corners_px).max(axis=0))
    farthest = min(out[fold], MARGIN * float(np.interp(corner_px, away_px[: fold + 1], out[: fold + 1])))
    steps = np.linspace(-farthest, farthest, RAYS)
    grid = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    grid = grid[np.linalg.norm(grid, axis=1) <= farthest]
    px = _projected(grid, matrix, values, fisheye)
    return np.asarray(grid[((px >= -0.5) & (px <= np.array(size) - 0.5)).all(axis=1)], float)
