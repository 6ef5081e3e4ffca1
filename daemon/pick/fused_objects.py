"""Objects on the table, fused from all looks so far: named parts, and objects without a name. Pure.

A part that one look named keeps its name. The facets of the most informative looks are fused, at most MOST_FUSED, so
that further looks take no longer. The recogniser gets the facets that no named part explains: each connected group as a
whole, and split at concave edges, where touching parts meet. Takes up to a second: not for the event loop.
"""

from collections.abc import Sequence

import numpy as np

from daemon import frames
from daemon.arrays import Array
from daemon.pick.looks import Look
from daemon.pick.pose_fusion import Doubt
from daemon.pick.recogniser import PartRecogniser
from daemon.pick.seen import SAME_PLACE_MM, ObservedPart, seen_parts
from daemon.vision.facets import FusedLooks, LookFacets, connected, fuse, group_of, merge_vertices
from daemon.vision.geometry import Polyhedron, axes_in, encloses, inside
from daemon.vision.values import Group

SAME_PART_MM = 15.0
"""Named parts whose centres are this near are the same part."""
ON_FACE_MM, ON_FACE_RAD = 4.0, 0.25
"""A facet this near and this parallel to a face of a named part belongs to that part, and so does, however it was
measured, one whose middle lies in the part or this far before its surface."""
EDGE_MM = 6.0
"""An edge whose ends are this near to those of a part's edge is that edge."""
OWN_SHARE = 0.5
"""A facet with a larger share of its area in a face belongs to that face."""
MOST_FUSED = 5
"""Maximum number of fused looks: the time grows with the square of the number, and five sides
show all that can be seen."""
NAMED_WEIGHT = 0.1
"""Weight of a named part in the choice of looks, relative to an unnamed one."""
CELLS = 12
"""Grid points per axis at which polygons are compared."""
HOLLOW_MM = 2.0
"""Facets whose centres are this far in front of each other's planes meet at a concave edge."""


def fuse_objects(looks: Sequence[Look], recogniser: PartRecogniser, doubt: Doubt) -> list[ObservedPart]:
    """All objects that the looks show, which are in order of time: named parts as the newest look that named them has
    them; unnamed ones from all looks together, in the newest look's frame."""
    every = [part for look in looks for part in seen_parts(look)]
    named = _latest_of_each([part for part in every if part.named], recogniser)
    if len(looks) < 2:
        return [*named, *(part for part in every if not part.named)]
    try:
        fused = fuse([_whole_look_facets(look, doubt) for look in most_informative(looks)], doubt.shared())
    except np.linalg.LinAlgError:  # facets of no extent: use each look by itself
        fused = None
    if fused is None:
        return [*named, *(part for part in seen_parts(looks[-1]) if not part.named)]
    newest = looks[-1]
    for piece in _candidate_groups(fused, _unexplained(fused, named, recogniser)):
        named += [part for part in _recognised(fused, piece, newest, recogniser) if part.named]
    named = parts_not_overlapping(fused, _latest_of_each(named, recogniser), recogniser)
    left = _unexplained(fused, named, recogniser)
    return [
        *named,
        *(part for piece in _connected_groups(fused, left) for part in _recognised(fused, piece, newest, recogniser)),
    ]


def most_informative(looks: Sequence[Look], most: int = MOST_FUSED) -> list[Look]:
    """Select the most informative looks, at most so many, in their order: the newest, then one by one the look that
    shows most of what the others show least; unnamed groups count most."""
    parts = [(k, part) for k, look in enumerate(looks) for part in seen_parts(look)]
    owner = np.array([k for k, _ in parts], np.intp)
    centres = np.array([part.centre for _, part in parts]).reshape(-1, 3)
    rays = np.array([part.look.world_from_cyclopean[:3, 3] for _, part in parts]).reshape(-1, 3) - centres
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    weight = np.array([NAMED_WEIGHT if part.named else 1.0 for _, part in parts])
    one = np.linalg.norm(centres[:, None] - centres, axis=2) < SAME_PLACE_MM
    alike = np.where(one, rays @ rays.T, -1.0)  # cosines of the rays to one place; other places are as the other side
    chosen, nearest = list[int](), np.full(len(parts), -1.0)
    for _ in range(min(most, len(looks))):
        gains = np.bincount(owner, weight * (1.0 - nearest), len(looks))
        gains[chosen] = -1.0
        best = len(looks) - 1 - int(np.argmax(gains[::-1])) if chosen else len(looks) - 1  # the newer of two alike
        chosen.append(best)
        if np.any(owner == best):
            nearest = np.maximum(nearest, alike[:, owner == best].max(axis=1))
    return [looks[k] for k in sorted(chosen)]


