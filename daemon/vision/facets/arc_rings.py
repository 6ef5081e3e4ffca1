"""Facets whose outline has arcs: in the plane of a circle that both cameras see, the ring of arcs and straight sides.

In: a stereo pair. Out: candidates like those of closed regions, an arc's place taken by the few chords that drawings
have there. No region need be closed: segments that lie in the plane in both images join the ends of arcs.
Source: D'Souza, section 5.7 (arcs as elements of a facet).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from daemon.arrays import Array
from daemon.vision.facets.candidates import Candidate, candidates
from daemon.vision.facets.circles import SeenCircle, circles_seen
from daemon.vision.geometry import Baseline, axes_in, chord_turns, fit_plane, is_simple, rings
from daemon.vision.image import Fitted, Segments, Sides, StereoImages, fit_sides, joined, met_covariance, pairs_within
from daemon.vision.values import Polygon

SAME_PLANE, OFF_PLANE_MM = np.cos(np.radians(7.0)), 3.0
"""Circles lie in one plane whose normals differ by less, and whose centres are no farther off it."""
WITHIN = 0.95
"""Share of a hole that the facet that it is in covers."""
LINE_PX, OVERLAP, ASKEW = 2.0, 0.3, np.radians(6.0)
"""A segment of the left image and one of the right that lie so near to each other in the plane, and beside each other
for such a share of the shorter one, at no larger angle, are one edge in it."""
GAP_PX, OF_LENGTH = 16.0, 0.5
"""How far beyond the end of a segment the next element may meet it; and for which share of its length it, or an arc,
may show less or more than the ring has of it: each side of a ring is then looked for by itself."""
TANGENT_PX = 1.5
"""A line that passes a circle so near is a tangent."""
CLOSED = np.radians(30.0)
"""Arcs without a wider gap are circles."""
LEAST_SINE = np.sin(np.radians(12.0))
"""Of the angle at a corner."""
SHORTEST_PX = 6.0
"""Of a side or a chord."""
MOST_SIDES, LEAST_SEEN, LEAST_SUPPORT = 12, 0.6, 0.4
"""Elements of a ring; share of its length that shows; and of each side's rows that lie on it."""
PER_ELEMENT = 0.05  # of worth, that each element must bring
POINTS = 24  # on an arc


@dataclass(frozen=True, eq=False)
class _Plane:
    """origin (3,) mm and axes (2, 3) of a plane, cyclopean, its normal towards the cameras; px_mm: what a pixel is
    there."""

    origin: Array
    axes: Array
    px_mm: float

    def down(self, ideal: Array, camera: int, geometry: Baseline) -> Array:
        """(N, 2) mm where rays through ideal coordinates (N, 2) of the left (0) or right (1) camera meet it."""
        turn = geometry.cyclopean_from_baseline
        rays = ideal @ turn[:, :2].T + turn[:, 2]
        normal = np.cross(*self.axes)
        from_camera = self.origin - geometry.cameras_mm[camera]
        facing = rays @ normal
        facing = np.where(np.abs(facing) < 1e-9, 1e-9, facing)
        return np.asarray((rays * (from_camera @ normal / facing)[:, None] - from_camera) @ self.axes.T)

    def up(self, points: Array) -> Array:
        """(N, 2) mm in it to (N, 3)."""
        return np.asarray(self.origin + points @ self.axes)


@dataclass(frozen=True, eq=False)
class _Arc:
    """In a plane: centre (2,), radius mm, begin and sweep (rad, anticlockwise) of what shows."""

    centre: Array
    radius: float
    begin: float
    sweep: float

    def at(self, angle: Array | float) -> Array:
        """(..., 2) its points at some angles."""
        return np.asarray(self.centre + self.radius * np.stack([np.cos(angle), np.sin(angle)], -1))

    def angle(self, point: Array) -> float:
        """Of a point (2,) about the centre."""
        return float(np.arctan2(*(point - self.centre)[::-1]))


@dataclass(frozen=True, eq=False)
class _Ring:
    """Arcs and straight sides one after the other, anticlockwise: elements, each an _Arc or the ends (2, 2) of a
    segment; gap_mm: of its length, what does not show."""

    elements: tuple[_Arc | Array, ...]
    gap_mm: float


