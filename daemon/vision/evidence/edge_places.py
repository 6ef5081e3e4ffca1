"""What both cameras show at places along the edges of a part: whether an edge is there, and whether one should be.

In: a solid at its pose, both images. Out: EdgePlaces of the left and of the right camera. An edge between equal greys
shows in no picture, so each place has the levels that the facets on its two hands have elsewhere.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from daemon import frames
from daemon.arrays import Array, Flags, Index
from daemon.vision.geometry import Polyhedron, hidden, thickness
from daemon.vision.image import LEAST_SIGMAS, CameraImage, StereoImages, levels_across, peaks, slopes_across
from daemon.vision.refine import ROOM_PX, THIN_PX, across

PLACES, REACH_PX = 24, 7
"""On each edge, at which is looked, and how far to either hand."""
SHORTEST_PX = 12.0
ON_PLACE_PX, CLOSE_PX, BESIDE_PX = 2.25, 1.6, (2.5, 5.5)
"""Within what of its place a slope may be the edge, where one camera counts, and where both do; and between which the
level beside it is taken."""
INNER = 0.25
"""How much an edge between two facets that are seen counts, which may be alike."""
FAINT, STEP = 0.2, 0.6
"""Of the difference of levels that is expected: the share that a slope must be to be the edge; and the share that the
step there must reach to be the edge, however it slopes."""
FEWEST = 8
"""Places by which a facet's level is known; with fewer, all of its borders say it."""
_OFFSETS_PX = np.arange(-REACH_PX, REACH_PX + 1.0)
_BETWEEN_PX = (_OFFSETS_PX[2:-1] + _OFFSETS_PX[1:-2]) / 2
"""Of the slopes between those, where there may be a peak."""
_ON_PLACE, _CLOSE = (np.abs(_BETWEEN_PX) <= near for near in (ON_PLACE_PX, CLOSE_PX))
_BESIDE = np.stack(
    [np.flatnonzero((side * _OFFSETS_PX >= BESIDE_PX[0]) & (side * _OFFSETS_PX <= BESIDE_PX[1])) for side in (-1, 1)]
)
_TENTHS = 2.56
"""Standard deviations between the tenth and the ninetieth of hundred."""


@dataclass(frozen=True, eq=False)
class EdgePlaces:
    """What one camera shows at places along the edges of a part: length_px (E,) a place; weight (E,) of each edge;
    and of each place (E, S): visible, whether the camera should see it; there, whether an edge is near, as a worn one
    is; close, whether one as strong as expected is; expected, by how many sigmas the levels on its hands should differ:
    those of the facets, as their borders that show have them, or what lies beside the edge there; step, the share of
    that by which they do; spread, of the levels along the borders of those facets, in sigmas.
    """

    length_px: Array
    weight: Array
    visible: Flags
    there: Flags
    close: Flags
    expected: Array
    step: Array
    spread: Array


def edge_places(solid: Polyhedron, pose: Array, eyes: StereoImages) -> list[EdgePlaces]:
    """What the left and the right camera show along the edges of a part at cyclopean_from_part (4, 4)."""
    return [_samples(solid, pose, *one) for one in zip(eyes.views, eyes.geometry.eyes_mm, strict=True)]


def _samples(solid: Polyhedron, pose: Array, view: CameraImage, eye_mm: Array) -> EdgePlaces:
    ends = solid.lines[0]
    corners = view.eye.camera.project(frames.apply(pose, solid.corners_mm))
    thick = thickness(corners[solid.ring_table])
    hands = np.where((thick >= THIN_PX[1])[solid.hands], solid.hands, -1)
    shares = ((np.arange(PLACES) + 0.5) / PLACES)[:, None]
    places = solid.corners_mm[ends[:, :1]] * (1 - shares) + solid.corners_mm[ends[:, 1:]] * shares
    px = view.eye.camera.project(frames.apply(pose, places.reshape(-1, 3)))
    start, end = corners[ends[:, 0]], corners[ends[:, 1]]
    long = np.linalg.norm(end - start, axis=1)
    inside = ((px > ROOM_PX) & (px < np.array(view.grey.shape[::-1]) - 1 - ROOM_PX)).all(1)
    visible = inside.reshape(-1, PLACES) & ((hands >= 0).any(1) & (long >= SHORTEST_PX))[:, None]
    if not solid.convex:
        eye = frames.apply(frames.inverse(pose), eye_mm[None])[0]
        visible &= ~hidden(solid, places.reshape(-1, 3), eye).reshape(-1, PLACES)
    levels = np.zeros((len(px), len(_OFFSETS_PX)), np.float32)
    seen = visible.reshape(-1)
    levels[seen] = levels_across(view.smooth, px[seen], across(start, end).repeat(PLACES, 0)[seen], _OFFSETS_PX)
    slopes = np.abs(slopes_across(levels)).reshape(len(ends), PLACES, -1)
    beside = levels.reshape(len(ends), PLACES, -1)[..., _BESIDE].mean(3)
    there = np.asarray((peaks(slopes, LEAST_SIGMAS) & _ON_PLACE).any(2))
    usual, spread = _usual(hands, beside, visible, there, len(solid.facets))
    raised = np.linalg.norm(solid.bisectors, axis=1) > 0  # of facets that meet in a hollow either may shade the other
    known = ((hands >= 0) & raised[:, None])[:, None]
    before, after = np.moveaxis(np.where(known, usual[hands][:, None], beside), 2, 0)
    expected = np.abs(after - before)
    least = np.maximum(LEAST_SIGMAS, FAINT * expected)[..., None]
    close = np.asarray((peaks(slopes, least) & _CLOSE).any(2))
    step = (beside[..., 1] - beside[..., 0]) * np.sign(after - before) / np.maximum(expected, 1e-6)
    sharp = ~((thick > THIN_PX[0]) & (thick < THIN_PX[1]))
    outline = ((hands >= 0).sum(1) == 1) & np.where(solid.hands < 0, True, sharp[solid.hands]).all(1)
    spreads = np.where(hands >= 0, spread[hands], 0.0)
    return EdgePlaces(
        long / PLACES, np.where(outline, 1.0, INNER), visible, there, close,
        expected, step, np.hypot(spreads[:, 0], spreads[:, 1])[:, None],
    )  # fmt: skip


def _usual(hands: Index, beside: Array, visible: Flags, there: Flags, count: int) -> tuple[Array, Array]:
    """(F,) the level of each facet along its borders that show, and (F,) its spread; hands (E, 2) the facets beside
    each edge, with levels (E, S, 2)."""
    usual, spread = np.zeros(count), np.zeros(count)
    for facet in np.unique(hands[hands >= 0]).tolist():
        edge, hand = np.nonzero(hands == facet)
        level, seen = beside[edge, :, hand], visible[edge]
        firm = seen & there[edge]
        own = level[firm if firm.sum() >= FEWEST else seen]
        if len(own):
            low, usual[facet], high = np.sort(own)[(np.array([0.1, 0.5, 0.9]) * len(own)).astype(np.intp)]
            spread[facet] = (high - low) / _TENTHS
    return usual, spread
