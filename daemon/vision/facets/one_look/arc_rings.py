"""Facets whose outline has arcs: discs, by a circle that both cameras see, and rings of arcs and straight sides.

In: a stereo pair. Out: candidates like those of closed regions, an arc's place taken by the few chords that drawings
have there. Source: D'Souza, section 5.7 (arcs as elements of a facet).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from daemon.arrays import Array
from daemon.vision.facets.one_look.candidates import Candidate, candidates
from daemon.vision.facets.one_look.circles import MeasuredCircle, find_circles
from daemon.vision.facets.one_look.fitted_rings import FittedRing, fitted_rings
from daemon.vision.geometry import axes_in, chord_turns, fit_plane, is_simple, rings
from daemon.vision.image import Fitted, StereoImages, fit_sides, met_covariance, sweep_of
from daemon.vision.settings import VisionSettings
from daemon.vision.values import Polygon

OFF_PLANE_MM = 3.0
"""A hole's rim is no farther off the plane of the facet that it is in."""
WITHIN, SMALLER = 0.95, 0.85
"""Share of a hole that the facet that it is in covers; and the largest share of that facet that a hole takes: more, and
both are outlines of one disc."""
WHOLE = np.radians(330.0)
"""Share of either ellipse that must show for a whole circle to be assumed."""
SHORTEST_PX, MIN_SUPPORT = 6.0, 0.4
"""Shortest side or chord, px; and least share of a side's rows that must lie on it."""
PER_ELEMENT = 0.05  # of worth, that each element must bring
POINTS = 24  # on an arc


def round_facets(images: StereoImages, settings: VisionSettings) -> list[Candidate]:
    """Facets that circles bound, alone or with straight sides; and straight-sided ones with rounded corners."""
    fitted = fitted_rings(images, [view.rough(settings) for view in images.views])
    found = [*map(_disc, filter(_is_whole, find_circles(images))), *map(_ring, fitted)]
    return [one for ring in found if (one := _candidate(*ring, images)) is not None]


def is_hole_in(one: Candidate, other: Candidate) -> bool:
    """Whether a disc lies within another facet and in its plane: the rim of a hole, or print."""
    around = one.facet.arcs[0]
    if np.linalg.norm(around[0] - around[-1]) > OFF_PLANE_MM:
        return False
    shapes = (one.left_shape, other.left_shape), (one.right_shape, other.right_shape)
    if one is other or any(own.area > SMALLER * outer.area or outer.covers(own) < WITHIN for own, outer in shapes):
        return False
    normal, level = fit_plane(other.facet.corners_mm)
    return bool(np.abs(one.facet.corners_mm @ normal - level).mean() < OFF_PLANE_MM)


def _is_whole(circle: MeasuredCircle) -> bool:
    return any(sweep_of(seen, seen.places) > WHOLE for seen in (circle.left, circle.right))


def _disc(circle: MeasuredCircle) -> tuple[Array, list[bool], list[Array]]:
    """Return the ring that bounds a disc: its corners (N, 3) mm, anticlockwise as seen; whether the side behind each is
    a chord; and points (POINTS, 3) mm along each of its arcs."""
    x, y = axes_in(circle.normal)
    axes = np.stack([x, y if np.cross(x, y) @ circle.normal > 0 else -y])
    shares, out = chord_turns(circle.radius_mm, 2 * np.pi, closed=True)
    corners, around = (
        circle.centre_mm + size * circle.radius_mm * _unit(2 * np.pi * turn) @ axes
        for size, turn in ((out, shares), (1.0, np.linspace(0, 1, POINTS)))
    )
    return corners, [True] * len(corners), [around]


def _ring(ring: FittedRing) -> tuple[Array, list[bool], list[Array]]:
    """Corners, chords and points of a fitted ring, as of a disc."""
    corners, chord, points = list[Array](), list[bool](), list[Array]()
    arcs = zip(*ring.arcs, strict=True)
    for begin, end, radius in zip(*ring.ends, ring.radius_mm, strict=True):
        corners.append(begin)
        chord.append(False)
        if radius > 0:
            centre, first, sweep = next(arcs)
            shares, out = chord_turns(radius, sweep, closed=False)
            corners += [end, *(centre + out * radius * _unit(first + sweep * shares))]
            chord += [True] * (1 + len(shares))
            points.append(centre + radius * _unit(first + sweep * np.linspace(0, 1, POINTS)))
    in_space = [ring.origin + own @ ring.axes for own in (np.array(corners), *points)]
    return in_space[0], chord, in_space[1:]


def _unit(angle: Array) -> Array:
    return np.stack([np.cos(angle), np.sin(angle)], -1)


def _candidate(corners: Array, chord: Sequence[bool], arcs: Sequence[Array], images: StereoImages) -> Candidate | None:
    """The facet that a ring bounds, its straight sides measured between pixels; None where they do not show."""
    geometry, count = images.geometry, len(corners)
    cameras = geometry.left, geometry.right
    px = [camera.pixels(own) for camera, own in zip(cameras, geometry.project(corners), strict=True)]
    start, end = (np.concatenate([np.roll(own, -turn, axis=0) for own in px]) for turn in (0, 1))
    if np.hypot(*(end - start).T).min() < SHORTEST_PX or not all(map(is_simple, px)):
        return None
    fitted = fit_sides([(view.exposure, count) for view in images.views], start, end)
    if fitted.support.min() < MIN_SUPPORT:
        return None
    on_arc = np.tile(chord, 2)[:, None]
    sides = replace(fitted, start=np.where(on_arc, start, fitted.start), end=np.where(on_arc, end, fitted.end))
    covariance = met_covariance(rings(px), sides).reshape(2, count, 2, 2)
    each = [sides.chosen(np.arange(count) + k * count) for k in (0, 1)]
    left, right = (
        Fitted(Polygon(own, spread, np.abs(these.step), own), these)
        for own, spread, these in zip(px, covariance, each, strict=True)
    )
    (found,) = candidates([(left, right, 0.0)], geometry)
    elements = len(arcs) + chord.count(False)
    score = 1 + float(fitted.support.min()) - PER_ELEMENT * elements
    return replace(found, facet=replace(found.facet, arcs=tuple(arcs)), score=score)