def round_facets(images: StereoImages) -> list[Candidate]:
    """Facets that circles bound, alone or with straight sides."""
    circles = circles_seen(images)
    found, used = list[Candidate](), set[int]()
    segments = [joined(view.segments) for view in images.views] if circles else []
    for k, circle in enumerate(circles):
        if k in used:
            continue
        own = [j for j, one in enumerate(circles) if j not in used and _in_plane(one, circle)]
        plane = _plane([circles[j] for j in own], images.geometry)
        arcs = [_arc(circles[j], plane, images.geometry) for j in own]
        ring = _ring(arcs[own.index(k)], arcs, _sides_in(plane, segments, images.geometry), plane.px_mm)
        one = _candidate(ring, plane, images) if ring is not None else None
        if one is not None and ring is not None:
            found.append(one)
            used |= {j for j, arc in zip(own, arcs, strict=True) if any(arc is one for one in ring.elements)}
    return found


def is_hole_in(one: Candidate, other: Candidate) -> bool:
    """Whether a disc lies within another facet and in its plane: the rim of a hole, or print."""
    around = one.facet.arcs[0]
    if np.linalg.norm(around[0] - around[-1]) > OFF_PLANE_MM:
        return False
    shapes = (one.left_shape, other.left_shape), (one.right_shape, other.right_shape)
    if one is other or any(own.area > outer.area or outer.covers(own) < WITHIN for own, outer in shapes):
        return False
    normal, level = fit_plane(other.facet.corners_mm)
    return bool(np.abs(one.facet.corners_mm @ normal - level).mean() < OFF_PLANE_MM)


def _plane(circles: Sequence[SeenCircle], geometry: Baseline) -> _Plane:
    """The plane nearest to circles in it."""
    origin = np.mean([one.centre_mm for one in circles], axis=0)
    turns = 2 * np.pi * np.arange(POINTS) / POINTS
    unit = np.column_stack([np.cos(turns), np.sin(turns)])
    points = [one.centre_mm + one.radius_mm * unit @ axes_in(one.normal) for one in circles]
    axes = np.linalg.svd(np.concatenate(points) - origin, full_matrices=False)[2][:2]
    if np.cross(*axes) @ circles[0].normal < 0:
        axes = axes[::-1]
    return _Plane(origin, axes, float(np.linalg.norm(origin - geometry.middle_mm)) / geometry.left.focal_px)


def _in_plane(one: SeenCircle, other: SeenCircle) -> bool:
    off = abs(float((one.centre_mm - other.centre_mm) @ other.normal))
    return bool(one.normal @ other.normal > SAME_PLANE and off < OFF_PLANE_MM)


def _arc(circle: SeenCircle, plane: _Plane, geometry: Baseline) -> _Arc:
    """What either camera shows of a circle."""
    centre = (circle.centre_mm - plane.origin) @ plane.axes.T
    images = (circle.left, geometry.left), (circle.right, geometry.right)
    seen = [plane.down(camera.ideal(one.places), k, geometry) - centre for k, (one, camera) in enumerate(images)]
    angle = np.sort(np.arctan2(*np.concatenate(seen).T[::-1]))
    gaps = np.diff(angle, append=angle[0] + 2 * np.pi)
    widest = int(gaps.argmax())
    if gaps[widest] < CLOSED:
        return _Arc(centre, circle.radius_mm, 0.0, 2 * np.pi)
    return _Arc(centre, circle.radius_mm, float(angle[(widest + 1) % len(angle)]), float(2 * np.pi - gaps[widest]))


def _sides_in(plane: _Plane, segments: Sequence[Segments], geometry: Baseline) -> list[Array]:
    """Ends (2, 2) mm of the segments of the left and the right image that lie in a plane, as both have them."""
    cameras = enumerate((geometry.left, geometry.right))
    ends = (np.stack([own.start, own.end], 1).reshape(-1, 2) for own in segments)
    left, right = (
        plane.down(camera.ideal(own), k, geometry).reshape(-1, 2, 2)
        for (k, camera), own in zip(cameras, ends, strict=True)
    )
    ways = [own[:, 1] - own[:, 0] for own in (left, right)]
    lengths = [np.maximum(np.linalg.norm(way, axis=1), 1e-9) for way in ways]
    angle, beside = (np.arctan2(*way.T) for way in ways)
    one, other = pairs_within(angle, np.concatenate([beside - 2 * np.pi, beside, beside + 2 * np.pi]), ASKEW)
    other = other % max(len(right), 1)
    unit = (ways[0] / lengths[0][:, None])[one]
    from_start = right[other] - left[one, :1]
    along = (from_start * unit[:, None]).sum(2)
    across = np.abs(from_start[..., 0] * unit[:, None, 1] - from_start[..., 1] * unit[:, None, 0]).max(1)
    both = np.minimum(along.max(1), lengths[0][one]) - np.maximum(along.min(1), 0)
    good = (across < LINE_PX * plane.px_mm) & (both > OVERLAP * np.minimum(lengths[0][one], lengths[1][other]))
    found = []
    for i, j in zip(one[good].tolist(), other[good].tolist(), strict=True):
        middle = (left[i] + right[j]) / 2
        axis = (middle[1] - middle[0]) / np.linalg.norm(middle[1] - middle[0])
        reach = (np.concatenate([left[i], right[j]]) - middle[0]) @ axis
        found.append(middle[0] + np.outer([reach.min(), reach.max()], axis))
    return found


