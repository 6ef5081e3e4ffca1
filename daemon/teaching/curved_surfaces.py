"""Find the flat regions of a drawing that are strips of a curved surface: a cylinder (a bore, a boss, a fillet), a
cone, or another shape. Pure."""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from daemon.arrays import Array, Index
from daemon.teaching.flat_regions import FlatRegions
from daemon.vision.facets import connected
from daemon.vision.geometry import axes_in, circle_along

STRIP_RAD = np.radians(31.0)
"""Largest turn from strip to strip: twelve strips to a circle, and a margin."""
ALIKE_WIDTHS = 3.0
"""Largest ratio of widths of neighbouring strips; a flat face is wider than the strips of its fillet."""
MIN_STRIPS, SURE_STRIPS, EVENLY = 3, 6, 1.5
"""Least number of neighbouring flat faces that are a curved surface; fewer than the second must turn evenly, within the
third."""
ROUND_SHARE = 0.02
"""Largest distance of corners of a cylinder from its circle, as a share of the radius."""
ALONG_SIN = 0.02
"""Largest inclination of a cylinder's normals along its axis."""
COVER_RAD = np.radians(30.0)
"""Largest arc of a curved surface that one quadrilateral stands for in the test of what it hides."""
WHOLE_RAD = np.radians(330.0)


@dataclass(frozen=True, eq=False)
class CurvedSurface:
    """kind: cylinder, cone or free; regions: its strips; radius_mm of a cylinder, else 0; sweep_rad: the arc that it
    covers; hollow: whether its centre is outside the part; covers (N, 4, 3): quadrilaterals on it that hide what is
    behind, wound like facets."""

    kind: str
    regions: tuple[int, ...]
    radius_mm: float
    sweep_rad: float
    hollow: bool
    covers: Array = field(default_factory=lambda: np.zeros((0, 4, 3)))

    @property
    def whole(self) -> bool:
        """Whether it is closed all round."""
        return bool(self.sweep_rad > WHOLE_RAD)

    def __str__(self) -> str:
        if self.kind != "cylinder":
            return "cone" if self.kind == "cone" else "curved surface"
        if self.whole:
            return f"{'bore' if self.hollow else 'boss'} of {2 * self.radius_mm:.3g} mm"
        return f"{'hollow' if self.hollow else 'outer'} rounding of radius {self.radius_mm:.3g} mm"


def curved_surfaces(regions: FlatRegions) -> tuple[CurvedSurface, ...]:
    """Find strips that are neighbours, turn little from one to the next, and are about equally wide."""
    count = len(regions.areas)
    linked = np.zeros((count, count), bool)
    turns: dict[tuple[int, int], float] = {}
    for (one, other), shared in regions.shared_mm.items():
        turn = regions.turn_rad(one, other)
        widths = regions.areas[[one, other]] / max(shared, 1e-9)
        if turn < STRIP_RAD and widths.max() < ALIKE_WIDTHS * widths.min():
            linked[one, other] = True
            turns[one, other] = turn
    found = []
    for members in connected(linked):
        own = [turn for (one, _), turn in turns.items() if one in set(members)] if len(members) < SURE_STRIPS else [1.0]
        if len(members) >= MIN_STRIPS and max(own) < EVENLY * min(own):
            found.append(_surface(regions, tuple(members), turns))
    return tuple(found)


def _surface(regions: FlatRegions, members: tuple[int, ...], turns: dict[tuple[int, int], float]) -> CurvedSurface:
    normals = regions.normals[list(members)]
    corners = regions.corners[sorted({k for r in members for loop in regions.loops[r] for k in loop})]
    pairs = [pair for pair in turns if pair[0] in members and pair[1] in members]
    axis = np.linalg.svd(normals)[2][2]
    if np.abs(normals @ axis).max() < ALONG_SIN:
        centre, radius, off = circle_along(corners, axis)
        if off < ROUND_SHARE * radius + 0.05:
            middles = np.array([regions.corners[list(regions.loops[r][0])].mean(axis=0) for r in members])
            hollow = bool(np.mean(((middles - centre) * normals).sum(axis=1)) < 0)
            sweep = sum(turns[pair] for pair in pairs) / 2 + float(np.mean([turns[pair] for pair in pairs]))
            covers = np.zeros((0, 4, 3)) if hollow else _covers(regions, members, axis, centre, radius)
            return CurvedSurface("cylinder", members, radius, min(sweep, 2 * np.pi), hollow, covers)
    lean = np.linalg.svd(normals - normals.mean(axis=0))[1][2] / np.sqrt(len(members))
    return CurvedSurface("cone" if lean < ALONG_SIN and len(members) > 3 else "free", members, 0.0, 0.0, False)


def _covers(regions: FlatRegions, members: tuple[int, ...], axis: Array, centre: Array, radius: float) -> Array:
    """(N, 4, 3) chords of a cylinder, as long as all strips behind them."""
    across = axes_in(axis)
    across = across if np.linalg.det(np.vstack([across, axis])) > 0 else across[::-1]
    strips = [regions.corners[list(regions.loops[r][0])] for r in members]
    normals = regions.normals[list(members)] @ across.T
    order = np.argsort(np.arctan2(normals[:, 1], normals[:, 0]))
    turns = np.arctan2(normals[order, 1], normals[order, 0])
    levels = np.array([(strip @ axis).min() for strip in strips]), np.array([(strip @ axis).max() for strip in strips])
    found = []
    for chunk in np.split(order, np.flatnonzero(np.diff(np.floor(turns / COVER_RAD))) + 1):
        rays = np.concatenate([strips[k] for k in chunk]) @ across.T - centre @ across.T
        middle = normals[chunk].sum(axis=0)
        off = np.arctan2(middle[0] * rays[:, 1] - middle[1] * rays[:, 0], rays @ middle)
        at = np.arctan2(middle[1], middle[0]) + np.array([off.min(), off.max()])
        low, high = levels[0][chunk].max(), levels[1][chunk].min()
        if high > low:
            ring = centre + radius * np.column_stack([np.cos(at), np.sin(at)]) @ across
            ring = ring - np.outer(ring @ axis, axis)
            found.append([ring[0] + low * axis, ring[1] + low * axis, ring[1] + high * axis, ring[0] + high * axis])
    return np.array(found).reshape(-1, 4, 3)


def owners(regions: FlatRegions, surfaces: tuple[CurvedSurface, ...]) -> Index:
    """(R,) the curved surface that each region is a strip of; -1: a flat face."""
    owner = np.full(len(regions.areas), -1, np.intp)
    for k, surface in enumerate(surfaces):
        owner[list(surface.regions)] = k
    return owner


def counted(names: Iterable[str]) -> str:
    """['bore of 8 mm', 'bore of 8 mm', 'cone'] -> '2 x bore of 8 mm, cone'."""
    return ", ".join(name if count == 1 else f"{count} x {name}" for name, count in Counter(names).items())
