"""Near-duplicates of a part that nobody taught: its mirror image, one with a tip the other way, one with a cut corner
whole, one with a corner cut off.

In: a solid at its pose, what both images show along its edges. Out: solids in the part's frame, where they keep most of
it; for corners that may be cut, what both images show along its edges says where. Whether one of them fits better is
counter_evidence.py's.
"""

from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from itertools import product
from typing import NamedTuple

import numpy as np

from daemon.arrays import Array
from daemon.vision.evidence.edge_places import STEP, EdgePlaces
from daemon.vision.geometry import Polyhedron, exact, with_rings
from daemon.vision.image import StereoImages
from daemon.vision.model import mirror_images

MIRRORED = 2
"""Mirror images that are held against a part. With one five of twelve near-duplicates that kept their names are found,
with two seven, with twelve no more."""
FLAT_MM = 1.0
"""Of the singular values of a rim's corners about their plane, what is none."""
MET_MM, FARTHEST, SURE = 2.0, 1.5, 1e3
"""How far from each of a facet's side edges the point may lie where they meet; how far from the facet, in sizes of the
solid; and the condition number of a point that they give."""
LEAST_CUT, MOST_CUT = 2 / 24, 0.9
"""Of an edge, what must be missing at a corner for it to be cut there, and the most that is cut off."""
STRETCHED = 1.1, 1.5
"""How many times longer the missing end of an edge may be than it seems: beside a flat cut, the edge of the cut is
taken for the part's. With both 21 of 72 near-duplicates have a cut corner that leads by two nats, with 1.2 alone 13."""
NEAR_END = 3
"""Places beside a corner of which one at least must be missing for the edge to end early."""
MOST_ENDS = 3
"""Edges at a corner that are cut at places of their own."""


class NearDuplicate(NamedTuple):
    """A solid that is nearly another one, and how it differs, in words."""

    solid: Polyhedron
    difference: str


def near_duplicates(
    solid: Polyhedron, pose: Array, images: StereoImages, both: Sequence[EdgePlaces]
) -> list[NearDuplicate]:
    """All that a part at cyclopean_from_part (4, 4) could be taken for; mirror images where they keep most of what the
    left camera sees of it, and corners cut where both images lack the ends of its edges."""
    kinds = (
        ("mirrored", _mirrored(solid, pose, images)),
        ("with a tip the other way", inverted_corners(solid)),
        ("with a cut corner whole", completed_corners(solid)),
        ("with a corner cut off", cut_corners(solid, both)),
    )
    return [NearDuplicate(one, difference) for difference, solids in kinds for one in solids]


def _mirrored(solid: Polyhedron, pose: Array, images: StereoImages) -> list[Polyhedron]:
    """The mirror images that keep most of what the left camera sees of a part at cyclopean_from_part (4, 4)."""
    mirrored = mirror_images(solid)
    if not mirrored:
        return []
    shown_mm2 = np.maximum(solid.facing(pose, images.geometry.cameras_mm[0]), 0.0) * np.linalg.norm(
        solid.areas_mm2, axis=1
    )
    best = sorted(mirrored, key=lambda one: -float(shown_mm2 @ one.kept))[:MIRRORED]
    return [one.solid for one in best if shown_mm2 @ one.kept > 0]


@lru_cache(maxsize=256)
def inverted_corners(solid: Polyhedron) -> tuple[Polyhedron, ...]:
    """A solid with the tip of each pyramid on it sunk as far as it was raised, or raised as far as it was sunk."""
    found = list[Polyhedron]()
    for corner in range(len(solid.corners_mm)):
        own = [ring for ring in solid.facets if corner in ring]
        rim = sorted({k for ring in own for k in ring} - {corner})
        if (
            any(len(ring) > 3 for ring in own)
            or len(own) != len(rim)
            or any(set(ring) == set(rim) for ring in solid.facets)
        ):
            continue
        middle = solid.corners_mm[rim].mean(0)
        _, sizes, ways = np.linalg.svd(solid.corners_mm[rim] - middle)
        if sizes[2] < FLAT_MM:
            moved = solid.corners_mm.copy()
            moved[corner] -= 2 * ((moved[corner] - middle) @ ways[2]) * ways[2]
            found.append(exact(moved, solid.facets))
    return tuple(found)


@lru_cache(maxsize=256)
def completed_corners(solid: Polyhedron) -> tuple[Polyhedron, ...]:
    """A solid without each of its facets beyond which the edges that end at it meet in one point, drawn on to there."""
    ways = {*solid.edges, *((other, one) for one, other in solid.edges)}  # a side of two facets is there twice
    found = list[Polyhedron]()
    for facet, ring in enumerate(solid.rings):
        beyond = [[k for here, k in ways if here == corner and k not in ring] for corner in ring.tolist()]
        if any(len(one) != 1 for one in beyond):
            continue
        tip = _met_at(solid.corners_mm[ring], solid.corners_mm[[one[0] for one in beyond]])
        if tip is None or np.linalg.norm(tip - solid.centres_mm[facet]) > FARTHEST * solid.size_mm:
            continue
        last = len(solid.corners_mm)
        others = [[last if k in ring else k for k in one] for n, one in enumerate(solid.facets) if n != facet]
        once = [[k for place, k in enumerate(one) if k != one[place - 1]] for one in others]
        found.append(with_rings(np.vstack([solid.corners_mm, tip]), [one for one in once if len(one) > 2]))
    return tuple(found)