def _ring(first: _Arc, arcs: Sequence[_Arc], sides: Sequence[Array], px_mm: float) -> _Ring | None:
    """The ring through an arc of which the least is missing; None where none closes."""
    if first.sweep == 2 * np.pi:
        return _Ring((first,), 0.0)
    best = list[_Ring]()

    def go_on(path: tuple[_Arc | Array, ...], gap: float) -> None:
        if best and gap >= best[0].gap_mm:
            return
        used = [own.base for own in path if not isinstance(own, _Arc)]
        others = [side for side in sides if not any(side is own for own in used)]
        after: list[_Arc | Array] = [way for side in others for way in (side[:], side[::-1])]  # views: base is the side
        if not isinstance(path[-1], _Arc):
            after = [*arcs, *after]
        for one in after if len(path) <= MOST_SIDES else ():
            met = _met(path[-1], one, px_mm)
            if met is None:
                continue
            if one is first:
                if not best or gap + met[1] < best[0].gap_mm:
                    best[:] = [_Ring(path, gap + met[1])]
            elif not any(one is known for known in path):
                go_on((*path, one), gap + met[1])

    go_on((first,), 0.0)
    return best[0] if best else None


def _met(one: _Arc | Array, other: _Arc | Array, px_mm: float) -> tuple[Array, float] | None:
    """Where (2,) an element goes on into another, and how far that is from the ends of both, mm; None where it is too
    far from either."""
    if isinstance(one, _Arc):
        at = None if isinstance(other, _Arc) else _on_arc(one, other, one.begin + one.sweep, px_mm)
    else:
        at = _on_arc(other, one, other.begin, px_mm) if isinstance(other, _Arc) else _crossing(one, other)
    if at is None:
        return None
    gaps = [
        _turn_to(own, own.begin + own.sweep * (own is one), at) if isinstance(own, _Arc) else _off_end(own, at, px_mm)
        for own in (one, other if isinstance(other, _Arc) else other[::-1])
    ]
    if any(gap > OF_LENGTH * _length(own) for gap, own in zip(gaps, (one, other), strict=True)):
        return None
    return at, sum(gaps)


def _length(one: _Arc | Array) -> float:
    return one.radius * one.sweep if isinstance(one, _Arc) else float(np.linalg.norm(one[1] - one[0]))


def _off_end(side: Array, at: Array, px_mm: float) -> float:
    """How far a point is from the end of a side, mm; infinite where it is too far beyond."""
    away = side[1] - side[0]
    beyond = float((at - side[1]) @ away) > 0 and float(np.linalg.norm(at - side[1])) > GAP_PX * px_mm
    return np.inf if beyond else float(np.linalg.norm(at - side[1]))


def _turn_to(arc: _Arc, angle: float, at: Array) -> float:
    """How far along an arc's circle a point is from an angle, mm."""
    return arc.radius * abs((arc.angle(at) - angle + np.pi) % (2 * np.pi) - np.pi)


def _crossing(one: Array, other: Array) -> Array | None:
    """Where two sides meet; None where they are nearly in line."""
    a, b = one[1] - one[0], other[1] - other[0]
    sine = float(a[0] * b[1] - a[1] * b[0])
    if abs(sine) < LEAST_SINE * np.linalg.norm(a) * np.linalg.norm(b):
        return None
    off = other[0] - one[0]
    return np.asarray(one[0] + a * (off[0] * b[1] - off[1] * b[0]) / sine)


def _on_arc(arc: _Arc, side: Array, angle: float, px_mm: float) -> Array | None:
    """Where the line of a side meets the circle of an arc, the nearer to an angle; or touches it."""
    unit = (side[1] - side[0]) / max(float(np.linalg.norm(side[1] - side[0])), 1e-9)
    foot = side[0] + unit * float((arc.centre - side[0]) @ unit)
    off = float(np.linalg.norm(foot - arc.centre))
    if abs(off - arc.radius) < TANGENT_PX * px_mm:
        return arc.at(arc.angle(foot))
    if off > arc.radius:
        return None
    half = np.sqrt(arc.radius**2 - off**2)
    ways: tuple[Array, Array] = foot + half * unit, foot - half * unit
    return min(ways, key=lambda at: _turn_to(arc, angle, at))


