"""Objects on the table, fused from all looks so far: named parts, and objects without a name. Pure.

A name that one look gave stays. The facets of the looks that tell most are fused, of so many that one look more takes
no longer; those that no named part explains are put to the recogniser together, and where they hang together over a
hollow edge, as parts that touch do, piece by piece. Fusing is vision's, and so is naming. Takes up to a second: not for
the event loop.
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
from daemon.vision.geometry import Polyhedron, axes_in, inside
from daemon.vision.values import Group

ONE_MM = 15.0
"""Named parts whose middles are this near are one."""
ON_FACE_MM, ON_FACE_RAD = 4.0, 0.25
"""A facet that lies this near to a face of a named part, and so parallel, is of that part."""
EDGE_MM = 6.0
"""An edge whose ends are this near to those of a part's is that edge."""
MOST = 0.5
"""A facet of which more lies in a face is of that face."""
MOST_FUSED = 5
"""So many looks are fused at most. What fusing takes grows with the square of their number, and what a table holds is
seen from five sides, or from none."""
OF_NAMED = 0.1
"""What a part that has its name counts, beside one that has none, where looks are chosen."""
CELLS = 12
"""A polygon is tried at so many times so many places."""
HOLLOW_MM = 2.0
"""So far in front of each other's planes lie the middles of facets that meet in a hollow edge."""


def fuse_objects(looks: Sequence[Look], recogniser: PartRecogniser, doubt: Doubt) -> list[ObservedPart]:
    """Everything that the looks, in order, show: what has a name as the newest look that named it has it; what has none
    as all of them together do, in the newest look's frame."""
    every = [part for look in looks for part in seen_parts(look)]
    named = _agreed([part for part in every if part.named], recogniser)
    if len(looks) < 2:
        return [*named, *(part for part in every if not part.named)]
    try:
        fused = fuse([_whole_look_facets(look, doubt) for look in most_informative(looks)], doubt.shared())
    except np.linalg.LinAlgError:  # facets of no extent: what each look says by itself stands
        fused = None
    if fused is None:
        return [*named, *(part for part in seen_parts(looks[-1]) if not part.named)]
    newest = looks[-1]
    for piece in _pieces(fused, _unexplained(fused, named, recogniser)):
        named += [part for part in _recognised(fused, piece, newest, recogniser) if part.named]
    named = parts_not_overlapping(fused, _agreed(named, recogniser), recogniser)
    left = _unexplained(fused, named, recogniser)
    return [*named, *(part for piece in _whole(fused, left) for part in _recognised(fused, piece, newest, recogniser))]


def most_informative(looks: Sequence[Look], most: int = MOST_FUSED) -> list[Look]:
    """Select the most informative looks, at most so many, in their order: the newest, then one by one the look that
    shows most of what the others show least; unnamed groups count most."""
    parts = [(k, part) for k, look in enumerate(looks) for part in seen_parts(look)]
    owner = np.array([k for k, _ in parts], np.intp)
    centres = np.array([part.centre for _, part in parts]).reshape(-1, 3)
    rays = np.array([part.look.world_from_cyclopean[:3, 3] for _, part in parts]).reshape(-1, 3) - centres
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    weight = np.array([OF_NAMED if part.named else 1.0 for _, part in parts])
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
    """Groups of facets that a look measured, and from where."""
    rig, here = look.taken.rig, look.world_from_cyclopean
    return LookFacets(tuple(groups), here, doubt.arm(), float(rig.left.matrix[0, 0]), rig.baseline_mm)


def _whole_look_facets(look: Look, doubt: Doubt) -> LookFacets:
    return look_facets(look, [merge_vertices(part.facets) for part in look.scene.parts if part.facets], doubt)


def _agreed(named: Sequence[ObservedPart], recogniser: PartRecogniser) -> list[ObservedPart]:
    """Each named part once, as it was seen last; those left out that looks gave different names to."""
    middles = np.array([_middle(part, recogniser) for part in named]).reshape(-1, 3)
    near = np.linalg.norm(middles[:, None] - middles, axis=2) < ONE_MM
    out = set[int]()
    for i, j in np.argwhere(np.triu(near, 1)).tolist():
        out |= {i} if named[i].label == named[j].label else {i, j}
    return [part for k, part in enumerate(named) if k not in out]


def parts_not_overlapping(
    fused: FusedLooks, named: Sequence[ObservedPart], recogniser: PartRecogniser
) -> list[ObservedPart]:
    """Named parts of which no two have the same facet, as two do that would lie in each other: of two of one name the
    one stays that has more, two of different names both go."""
    seen = fused.polyhedron
    area_mm2 = np.linalg.norm(seen.areas_mm2, axis=1)
    shares = np.array([_shares(seen, part, recogniser) for part in named]).reshape(len(named), len(seen.facets))
    theirs, whole_mm2 = (shares > MOST).astype(float), shares @ area_mm2
    out = set[int]()
    for i, j in np.argwhere(np.triu(theirs @ theirs.T > 0.0, 1)).tolist():
        less = i if whole_mm2[i] < whole_mm2[j] else j
        out |= {less} if named[i].label == named[j].label else {i, j}
    return [part for k, part in enumerate(named) if k not in out]


