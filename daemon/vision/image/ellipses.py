"""Ellipses of one image: the rims of bores and of round faces, whole or in part. Nothing is compared with the other
camera here.

In: the smoothed image. Out: ellipses, and the places on them where the image shows an edge, to a fraction of a px. Edge
pixels are followed; where they run round in one direction by small, even turns an ellipse is fitted to them, and again
to where the grey levels across it have the edge. Source: direct least squares fit (Fitzgibbon, Pilu and Fisher 1999),
OpenCV's.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import cv2
import numpy as np

from daemon.arrays import Array, Image32, Index
from daemon.vision.image.calipers import bilinear
from daemon.vision.image.edge_lines import SLOPE_NOISE, SMOOTHING_ROW_PX, peak_places, peaks
from daemon.vision.image.grey import FINE, Fine
from daemon.vision.image.regions import SMOOTHING_PX, Window, gradient_noise

STEP_PX, ROWS = 1.25, 2
"""Distance, px, between places on a curve at which slopes across it are taken; and the rows to either hand of which
each is the mean: as many px as an edge is smoothed across."""
EDGE_SIGMAS = 5.0, 10.0
"""An edge's pixels are so strong at least, and one of them so strong."""
MIN_PX = 14
"""Pixels of an edge to which an ellipse is fitted."""
LINE_PX, MAX_TURN, UNEVEN = 1.2, np.radians(65.0), 4.5
"""Largest distance, px, of chords from the edge; largest turn from one to the next; largest ratio of their lengths."""
ROUGH_PX, FINE_PX, ON_PX = 1.0, 0.45, 0.8
"""Rms by which pixels, and edges between pixels, may lie off their ellipse; and off which an edge is not on it."""
ROUGH_SWEEP, MIN_SWEEP, MIN_SHARE = np.radians(60.0), np.radians(80.0), 0.2
"""Least sweep, rad, of a run's pixels, and then of an edge between pixels, and least share of its ellipse on which it
shows: where another edge touches an arc, a run ends that goes on behind it."""
SMALLEST_PX, LARGEST_PX, RIM_PX = 6.0, 500.0, 12.0
"""Axes that are fitted, and how far inside the image an edge must lie."""
REACH_PX, NEAR_PX, ROUNDS = 3, 1.2, 3
PART, PART_STEP = np.radians(70.0), np.radians(40.0)
"""Turn, rad, of a part of a run, and by how much later the next begins: in half a circle lies a whole one."""
SAME_RUN_PX = 0.5
"""Two runs along the two sides of one edge give ellipses that differ by less."""
CLOSED, MIDDLE, GROWS = np.radians(20.0), 0.5, 0.05
"""A wider gap ends an arc; share of its places in its middle, and by what share it then grows at a time."""
TOGETHER, TANGENT_PX = 9, 0.15
"""Number of places in a row, and their mean distance, px, from which on they are on an arc no more."""
MAX_EDGES, MOST = 400, 80
"""Edges that are followed, and ellipses that are fitted between pixels: a patterned table has a thousand and hundreds,
most of them smaller than rims."""
_SCALE = 16.0


class Ellipse(NamedTuple):
    """centre (2,) px; axes (2, 2), unit, by rows; radii (2,) px along them; places (N, 2) px at which the image has
    it."""

    centre: Array
    axes: Array
    radii: Array
    places: Array

    def off_px(self, px: Array) -> tuple[Array, Array]:
        """(N,) how far points (N, 2) px lie outside it, nearly; and (N,) the angle at which each is, in its axes."""
        unit = (px - self.centre) @ self.axes.T / self.radii
        away = np.linalg.norm(unit, axis=1)
        slope = np.linalg.norm(unit / self.radii, axis=1) / np.maximum(away, 1e-9)
        return (away - 1) / np.maximum(slope, 1e-9), np.arctan2(unit[:, 1], unit[:, 0])

    def like(self, others: Sequence["Ellipse"], within_px: float) -> bool:
        """Whether it is nearly one of others: found from either side of an edge, or twice along one."""
        centres, radii = np.array([one.centre for one in others]), np.array([one.radii for one in others])
        near = (np.abs(radii - self.radii) < within_px).all(1)
        return bool((near & (((centres - self.centre) ** 2).sum(1) < within_px**2)).any())


def find_ellipses(smooth: Fine, window: Window | None, grain: float) -> list[Ellipse]:
    """Ellipses in the part of an image (H, W) that shows edges, those with the longest edges; smooth: of unit noise,
    after a Gaussian of SMOOTHING_PX, its noise grain times that of white noise."""
    found, tried = list[Ellipse](), list[Ellipse]()
    edges = sorted(_edges(smooth, window, grain), key=len, reverse=True)[:MAX_EDGES]
    every = [run for edge in edges for run in _round_runs(edge)]
    for run in sorted(every, key=lambda one: len(one.places), reverse=True):
        for rough in _on_one(run, found):
            if tried and rough.like(tried, SAME_RUN_PX):
                continue
            tried.append(rough)
            fine = _between_pixels(rough, smooth, grain)
            if fine is not None and not (found and fine.like(found, 2 * ON_PX)):
                found.append(fine)
            if len(tried) == MOST:
                return found
    return found


