"""Facets that the edge of a shadow divides, joined to one: a virtual edge in D'Souza's words (section 5.7).

A shadow's edge is a step of grey on a surface that goes on. So the two facets lie in one plane, their common outline
goes straight on, or has a corner, at both ends of the edge, and the grey falls from one side of the edge to the other
without a dip. A crease bends the surface; a gap between two parts is darker than both. Two facets stay two where the
measurement is too coarse to exclude a crease.
"""

from collections.abc import Sequence
from dataclasses import fields, replace

import numpy as np

from daemon.arrays import Array
from daemon.vision.facets.candidates import Candidate, candidates
from daemon.vision.geometry import Polyhedron, RectifiedCamera, weighted_plane
from daemon.vision.image import MODEL_PX, CameraImage, Fitted, Sides, StereoImages, fitted_from, levels_across

SIGMAS = 3.0
"""How many predicted errors exclude a bend, and allow one that was measured."""
LEAST_CREASE = float(np.radians(3))
"""Creases from here on must be excluded, or the facets stay two."""
STRAIGHT_CHI2 = 30.0
"""Of one line through the four ends of two sides: two degrees of freedom, and room for what their covariance does not
know of, as the third edge that meets them there."""
_NEARLY_FLAT = float(np.cos(np.radians(30)))
"""Cosine of the largest angle, between three corners of each, of facets that are measured at all."""
CORNER = float(np.radians(20))
"""Sides that meet at a larger angle form a corner."""
DIP = 0.05
"""Of the step, in addition to SIGMAS of noise: what is darker than both sides by more is a gap."""
_OFFSETS_PX = np.arange(-4.0, 5.0)
_PLACES = np.linspace(0.25, 0.75, 7)


def join_shaded(members: Sequence[Candidate], solid: Polyhedron, eyes: StereoImages) -> list[Candidate] | None:
    """Candidates with two that only a shadow's edge divides replaced by one; None where there are none.

    solid: the candidates' facets with the corners that they share.
    """
    for (one, i), (other, j) in solid.across.items():
        if one < other and _nearly_flat(members[one], i, members[other], j):
            made = joined_across(members[one], i, members[other], j, eyes)
            if made is not None:
                return [made, *(c for k, c in enumerate(members) if k not in (one, other))]
    return None


def _nearly_flat(one: Candidate, i: int, other: Candidate, j: int) -> bool:
    """Whether the corners beside the shared edge lie nearly in one plane with it: cheap, for every edge of every
    look."""
    a, b = one.facet.corners_mm, other.facet.corners_mm
    n, m = len(a), len(b)
    (x, y, z), (u, v, w), (p, q, r) = (
        (a[(i + 1) % n] - a[i]).tolist(),
        (a[i - 1] - a[i]).tolist(),
        (b[(j + 2) % m] - a[i]).tolist(),
    )
    ex, ey, ez = y * w - z * v, z * u - x * w, x * v - y * u
    fx, fy, fz = q * z - r * y, r * x - p * z, p * y - q * x
    along = ex * fx + ey * fy + ez * fz
    return bool(along > 0 and along**2 > _NEARLY_FLAT**2 * (ex**2 + ey**2 + ez**2) * (fx**2 + fy**2 + fz**2))


def joined_across(one: Candidate, i: int, other: Candidate, j: int, eyes: StereoImages) -> Candidate | None:
    """Two facets as one, without side i of the first, which is side j of the second; None unless that is a shadow's
    edge."""
    bend, sigma = bend_at(one, i, other, j)
    if abs(bend) > SIGMAS * sigma or abs(bend) + SIGMAS * sigma > LEAST_CREASE:
        return None
    fitted = []
    for a, b, view in ((one.left, other.left, eyes.left), (one.right, other.right, eyes.right)):
        sides = _around(a.sides, i, b.sides, j, view.eye)
        if sides is None or _dips(view, a, i):
            return None
        fitted.append(fitted_from(sides, np.concatenate([a.polygon.border_px, b.polygon.border_px])))
    (made,) = candidates([(fitted[0], fitted[1], 0.0)], eyes.geometry)
    return replace(made, worth=min(one.worth, other.worth))


