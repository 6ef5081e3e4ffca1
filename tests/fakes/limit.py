"""Compare the corner noise of an observation with the Cramer-Rao bound of light and optics.

It shows whether light (contrast, noise), focus (blur) or calibration limits the accuracy.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from daemon.arrays import Array
from daemon.vision.values import FacetView, Polygon


@dataclass(frozen=True)
class Limit:
    """Medians over the corners of a look. seen_px: noise of a corner across the epipolar lines, in one camera;
    bound_px: the least it could be; noise_sigma, contrast: grey levels; blur_px: sigma of the edges' blur; edge_px:
    side length.
    """

    seen_px: float
    bound_px: float
    noise_sigma: float
    contrast: float
    blur_px: float
    edge_px: float

    @property
    def ratio(self) -> float:
        """Measured over possible noise: near 1 the images are fully used; far above it, calibration or model is off."""
        return self.seen_px / self.bound_px if self.bound_px > 0 else float("nan")


def side_bound(noise_sigma: float, contrast: Array, blur_px: float, length_px: Array) -> Array:
    """Least sigma, px, of a straight side's offset: (sigma / A) sqrt(2 sqrt(pi) blur) a row, over sqrt(rows)."""
    a_row = noise_sigma / np.maximum(contrast, 1e-6) * np.sqrt(2 * np.sqrt(np.pi) * blur_px)
    return np.asarray(a_row / np.sqrt(np.maximum(length_px, 1.0)))


def corner_bound(polygon: Polygon, noise_sigma: float, blur_px: float) -> Array:
    """Least sigma (N,) px, mean over directions, of each corner where two sides of the polygon meet.

    A line's offset is known twice as badly at its end as in its middle, and two lines meet the worse the flatter
    they do.
    """
    chord = np.roll(polygon.corners_px, -1, 0) - polygon.corners_px
    length = np.linalg.norm(chord, axis=1)
    end = 2 * side_bound(noise_sigma, polygon.contrast, blur_px, length)
    unit = chord / np.maximum(length, 1e-9)[:, None]
    before = np.roll(unit, 1, 0)
    sine = np.abs(before[:, 0] * unit[:, 1] - before[:, 1] * unit[:, 0])
    return np.asarray(np.sqrt((end**2 + np.roll(end, 1) ** 2) / 2) / np.maximum(sine, 0.05))


def limit(view: FacetView) -> Limit | None:
    """The measures of one look; None where nothing was seen."""
    polygons = view.polygons_left + view.polygons_right
    off = [f.epipolar_px for g in view.groups for f in g.facets]
    if not polygons or not off:
        return None
    bounds = np.concatenate([corner_bound(p, view.noise_sigma, view.blur_px) for p in polygons])
    lengths = np.concatenate([np.linalg.norm(np.roll(p.corners_px, -1, 0) - p.corners_px, axis=1) for p in polygons])
    seen = float(np.median(np.concatenate(off))) / 0.6745 / np.sqrt(2)
    contrast = float(np.median(np.concatenate([p.contrast for p in polygons])))
    return Limit(seen, float(np.median(bounds)), view.noise_sigma, contrast, view.blur_px, float(np.median(lengths)))
