"""What speaks against a named part, whichever way it got its name: edges it should show that neither picture has, edges
inside it that lie off its faces, and a look-alike that fits better.

A near twin that was never taught (a mirror image, another size, a corner cut off) has most edges where the part has
them; some of the part's own are not there. An edge between equal greys shows in no picture, so each place on an edge
counts as much as the levels on its two hands let one expect. Where both cameras miss the same place it is no accident
of one of them: such places count once more. Print beside an edge makes it fade here and there, a part that is not there
makes it end: only what is missing up to a corner counts so. In: named parts, both images. Out: their confidence, or no
name.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from daemon import frames
from daemon.arrays import Array, Flags, Index
from daemon.vision.evidence.occlusion import hidden_places
from daemon.vision.evidence.off_faces import off_faces_px
from daemon.vision.evidence.rivals import untaught_rival
from daemon.vision.geometry import Polyhedron, hidden
from daemon.vision.image import CameraImage, StereoImages, levels_across, peaks, slopes_across
from daemon.vision.model import Model
from daemon.vision.recognition import Recognised, without_name
from daemon.vision.refine import ROOM_PX, THIN_PX, ShapeBatch, across

PLACES, REACH_PX = 24, 7
"""On each edge, at which is looked, and how far to either hand."""
SHORTEST_PX = 12.0
LEAST_SIGMAS, ON_PLACE_PX, CLOSE_PX, BESIDE_PX = 4.0, 2.25, 1.6, (2.5, 5.5)
"""What a slope must be to be an edge; within what of its place it may be one, where one camera counts, and where both
do; and between which the level beside it is taken."""
EXPECTED, INNER = 6.0, 0.25
"""In sigmas of the noise, the difference of levels at which an edge surely shows; how much an edge between two facets
that are seen counts, which may be alike."""
CLEARLY, SPREADS, FAINT, STEP = 8.0, 2.0, 0.2, 0.6
"""Where both cameras count: the difference of levels, in sigmas and in spreads of the levels along the facets' borders
(print makes them differ); the share of it that a slope must be to be the edge; and the share of it that the step there
must fall short of."""
AT_END = 3
"""Of its places, how many beside a corner may be there though the edge ends before it."""
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
MISSING_PX, OFF_PX = 2.0, 5.0
"""Lengths from where on evidence grows as their logarithm: what is beside a missing place is missing too."""
RIVAL_NATS = 10.0
"""What a look-alike's lead is counted in."""
TWIN, BY_MISSING, BY_BOTH, BY_OFF, BY_RIVAL = -6.8, 0.59, 1.6, 2.1, 2.73
"""Log odds that what fits is a near twin, where nothing speaks against the part, and how they grow with the per cent
missing, with the length both cameras miss, with the length off its faces, and with each RIVAL_NATS for a look-alike: a
logistic regression on 282 parts named rightly in rendered looks and 73 near twins of look-alike families, taken for as
seldom as three in 200 of what is seen. tests/bench/missing.py makes it again; tests/bench/look_alikes.py shows what it
does."""
_WEIGHTS = BY_MISSING, BY_BOTH, BY_OFF, BY_RIVAL
MOST_LIKELY_TWIN = 0.055
"""Likelier, and the part has no name."""


@dataclass(frozen=True)
class Against:
    """What speaks against a part: missing, the share of its edges that is not there though the levels beside it differ;
    both_px, of these what both cameras miss, px over both; off_px, edges inside it that lie off its faces; rival, nats
    by which a look-alike that nobody taught fits better."""

    missing: float
    both_px: float
    off_px: float
    rival: float

    @property
    def terms(self) -> tuple[float, float, float, float]:
        """What the log odds of a near twin grow with."""
        lengths = float(np.log1p(self.both_px / MISSING_PX)), float(np.log1p(self.off_px / OFF_PX))
        return 100 * self.missing, *lengths, self.rival / RIVAL_NATS

    @property
    def twin(self) -> float:
        """How likely what fits is a near twin that was never taught."""
        return float(1 / (1 + np.exp(-TWIN - np.dot(_WEIGHTS, self.terms))))

    def __str__(self) -> str:
        missing, both, off, rival = np.multiply(_WEIGHTS, self.terms)
        if rival > max(missing + both, off):
            return "its mirror image, or one with a tip the other way, fits better"
        if off > missing + both:
            return f"edges of {self.off_px:.0f} px inside it lie before or behind its faces"
        return f"{self.missing:.0%} of what that should show is in neither picture"


