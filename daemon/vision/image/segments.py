"""Straight segments of one image, and the corners where two of them meet. Nothing closed is asked for.

A facet's outline breaks where the table is patterned, the face printed or the edge worn; most of its length still is
straight. Source: LSD (Grompone von Gioi, Jakubowicz, Morel and Randall 2010), OpenCV's.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from daemon.arrays import Array, Flags, Index
from daemon.vision.image.grey import Grey

SHARE = 0.5
"""Scale of the image at which segments are searched: half the pixels a side, a quarter of the time."""
SHORTEST_PX = 11.0
SMOOTHING_PX, GAIN, STRONG_GREY = 0.8, 3.0, 10.0
"""Smoothing, px, and gain by which contrast is raised where there is little; half of it and less where grey levels
differ from their surroundings by STRONG_GREY and more: a raised shade beside a strong edge is a line that is not there.
Of 343 plain, printed and metal parts rendered on photographed and on grainy tables 327 were named with 1, 334 with 2,
337 with 3, 336 with 4."""
ABOUT_PX, COARSE = 36, 4
"""Radius, px, of the surroundings that a grey level is raised against, the nearer the more; and how many times coarser
pixels do for that."""
MAX_SEGMENTS, DIRECTIONS = 800, 16
"""The longest of each direction, so many in all: the grain of wood has thousands of one, and leaves those of a part."""
NEAR_PX, NEAR_SHARE = 12.0, 0.3
"""Distance from its end at which a segment may meet another: px, and share of its length."""
GAP_PX, OVERLAP_PX, OFF_LINE_PX, END_OFF_LINE_PX = 14.0, 4.0, 1.5, 3.75
SAME_WAY = np.cos(np.radians(4.0))
"""How a segment may go on that was broken: px to the next piece, px both may overlap, px that begins and ends off the
line of the first, and the angle between them."""
MIN_ANGLE = np.sin(np.radians(15.0))
MAX_CORNERS, CELL_PX = 1500, 64.0
"""Largest number of corners, taken evenly from cells of CELL_PX, those with the longest arms: a ruled table has
thousands, and leaves a part its own."""
AT_ONCE = 64  # segments held against all others: what a processor's cache holds


@dataclass(frozen=True, eq=False)
class Segments:
    """start, end (N, 2) px, the brighter side always on the same hand; the longest first."""

    start: Array
    end: Array

    @property
    def lengths_px(self) -> Array:
        """(N,) px."""
        return np.asarray(np.linalg.norm(self.end - self.start, axis=1))

    def chosen(self, which: Index | Flags) -> Segments:
        """Some of them."""
        return Segments(self.start[which], self.end[which])


@dataclass(frozen=True, eq=False)
class SegmentCorners:
    """Where two segments meet: at (C, 2) px; arms (C, 2, 2) px, the far ends of both; sign (C, 2): 1 where the segment
    runs away from the corner, -1 where it runs towards it; those with the longest shorter arm first."""

    at: Array
    arms: Array
    sign: Array

    def at_most(self, most: int) -> SegmentCorners:
        """Keep so many of them with long arms, all over the image."""
        kept = shared_out(cells_of(self.at), most)
        return SegmentCorners(self.at[kept], self.arms[kept], self.sign[kept])


def find_segments(grey: Grey) -> Segments:
    """The straight segments of an image (H, W), faint ones among strong ones as well."""
    found = segments_by_lsd(_raised(grey))
    every = Segments(found[:, :2], found[:, 2:])
    return _longest(every.chosen(every.lengths_px >= SHORTEST_PX))


def _raised(grey: Grey) -> Grey:
    """An image (H, W) with more contrast where it has little."""
    size, side = grey.shape[::-1], 2 * (ABOUT_PX // COARSE) + 1
    smooth = cv2.GaussianBlur(grey.astype(np.float32), (0, 0), SMOOTHING_PX)
    coarse = cv2.resize(smooth, None, fx=1 / COARSE, fy=1 / COARSE, interpolation=cv2.INTER_AREA)
    about = cv2.stackBlur(coarse, (side, side))
    contrast2 = cv2.stackBlur((coarse - about) ** 2, (side, side))
    gain = GAIN / np.sqrt(1 + contrast2 / STRONG_GREY**2)
    about, gain = (cv2.resize(one, size, interpolation=cv2.INTER_LINEAR) for one in (about, gain))
    raised = cv2.multiply(cv2.subtract(smooth, about), gain)
    # 128 more, rounded and clipped, in one pass.
    return np.asarray(cv2.addWeighted(raised, 1.0, raised, 0.0, 128, dtype=cv2.CV_8U), np.uint8)


def _longest(every: Segments) -> Segments:
    """The longest of every direction, MAX_SEGMENTS in all, the longest first."""
    every = every.chosen(np.argsort(-every.lengths_px, kind="stable"))
    if len(every.start) <= MAX_SEGMENTS:
        return every
    way = every.end - every.start
    direction = np.rint(np.arctan2(way[:, 1], way[:, 0]) * (DIRECTIONS / np.pi)).astype(int) % DIRECTIONS
    return every.chosen(shared_out(direction, MAX_SEGMENTS))


def segments_by_lsd(grey: Grey) -> Array:
    """(N, 4) px, both ends of each segment."""
    found = cv2.createLineSegmentDetector(cv2.LSD_REFINE_STD, scale=SHARE).detect(grey)[0]
    return np.zeros((0, 4)) if found is None else np.asarray(found, float).reshape(-1, 4)


def join_segments(segments: Segments) -> Segments:
    """The segments, and as one every two of which the second goes on where the first ends: print and noise break
    what is one edge, and its pieces end far from its corners. The longest first."""
    start, end = segments.start, segments.end
    unit = (end - start) / segments.lengths_px[:, None]
    first, second = pairs_within(end[:, 0], start[:, 0], GAP_PX)
    level = np.abs(end[first, 1] - start[second, 1]) < GAP_PX + OFF_LINE_PX
    first, second = first[level], second[level]
    normal = np.stack([-unit[first, 1], unit[first, 0]], 1)
    across_gap, beyond = start[second] - end[first], end[second] - end[first]
    along, off = (across_gap * unit[first]).sum(1), np.abs((across_gap * normal).sum(1))
    straight = (unit[first] * unit[second]).sum(1) > SAME_WAY
    on_line = (off < OFF_LINE_PX) & (np.abs((beyond * normal).sum(1)) < END_OFF_LINE_PX)
    good = straight & on_line & (along > -OVERLAP_PX) & (along < GAP_PX)
    first, second = first[good], second[good]
    return _longest(Segments(np.concatenate([start, start[first]]), np.concatenate([end, end[second]])))


def segment_corners(segments: Segments) -> SegmentCorners:
    """Every two segments whose lines meet near an end of both, at an angle."""
    way, length = segments.end - segments.start, segments.lengths_px
    unit = way / length[:, None]
    reach = np.maximum(NEAR_PX, NEAR_SHARE * length)
    first, second = _ends_near(segments, reach)
    sine = unit[first, 0] * unit[second, 1] - unit[first, 1] * unit[second, 0]
    steep = np.abs(sine) > MIN_ANGLE
    first, second, sine = first[steep], second[steep], sine[steep]
    apart = segments.start[second] - segments.start[first]
    along_first = (apart[:, 0] * unit[second, 1] - apart[:, 1] * unit[second, 0]) / sine
    along_second = (apart[:, 0] * unit[first, 1] - apart[:, 1] * unit[first, 0]) / sine
    near = np.ones(len(first), bool)
    from_start = []
    for along, own in ((along_first, first), (along_second, second)):
        to_start, to_end = np.abs(along), np.abs(along - length[own])
        near &= np.minimum(to_start, to_end) < reach[own]
        from_start.append(to_start < to_end)
    first, second = first[near], second[near]
    at = segments.start[first] + along_first[near, None] * unit[first]
    away = np.stack([from_start[0][near], from_start[1][near]], 1)
    which = np.stack([first, second], 1)
    arms = np.where(away[..., None], segments.end[which], segments.start[which])
    reach = np.linalg.norm(arms - at[:, None], axis=2).min(1)
    order = np.argsort(-reach, kind="stable")
    order = order[shared_out(cells_of(at[order]), MAX_CORNERS)]
    return SegmentCorners(at[order], arms[order], np.where(away, 1, -1)[order])


def cells_of(at: Array) -> Index:
    """(N,) in which part of the image each of places (N, 2) px lies."""
    column, row = np.floor(at / CELL_PX).astype(np.intp).T
    return np.asarray(column + 1000 * row)


def shared_out(group: Index, most: int) -> Index:
    """Return the indices to keep of N items, the best first, each of a group (N,): at most so many, and of no group
    more than of another that has more to give."""
    if len(group) <= most:
        return np.arange(len(group))
    return np.sort(np.argsort(ranks(group), kind="stable")[:most])


def ranks(group: Index) -> Index:
    """(N,) how many of the same group (N,) come before each."""
    order = np.argsort(group, kind="stable")
    found = np.empty(len(group), np.intp)
    found[order] = np.arange(len(group)) - np.searchsorted(group[order], group[order])
    return found


def _ends_near(segments: Segments, reach_px: Array) -> tuple[Index, Index]:
    """Every two segments, the earlier first, of which two ends are no farther apart than both may reach."""
    count, ends, reach = len(reach_px), np.concatenate([segments.start, segments.end]), np.tile(reach_px, 2)
    x, y = (ends - ends.sum(0) / max(len(ends), 1)).T  # small numbers: single precision is enough for their squares
    own, one = x * x + y * y - reach * reach, np.ones(len(ends))
    # (x - u)^2 + (y - v)^2 - (r + s)^2 as a product of matrices, which is quicker than term by term
    some = np.array([-2 * x, -2 * y, -2 * reach, own, one], np.float32).T.reshape(2, count, 5)
    others = np.array([x, y, reach, one, own], np.float32).reshape(5, 2, count)
    pairs = [np.zeros(0, np.intp)]
    for k in range(0, count, AT_ONCE):
        beyond = some[:, k : k + AT_ONCE].reshape(-1, 5) @ others[:, :, k:].reshape(5, -1)
        near = beyond.reshape(2, -1, 2, count - k).min(0).min(1) <= 0
        first, second = np.divmod(np.flatnonzero(near), count - k)
        pairs.append(((first + k) * count + second + k)[first < second])
    return np.divmod(np.concatenate(pairs), max(count, 1))


def pairs_within(ones: Array, others: Array, reach: Array | float) -> tuple[Index, Index]:
    """Every two of numbers (N,), (M,) that are no farther apart than the reach, (N,) or one for all: which of the
    first, in their order, and which of the second."""
    order = np.argsort(others)
    low, high = (np.searchsorted(others[order], ones + side * reach) for side in (-1, 1))
    first, place = runs(low, high - low)
    return first, order[place]


def runs(begin: Index, count: Index) -> tuple[Index, Index]:
    """Every number of runs of counts (N,) that begin at (N,), run after run: which run it is of, and the number."""
    of = np.repeat(np.arange(len(count)), count)
    return of, np.arange(len(of)) + np.repeat(begin - np.cumsum(count) + count, count)