class _RoundRun(NamedTuple):
    """A stretch of an edge that turns one way: its pixels (N, 2) px; which of them are corners of its chords (C,), and
    by how much it has turned until just behind each (C,)."""

    places: Array
    corners: Index
    turned: Array

    def parts(self) -> Iterator[Array]:
        """Stretches (N, 2) px that turn by PART each, PART_STEP apart: rims of a part run on into each other, or into a
        straight edge, where one touches the other."""
        first = np.unique(np.searchsorted(self.turned, np.arange(0, self.turned[-1], PART_STEP)))
        last = np.searchsorted(self.turned, self.turned[first] + PART) + 1
        for begin, end in zip(first, last, strict=True):
            if end < len(self.corners):
                yield self.places[self.corners[begin] : self.corners[end] + 1]


def _on_one(run: _RoundRun, found: Sequence[Ellipse]) -> Iterator[Ellipse]:
    """The ellipse on which a run lies, or those of its parts, but for what lies on one that is found."""
    whole = _rough(run.places)
    if whole is not None:
        yield whole
        return
    for part in run.parts():
        rough = _rough(part)
        if rough is not None and all(_rms(one.off_px(part)[0]) > ROUGH_PX for one in found):
            yield rough


def _rough(run: Array) -> Ellipse | None:
    """The ellipse on which pixels (N, 2) lie; None where they do not, or not far enough round it."""
    rough = _fitted(run)
    if rough is None or _rms(rough.off_px(run)[0]) > ROUGH_PX or sweep_of(rough, run) < ROUGH_SWEEP:
        return None
    return rough


def _edges(smooth: Fine, window: Window | None, grain: float) -> list[Array]:
    """Borders (N, 2) px of the image's thinned edges: there along one side and back along the other."""
    if window is None:
        return []
    (left, top), (right, bottom) = window
    scale = 0.125 * _SCALE / gradient_noise(SMOOTHING_PX) / FINE / grain
    part = smooth[top:bottom, left:right].view(np.int16)
    slopes = [cv2.Sobel(part, cv2.CV_16S, x, 1 - x, scale=scale) for x in (1, 0)]
    least, sure = (sigmas * _SCALE for sigmas in EDGE_SIGMAS)
    thin = cv2.Canny(slopes[0], slopes[1], least, sure, L2gradient=True)
    borders, _ = cv2.findContours(thin, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE, offset=(int(left), int(top)))
    return [np.asarray(border[:, 0], float) for border in borders if len(border) >= MIN_PX]