def bend_at(one: Candidate, i: int, other: Candidate, j: int) -> tuple[float, float]:
    """Angle, rad, by which the surface bends at side i of a facet, which is side j of another, and its sigma.

    Weighted least squares of two planes that meet at that side, through the corners of both.
    """
    points = np.concatenate([one.facet.corners_mm, other.facet.corners_mm])
    covariance = np.concatenate([one.facet.covariance_mm2, other.facet.covariance_mm2])
    n, m = len(one.facet.corners_mm), len(other.facet.corners_mm)
    shared = np.array([i, (i + 1) % n, n + (j + 1) % m, n + j])
    ends = (points[shared[:2]] + points[shared[2:]]) / 2
    normal = weighted_plane(points, covariance)[0]
    along = ends[1] - ends[0]
    along = along - normal * (along @ normal)
    along /= np.linalg.norm(along)
    x, y, height = ((points - ends.mean(0)) @ np.stack([along, np.cross(normal, along), normal], 1)).T
    twice = np.ones(n + m)
    twice[shared] = 2.0  # both facets measured these in the same pixels
    weight = 1 / np.maximum(twice * (covariance @ normal @ normal), 1e-8)
    terms = np.column_stack([np.ones(n + m), x, y, np.abs(y)])
    spread = np.linalg.inv((terms * weight[:, None]).T @ terms)
    solution = spread @ (terms * weight[:, None]).T @ height
    return 2 * float(solution[3]), 2 * float(np.sqrt(spread[3, 3]))


def _around(a: Sides, i: int, b: Sides, j: int, eye: RectifiedCamera) -> Sides | None:
    """The sides of two polygons without the one that they share, those in line as one; None where they are nearly in
    line."""
    own, far = _from(a, i), _from(b, j)
    ahead, behind = _onward(own, far, eye), _onward(far, own, eye)
    if ahead is None or behind is None:
        return None
    ring = [ahead] if len(ahead.step) == 1 else []
    first = 2 - len(behind.step)
    kept = [own.chosen(np.arange(first, len(own.step) - len(ring))), *ring,
            far.chosen(np.arange(len(ring), len(far.step) - first)), *([behind] if first else [])]  # fmt: skip
    return _together(kept)


def _from(sides: Sides, left_out: int) -> Sides:
    """The other sides in order, the one after it first."""
    count = len(sides.step)
    return sides.chosen((left_out + 1 + np.arange(count - 1)) % count)


def _together(parts: Sequence[Sides]) -> Sides:
    return Sides(*(np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(Sides)))


def _onward(a: Sides, b: Sides, eye: RectifiedCamera) -> Sides | None:
    """The last side of a and the first of b: one where they are in line, both where they meet in a corner, else
    None."""
    one, other = a.chosen(np.array([len(a.step) - 1])), b.chosen(np.array([0]))
    (x, y), (u, v) = (one.end - one.start)[0], (other.end - other.start)[0]
    if abs(x * v - y * u) > np.sin(CORNER) * np.hypot(x, y) * np.hypot(u, v):
        return _together([one, other])
    return _in_line(one, other, eye)


def _in_line(one: Sides, other: Sides, eye: RectifiedCamera) -> Sides | None:
    """A side and the one that follows it as one, by least squares on the ends of both; None where no line fits them."""
    points = eye.ideal(np.concatenate([one.start, one.end, other.start, other.end]))
    chord = points[3] - points[0]
    length = float(np.hypot(*chord))
    normal = np.array([chord[1], -chord[0]]) / length
    off = (points - points[0]) @ normal * eye.focal_px
    at = (points - points[0]) @ chord / length**2
    terms = np.column_stack([1 - at, at])
    noise = MODEL_PX**2 * np.eye(4)
    noise[:2, :2] += one.covariance[0]
    noise[2:, 2:] += other.covariance[0]
    weight = np.linalg.inv(noise)
    spread = np.linalg.inv(terms.T @ weight @ terms)
    ends = spread @ terms.T @ weight @ off
    rest = off - terms @ ends
    if float(rest @ weight @ rest) > STRAIGHT_CHI2:
        return None
    line = eye.pixels(points[[0, 3]] + ends[:, None] * normal / eye.focal_px)
    lengths = [float(np.hypot(*(s.end - s.start)[0])) for s in (one, other)]

    def mean(name: str) -> Array:
        return np.average([getattr(one, name), getattr(other, name)], axis=0, weights=lengths)

    return Sides(line[:1], line[1:], spread[None], mean("step"), mean("evidence"), mean("support"), mean("blur"))


def _dips(view: CameraImage, half: Fitted, side: int) -> bool:
    """Whether the grey across a side is darker at it than on both hands of it."""
    start, end = half.sides.start[side], half.sides.end[side]
    way = (end - start) / np.hypot(*(end - start))
    normal = np.repeat([[way[1], -way[0]]], len(_PLACES), 0)
    levels = levels_across(view.smooth, start + _PLACES[:, None] * (end - start), normal, _OFFSETS_PX)
    profile, scatter = levels.mean(0), levels.std(0).mean() / np.sqrt(len(_PLACES))
    hands = profile[:2].mean(), profile[-2:].mean()
    return bool(profile[2:-2].min() < min(hands) - SIGMAS * scatter - DIP * abs(hands[0] - hands[1]))