def _met_at(ends: Array, begins: Array) -> Array | None:
    """(3,) where lines from begins (N, 3) through ends (N, 3) meet beyond the ends, if they do."""
    way = ends - begins
    way = way / np.linalg.norm(way, axis=1, keepdims=True)
    off = np.eye(3) - way[:, :, None] * way[:, None, :]
    total = off.sum(0)
    if np.linalg.cond(total) > SURE:
        return None
    tip: Array = np.linalg.solve(total, (off @ ends[..., None]).sum(0)[:, 0])
    aside = np.linalg.norm((off @ (tip - ends)[..., None])[..., 0], axis=1)
    return tip if aside.max() < MET_MM and (((tip - ends) * way).sum(1) > 0).all() else None


def cut_corners(solid: Polyhedron, both: Sequence[EdgePlaces]) -> Iterator[Polyhedron]:
    """A solid without the corner at which most is missing of those where all edges in view end early in both images, as
    EdgePlaces have it: cut where they seem to end and farther from the corner."""
    cut = [(corner, ends) for corner, ends in _missing_ends(solid, both).items() if _ends_early(ends)]
    if not cut:
        return
    corner, ends = max(cut, key=lambda one: sum(filter(np.isfinite, one[1].values())))
    seen = {other: share for other, share in ends.items() if share < np.inf}
    usual = float(np.mean(list(seen.values())))
    each_by_itself = product(STRETCHED, repeat=len(seen)) if len(seen) <= MOST_ENDS else None
    for times in each_by_itself or ((by,) * len(seen) for by in STRETCHED):
        stretched = dict.fromkeys(ends, usual * float(np.mean(times)))
        stretched |= {other: share * by for (other, share), by in zip(seen.items(), times, strict=True)}
        yield without_corner(solid, corner, {other: min(share, MOST_CUT) for other, share in stretched.items()})


def _ends_early(ends: Mapping[int, float]) -> bool:
    """Whether all edges at a corner that are in view lack their ends there, and one clearly."""
    seen = [share for share in ends.values() if share < np.inf]
    return len(ends) > 2 and bool(seen) and min(seen) > 0 and max(seen) >= LEAST_CUT


def _missing_ends(solid: Polyhedron, both: Sequence[EdgePlaces]) -> dict[int, dict[int, float]]:
    """Return of each corner, by the corners at the other ends of its edges, the share of the edge that is missing there
    in both images; infinite where neither shows it; nothing where no edge lacks enough for a cut."""
    seen = np.array([one.visible for one in both])
    lacking = seen & (np.array([one.step for one in both]) < STEP)
    visible, row = (np.stack([one, one[..., ::-1]]) for one in (seen, lacking))  # from either end of each edge
    near, count = row[..., :NEAR_END], row.shape[-1]
    broken = ~row & (np.arange(count) >= near.argmax(-1)[..., None])
    share = near.any(-1) * np.where(broken.any(-1), broken.argmax(-1), count) / count
    least = np.where(visible[..., :NEAR_END].any(-1), share, np.inf).min(1)
    if not ((least >= LEAST_CUT) & (least < np.inf)).any():
        return {}
    found = dict[int, dict[int, float]]()
    for (one, other), at_one, at_other in zip(solid.lines[0].tolist(), *least.tolist(), strict=True):
        found.setdefault(one, {})[other] = at_one
        found.setdefault(other, {})[one] = at_other
    return found


def without_corner(solid: Polyhedron, corner: int, shares: Mapping[int, float]) -> Polyhedron:
    """A solid with a corner cut off; shares: how much of each edge there goes, by the corner at its other end."""
    count, start = len(solid.corners_mm), solid.corners_mm[corner]
    new = {other: count + place for place, other in enumerate(shares)}
    points = [start + share * (solid.corners_mm[other] - start) for other, share in shares.items()]
    rings, onward = list[Sequence[int]](), dict[int, int]()
    for ring in solid.facets:
        if corner not in ring:
            rings.append(ring)
            continue
        place = ring.index(corner)
        before, after = new[ring[place - 1]], new[ring[(place + 1) % len(ring)]]
        rings.append((*ring[:place], before, after, *ring[place + 1 :]))
        onward[after] = before
    cap = [next(iter(onward))]
    while len(cap) < len(onward) and cap[-1] in onward:
        cap.append(onward[cap[-1]])
    closed = onward.get(cap[-1]) == cap[0] and len(cap) > 2  # where a facet there is not known the cut is not bounded
    return with_rings(np.vstack([solid.corners_mm, points]), [*rings, *([cap] if closed else [])])
