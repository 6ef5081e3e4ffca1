"""Elements of a facet's outline: straight sides and arcs, in order round it.

In: corners, and points along the arcs that are known. Out: arcs among corners alone; elements with their sweep and the
turn to the next. What a ring of elements is called: ring_names.py. Source: D'Souza, section 5.7 (the sector angle of an
arc as a property of the element).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from daemon.arrays import Array
from daemon.vision.geometry import fit_circle, newell_normal

MIN_CORNERS = 7  # fewer than this on a circle is a regular polygon as well as an arc
ROUND_MM, ROUND_SIGMAS = 0.2, 2.0  # how far a corner may lie off the circle, and in predicted errors on top
LONGEST_RAD, UNEVEN = np.pi / 2, 4.0  # a longer turn is a straight side, and so is one of so many usual ones
CLOSED_MM = 1e-6  # between the ends of a whole circle


@dataclass(frozen=True)
class Arc:
    """Corners first, first + 1, ... (count of them, round the facet) on one circle; sector_rad is 2 pi for a disc."""

    first: int
    count: int
    sector_rad: float
    radius_mm: float


@dataclass(frozen=True)
class Element:
    """A straight side, or an arc, from one corner of a facet to another, by their numbers. sweep_rad: 0 of a side, of
    an arc positive where it bends outwards; radius_mm: 0 of a side; turn_rad: by how much the outline turns at its end,
    into the next element, anticlockwise."""

    first: int
    last: int
    sweep_rad: float
    radius_mm: float
    turn_rad: float

    @property
    def straight(self) -> bool:
        """Whether it is a side."""
        return self.radius_mm == 0


def ring_elements(corners_mm: Array, arcs_mm: Sequence[Array]) -> tuple[Element, ...]:
    """The elements of an outline with arcs, from one of these on; none where they do not follow one another.

    corners_mm (N, 3), those of chords among them; arcs_mm: points (K, 3) along each arc, from end to end, the way the
    corners run. One arc alone is a disc.
    """
    origin, axes = _plane(corners_mm)
    flat = (corners_mm - origin) @ axes.T
    known = dict[int, tuple[int, Array]]()
    for points in ((one - origin) @ axes.T for one in arcs_mm):
        first, last = (int(((flat - points[end]) ** 2).sum(1).argmin()) for end in (0, -1))
        if first == last or np.linalg.norm(points[0] - points[-1]) < CLOSED_MM:
            radius = fit_circle(points)[1]
            return (Element(0, 0, 2 * np.pi, radius, 0.0),) if len(arcs_mm) == 1 else ()
        known[first] = last, points
    start = min(known)
    return _turned(_walk(flat, known, start))


def elements_by_corners(corners_mm: Array, covariance_mm2: Array) -> tuple[Element, ...]:
    """The elements of an outline of which corners alone are known; none where none run round a circle."""
    arc = find_arc(corners_mm, covariance_mm2)
    if arc is None:
        return ()
    on_arc = np.arange(arc.first, arc.first + arc.count + (arc.count == len(corners_mm))) % len(corners_mm)
    return ring_elements(corners_mm, [corners_mm[on_arc]])


_Stretch = tuple[int, int, float, float, Array, Array]
"""First and last corner, sweep, radius, and the directions (2,) at either end of an element."""


def _walk(flat: Array, known: dict[int, tuple[int, Array]], start: int) -> list[_Stretch]:
    """Return the elements once round corners (N, 2) from one on; none where an arc leads beyond it."""
    found, at, left = list[_Stretch](), start, len(flat)
    while left > 0:
        last, points = known.get(at, ((at + 1) % len(flat), np.zeros((0, 2))))
        if at in known:
            centre, radius, _ = fit_circle(points)
            sweep = _sector(points, centre)
            begin, end = (np.sign(sweep) * np.array([-y, x]) for x, y in (points[[0, -1]] - centre).tolist())
            found.append((at, last, sweep, radius, begin, end))
        else:
            way = flat[last] - flat[at]
            found.append((at, last, 0.0, 0.0, way, way))
        left -= (last - at) % len(flat)
        at = last
    return found if left == 0 else []


def _turned(ring: list[_Stretch]) -> tuple[Element, ...]:
    """Elements with the turns between them."""
    found = list[Element]()
    for (first, last, sweep, radius, _, end), (*_, begin, _) in zip(ring, [*ring[1:], *ring[:1]], strict=True):
        turn = np.arctan2(end[0] * begin[1] - end[1] * begin[0], end @ begin)
        found.append(Element(first, last, sweep, radius, float(turn)))
    return tuple(found)


def find_arc(corners_mm: Array, covariance_mm2: Array) -> Arc | None:
    """The longest run of at least seven corners on one circle, or None. (N, 3) mm, (N, 3, 3) mm^2."""
    n = len(corners_mm)
    if n < MIN_CORNERS:
        return None
    origin, axes = _plane(corners_mm)
    flat = (corners_mm - origin) @ axes.T
    most_mm = ROUND_MM + ROUND_SIGMAS * float(np.sqrt(np.trace(covariance_mm2, axis1=1, axis2=2).mean() / 3))
    runs = [(n, 0, True), *((count, first, False) for count in range(n, MIN_CORNERS - 1, -1) for first in range(n))]
    for count, first, closed in runs:  # all corners of a D lie on its circle, and its straight side does not
        points = flat[(first + np.arange(count)) % n]
        centre, radius, worst = fit_circle(points)
        round_once = np.vstack([points, points[:1]]) if closed else points
        if worst < most_mm and _turns_evenly(round_once, centre):
            return Arc(first, count, 2 * np.pi if closed else _sector(points, centre), radius)
    return None


def _plane(corners: Array) -> tuple[Array, Array]:
    """The middle (3,) of corners (N, 3), and two unit axes (2, 3) across their normal, anticlockwise."""
    normal, middle = newell_normal(corners), corners.mean(0)
    one = corners[0] - middle
    one = one - normal * (one @ normal)
    one = one / max(float(np.linalg.norm(one)), 1e-9)
    return middle, np.stack([one, np.cross(normal, one)])


def _turns_evenly(points: Array, centre: Array) -> bool:
    """Whether the steps round the circle all go one way and none is longer than a straight side would be."""
    steps = _steps(points, centre)
    return bool((steps > 0).all() and steps.max() < LONGEST_RAD and steps.max() < UNEVEN * np.median(steps))


def _sector(points: Array, centre: Array) -> float:
    return float(_steps(points, centre).sum())


def _steps(points: Array, centre: Array) -> Array:
    angle = np.arctan2(points[:, 1] - centre[1], points[:, 0] - centre[0])
    steps: Array = (np.diff(angle) + np.pi) % (2 * np.pi) - np.pi
    return steps
