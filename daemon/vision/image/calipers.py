"""Calipers laid across many straight lines at once: each gives a profile, the image's values along a short line across;
and what the two faces beside an edge look like by themselves, as profiles have them.

Lines are straight in ideal coordinates and slightly bowed in a distorted image; the calipers follow that bow. Arrays of
profiles are (C, R), offset by offset, so that what is done to each is done along the whole array. The level of either
face is carried on under the edge; where the edge is, is for edge_lines.py.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np

from daemon.arrays import Array, Flags, Image32, Index, Real
from daemon.vision.geometry import RectifiedCamera, outward
from daemon.vision.image.grey import FINE, Fine, NoiseOfMany

Images = Sequence[tuple[Fine, int]]
"""Images, each with how many of the sides, one after the other, lie in it."""
FEWEST, MOST = 3, 400
"""Calipers on one side."""
BLOCKS, IN_BLOCK = 6, 6
"""Stretches of a side, and calipers in each, where all sides get as many; set by eye."""
_MAX_COLUMNS = 32000  # of a map that cv2.remap takes


@dataclass(frozen=True, eq=False)
class Calipers:
    """R calipers across S sides, side by side.

    side (R,) which side each belongs to; first, count (S,) its first, how many it has; at (R,) position along the side,
    -1 at its start to 1 at its end; base (2, R) px on the bowed side; across (2, R), and normal (S, 2) by side: px unit
    vector pointing out of the polygon. spacing_px: between neighbours, about.
    """

    side: Index
    first: Index
    count: Index
    at: Array
    base: Array
    across: Array
    normal: Array
    spacing_px: float

    def sums(self, values: Real) -> Array:
        """Sums (..., S) of (..., R) values over each side."""
        return np.asarray(np.add.reduceat(values, self.first, axis=-1, dtype=float))

    def means(self, values: Real) -> Array:
        """Means (..., S) of (..., R) values over each side."""
        return self.sums(values) / self.count

    def running_means(self, values: Real, reach_px: float) -> Array:
        """Means (K, R) of values over the calipers of the same side within so many px, the neighbours at least."""
        half = max(round(reach_px / self.spacing_px), 1)
        here, end = np.arange(len(self.side)), self.first + self.count
        low = np.maximum(here - half, self.first.take(self.side))
        high = np.minimum(here + half + 1, end.take(self.side))
        total = np.zeros((len(values), len(here) + 1))
        values.cumsum(1, out=total[:, 1:])
        return np.asarray((total.take(high, 1) - total.take(low, 1)) / (high - low))


def lay_calipers(start_px: Array, end_px: Array, bow_px: Array | None, trim_px: float, spacing_px: float) -> Calipers:
    """Calipers across the sides start -> end, (S, 2) px each, polygon on the left hand as seen (anticlockwise corners).

    trim_px is left out at either end, at most a quarter of the side, because there the neighbouring side is in view.
    bow_px (S, 2): as lens_bow says; None where lines are straight in the image.
    """
    chord = end_px - start_px
    length = np.maximum(np.hypot(chord[:, 0], chord[:, 1]), 1e-6)
    reach = measured_reach(length, trim_px)
    count = np.minimum(np.maximum(np.ceil(reach * length / spacing_px), FEWEST), MOST).astype(np.intp)
    first = count.cumsum() - count
    side = np.arange(len(count)).repeat(count)
    normal = outward(chord, length)
    bow = np.zeros_like(chord) if bow_px is None else bow_px
    by_side = np.concatenate([(start_px + end_px).T / 2, chord.T / 2, bow.T, normal.T, [first, 2 / count, reach]])
    here = by_side.take(side, 1)
    at = ((np.arange(len(side)) - here[8] + 0.5) * here[9] - 1) * here[10]
    base = here[0:2] + at * here[2:4] + (1 - at * at) * here[4:6]
    return Calipers(side, first, count, at, base, here[6:8], normal, spacing_px)


def measured_reach(length_px: Array, trim_px: float) -> Array:
    """How far from its middle, as a share of its half, each side (S,) px long is measured."""
    return np.asarray(1 - 2 * np.minimum(trim_px, 0.25 * length_px) / length_px)


def lens_bow(start_px: Array, end_px: Array, camera: RectifiedCamera | None) -> Array | None:
    """Return how far (S, 2) px the middle of each truly straight side lies from its chord in the distorted image.

    None where there is no camera whose lens would bend anything.

    Along the side the bow is a parabola to well under 0.01 px for lenses of ordinary distortion.
    """
    if camera is None:
        return None
    ends = camera.ideal(np.concatenate([start_px, end_px]))
    n = len(start_px)
    middle = camera.pixels((ends[:n] + ends[n:]) / 2)
    chord = end_px - start_px
    off = middle - (start_px + end_px) / 2
    along = (off * chord).sum(1) / np.maximum((chord * chord).sum(1), 1e-9)
    return np.asarray(off - along[:, None] * chord)


def profiles(images: Sequence[Fine], cuts: Sequence[int], calipers: Calipers, offsets: Array) -> Image32:
    """Image values (C, R), bilinear, at C offsets px outwards of each caliper's base; outside the image its rim. The
    calipers from cuts[k] to cuts[k + 1] lie across the image k."""
    base, across = calipers.base.astype(np.float32), calipers.across.astype(np.float32)
    x, y = (base[k] + offsets.astype(np.float32)[:, None] * across[k] for k in (0, 1))
    return np.concatenate(
        [bilinear(image, x[:, a:b], y[:, a:b]) for image, (a, b) in zip(images, pairwise(cuts), strict=True) if b > a],
        axis=1,
    )


def stretch_profiles(
    images: Images, start: Array, end: Array, trim_px: float, offsets: Array, bias_px: Array
) -> Image32:
    """Mean profiles (S, BLOCKS, C) of equal stretches of straight sides (S, 2), (S, 2) px.

    offsets (C,) px, counted from each side's bias_px (S, 1), or each stretch's (S, BLOCKS), outwards; trim_px is left
    out at either end.
    """
    chord = end - start
    length, places = stretches(start, end, trim_px)
    normal = outward(chord, length)
    fine = (
        places + (np.arange(IN_BLOCK)[:, None, None] - (IN_BLOCK - 1) / 2) * (places[:, 1:2] - places[:, :1]) / IN_BLOCK
    )
    middle = ((start + end) / 2)[:, None] + normal[:, None] * bias_px[..., None]
    # (C, IN_BLOCK, S * BLOCKS): long rows are reckoned and read out faster than ones of a few offsets.
    x, y = (
        np.asarray(middle[..., k] + fine * chord[:, k, None] / 2, np.float32).reshape(IN_BLOCK, -1)
        + offsets.astype(np.float32)[:, None, None] * normal[:, k].astype(np.float32).repeat(BLOCKS)
        for k in (0, 1)
    )
    first, means = 0, []
    for image, count in images:
        if count:
            own, wide = slice(BLOCKS * first, BLOCKS * (first + count)), BLOCKS * count
            values = bilinear(image, x[..., own].reshape(-1, wide), y[..., own].reshape(-1, wide))
            means.append(values.reshape(len(offsets), IN_BLOCK, count, BLOCKS).mean(1))
            first += count
    return np.ascontiguousarray(np.concatenate(means, 1).transpose(1, 2, 0))


def stretches(start: Array, end: Array, trim_px: float) -> tuple[Array, Array]:
    """Lengths (S,) px of sides, and the middles (S, BLOCKS) of equal stretches, -1 at a side's start to 1 at its end,
    trim_px left out at either end."""
    length = np.maximum(np.hypot(*(end - start).T), 1e-6)
    middles = (np.arange(BLOCKS) + 0.5) / BLOCKS * 2 - 1
    return length, middles * measured_reach(length, trim_px)[:, None]


def bilinear(image: Fine, x: Image32, y: Image32) -> Image32:
    """Image values at real pixel coordinates (N, M); outside the image its rim."""
    longer = int(x.shape[1] > x.shape[0])
    if x.shape[longer] > _MAX_COLUMNS:
        cuts = range(_MAX_COLUMNS, x.shape[longer], _MAX_COLUMNS)
        parts = zip(*(np.split(each, cuts, longer) for each in (x, y)), strict=True)
        return np.concatenate([bilinear(image, *part) for part in parts], longer)
    values = cv2.remap(image, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.multiply(values, 1 / FINE, dtype=np.float32)


REACH_PX = 4
OFFSETS = np.arange(-REACH_PX, REACH_PX + 1, dtype=float)
CLEAR = 3
"""Offsets on either hand, the outermost, that are clear of the edge."""
_FAR = np.stack([OFFSETS < -1.9, OFFSETS > 1.9]).astype(float)
_SHARE = _FAR / CLEAR
_MIDDLE = _SHARE @ OFFSETS
_LEVER = _FAR * (OFFSETS - _MIDDLE[:, None])
_LEVER2 = np.sum(_LEVER**2, 1)
_PER_PX = _LEVER / _LEVER2[:, None]
_HANDS = np.array([[2, 1, 0], [6, 7, 8]])
"""The offsets clear of the edge on either hand, from the nearest outwards."""
_SLOPE_SIGMAS = 2.0
"""A slope across a face counts the less the nearer it is to so many of its own sigmas; set by eye."""
_CLIPPED = 247.0
"""Mean grey level of a face whose brightest pixels are cut off."""
_HEIGHTS = np.geomspace(1.0, 2.5, 14)
_SHIFTS_PX = np.linspace(-0.75, 0.75, 31)


def face_planes(values: Image32, mean: Array, noise: NoiseOfMany, calipers: Calipers) -> tuple[Array, Flags]:
    """Fit planes to the grey levels of each face of the step, as if the other were not there: inside's level on the
    side and slope across it, outside's level and slope, (4, R) grey levels and grey levels a px.

    The level may drift along the side; the slope, as near a contact shadow, is one for each side. values (C, R)
    profiles; mean (C, S): theirs over each side. The second array (C, R) says where no other edge has come into view,
    as in the thin end of a face seen edge-on.
    """
    hands = values.take(_HANDS, 0)  # (2, CLEAR, R)
    third, fourth = _in_the_clear(hands, noise, calipers)
    seen_levels = np.empty((4, len(calipers.side)))
    seen_levels[:2] = hands[:, 0] + hands[:, 1] * third + hands[:, 2] * fourth
    seen_levels[2:] = 1.0 + third + fourth
    total = calipers.running_means(seen_levels, 6.0)
    level = total[:2] / total[2:]
    whole = calipers.means(seen_levels[2:]) > 0.9 * CLEAR
    sigma = calipers.means(noise.at(level)) / np.sqrt(_LEVER2[:, None] * calipers.count)
    across = (_PER_PX @ mean) * whole
    across *= np.maximum(0.0, 1.0 - (_SLOPE_SIGMAS * sigma / np.maximum(np.abs(across), 1e-9)) ** 2)
    planes = np.empty((4, len(calipers.side)))
    planes[1::2] = tilt = across.take(calipers.side, 1)
    np.subtract(level, tilt * _MIDDLE[:, None], out=planes[::2])
    clear = np.ones(values.shape, bool)
    clear[1::6], clear[::8] = third, fourth  # three pixels off, and four, on either hand
    return planes, clear


def _in_the_clear(hands: Image32, noise: NoiseOfMany, calipers: Calipers) -> tuple[Flags, Flags]:
    """(2, R), (2, R): whether three and four pixels off the side, on either hand, the grey level is what it was at two.

    hands (2, CLEAR, R): the profiles on either hand, from two pixels off outwards.
    """
    level = calipers.running_means(hands.reshape(2 * CLEAR, -1), 2.0).reshape(2, CLEAR, -1)
    near, apart = level[:, 0], np.abs(level[:, 1:] - level[:, :1])
    limit = 3.0 / np.sqrt(2.5) * noise.at(near) + 0.02 * np.abs(level[0, -1] - level[1, -1])
    third = apart[:, 0] < limit
    return third, third & (apart[:, 1] < 1.5 * limit)


def unclipped(mean: Array, calipers: Calipers, planes: Array, blur_px: Array) -> Array:
    """The planes with those of saturated faces replaced: how bright such a face is shows in how steeply its edge
    sets in.

    Per side the mean profile (C, S) below saturation is fitted by steps of several heights, each free to shift; the
    best is taken. blur_px (S,).
    """
    bright = _SHARE @ mean > _CLIPPED
    sides = np.flatnonzero(bright[0] != bright[1])
    if not len(sides):
        return planes
    inside = bright[0, sides]
    dark = np.where(inside, calipers.means(planes[2:])[:, sides], calipers.means(planes[:2])[:, sides])
    use = (mean[:, sides].T < _CLIPPED) & (np.abs(OFFSETS) < CLEAR)
    above = (mean[:, sides] - dark[0] - dark[1] * OFFSETS[:, None]).T * use
    falling = 1 - normal_cdf((OFFSETS - _SHIFTS_PX[:, None]) / blur_px[sides, None, None])
    shapes = np.where(inside[:, None, None], falling, 1 - falling)  # (sides, shifts, C)
    height = (255.0 - dark[0])[:, None] * _HEIGHTS
    along, own = (shapes @ above[:, :, None])[..., 0], (shapes**2 @ use[:, :, None])[..., 0]
    misfit = (height[:, :, None] ** 2 * own[:, None] - 2 * height[:, :, None] * along[:, None]).min(2)
    level = dark[0] + height[np.arange(len(sides)), np.argmin(misfit, 1)]
    replaced = planes.copy()
    for s, k in enumerate(sides):
        here = slice(calipers.first[k], calipers.first[k] + calipers.count[k])
        replaced[0 if inside[s] else 2, here], replaced[1 if inside[s] else 3, here] = level[s], dark[1, s]
    return replaced


def normal_cdf(x: Array) -> Array:
    """Cumulative normal distribution, to 1e-7 (Abramowitz and Stegun 7.1.26)."""
    t = 1 / (1 + 0.3275911 * np.abs(x) / np.sqrt(2))
    tail = t * (0.254829592 + t * (-0.284496736 + t * (1.421413741 + t * (-1.453152027 + t * 1.061405429))))
    erf = 1 - tail * np.exp(-x * x / 2)
    return np.asarray(0.5 * (1 + np.sign(x) * erf))
