"""Which corners and which facets, as several looks measured them, are one. Pure; where they then are is
looks_adjustment.py's.
"""

import numpy as np

from daemon.arrays import Array, Index
from daemon.vision.facets.grouping import connected
from daemon.vision.facets.many_looks.looks_adjustment import MIN_MM2
from daemon.vision.geometry import area_vector, axes_in, inside, newell_normal, off_segments

Ring = tuple[int, ...]
Pieces = list[tuple[int, int]]
"""(look, facet) of what is one facet or a piece of it."""

MIN_MM, MAX_MM, SIGMAS = 1.0, 8.0, 4.0
"""Corners this near are one, farther apart never; in between, those within so many predicted errors."""
GAP_MM = 4.0
"""Pieces of one facet lie this near to its plane, or within so many predicted errors, and to each other."""
OF_SHORTEST = 1 / 3  # the same as a share of the shorter of the sides that end there
TILT_DEG, MAX_TILT_DEG = 12.0, 30.0
"""Largest angle, degrees, between the normals of pieces of one facet, on top of their own uncertainty; and with it."""
FACING = 0.2
"""Cosine to its normal from where a facet would have been seen."""
DEPTHS = (0.4, 0.8)  # of the way from a facet's middle to its corners


def match_corners(moved: list[Array], spread: list[Array], outlines: list[list[Ring]]) -> list[Index]:
    """Number the corners of all looks, the same number where looks measured one corner: the surest corners first, each
    with the nearest one that is near enough and not of its own outline. What one look separated only another's corner
    makes one. moved (N, 3) base, spread (N, 3, 3)."""
    owner = [np.full(len(points), -1, np.intp) for points in moved]
    widths = [_widths(points, rings) for points, rings in zip(moved, outlines, strict=True)]
    doubts = [np.trace(covariance, axis1=1, axis2=2) + MIN_MM2 for covariance in spread]
    beside = [
        [{k for ring in rings if corner in ring for k in ring} for corner in range(len(points))]
        for points, rings in zip(moved, outlines, strict=True)
    ]
    every = sorted((float(doubt[k]), look, k) for look, doubt in enumerate(doubts) for k in range(len(doubt)))
    centres, weights, narrowest = np.zeros((len(every), 3)), np.zeros(len(every)), np.full(len(every), np.inf)
    seen_by = np.zeros((len(moved), len(every)), bool)
    count = 0
    for doubt, look, k in every:
        at, width = moved[look][k], widths[look][k]
        limit = np.clip(SIGMAS * np.sqrt(doubt + 1 / weights[:count]), MIN_MM, MAX_MM)
        limit = np.minimum(limit, OF_SHORTEST * np.minimum(width, narrowest[:count]))
        apart = np.linalg.norm(centres[:count] - at, axis=1)
        apart[seen_by[look, :count] & (seen_by[:, :count].sum(0) == 1)] = np.inf
        apart[[j for j in {int(owner[look][other]) for other in beside[look][k]} if j >= 0]] = np.inf
        near = np.flatnonzero(apart < limit)
        j = int(near[np.argmin(apart[near])]) if len(near) else count
        count = max(count, j + 1)
        owner[look][k] = j
        seen_by[look, j] = True
        weights[j] += 1 / doubt
        centres[j] += (at - centres[j]) / (doubt * weights[j])
        narrowest[j] = min(narrowest[j], width)
    return owner


def _widths(points: Array, rings: list[Ring]) -> Array:
    """(N,) the shortest side that ends in each corner."""
    widths = np.full(len(points), np.inf)
    for ring in rings:
        corners = points[list(ring)]
        sides = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
        widths[list(ring)] = np.minimum(widths[list(ring)], np.minimum(sides, np.roll(sides, 1)))
    return widths


