"""An object's outline as a 20 x 20 binary pattern for ART 1: threshold, Prewitt, bounding square, grid.

Source: D'Souza, section 4.1, figures 4.2 and 4.3. One dark object on a light background.
"""

import cv2
import numpy as np

from daemon.arrays import Array
from daemon.vision.image import Grey, VisionError

CELLS = 20
MIN_POINTS = 0.02
"""Share of a cell's pixels that must lie on an edge for a 1."""


def silhouette(picture: Grey) -> Array:
    """The object's edges on a grid over its bounding square, (CELLS * CELLS,) of 0 and 1, row by row.

    picture: (H, W) grey. Where the thesis sets the threshold by experiment, Otsu's method finds it.
    Raises VisionError where nothing stands out from the background.
    """
    _, dark = cv2.threshold(picture, 0, 1, cv2.THRESH_BINARY_INV | cv2.THRESH_OTSU)
    rise = np.array([[-1, 0, 1]] * 3, np.float32)
    edges = np.hypot(cv2.filter2D(dark, cv2.CV_32F, rise), cv2.filter2D(dark, cv2.CV_32F, rise.T)) > 0
    rows, columns = np.nonzero(edges)
    if not len(rows):
        raise VisionError("silhouette: nothing stands out from the background")
    low = np.array([rows.min(), columns.min()])
    side = float(max(np.ptp(rows), np.ptp(columns)) + 1)
    row, column = (
        ((values - least) * CELLS / side).astype(int) for values, least in zip((rows, columns), low, strict=True)
    )
    points = np.zeros((CELLS, CELLS))
    np.add.at(points, (row, column), 1.0)
    return np.asarray(points > MIN_POINTS * (side / CELLS) ** 2, float).ravel()
