"""Replace fillets and chamfers that no camera resolves by the sharp edges between the flat faces beside them, as of a
part with worn edges. Pure."""

from dataclasses import dataclass

import numpy as np

from daemon.arrays import Array, Flags, Index
from daemon.teaching.flat_regions import FlatRegions
from daemon.vision.facets import connected
from daemon.vision.geometry import sides_of

DEEP_MM = 0.6
"""Largest distance of the middle of a blend from the nearest face that it joins: a fillet of radius 2 mm, a chamfer of
1.2 mm. Its edge then lies as far back as that of the worn parts for which the pose is refined (0.8 mm)."""
BETWEEN_COS = 0.3
"""Smallest cosine between the normals of a blend and a face that it joins: the wall of a step or a bore is square to
it."""
CROSSING_SIN = 0.1
MIN_DETERMINANT = 0.05
FARTHEST_MM = 5.0
"""Largest distance, mm, by which a border may be extended."""
SAME_MM = 0.05


@dataclass(frozen=True, eq=False)
class Blends:
    """cluster (R,): the blend of each region, -1 if none; joins: the flat faces that each blend joins; flat (R,): which
    regions are flat faces."""

    cluster: Index
    joins: tuple[tuple[int, ...], ...]
    flat: Flags


def find_blends(regions: FlatRegions, owner: Index) -> Blends:
    """Find the narrow strips between flat faces. owner (R,): the curved surface of each region, or -1."""
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
    """Whether a region is narrow enough for a blend, by its area and its longest shared border."""
    longest = regions.longest_mm.get(region, 0.0)
    return bool(regions.areas[region] < 4 * DEEP_MM * max(longest, DEEP_MM))


def _joined(regions: FlatRegions, strip: int, face: int) -> bool:
    """Whether a strip lies near a face and is inclined towards it."""
    middle = regions.corners[list(regions.loops[strip][0])].mean(axis=0)
    off_mm = (middle - regions.corners[regions.loops[face][0][0]]) @ regions.normals[face]
    return bool(regions.normals[face] @ regions.normals[strip] > BETWEEN_COS and abs(off_mm) < DEEP_MM)


@dataclass(frozen=True, eq=False)
class Borders:
    """Outer borders of flat faces. points: corners, (3,) each, of the drawing and then new ones; rings: for each face
    its corners, each with the region beyond the side after it."""

    points: list[Array]
    rings: dict[int, list[tuple[int, int]]]


def borders(regions: FlatRegions, faces: list[int], blends: Blends) -> Borders:
    """The outer border of each face, extended across blends to the planes of the faces beyond."""
    points = list(regions.corners)
    rings = {}
    for face in faces:
        ring = regions.loops[face][0]
        direct = [regions.beyond[side] for side in sides_of(ring)]
        across = [_across(regions, face, side, blends) for side in sides_of(ring)]
        beyond = [region if other is None else other for region, other in zip(direct, across, strict=True)]
        made = []
        for k, corner in enumerate(ring):
            blended = across[k - 1] is not None or across[k] is not None
            if blended and beyond[k - 1] == beyond[k]:
                continue
            planes = [face, *(one for one in (beyond[k - 1], beyond[k]) if blends.flat[one])]
            made.append((_met(points, regions, planes, corner) if blended else corner, beyond[k]))
        rings[face] = made
    return Borders(points, rings)


def _across(regions: FlatRegions, face: int, side: tuple[int, int], blends: Blends) -> int | None:
    """The flat face beyond the blend at a side: the one with the nearest plane; None if there is no blend."""
    cluster = int(blends.cluster[regions.beyond[side]])
    if cluster < 0:
        return None
    ends = regions.corners[list(side)]
    crossing = [
        (float(np.abs((ends - regions.corners[regions.loops[other][0][0]]) @ regions.normals[other]).max()), other)
        for other in blends.joins[cluster]
        if np.linalg.norm(np.cross(regions.normals[face], regions.normals[other])) > CROSSING_SIN
    ]
    return min(crossing)[1] if crossing and min(crossing)[0] < FARTHEST_MM else None


def _met(points: list[Array], regions: FlatRegions, planes: list[int], corner: int) -> int:
    """The number of the point, nearest to a corner, where planes of faces meet; the corner's own number where they do
    not."""
    normals = regions.normals[planes]
    levels = np.array([normals[k] @ regions.corners[regions.loops[p][0][0]] for k, p in enumerate(planes)])
    if len(planes) == 3 and abs(np.linalg.det(normals)) < MIN_DETERMINANT:
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
