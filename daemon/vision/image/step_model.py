"""What the two faces beside an edge look like by themselves: grey levels across many sides, profile by profile.

In: profiles across sides (calipers.py). Out: the level of either face carried on under the edge. Where the edge is, is
for edge_lines.py.
"""

from __future__ import annotations

import numpy as np

from daemon.arrays import Array, Flags, Image32
from daemon.vision.image.calipers import Calipers
from daemon.vision.image.grey import NoiseOfMany

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
    """What each face of the step would show if the other were not there, as planes: inside's level on the side and
    slope across it, outside's level and slope, (4, R) grey levels and grey levels a px.

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