def _candidate(ring: _Ring, plane: _Plane, images: StereoImages) -> Candidate | None:
    """The facet that a ring bounds, its straight sides measured between pixels; None where they do not show."""
    geometry = images.geometry
    whole = sum(map(_length, ring.elements))
    if ring.gap_mm > (1 - LEAST_SEEN) * whole:
        return None
    for _ in range(2):  # rough, and with the sides as measured
        outline = _outline(ring, plane.px_mm)
        if outline is None:
            return None
        corners, element, arcs = outline
        on_plane = plane.up(corners)
        ideal = geometry.project(on_plane)
        px = [camera.pixels(own) for camera, own in zip((geometry.left, geometry.right), ideal, strict=True)]
        count = len(corners)
        start, end = (np.concatenate([np.roll(own, -turn, axis=0) for own in px]) for turn in (0, 1))
        if np.hypot(*(end - start).T).min() < SHORTEST_PX:
            return None
        fitted = fit_sides([(view.exposure, count) for view in images.views], start, end)
        if fitted.support.min() < LEAST_SUPPORT:
            return None
        ring = _measured(ring, element, fitted, plane, geometry)
    shape = rings(px)
    chord = np.tile([isinstance(ring.elements[k], _Arc) for k in element], 2)[:, None]
    sides = replace(fitted, start=np.where(chord, start, fitted.start), end=np.where(chord, end, fitted.end))
    covariance = met_covariance(shape, sides).reshape(2, count, 2, 2)
    each = [sides.chosen(np.arange(count) + k * count) for k in (0, 1)]
    left, right = (
        Fitted(Polygon(own, spread, np.abs(these.step), own), these)
        for own, spread, these in zip(px, covariance, each, strict=True)
    )
    (found,) = candidates([(left, right, 0.0)], geometry)
    points = tuple(plane.up(one.at(one.begin + one.sweep * np.linspace(0, 1, POINTS))) for one in arcs)
    worth = 1 - ring.gap_mm / whole + float(fitted.support.min()) - PER_ELEMENT * len(ring.elements)
    return replace(found, facet=replace(found.facet, arcs=points), worth=worth)


def _outline(ring: _Ring, px_mm: float) -> tuple[Array, list[int], list[_Arc]] | None:
    """(N, 2) mm the corners of a ring, chords for its arcs; the number of the element that the side after each is of;
    and its arcs as far as they go. None where it crosses itself or runs the wrong way round."""
    elements, corners, owner, arcs = ring.elements, list[Array](), list[int](), list[_Arc]()
    if len(elements) == 1:
        (circle,) = elements
        assert isinstance(circle, _Arc)
        shares, out = chord_turns(circle.radius, circle.sweep, closed=True)
        wider = replace(circle, radius=out * circle.radius)
        return wider.at(circle.begin + circle.sweep * shares), [0] * len(shares), [circle]
    joints = [_met(elements[k - 1], one, px_mm) for k, one in enumerate(elements)]
    ends = [joint[0] for joint in joints if joint is not None]
    if len(ends) < len(joints):
        return None
    for k, one in enumerate(elements):
        corners.append(ends[k])
        owner.append(k)
        if isinstance(one, _Arc):
            begin = one.angle(ends[k])
            sweep = (one.angle(ends[(k + 1) % len(ends)]) - begin) % (2 * np.pi)
            shares, out = chord_turns(one.radius, sweep, closed=False)
            inner = replace(one, radius=out * one.radius).at(begin + sweep * shares)
            arcs.append(replace(one, begin=begin, sweep=sweep))
            corners += list(inner)
            owner += [k] * len(inner)
    outline = np.array(corners)
    return (outline, owner, arcs) if is_simple(outline * [1.0, -1.0]) else None  # as an image has it, y down


def _measured(ring: _Ring, element: Sequence[int], fitted: Sides, plane: _Plane, geometry: Baseline) -> _Ring:
    """A ring with its straight sides where both cameras measured them."""
    count = len(element)
    ends = np.stack([fitted.start, fitted.end], 1).reshape(2, -1, 2)
    cameras = enumerate((geometry.left, geometry.right))
    laid = np.mean([plane.down(camera.ideal(ends[k]), k, geometry) for k, camera in cameras], axis=0).reshape(
        count, 2, 2
    )
    moved = list(ring.elements)
    for k, own in enumerate(element):
        if not isinstance(moved[own], _Arc):
            moved[own] = laid[k]
    return _Ring(tuple(moved), ring.gap_mm)
