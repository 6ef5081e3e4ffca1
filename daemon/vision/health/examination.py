"""What is wrong with the images themselves: each measure with its limit, a name, and advice in words. Pure.

In: a stereo pair, the one before it, the rig, the scene seen. Out: findings. A finding is about the picture (light,
lens, cable, mounting), never about parts; what follows from one is for the caller to decide.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daemon.vision.geometry import StereoRig
from daemon.vision.health.blur import measure_blur
from daemon.vision.health.camera_order import Assignment, assignment
from daemon.vision.image import SATURATED, block_means
from daemon.vision.values import Scene

Image = NDArray[np.uint8]
Pair = tuple[Image, Image]


@dataclass(frozen=True)
class Measure:
    """A limit a picture is held to. above: whether values above the limit are bad (else those below). misleads: whether
    such a picture shows something else than what is there, so that nothing may be done on the strength of it."""

    limit: float
    unit: str
    above: bool
    advice: str
    misleads: bool = False


MEASURES = {
    "saturation": Measure(5.0, "% of pixels", True, "too bright: shorten exposure_us, lower gain, or reduce the light"),
    "darkness": Measure(30.0, "grey levels", False, "too dark: lengthen exposure_us, raise gain, or add light"),
    "covered": Measure(4.0, "grey levels", False, "nothing to see: is the lens covered, or the light off?", True),
    "focus": Measure(1.5, "px", True, "out of focus: focus the lens at the working distance, or clean it"),
    "motion": Measure(6.0, "px", True, "blurred by motion: shorten exposure_us, or let the arm settle longer"),
    "half": Measure(
        4.0, "% of rows", True, "half a frame: check the cable and the USB bandwidth (MJPEG needs least)", True
    ),
    "torn": Measure(5.0, "grey levels", True, "torn frame: lower the frame rate, or use another USB controller"),
    "frozen": Measure(
        0.0, "same pairs", True, "frozen: the camera repeats its last frame; unplug it and plug it in", True
    ),
    "doubled": Measure(
        0.0,
        "same images",
        True,
        "both cameras show the same image: give cameras.left and cameras.right two devices",
        True,
    ),
    "swapped": Measure(
        0.5,
        "exchanged pairs",
        True,
        "left and right are swapped: exchange the two USB plugs (or one camera was knocked upwards: look at it)",
        True,
    ),
    "knocked": Measure(
        3.5,
        "px",
        True,
        "a camera was knocked: it is not where it was calibrated; fasten it, `facetctl calibrate verify`",
        True,
    ),
    "epipolar": Measure(0.6, "px", True, "the cameras have moved since calibration: `facetctl calibrate stereo`"),
}


@dataclass(frozen=True)
class Finding:
    """One measure of one picture: name as in MEASURES; camera left, right or pair; the value; whether it is in
    order."""

    name: str
    camera: str
    value: float
    good: bool

    def __str__(self) -> str:
        """Return the finding as text, such as `left: too dark: lengthen exposure_us ... (darkness 12 grey levels, limit
        30)`."""
        measure = MEASURES[self.name]
        figures = f"{self.name} {self.value:.3g} {measure.unit}, limit {measure.limit:g}"
        return f"{self.camera}: {measure.advice} ({figures})" if not self.good else f"{self.camera}: {figures}"


def _finding(name: str, camera: str, value: float) -> Finding:
    measure = MEASURES[name]
    return Finding(name, camera, value, value <= measure.limit if measure.above else value >= measure.limit)


def examine(
    pair: Pair, before: Pair | None = None, rig: StereoRig | None = None, sharp: bool = True
) -> tuple[Finding, ...]:
    """Every measure that can be taken of a pair of grey images (H, W), or of one image given twice; what cannot be
    measured is left out.

    before: the pair grabbed before this one (frozen). rig: finds swapped cameras and a camera knocked by much; a small
    knock is for drift() and for daemon/calibration/drift.py to tell, from measured corners. sharp: whether sharpness()
    is asked, too; it takes longest.
    """
    findings: list[Finding] = []
    contrasts = [_contrast(image) for image in pair]
    for k, (camera, image) in enumerate(zip(("left", "right"), pair, strict=True)):
        findings += _image(camera, image, contrasts[k], contrasts[1 - k])
    if sharp:
        findings += sharpness(pair)
    same = sum(np.array_equal(now, then) for now, then in zip(pair, before, strict=True)) if before else 0
    findings.append(_finding("frozen", "pair", float(same)))
    if pair[0] is pair[1]:  # one camera's picture, twice
        return tuple(findings)
    findings.append(_finding("doubled", "pair", float(np.array_equal(*pair))))
    if rig is not None and all(f.good for f in findings):
        verdict, off_px = assignment(*pair, rig)
        if verdict is not Assignment.UNKNOWN:
            findings.append(_finding("swapped", "pair", float(verdict is Assignment.SWAPPED)))
        if not np.isnan(off_px):
            findings.append(_finding("knocked", "pair", off_px))
    return tuple(findings)


def _contrast(image: Image) -> float:
    """Grey levels between the darkest and the brightest parts of an image, noise averaged out."""
    return float(np.ptp(np.percentile(block_means(image), [2, 98])))


def _image(camera: str, image: Image, contrast: float, other_contrast: float) -> Iterator[Finding]:
    """Light first: of a picture without light or contrast nothing else can be said.

    A plain bright picture may be an empty table; a dark one, or one beside a camera that sees something, is covered.
    """
    yield _finding("half", camera, 100.0 * _repeated_rows(image))
    bright = float(np.percentile(image[::4, ::4], 99))
    least = MEASURES["covered"].limit
    plain = contrast < least
    covered = plain and (bright < MEASURES["darkness"].limit or other_contrast > 3 * least)
    yield Finding("covered", camera, contrast, not covered)
    if plain:
        return
    yield _finding("saturation", camera, 100.0 * float(np.mean(image >= SATURATED)))
    yield _finding("darkness", camera, bright)
    yield _finding("torn", camera, _tear(image))


def sharpness(pair: Pair) -> tuple[Finding, ...]:
    """Measure how sharp the edges of a pair of grey images (H, W) are, where they have enough."""
    findings: list[Finding] = []
    for camera, image in zip(("left", "right"), pair, strict=True):
        blur = measure_blur(image)
        if not np.isnan(blur.least_px):
            findings += [_finding("focus", camera, blur.least_px), _finding("motion", camera, blur.motion_px)]
    return tuple(findings)


def _repeated_rows(image: Image) -> float:
    """Share of the rows in the longest run of rows that repeat the one above: a sensor's noise never does, where it is
    not burnt out."""
    longest = run = 0
    for same in np.all((image[1:] == image[:-1]) & (image[1:] < 255), axis=1):
        run = run + 1 if same else 0
        longest = max(longest, run)
    return longest / len(image)


def _tear(image: Image) -> float:
    """Grey levels by which a row's step to the next falls when the lower part is shifted: high where two moments meet.

    Of the rows that differ most from the next, compared with their neighbours. A part's edge that happens to follow a
    row gains nothing from shifting.
    """
    grey, reach_px = image.astype(np.float32), min(40, image.shape[1] // 8)
    step = np.abs(np.diff(grey, axis=0)).mean(axis=1)
    excess = np.maximum(step - 0.9 * np.median(step), 0.0) + 0.25
    around = np.maximum(np.r_[0.0, excess[:-1]], np.r_[excess[1:], 0.0])
    sudden = excess / (around + 0.25)
    worst = 0.0
    for row in (k for k in np.argsort(sudden)[-3:] if sudden[k] > 1.5):
        above, below = grey[row], grey[row + 1]
        inner = slice(reach_px, len(above) - reach_px)
        shifted = [np.abs(np.roll(below, s)[inner] - above[inner]).mean() for s in range(-reach_px, reach_px + 1)]
        noise = float(np.median(step))
        if min(shifted) - noise < 0.4 * (shifted[reach_px] - noise):
            worst = max(worst, float(shifted[reach_px] - min(shifted)))
    return worst


def drift(scene: Scene) -> tuple[Finding, ...]:
    """Median distance of matched corners from their epipolar lines, once enough of them were matched."""
    rows = [facet.epipolar_px for group in scene.view.groups for facet in group.facets]
    if not rows or sum(map(len, rows)) < 8:
        return ()
    return (_finding("epipolar", "pair", float(np.median(np.abs(np.concatenate(rows))))),)


def misleading(findings: tuple[Finding, ...]) -> tuple[Finding, ...]:
    """Return the findings that make the pair worse than none."""
    return tuple(finding for finding in findings if not finding.good and MEASURES[finding.name].misleads)


def troubles(findings: tuple[Finding, ...]) -> tuple[str, ...]:
    """Return what is not in order, a line each, for people."""
    return tuple(str(finding) for finding in findings if not finding.good)


def findings_json(findings: tuple[Finding, ...]) -> list[dict[str, Any]]:
    """Return the findings for run logs and machines: name, camera, value, good, and limit."""
    return [
        {
            "name": f.name,
            "eye": f.camera,
            "value": round(f.value, 4),
            "good": f.good,
            "limit": MEASURES[f.name].limit,
            "unit": MEASURES[f.name].unit,
        }
        for f in findings
    ]
