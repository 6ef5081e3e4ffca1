"""Fillets and chamfers too small for a camera to resolve -> the sharp edges they were made from, as of a part whose
edges are worn: the flat faces beside them are carried on until they meet. Pure.
"""

from dataclasses import dataclass

import numpy as np

from daemon.arrays import Array, Flags, Index
from daemon.teaching.flat_regions import FlatRegions
from daemon.vision.facets import connected
from daemon.vision.geometry import sides_of

DEEP_MM = 0.6
"""How far at most the middle of a blend lies from the nearest face it joins: a fillet of radius 2 mm, a chamfer of
1.2 mm, whose edge draws back by as much as that of the worn parts that the pose is refined for (0.8 mm)."""
BETWEEN_COS = 0.3
"""A blend's normal is so near at least to that of a face it joins: the wall of a step or a bore is square to it."""
CROSSING_SIN = 0.1
LEAST_DETERMINANT = 0.05
FARTHEST_MM = 5.0
"""How far at most a border is carried on."""
SAME_MM = 0.05


@dataclass(frozen=True, eq=False)
class Blends:
    """cluster (R,): which blend each region is of, -1 if none; joins: the flat faces that each blend joins; flat (R,):
    which regions are flat faces."""

    cluster: Index
    joins: tuple[tuple[int, ...], ...]
    flat: Flags


def blends(regions: FlatRegions, owner: Index) -> Blends:
    """The small strips between flat faces; owner (R,): the curved surface each region is of, or -1."""
    small = np.array([_narrow(regions, region, owner) for region in range(len(owner))], bool)
    beside = np.zeros((len(owner), len(owner)), bool)
    for one, other in regions.shared_mm:
        beside[one, other] = True
    cluster = np.full(len(owner), -1, np.intp)
    joins: list[tuple[int, ...]] = []
    own = np.flatnonzero(small)
    for members in connected(beside[np.ix_(own, own)]):
        strips = own[members]
        faces = [k for k in np.flatnonzero(beside[strips].any(axis=0)).tolist() if owner[k] < 0 and not small[k]]
        leans = np.array([[_joined(regions, strip, face) for face in faces] for strip in strips.tolist()], bool)
        if leans.any(axis=0).sum() >= 2 and leans.any(axis=1).all():
            cluster[strips] = len(joins)
            joins.append(tuple(np.array(faces)[leans.any(axis=0)].tolist()))
    return Blends(cluster, tuple(joins), (owner < 0) & (cluster < 0))


def _narrow(regions: FlatRegions, region: int, owner: Index) -> bool:
    """Whether a region is no wider than a blend may be: by its area and the longest border it shares."""
    longest = max((mm for (one, _), mm in regions.shared_mm.items() if one == region), default=0.0)
    return bool(regions.areas[region] < 4 * DEEP_MM * max(longest, DEEP_MM))


def _joined(regions: FlatRegions, strip: int, face: int) -> bool:
    """Whether a strip lies near a face, and leans towards it."""
    middle = regions.corners[list(regions.loops[strip][0])].mean(axis=0)
    off_mm = (middle - regions.corners[regions.loops[face][0][0]]) @ regions.normals[face]
    return bool(regions.normals[face] @ regions.normals[strip] > BETWEEN_COS and abs(off_mm) < DEEP_MM)


@dataclass(frozen=True, eq=False)
class Borders:
    """Outer borders of flat faces. points: corners, (3,) each, of the drawing and behind them new ones; rings: of each
    face its corners, each with the region beyond the side that follows it."""

    points: list[Array]
    rings: dict[int, list[tuple[int, int]]]


def borders(regions: FlatRegions, faces: list[int], found: Blends) -> Borders:
    """The outer border of each face, carried on across blends to the planes of the faces beyond them."""
    points = list(regions.corners)
    rings = {}
    for face in faces:
        ring = regions.loops[face][0]
        direct = [regions.beyond[side] for side in sides_of(ring)]
        across = [_across(regions, face, side, found) for side in sides_of(ring)]
        beyond = [region if other is None else other for region, other in zip(direct, across, strict=True)]
        made = []
        for k, corner in enumerate(ring):
            blended = across[k - 1] is not None or across[k] is not None
            if blended and beyond[k - 1] == beyond[k]:
                continue
            planes = [face, *(one for one in (beyond[k - 1], beyond[k]) if found.flat[one])]
            made.append((_met(points, regions, planes, corner) if blended else corner, beyond[k]))
        rings[face] = made
    return Borders(points, rings)


def _across(regions: FlatRegions, face: int, side: tuple[int, int], found: Blends) -> int | None:
    """The flat face beyond the blend on the other hand of a side: the one whose plane is nearest; None if no blend."""
    cluster = int(found.cluster[regions.beyond[side]])
    if cluster < 0:
        return None
    ends = regions.corners[list(side)]
    crossing = [
        (float(np.abs((ends - regions.corners[regions.loops[other][0][0]]) @ regions.normals[other]).max()), other)
        for other in found.joins[cluster]
        if np.linalg.norm(np.cross(regions.normals[face], regions.normals[other])) > CROSSING_SIN
    ]
    return min(crossing)[1] if crossing and min(crossing)[0] < FARTHEST_MM else None


def _met(points: list[Array], regions: FlatRegions, planes: list[int], corner: int) -> int:
    """The number of the point nearest to a corner in which planes of faces meet; the corner's own where they do not."""
    normals = regions.normals[planes]
    levels = np.array([normals[k] @ regions.corners[regions.loops[p][0][0]] for k, p in enumerate(planes)])
    if len(planes) == 3 and abs(np.linalg.det(normals)) < LEAST_DETERMINANT:
        return corner
    old = points[corner]
    new = old + np.linalg.pinv(normals) @ (levels - normals @ old)
    if np.linalg.norm(new - old) > FARTHEST_MM:
        return corner
    for k in range(len(regions.corners), len(points)):
        if np.linalg.norm(points[k] - new) < SAME_MM:
            return k
    points.append(new)
    return len(points) - 1