def look_facets(look: Look, groups: Sequence[Group], doubt: Doubt) -> LookFacets:
    """Groups of facets of a look, with its viewpoint and errors."""
    rig, here = look.taken.rig, look.world_from_cyclopean
    return LookFacets(tuple(groups), here, doubt.arm(), float(rig.left.matrix[0, 0]), rig.baseline_mm)


def _whole_look_facets(look: Look, doubt: Doubt) -> LookFacets:
    return look_facets(look, [merge_vertices(part.facets) for part in look.scene.parts if part.facets], doubt)


def _latest_of_each(named: Sequence[ObservedPart], recogniser: PartRecogniser) -> list[ObservedPart]:
    """Each named part once, from the newest look that shows it, without parts to which looks gave different names."""
    middles = np.array([_middle(part, recogniser) for part in named]).reshape(-1, 3)
    near = np.linalg.norm(middles[:, None] - middles, axis=2) < SAME_PART_MM
    out = set[int]()
    for i, j in np.argwhere(np.triu(near, 1)).tolist():
        out |= {i} if named[i].label == named[j].label else {i, j}
    return [part for k, part in enumerate(named) if k not in out]


def parts_not_overlapping(
    fused: FusedLooks, named: Sequence[ObservedPart], recogniser: PartRecogniser
) -> list[ObservedPart]:
    """Drop named parts that claim the same facet, which two real parts cannot: of two with the same name keep the one
    with more facet area; drop both of two with different names."""
    seen = fused.polyhedron
    area_mm2 = np.linalg.norm(seen.areas_mm2, axis=1)
    shares = np.array([_shares(seen, part, recogniser) for part in named]).reshape(len(named), len(seen.facets))
    theirs, whole_mm2 = (shares > OWN_SHARE).astype(float), shares @ area_mm2
    out = set[int]()
    for i, j in np.argwhere(np.triu(theirs @ theirs.T > 0.0, 1)).tolist():
        less = i if whole_mm2[i] < whole_mm2[j] else j
        out |= {less} if named[i].label == named[j].label else {i, j}
    return [part for k, part in enumerate(named) if k not in out]


def _shares(seen: Polyhedron, part: ObservedPart, recogniser: PartRecogniser) -> Array:
    """(F,) the share of each facet that lies in a face of a named part; 1 of one in the part: nothing else is there."""
    shape, shares = recogniser.shape(part.label), np.zeros(len(seen.facets))
    if shape is None:
        return shares
    corners = frames.apply(part.world_from_part, shape.corners_mm)
    reach_mm = np.linalg.norm(corners - corners.mean(axis=0), axis=1).max() + ON_FACE_MM
    near = np.flatnonzero(np.linalg.norm(seen.centres_mm - corners.mean(axis=0), axis=1) < reach_mm)
    middles = seen.centres_mm[near]
    behind = frames.apply(
        frames.inverse(part.world_from_part), np.stack([middles, middles - ON_FACE_MM * seen.normals[near]])
    )
    within = np.asarray(encloses(shape, behind).any(axis=0))
    for k, inner in zip(near.tolist(), within.tolist(), strict=True):
        shares[k] = 1.0 if inner else share_on_face(seen, k, shape, part.world_from_part)
    return shares


def _middle(part: ObservedPart, recogniser: PartRecogniser) -> Array:
    """(3,) world: of the part's corners, seen or not."""
    shape = recogniser.shape(part.label)
    return part.centre if shape is None else frames.apply(part.world_from_part, shape.corners_mm).mean(axis=0)


def _unexplained(fused: FusedLooks, named: Sequence[ObservedPart], recogniser: PartRecogniser) -> list[int]:
    """Facets with at most MOST of their area in faces of named parts, which are not untaught sides of such a part."""
    seen = fused.polyhedron
    explained, theirs = np.zeros(len(seen.facets)), set[int]()
    for part in named:
        shape = recogniser.shape(part.label)
        if shape is not None:
            shares = _shares(seen, part, recogniser)
            explained += shares
            theirs |= untaught_facets(
                seen, set(np.flatnonzero(shares > OWN_SHARE).tolist()), shape, part.world_from_part
            )
    return sorted(set(np.flatnonzero(explained <= OWN_SHARE).tolist()) - theirs)


