"""Images of a texture that moves before one camera, with a shutter, gain and focus of one's choice."""

from collections.abc import Callable

import cv2
import numpy as np

SIZE, FPS = (480, 360), 30.0
TEXTURE = cv2.GaussianBlur(np.random.default_rng(0).normal(0, 1, (500, 1800)).astype(np.float32), (0, 0), 3)
TEXTURE = (TEXTURE - TEXTURE.min()) / np.ptp(TEXTURE) * 180 + 30


def frame(
    way_px: Callable[[float], float], at_s: float, rng: np.random.Generator, readout_s: float = 0.0, depth: float = 0.0,
    gain: float = 1.0, blur_px: float = 0.0,
) -> np.ndarray:  # fmt: skip
    """A texture that moves along the rows; depth: how much farther the last row moves than the first, as a share."""
    width, height = SIZE
    share = np.arange(height) / height
    shift = np.array([way_px(at_s + readout_s * (part - 0.5)) * (1 + depth * part) for part in share])
    x = (np.arange(width) + 500 - shift[:, None]).astype(np.float32)
    y = np.broadcast_to(np.arange(height)[:, None] + 60, x.shape).astype(np.float32)
    image: np.ndarray = cv2.remap(TEXTURE, x, y, cv2.INTER_LINEAR) * gain
    image = cv2.GaussianBlur(image, (0, 0), blur_px) if blur_px else image
    return np.clip(image + rng.normal(0, 2, image.shape), 0, 255).astype(np.uint8)
