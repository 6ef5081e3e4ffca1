"""Wait until the images are still: the arm has settled when two consecutive image pairs show the same."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from daemon.arm.workcell import Pictures, Workcell
from daemon.errors import FacetdError
from daemon.quantities import Seconds
from daemon.vision.image import block_means


class NotSettledError(FacetdError):
    """The images still changed at the time limit: the arm shakes, a part moves, or the light flickers."""

    code = "motion_blur"


@dataclass(frozen=True)
class Settling:
    """Settings that say when images count as still after the arm came to rest."""

    still_noise: Annotated[float, Meta(gt=0, le=1000)] = 6.0
    """Largest change of an image block, in multiples of the image's own noise."""
    floor_grey: Annotated[float, Meta(ge=0, le=255)] = 1.5
    """Change of a block that is always allowed, grey levels."""
    most_noise_grey: Annotated[float, Meta(gt=0, le=255)] = 2.0
    """Largest change of the whole image that can still be noise, grey levels."""
    timeout_s: Seconds = 5.0
    """Time after which to give up, s."""


@dataclass(frozen=True, eq=False)
class SettledPair:
    """An image pair that agrees with the previous one; seconds: from the arm's rest to the previous one."""

    before: Pictures
    pictures: Pictures
    seconds: float


def change(before: NDArray[np.uint8], after: NDArray[np.uint8]) -> tuple[float, float]:
    """(largest, typical) change of a block between two images, grey levels: the 99.8 % quantile, and the robust noise.

    A change of brightness that is common to the whole image (lamps) is subtracted first.
    """
    difference = block_means(after) - block_means(before)
    difference = np.abs(difference - np.median(difference))
    return float(np.quantile(difference, 0.998)), float(1.4826 * np.median(difference))


def still(before: Pictures, after: Pictures, settling: Settling) -> bool:
    """Whether two pairs show the same scene from the same place."""
    changes = (change(a.pixels, b.pixels) for a, b in ((before.left, after.left), (before.right, after.right)))
    return all(
        largest <= max(settling.floor_grey, settling.still_noise * min(typical, settling.most_noise_grey))
        for largest, typical in changes
    )


async def settled_pair(cell: Workcell, rest_s: float, settling: Settling) -> SettledPair:
    """Wait until two consecutive pairs agree. rest_s: when the arm came to rest, on the cell's clock. Raises
    NotSettledError, or the camera's error."""
    before = await cell.cameras.grab(rest_s, settling.timeout_s)
    while True:
        after = await cell.cameras.grab(max(before.left.taken_s, before.right.taken_s), settling.timeout_s)
        if still(before, after, settling):
            return SettledPair(before, after, max(0.0, before.left.taken_s - rest_s))
        if cell.clock() - rest_s > settling.timeout_s:
            raise NotSettledError(f"the images still change {settling.timeout_s:g} s after the arm came to rest")
        before = after