def checked_for_missing(found: Sequence[Recognised], model: Model, eyes: StereoImages) -> tuple[Recognised, ...]:
    """The named ones with a confidence that counts what speaks against them; without their names where that is too
    much."""
    return tuple(_checked(one, model, eyes) if one.named else one for one in found)


def _checked(one: Recognised, model: Model, eyes: StereoImages) -> Recognised:
    verdict = one.part.recognition
    against = speaks_against(model.metric[one.label].solid, one.part.cyclopean_from_part, eyes)
    confidence = verdict.confidence * (1 - against.twin)
    if against.twin > MOST_LIKELY_TWIN:
        return without_name(one, f"may be {one.label}, but {against}", confidence, model)
    return replace(one, part=replace(one.part, recognition=replace(verdict, confidence=confidence)))


def speaks_against(solid: Polyhedron, pose: Array, eyes: StereoImages) -> Against:
    """What speaks against a part's being at cyclopean_from_part (4, 4). Where that would take its name it is asked what
    lies before the part: that hides edges, and has some of its own."""
    both = edge_places(solid, pose, eyes)
    off_px, rival = off_faces_px(solid, pose, eyes), untaught_rival(solid, pose, eyes)
    found = Against(missing_share(both), missing_in_both_px(both), off_px, rival)
    if found.twin < MOST_LIKELY_TWIN:
        return found
    hidden = [hidden_places(solid, pose, eyes, k, seen.visible, seen.there) for k, seen in enumerate(both)]
    both = [replace(seen, visible=seen.visible & ~hides) for seen, hides in zip(both, hidden, strict=True)]
    off_px = 0.0 if any(hides.any() for hides in hidden) else off_px
    return Against(missing_share(both), missing_in_both_px(both), off_px, rival)


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


def missing_share(both: Sequence[EdgePlaces]) -> float:
    """Of the edges that a part should show in both pictures, the share that is not there though the levels beside it
    differ."""
    lacking = every = 0.0
    for seen in both:
        each = (seen.weight * seen.length_px)[:, None] * seen.visible
        lacking += float((each * ~seen.there * np.minimum(seen.expected / EXPECTED, 1.0)).sum())
        every += float(each.sum())
    return lacking / max(every, 1e-9)


def missing_in_both_px(both: Sequence[EdgePlaces]) -> float:
    """Length of edge, px over both pictures, that neither camera has up to a corner and that one at least should see
    clearly."""
    missing, found = [], []
    for seen in both:
        shows = seen.close | (seen.step >= STEP)
        clear = (seen.expected >= CLEARLY) & (seen.expected >= SPREADS * seen.spread)
        missing.append(seen.visible & clear & ~shows)
        found.append(seen.visible & shows)
    lost: Flags = np.asarray(~found[0] & ~found[1])
    return float(
        sum((seen.length_px[:, None] * _ending(each & lost)).sum() for seen, each in zip(both, missing, strict=True))
    )


def _ending(missing: Flags) -> Flags:
    """(E, S) which of missing places belong to a row of such that reaches to AT_END places from an end of the edge."""
    broken: Flags = np.pad(~missing, ((0, 0), (1, 1)), constant_values=True)
    place = np.arange(broken.shape[1])
    before = np.maximum.accumulate(np.where(broken, place, 0), 1)[:, 1:-1]
    after = np.minimum.accumulate(np.where(broken, place, place[-1])[:, ::-1], 1)[:, ::-1][:, 1:-1]
    return np.asarray(missing & ((before <= AT_END) | (after >= place[-1] - AT_END)))


def _samples(solid: Polyhedron, pose: Array, view: CameraImage, eye_mm: Array) -> EdgePlaces:
    ends = solid.lines[0]
    corners = view.eye.camera.project(frames.apply(pose, solid.corners_mm))
    thick = ShapeBatch.of([solid]).thickness(corners)
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