def _round_runs(edge: Array) -> Iterator[_RoundRun]:
    """Stretches of a closed border (N, 2) along which its chords turn one way, by little, and are about as long."""
    corners = _chords(edge)
    count = len(corners)
    if count < 3:
        return
    ways = np.diff(edge[corners.take(range(-1, count + 1), mode="wrap")], axis=0)
    before, way, lengths = ways[:-1], ways[1:], np.hypot(*ways.T)
    turn = np.arctan2(before[:, 0] * way[:, 1] - before[:, 1] * way[:, 0], (before * way).sum(1))
    longer, shorter = (choose(lengths[:-1], lengths[1:]) for choose in (np.maximum, np.minimum))
    gentle = (np.abs(turn) < MAX_TURN) & (longer < UNEVEN * shorter)
    for one_way in (turn > 0, turn < 0):
        goes_on = gentle & one_way
        starts = np.flatnonzero(~goes_on)
        if not len(starts):
            starts = np.zeros(1, np.intp)
        for first, last in zip(starts, np.append(starts[1:], starts[0] + count), strict=True):
            if last - first >= 3:  # chords
                own = np.arange(first, last + 1)
                at = corners[own % count] + len(edge) * (own // count)
                if at[-1] - at[0] >= MIN_PX:
                    turned = np.cumsum(np.abs(turn[own % count]))
                    yield _RoundRun(edge[np.arange(at[0], at[-1] + 1) % len(edge)], at - at[0], turned - turned[0])


def _chords(edge: Array) -> Index:
    """Return the places along a border (N, 2) of the corners of its chords, in its order."""
    pixels = edge.astype(np.int32)
    corners = cv2.approxPolyDP(pixels[:, None], LINE_PX, True)[:, 0]
    width = int(pixels[:, 0].max()) + 1
    # There and back a border passes a pixel twice: the corners come in its order, so each is the next such pixel.
    keys, found, at = (pixels @ [1, width]).tolist(), list[int](), 0
    for key in (corners @ [1, width]).tolist():
        try:
            at = keys.index(key, at)
        except ValueError:
            at = keys.index(key)
        found.append(at)
    first = int(np.argmin(found))
    return np.array(found[first:] + found[:first], np.intp)


def _fitted(px: Array) -> Ellipse | None:
    """The ellipse through points (N, 2), with these as its places; None where there is none of a size."""
    try:
        (x, y), sizes, degrees = cv2.fitEllipseDirect(px.astype(np.float32))
    except cv2.error:
        return None
    radii, turn = np.array(sizes) / 2, np.radians(degrees)
    if not (np.isfinite([x, y, *radii, turn]).all() and 2 * radii.min() > SMALLEST_PX and 2 * radii.max() < LARGEST_PX):
        return None
    axes = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    return Ellipse(np.array([x, y]), axes, radii, px)


def rim_slopes(smooth: Fine, px: Array, normal: Array, reach_px: int) -> Image32:
    """(N, 2 reach_px + 1) slopes across a closed curve at places (N, 2) px, along unit normals (N, 2), at whole px up
    to the reach on either hand. smooth: of unit noise, after a Gaussian of SMOOTHING_PX."""
    offsets = np.arange(-reach_px - 0.5, reach_px + 1.0)[:, None]
    x, y = (np.asarray(px[:, k] + offsets * normal[:, k], np.float32) for k in (0, 1))
    levels = bilinear(smooth, x, y)
    count, round_ = levels.shape[1], np.concatenate([levels[:, -ROWS:], levels, levels[:, :ROWS]], 1)
    mean = sum(round_[:, row : row + count] for row in range(2 * ROWS + 1)) * np.float32(1 / (2 * ROWS + 1))
    independent = max((2 * ROWS + 1) * STEP_PX / SMOOTHING_ROW_PX, 1.0)
    return np.asarray(np.diff(mean, axis=0).T * np.float32(np.sqrt(independent) / SLOPE_NOISE))


def _between_pixels(rough: Ellipse, smooth: Fine, grain: float) -> Ellipse | None:
    """The ellipse where the grey levels across it have their edge; None where too little of it shows."""
    most, ellipse = np.array(smooth.shape[::-1]) - 1 - RIM_PX, rough
    offsets = np.arange(-REACH_PX, REACH_PX + 1.0)
    for _ in range(ROUNDS):
        count = max(int(np.pi * ellipse.radii.sum() / STEP_PX), 16)
        angle = 2 * np.pi * np.arange(count) / count
        unit = np.column_stack([np.cos(angle), np.sin(angle)])
        px = ellipse.centre + (unit * ellipse.radii) @ ellipse.axes
        normal = (unit / ellipse.radii) @ ellipse.axes
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        slopes = np.abs(rim_slopes(smooth, px, normal, REACH_PX)) / np.float32(grain)
        edge = np.where(peaks(slopes, EDGE_SIGMAS[0]), slopes[:, 1:-1], 0.0)
        likely = np.sqrt(edge) * np.exp(-0.5 * (offsets[1:-1] / NEAR_PX) ** 2)
        best = likely.argmax(1) + 1
        there = (likely.max(1) > 0) & ((px > RIM_PX) & (px < most)).all(1)
        places = (px + (offsets[best] + peak_places(slopes, best)[1])[:, None] * normal)[there]
        for _ in range(2):
            if len(places) < MIN_PX // 2 or (fitted := _fitted(places)) is None:
                return None
            ellipse = fitted
            places = places[np.abs(ellipse.off_px(places)[0]) < ON_PX]
    ellipse = _without_tangents(ellipse._replace(places=places))
    places = ellipse.places
    if len(places) < max(MIN_SHARE * count, MIN_PX // 2) or _rms(ellipse.off_px(places)[0]) > FINE_PX:
        return None
    return ellipse if sweep_of(ellipse, places) > MIN_SWEEP else None


def _without_tangents(ellipse: Ellipse) -> Ellipse:
    """The ellipse by the places of its arc alone: a straight edge that touches the end of an arc lies on the ellipse as
    well, nearly, and makes it larger. From the middle of the arc on, each way as far as its places stay on it."""
    angle = ellipse.off_px(ellipse.places)[1]
    order = np.argsort(angle)
    gaps = np.diff(angle[order], append=angle[order[0]] + 2 * np.pi)
    widest = int(gaps.argmax())
    if gaps[widest] < CLOSED:
        return ellipse
    run = ellipse.places[np.roll(order, -widest - 1)]
    count = len(run)
    first, last = int(count * (1 - MIDDLE) / 2), int(np.ceil(count * (1 + MIDDLE) / 2))
    step, row = max(int(count * GROWS), 1), np.ones(TOGETHER) / TOGETHER
    while True:
        own = _fitted(run[first:last])
        if own is None:
            return ellipse
        off = own.off_px(run)[0]
        astray = np.abs(np.convolve(np.pad(off, TOGETHER // 2, mode="edge"), row, "valid")) > TANGENT_PX
        before, behind = np.flatnonzero(astray[:first]), np.flatnonzero(astray[last:])
        begin = max(first - step, int(before[-1]) + 1 if len(before) else 0)
        end = min(last + step, last + int(behind[0]) if len(behind) else count)
        if (begin, end) == (first, last):
            return own
        first, last = begin, end


def _rms(values: Array) -> float:
    return float(np.sqrt((values**2).mean()))


def sweep_of(ellipse: Ellipse, px: Array) -> float:
    """Return how far round an ellipse, rad, points (N, 2) lie, without the widest gap between them."""
    angle = np.sort(ellipse.off_px(px)[1])
    return float(2 * np.pi - np.diff(np.append(angle, angle[0] + 2 * np.pi)).max())