def _shares(seen: Polyhedron, part: ObservedPart, recogniser: PartRecogniser) -> Array:
    """(F,) the share of each facet that lies in a face of a named part."""
    shape, shares = recogniser.shape(part.label), np.zeros(len(seen.facets))
    if shape is None:
        return shares
    corners = frames.apply(part.world_from_part, shape.corners_mm)
    reach_mm = np.linalg.norm(corners - corners.mean(axis=0), axis=1).max() + ON_FACE_MM
    for k in np.flatnonzero(np.linalg.norm(seen.centres_mm - corners.mean(axis=0), axis=1) < reach_mm):
        shares[k] = share_on_face(seen, int(k), shape, part.world_from_part)
    return shares


def _middle(part: ObservedPart, recogniser: PartRecogniser) -> Array:
    """(3,) world: of the part's corners, seen or not."""
    shape = recogniser.shape(part.label)
    return part.centre if shape is None else frames.apply(part.world_from_part, shape.corners_mm).mean(axis=0)


def _unexplained(fused: FusedLooks, named: Sequence[ObservedPart], recogniser: PartRecogniser) -> list[int]:
    """The facets that lie for less than half in faces of named parts, all together, and are no side of one that was
    never taught."""
    seen = fused.polyhedron
    explained, theirs = np.zeros(len(seen.facets)), set[int]()
    for part in named:
        shape = recogniser.shape(part.label)
        if shape is not None:
            shares = _shares(seen, part, recogniser)
            explained += shares
            theirs |= untaught_facets(seen, set(np.flatnonzero(shares > MOST).tolist()), shape, part.world_from_part)
    return sorted(set(np.flatnonzero(explained <= MOST).tolist()) - theirs)


def untaught_facets(seen: Polyhedron, mine: set[int], shape: Polyhedron, world_from_part: Array) -> set[int]:
    """The facets beyond edges at which what was taught of a part ends, and those that hang on them: sides of it that no
    taught view showed. mine: the facets in faces of it. Over such an edge the next facet bends away from the part: in
    the same plane, or hollow, another part begins."""
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
    """Whether two facets that share an edge meet in one that is neither hollow nor flat."""
    turned = float(seen.normals[facet] @ seen.normals[other]) < np.cos(ON_FACE_RAD)
    return turned and max(_before_mm(seen, facet, other)) < 0.0


def _before_mm(seen: Polyhedron, one: int, other: int) -> tuple[float, float]:
    """How far the middles of two facets lie in front of each other's planes."""
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
    """Share of a polygon (N, 2) that lies in another (M, 2). Where the middle of its corners lies would not tell: an
    L's lies outside the L."""
    low, high = ring.min(0), ring.max(0)
    cells = (np.indices((CELLS, CELLS)).reshape(2, -1).T + 0.5) / CELLS
    points = low + cells * (high - low)
    points = points[inside(points, ring[None])[0]]
    return float(inside(points, outline[None])[0].mean()) if len(points) else 0.0


def _whole(fused: FusedLooks, facets: list[int]) -> list[list[int]]:
    """Some of the facets, those together that share edges."""
    return [[facets[k] for k in thing] for thing in fused.only(facets).connected_facets()] if facets else []


def _pieces(fused: FusedLooks, facets: list[int]) -> list[list[int]]:
    """What of the facets may be one part: what hangs together; of that, what hangs together over no hollow edge; and of
    that the facets whose corners are seen to be corners, from two places."""
    found = list[list[int]]()
    for thing in _whole(fused, facets):
        for piece in (thing, *convex_groups(fused.polyhedron, thing)):
            sure = [k for k in piece if fused.confirmed[k]]
            found += [piece, *([sure] if sure else [])]
    return [piece for k, piece in enumerate(found) if piece not in found[:k]]


def convex_groups(seen: Polyhedron, thing: list[int]) -> list[list[int]]:
    """A thing's facets, those together that hang together over no hollow edge."""
    touch = seen.touching[np.ix_(thing, thing)].copy()
    for a, b in np.argwhere(touch).tolist():
        touch[a, b] = min(_before_mm(seen, thing[a], thing[b])) < HOLLOW_MM
    return [[thing[k] for k in piece] for piece in connected(touch)]


def _recognised(
    fused: FusedLooks, piece: Sequence[int], newest: Look, recogniser: PartRecogniser
) -> list[ObservedPart]:
    """Some facets as the newest look would have measured them all, and what they are taken for."""
    group = group_of(fused, piece, frames.inverse(newest.world_from_cyclopean), newest.taken.rig)
    return [ObservedPart(part, newest) for part in recogniser.recognise(group)]


def outlines_of(part: ObservedPart, recogniser: PartRecogniser) -> list[Array]:
    """(N, 3) world: every face of a named part, every facet that was seen of another."""
    shape = recogniser.shape(part.label) if part.named else None
    if shape is None:
        return [frames.apply(part.look.world_from_cyclopean, f.corners_mm) for f in part.facets]
    corners = frames.apply(part.world_from_part, shape.corners_mm)
    return [corners[ring] for ring in shape.rings]