def untaught_facets(seen: Polyhedron, mine: set[int], shape: Polyhedron, world_from_part: Array) -> set[int]:
    """Facets beyond the edges of a part's taught surface, and those connected to them: sides no taught view showed.
    mine: the facets in its faces. At such an edge the next facet bends away from the part; if it is coplanar or the
    edge is concave, another part begins."""
    ends = [shape.corners_mm[[a, b]] for (a, b), place in shape.edges.items() if place not in shape.across]
    corners = frames.apply(frames.inverse(world_from_part), seen.corners_mm)
    beyond, new = set[int](), set[int]()
    for edge, (facet, place) in seen.edges.items():
        other, _ = seen.across.get((facet, place), (facet, place))
        if facet in mine and other not in mine and _bends_away(seen, facet, other):
            there = corners[list(edge)]
            off = [np.linalg.norm(there - way, axis=1).max() for one in ends for way in (one, one[::-1])]
            new |= {other} if min(off, default=np.inf) < EDGE_MM else set()
    while new:
        beyond |= new
        hang = {
            int(k) for facet in new for k in np.flatnonzero(seen.touching[facet]) if _bends_away(seen, facet, int(k))
        }
        new = hang - beyond - mine
    return beyond


def _bends_away(seen: Polyhedron, facet: int, other: int) -> bool:
    """Whether two adjacent facets meet at a convex edge."""
    turned = float(seen.normals[facet] @ seen.normals[other]) < np.cos(ON_FACE_RAD)
    return turned and max(_plane_distances_mm(seen, facet, other)) < 0.0


def _plane_distances_mm(seen: Polyhedron, one: int, other: int) -> tuple[float, float]:
    """Signed distances of the centres of two facets from each other's planes, mm."""
    apart = seen.centres_mm[other] - seen.centres_mm[one]
    return float(seen.normals[one] @ apart), float(-seen.normals[other] @ apart)


def share_on_face(seen: Polyhedron, facet: int, shape: Polyhedron, world_from_part: Array) -> float:
    """Share of a facet that lies in one face of a part."""
    corners = frames.apply(frames.inverse(world_from_part), seen.corners_mm[seen.rings[facet]])
    normal = world_from_part[:3, :3].T @ seen.normals[facet]
    share = 0.0
    for ring, face in zip(shape.rings, shape.normals, strict=True):
        outline = shape.corners_mm[ring]
        if face @ normal < np.cos(ON_FACE_RAD) or np.abs((corners - outline[0]) @ face).max() > ON_FACE_MM:
            continue
        across = axes_in(face)
        share = max(share, _share_in(corners @ across.T, outline @ across.T))
    return share


def _share_in(ring: Array, outline: Array) -> float:
    """Share of a polygon's area (N, 2) inside another (M, 2). Its centre would not do: that of an L is outside it."""
    low, high = ring.min(0), ring.max(0)
    cells = (np.indices((CELLS, CELLS)).reshape(2, -1).T + 0.5) / CELLS
    points = low + cells * (high - low)
    points = points[inside(points, ring[None])[0]]
    return float(inside(points, outline[None])[0].mean()) if len(points) else 0.0


def _connected_groups(fused: FusedLooks, facets: list[int]) -> list[list[int]]:
    """Split facets into connected groups."""
    return [[facets[k] for k in group] for group in fused.only(facets).connected_facets()] if facets else []


def _candidate_groups(fused: FusedLooks, facets: list[int]) -> list[list[int]]:
    """Groups of facets that may be one part: connected ones; their parts between concave edges; and of each the facets
    whose corners two looks confirmed."""
    found = list[list[int]]()
    for group in _connected_groups(fused, facets):
        for piece in (group, *convex_groups(fused.polyhedron, group)):
            sure = [k for k in piece if fused.confirmed[k]]
            found += [piece, *([sure] if sure else [])]
    return [piece for k, piece in enumerate(found) if piece not in found[:k]]


def convex_groups(seen: Polyhedron, group: list[int]) -> list[list[int]]:
    """Split a connected group of facets at its concave edges."""
    touch = seen.touching[np.ix_(group, group)].copy()
    for a, b in np.argwhere(touch).tolist():
        touch[a, b] = min(_plane_distances_mm(seen, group[a], group[b])) < HOLLOW_MM
    return [[group[k] for k in piece] for piece in connected(touch)]


def _recognised(
    fused: FusedLooks, piece: Sequence[int], newest: Look, recogniser: PartRecogniser
) -> list[ObservedPart]:
    """Recognise a group of fused facets, in the newest look's frame."""
    group = group_of(fused, piece, frames.inverse(newest.world_from_cyclopean), newest.taken.rig)
    return [ObservedPart(part, newest) for part in recogniser.recognise(group)]


def outlines_of(part: ObservedPart, recogniser: PartRecogniser) -> list[Array]:
    """(N, 3) world: every face of a named part, every facet that was seen of another."""
    shape = recogniser.shape(part.label) if part.named else None
    if shape is None:
        return [frames.apply(part.look.world_from_cyclopean, f.corners_mm) for f in part.facets]
    corners = frames.apply(part.world_from_part, shape.corners_mm)
    return [corners[ring] for ring in shape.rings]