def match_facets(moved: list[Array], spread: list[Array], outlines: list[list[Ring]]) -> list[Pieces]:
    """The looks' facets (look, facet) in sets of what is one facet or a piece of it, each set with the one first whose
    plane is known best. moved (N, 3) base with spread (N, 3, 3)."""
    every = [(look, f) for look, rings in enumerate(outlines) for f in range(len(rings))]
    shapes = {(look, f): moved[look][list(outlines[look][f])] for look, f in every}
    doubts = {(k, f): np.sqrt(np.trace(spread[k][list(outlines[k][f])], axis1=1, axis2=2)) for k, f in every}
    planes = {at: (newell_normal(shapes[at]), shapes[at].mean(0)) for at in every}
    tilts = {at: _tilt(shapes[at], doubts[at]) for at in every}
    every.sort(key=lambda at: tilts[at])
    found = list[Pieces]()
    for at in every:
        most = np.cos(min(np.radians(TILT_DEG) + tilts[at], np.radians(MAX_TILT_DEG)))
        near_mm = np.maximum(GAP_MM, SIGMAS * doubts[at])
        for one in found:
            normal, middle = planes[one[0]]
            level = normal @ planes[at][0] > most and (np.abs((shapes[at] - middle) @ normal) < near_mm).all()
            if level and any(_touch(shapes[k], shapes[at]) for k in one):
                one.append(at)
                break
        else:
            found.append([at])
    return found


def drop_contradicted(
    facets: list[Pieces], moved: list[Array], outlines: list[list[Ring]], viewpoints: Array
) -> list[Pieces]:
    """The sets without those that more looks deny than saw them, the most denied one left out first. A look denies a
    facet that is turned to it when it saw another one where that is, or through it: such a facet was put together
    wrongly in the look that it is of. cameras (L, 3) base: where the looks were taken from."""
    shapes = [[points[list(ring)] for ring in rings] for points, rings in zip(moved, outlines, strict=True)]
    kept = list(facets)
    while kept:
        over = [_is_contradicted(kept, one, shapes, viewpoints) for one in kept]
        worst = int(np.argmax(over))
        if over[worst] <= 0:
            break
        kept.pop(worst)
    return kept


def _is_contradicted(facets: list[Pieces], one: Pieces, shapes: list[list[Array]], viewpoints: Array) -> int:
    """Return by how many more looks contradict a facet than saw it."""
    saw = {look for look, _ in one}
    outline = shapes[one[0][0]][one[0][1]]
    denied = 0
    for k, viewpoint in enumerate(viewpoints):
        if k not in saw:
            others = [shapes[look][ring] for other in facets if other is not one for look, ring in other if look == k]
            denied += _contradicts(others, outline, viewpoint)
    return denied - len(saw)


def _contradicts(others: list[Array], outline: Array, viewpoint: Array) -> bool:
    """Whether one of the outlines (N, 3) that were seen from there lies where most of this one should be, or behind."""
    if newell_normal(outline) @ (viewpoint - outline.mean(0)) < FACING * np.linalg.norm(viewpoint - outline.mean(0)):
        return False
    middle = outline.mean(0)
    rays = np.vstack([middle, *(middle + depth * (outline - middle) for depth in DEPTHS)]) - viewpoint
    denied = np.zeros(len(rays), bool)
    for other in others:
        normal = newell_normal(other)
        towards = rays @ normal
        share = np.divide((other.mean(0) - viewpoint) @ normal, towards, out=np.zeros(len(rays)), where=towards < -1e-9)
        axes = axes_in(normal)
        hit = inside((viewpoint + share[:, None] * rays) @ axes.T, (other @ axes.T)[None])[0]
        denied |= hit & ((share - 1.0) * np.linalg.norm(rays, axis=1) > -GAP_MM)
    return bool(denied.mean() > 0.5)


def connected_by_marks(marks: list[set[tuple[int, int]]]) -> list[list[int]]:
    """Connected components of facets that share a mark: a corner, or a group in a look."""
    return connected(np.array([[one is other or not one.isdisjoint(other) for other in marks] for one in marks], bool))


def _tilt(outline: Array, doubt: Array) -> float:
    """Return how far, rad, an outline's (N, 3) normal may be off whose corners may each be off by `doubt` (N,) mm."""
    return float((MIN_MM + doubt.max()) / np.sqrt(max(float(np.linalg.norm(area_vector(outline))), 1e-9)))


def _touch(large: Array, small: Array) -> bool:
    """Whether two outlines of one plane overlap, or lie within GAP_MM of each other."""
    axes = axes_in(newell_normal(large))
    one, other = (points @ axes.T for points in (large, small))
    if inside(np.vstack([other, other.mean(0)]), one[None]).any() or inside(one, other[None]).any():
        return True
    return min(_gap_mm(one, other), _gap_mm(other, one)) < GAP_MM


def _gap_mm(ring: Array, points: Array) -> float:
    """Distance of the nearest of the points (M, 2) from the border of a ring (N, 2)."""
    return float(off_segments(points[:, None], ring, np.roll(ring, -1, axis=0)).min())
