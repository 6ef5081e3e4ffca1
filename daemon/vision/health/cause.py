"""Why a part that is seen has no name, in the operator's words: the light, the place, what lies about it, or the part
itself. Pure; what could not be read from the picture is the part's own.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import cv2
import numpy as np

from daemon.arrays import Array
from daemon.vision.geometry import PlanarShape
from daemon.vision.health.examination import MEASURES
from daemon.vision.health.exposure import Image, Pictures, ground, hull, outlines
from daemon.vision.image import SATURATED, block_means
from daemon.vision.values import Cause, NearestGuess, Part

BORDER_PX = 4.0  # an outline that ends so near the border was cut there, or may have been
LIT_SHARE = 0.05  # of the part and its surroundings; with less that is bright at all it lies in the dark
BURNT_SHARE = 0.2  # of the part and its surroundings; beside so much white its edges are lost
PATTERNED_GREY = 2.0  # of unevenness; plain tables have 0.2 to 1.8, patterned ones 1.3 to 16 (bench: image_health)
MOSTLY = 0.5
"""A guess of whose edges so much shows is the part, and the rest is hidden, or too faint or too small to be seen."""


class Advice(NamedTuple):
    """A cause and what to do about it."""

    words: str
    remedy: str


ADVICE = {
    Cause.BORDER: Advice(
        "too near the border of the picture", "move it, or the arm, so that both cameras see it whole"
    ),
    Cause.DARK: Advice("too dark where it lies", "add light, or lengthen exposure_us"),
    Cause.BURNT: Advice("overexposed where it lies", "reduce the light, or shorten exposure_us"),
    Cause.HIDDEN: Advice("part of it does not show", "look from nearer or from another side, or move what covers it"),
    Cause.ALIKE: Advice("too little of it shows to tell it from another part", "look from another side, or turn it"),
    Cause.PATTERNED: Advice(
        "the pattern of the table runs into its edges", "put it on a plain surface, or light it better"
    ),
    Cause.STRANGE: Advice("it does not look like any taught part", "teach it, or this side of it"),
}


def with_causes(parts: Sequence[Part], guesses: Sequence[NearestGuess], pictures: Pictures) -> tuple[Part, ...]:
    """The parts, each unnamed one with the cause, and its reason in the operator's words before the recogniser's.

    pictures: left and right, (H, W) grey. guesses: what the unnamed came nearest to, in any order.
    """
    patterned: bool | None = None
    found = []
    for part in parts:
        if not part.named and part.facets:
            if patterned is None:
                patterned = _patterned(pictures)
            cause = _cause(part, parts, guesses, pictures, patterned)
            reason = f"{ADVICE[cause].words} ({part.recognition.reason})"
            part = replace(part, recognition=replace(part.recognition, cause=cause, reason=reason))
        found.append(part)
    return tuple(found)


def depth_doubt(guesses: Sequence[NearestGuess]) -> tuple[str, ...]:
    """Return notes for people where edges and print of one thing are at two depths: in one look that is the rig."""
    return tuple(
        f"depth calibration: edges and print of what may be {guess.label} do not agree on how far away it is "
        f"({abs(guess.print_apart_px):.0f} px); `facetctl calibrate stereo`"
        for guess in guesses
        if guess.print_apart_px
    )


def cause_of_nothing(pictures: Pictures) -> Cause | None:
    """Return what may hide a part where no part is seen at all; None where the picture would show one."""
    return _light(pictures) or (Cause.PATTERNED if _patterned(pictures) else None)


def _cause(
    part: Part, parts: Sequence[Part], guesses: Sequence[NearestGuess], pictures: Pictures, patterned: bool
) -> Cause:
    """Return the cause that has to be corrected first: of a part cut off or in the dark nothing else can be said."""
    hulls = outlines(part)
    own = next((g for g in guesses if len(g.left_px) and _holds(hull([g.left_px]), hulls[0].mean(0))), None)
    ends = hulls if own is None else (np.vstack([hulls[0], *own.left_px]), np.vstack([hulls[1], *own.right_px]))
    if any(_cut_off(corners, picture) for corners, picture in zip(ends, pictures, strict=True)):
        return Cause.BORDER
    light = _light([ground([corners], picture) for corners, picture in zip(hulls, pictures, strict=True)])
    if light is not None:
        return light
    if (own is not None and own.share > MOSTLY) or any(_before(other, part, hulls[0]) for other in parts):
        return Cause.HIDDEN
    if part.recognition.ambiguous and not (patterned and len(part.facets) == 1):
        return Cause.ALIKE
    return Cause.PATTERNED if patterned else Cause.STRANGE


def _light(levels: Sequence[Image]) -> Cause | None:
    """Whether either camera's grey levels, of any shape, lie too low or too high."""
    lit = int(MEASURES["darkness"].limit)
    if any(np.count_nonzero(level >= lit) < LIT_SHARE * level.size for level in levels):
        return Cause.DARK
    burnt = any(np.count_nonzero(level >= SATURATED) > BURNT_SHARE * level.size for level in levels)
    return Cause.BURNT if burnt else None


def _holds(corners: Array, point: Array) -> bool:
    return cv2.pointPolygonTest(corners.astype(np.float32), (float(point[0]), float(point[1])), False) >= 0


def _cut_off(outline_px: Array, picture: Image) -> bool:
    height, width = picture.shape
    return bool((outline_px < BORDER_PX).any() or (outline_px > np.array([width - 1, height - 1]) - BORDER_PX).any())


def _before(other: Part, part: Part, own: Array) -> bool:
    """Whether another part is nearer to the cameras and covers some of this one in the left camera. One that has a
    name: what has none may be more of this one.
    """
    if not other.named or not other.facets or other.cyclopean_from_part[2, 3] >= part.cyclopean_from_part[2, 3]:
        return False
    return PlanarShape.of(own).common(PlanarShape.of(outlines(other)[0])) > 0


def unevenness(picture: Image) -> float:
    """Median step between neighbouring 8x8 px blocks, grey levels: the table's, as parts fill less than half."""
    return float(np.median(np.abs(np.diff(block_means(picture), axis=1))))


def _patterned(pictures: Pictures) -> bool:
    return max(map(unevenness, pictures)) > PATTERNED_GREY
