"""What one eye sees: its image, its noise, and its outlines, with the fit of each made when it is first asked for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daemon.vision.geometry.rectified import Eye
from daemon.vision.image.grey import Grey, Noise, measure_noise
from daemon.vision.image.outlines import Outline, find_outlines
from daemon.vision.image.regions import Fine, scale_space
from daemon.vision.settings import VisionSettings


@dataclass(frozen=True, eq=False)
class Sight:
    """One eye's image as float32 grey levels, its noise, where it shows edges (None: nowhere) and its outlines."""

    eye: Eye
    image: NDArray[np.float32]
    noise: Noise
    fine: Fine | None
    outlines: list[Outline]


def look_with(eye: Eye, image: Grey, settings: VisionSettings) -> Sight:
    """Measure the noise of a checked image and find its outlines."""
    noise = measure_noise(image)
    fine, scales = scale_space(image, noise, settings)
    outlines = find_outlines(fine, scales, image.size, settings) if fine else []
    return Sight(eye, image.astype(np.float32), noise, fine, outlines)
