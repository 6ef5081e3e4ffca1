"""Make rings that a camera can measure from the borders of a drawing's flat faces: straight sides without corners in
them, arcs as few chords, and the sides that do not show because the surface continues smoothly. Pure."""

from dataclasses import dataclass, field
from itertools import groupby, pairwise

import numpy as np

from daemon.arrays import Array, Index
from daemon.teaching.blends import Blends, borders
from daemon.teaching.curved_surfaces import STRIP_RAD
from daemon.teaching.flat_regions import FlatRegions
from daemon.vision.geometry import chord_turns, fit_circle

STRAIGHT_RAD = np.radians(0.4)
"""A border that turns by less has no corner there, but continues a side; two facets that turn by a little more are
one."""
ON_CIRCLE_MM = 0.05
ARC_POINTS, MIN_POINTS = 7.6, 9
"""Points on an arc: for each radian, and at least; as on a round hole's rim."""


@dataclass(eq=False)
class Outlines:
    """Rings under construction. points: the drawing's corners, and behind them those of chords; smooth: sides
    that do not show, by their ends, the smaller first; arcs: each by the number of its ring, points (N, 3) on it, and
    whether it shows."""

    points: list[Array]
    rings: list[tuple[int, ...]] = field(default_factory=list)
    smooth: set[tuple[int, int]] = field(default_factory=set)
    arcs: list[tuple[int, Array, bool]] = field(default_factory=list)


def outlines(regions: FlatRegions, owner: Index, blends: Blends, step_mm: float) -> Outlines:
    """The outer ring of each flat face; owner (R,): the curved surface of each region, or -1."""
    faces = np.flatnonzero(blends.flat).tolist()
    drawn = borders(regions, faces, blends)
    made = Outlines(drawn.points)
    for face in faces:
        ring = [corner for corner, _ in drawn.rings[face]]
        kinds = [_kind(regions, face, beyond, owner) for _, beyond in drawn.rings[face]]
        turned = next((k for k in range(len(ring)) if kinds[k - 1] != kinds[k]), None)
        if turned is None and kinds[0][0] >= 0:
            made.rings.append(_chords(made, [*ring, ring[0]], step_mm, kinds[0][1]))
            continue
        first = turned or 0
        ring, kinds = ring[first:] + ring[:first], kinds[first:] + kinds[:first]
        made.rings.append(_straightened(made, _pieces(made, ring, kinds, step_mm), step_mm))
    return made


def _kind(regions: FlatRegions, face: int, other: int, owner: Index) -> tuple[int, bool]:
    """The curved surface of the region beyond a side, or -1; and whether the surface continues smoothly there."""
    surface = int(owner[other])
    return surface, surface >= 0 and regions.turn_rad(face, other) < STRIP_RAD


def _pieces(made: Outlines, ring: list[int], kinds: list[tuple[int, bool]], step_mm: float) -> list[int]:
    """The ring with the sides along each curved surface replaced by chords."""
    found: list[int] = []
    at = 0
    for (surface, smooth), run in groupby(kinds):
        count = len(list(run))
        stretch = [ring[k % len(ring)] for k in range(at, at + count + 1)]
        at += count
        if surface >= 0:
            stretch = [*_chords(made, stretch, step_mm, smooth), stretch[-1]]
        found += stretch[:-1]
    return found


def _chords(made: Outlines, stretch: list[int], step_mm: float, smooth: bool) -> tuple[int, ...]:
    """A border along a curved surface, without its last corner: an arc of a circle as few chords, another curve
    unchanged. Sides that do not show are noted."""
    points = np.array([made.points[k] for k in stretch])
    closed = stretch[0] == stretch[-1]
    arc = _arc(points, closed, ON_CIRCLE_MM + step_mm) if len(stretch) > 3 else None
    if arc is None:
        new = stretch
    else:
        chords, along = arc
        inner = list(range(len(made.points), len(made.points) + len(chords)))
        made.points.extend(chords)
        made.arcs.append((len(made.rings), along, not smooth))
        new = [*inner, inner[0]] if closed else [stretch[0], *inner, stretch[-1]]
    if smooth:
        made.smooth |= {(min(a, b), max(a, b)) for a, b in pairwise(new)}
    return tuple(new[:-1])


def _arc(points: Array, closed: bool, near_mm: float) -> tuple[Array, Array] | None:
    """(N, 3) the corners of chords along points (M, 3) on a circle, without the ends where it is open, and (K, 3)
    points on the arc itself, from end to end; None where they are on none."""
    middle = points.mean(axis=0)
    x, y, normal = np.linalg.svd(points - middle)[2]
    flat = (points - middle) @ np.column_stack([x, y])
    centre, radius, off = fit_circle(flat)
    if off > near_mm or np.abs((points - middle) @ normal).max() > near_mm or radius > 1e4:
        return None
    angles = np.unwrap(np.arctan2(*(flat - centre).T[::-1]))
    sweep = float(angles[-1] - angles[0])
    shares, out = chord_turns(radius, sweep, closed)
    at = angles[0] + sweep * shares
    along = angles[0] + sweep * np.linspace(0, 1, max(int(ARC_POINTS * abs(sweep)), MIN_POINTS))
    chords, arc = (
        middle + (centre + size * radius * np.column_stack([np.cos(turn), np.sin(turn)])) @ np.array([x, y])
        for size, turn in ((out, at), (1.0, along))
    )
    return chords, arc


def _straightened(made: Outlines, ring: list[int], step_mm: float) -> tuple[int, ...]:
    """The ring without corners where the border continues straight, within rounding to a step, and shows or does not
    show on both sides."""
    kept = list(ring)
    at = 0
    while at < len(kept) and len(kept) > 2:
        a, b, c = (kept[(at + step) % len(kept)] for step in (-1, 0, 1))
        one, two = made.points[b] - made.points[a], made.points[c] - made.points[b]
        lengths = np.linalg.norm([one, two], axis=1)
        straight = STRAIGHT_RAD + 2 * np.arctan2(step_mm, lengths.min())
        cosine = float(one @ two / max(float(lengths.prod()), 1e-12))
        sides = (min(a, b), max(a, b)) in made.smooth, (min(b, c), max(b, c)) in made.smooth
        if cosine > np.cos(straight) and sides[0] == sides[1]:
            kept.pop(at)
            if sides[0]:
                made.smooth.add((min(a, c), max(a, c)))
            at = max(at - 1, 0)
        else:
            at += 1
    return tuple(kept)
