"""Facets that one eye outlined and the other did not, looked for in the other eye along the edge of a facet that
both see.

Two corners are then known in both eyes. The rest follow, all along their epipolar lines, from one number: how the facet
turns about that edge. The turn whose sides show best in the other image is taken, and must then pass like any other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from daemon.arrays import Array
from daemon.vision.facets.candidates import COVERED, Candidate, candidates, flatness_sigmas
from daemon.vision.facets.grouping import same_edges
from daemon.vision.geometry import Baseline, areas, rings
from daemon.vision.image import CameraImage, Outline, StereoImages, fits, outlined, probe_sides
from daemon.vision.settings import VisionSettings
from daemon.vision.values import Polygon

# Set by eye on the rendered scenes.
_TURNS = np.linspace(-0.8, 0.8, 97)  # disparity by distance from the hinge
_MOST_TRIED = 8  # outlines of an eye
_EDGE_PX = 4.0  # ends of a side and of a known facet's are one: D'Souza's tolerance (section 5.1)
_REACH_PX, _SIGMA_PX = 2.0, 1.5


@dataclass(frozen=True, eq=False)
class _Hinge:
    """Side `side` of an outline in one eye is also a known facet's: its two ends (2, 2) in the other eye, px."""

    side: int
    other_px: Array


def complete(
    chosen: list[Candidate], outlines: Sequence[Sequence[Outline]], eyes: StereoImages, settings: VisionSettings
) -> list[Candidate]:
    """Further facets, none of which covers a chosen one or another; outlines: of the left and the right eye."""
    added: list[Candidate] = []
    for own, seen, other, is_left in zip(outlines, eyes.views, eyes.views[::-1], (True, False), strict=True):
        tried = 0
        for outline in own:
            if tried >= _MOST_TRIED:
                break
            hinge = _hinge(outline, chosen + added, is_left)
            if hinge is None:
                continue
            tried += 1
            found = _swing(outline, hinge, seen, other, is_left, eyes.geometry, settings)
            if found is not None and not any(found.covers(k) > COVERED for k in chosen + added):
                added.append(found)
    return added


def _hinge(outline: Outline, known: list[Candidate], is_left: bool) -> _Hinge | None:
    """A side shared with a known facet, unless the outline covers one."""
    found = None
    for c in known:
        own, far = (c.left.polygon, c.right.polygon) if is_left else (c.right.polygon, c.left.polygon)
        if outline.shape.covers(c.left_shape if is_left else c.right_shape) > COVERED:
            return None
        found = found or _common_side(outline.corners, own, far)
    return found


def _common_side(corners: Array, own: Polygon, far: Polygon) -> _Hinge | None:
    same = same_edges(corners, own.corners_px, _EDGE_PX)
    if not same.any():
        return None
    i, j = divmod(int(np.argmax(same)), same.shape[1])
    return _Hinge(i, far.corners_px[[(j + 1) % len(far.corners_px), j]])


def _swing(
    outline: Outline,
    hinge: _Hinge,
    seen: CameraImage,
    other: CameraImage,
    is_left: bool,
    geometry: Baseline,
    settings: VisionSettings,
) -> Candidate | None:
    """The outline's facet, turned about its hinge to where the other eye shows it; None where it does not."""
    if outline in seen.fitted and seen.fitted[outline] is None:
        return None
    polygons = _turned(outline, hinge, seen, other)
    polygons = polygons[areas(rings(list(polygons))) < -settings.min_area_px]
    if not len(polygons):
        return None
    start, end = (np.delete(p, hinge.side, axis=1).reshape(-1, 2) for p in (polygons, np.roll(polygons, -1, axis=1)))
    strength = probe_sides([(other.smooth, len(start))], start, end, other.grain)[0].reshape(len(polygons), -1)
    own = np.delete(outline.strength, hinge.side)
    agree = np.minimum(strength * np.sign(own), np.abs(own))
    best = int(np.argmax(agree.sum(1)))
    if not np.all(np.isfinite(agree[best])):
        return None
    image = [(other.smooth, polygons.shape[1])]
    near = rings([polygons[best]])
    (found,) = outlined(image, [other.grain], near, [outline.border], settings, _REACH_PX, _SIGMA_PX)
    if found is None:
        return None
    (here,), (far,) = fits(((seen, [outline]), (other, [found])))
    if here is None or far is None:
        return None
    worth = min(outline.support, found.support)
    (made,) = candidates([(here, far, worth) if is_left else (far, here, worth)], geometry)
    off = made.facet.epipolar_px.max() > settings.max_epipolar_px
    return None if off or flatness_sigmas(made.facet) > settings.planarity_sigmas else made


def _turned(outline: Outline, hinge: _Hinge, seen: CameraImage, other: CameraImage) -> Array:
    """The outline in the other eye for every turn about the hinge, (T, N, 2) px."""
    here = seen.eye.ideal(outline.corners)
    n = len(here)
    ends = here[[hinge.side, (hinge.side + 1) % n]]
    disparity = ends[:, 0] - other.eye.ideal(hinge.other_px)[:, 0]
    edge = ends[1] - ends[0]
    length = float(np.hypot(*edge))
    from_edge = here - ends[0]
    along = from_edge @ edge / length**2
    away = (from_edge[:, 0] * edge[1] - from_edge[:, 1] * edge[0]) / length
    shift = disparity[0] + along * (disparity[1] - disparity[0]) + _TURNS[:, None] * away
    there = np.stack([here[:, 0] - shift, np.broadcast_to(here[:, 1], shift.shape)], 2)
    return other.eye.pixels(there.reshape(-1, 2)).reshape(len(_TURNS), n, 2)
