"""Is a part taught well enough? What of it was never seen, and from where it could be taken for something else. Pure.

A part is turned before imagined cameras and its known facets are given to the recogniser as they would be measured:
what it then answers is what it would answer in the cell.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from daemon.arrays import Array
from daemon.vision.geometry import Polyhedron, StereoRig, area_vector, inside
from daemon.vision.model import Model
from daemon.vision.recognition import recognise_group
from daemon.vision.values import UNKNOWN, Facet, Group

VIEWPOINTS = 60
DISTANCE_MM = 400.0
CORNER_PX = 0.15
FACING = 0.3  # cosine below which a facet is too oblique to count on
HIDDEN_SHARE = 0.9
INSIDE = 0.95  # where a facet is tried for being covered: its corners and the middles of its sides, drawn in so far
BEFORE_MM = 1.0
EDGE_ON = 1e-3


@dataclass(frozen=True, eq=False)
class Mistake:
    """Viewpoints from which a part is not named: what it is taken for (several where it cannot be settled), which
    facets are in view there, and from how many of the viewpoints."""

    taken_for: tuple[str, ...]
    facets: tuple[str, ...]
    viewpoints: int


@dataclass(frozen=True, eq=False)
class Sufficiency:
    """One label: facets known by type, open edges (beyond them nothing was seen), share of viewpoints never seen, named
    rightly, and not; the mistakes; the facet (index, type) that should point away from the cameras in the next view."""

    label: str
    facets: tuple[str, ...]
    open_edges: int
    unseen: float
    named: float
    mistakes: tuple[Mistake, ...]
    turn_away: tuple[int, str] | None

    @property
    def complete(self) -> bool:
        """Every side was seen."""
        return self.open_edges == 0


@dataclass(frozen=True, eq=False)
class Alike:
    """Two parts that could be taken for each other: the view that shows the most facets of which that is so, these by
    type, and from how many of the viewpoints of one of them."""

    labels: tuple[str, str]
    facets: tuple[str, ...]
    viewpoints: int


def judge(model: Model, label: str, rig: StereoRig) -> Sufficiency:
    """Try a taught part from all round. Raises KeyError for a label that was not taught."""
    solid = model.metric[label].solid
    unseen, named, mistakes = 0, 0, Counter[tuple[tuple[str, ...], tuple[str, ...]]]()
    best: tuple[float, Array | None] = (0.0, None)
    directions = spread(VIEWPOINTS)
    for towards in directions:
        facing = solid.areas_mm2 @ towards
        front, back = float(facing.clip(0).sum()), float((-facing).clip(0).sum())
        if front < HIDDEN_SHARE * back:
            unseen += 1
            best = max(best, (back - front, towards), key=lambda pair: pair[0])
            continue
        seen = imagined_view(solid, towards, rig)
        if seen is None:
            continue
        verdict = recognise_group(seen, model).recognition
        if verdict.label == label:
            named += 1
        else:
            taken = tuple(sorted(verdict.candidates)) or (verdict.label,)
            mistakes[taken, tuple(sorted(f.type for f in seen.facets))] += 1
    return Sufficiency(
        label=label,
        facets=solid.types,
        open_edges=solid.open_edges,
        unseen=unseen / len(directions),
        named=named / len(directions),
        mistakes=tuple(Mistake(taken, facets, n) for (taken, facets), n in mistakes.most_common()),
        turn_away=None if best[1] is None else _opposite(solid, best[1]),
    )


def alike(judged: Iterable[Sufficiency]) -> tuple[Alike, ...]:
    """Every two parts that could be taken for each other, those first of which the most facets do not tell them
    apart."""
    worst: dict[tuple[str, str], Alike] = {}
    for one in judged:
        for mistake in one.mistakes:
            for other in set(mistake.taken_for) - {one.label, UNKNOWN}:
                first, second = sorted((one.label, other))
                found = Alike((first, second), mistake.facets, mistake.viewpoints)
                worst[first, second] = max(worst.get((first, second), found), found, key=_how_alike)
    return tuple(sorted(worst.values(), key=_how_alike, reverse=True))


def _how_alike(two: Alike) -> tuple[int, int]:
    return len(two.facets), two.viewpoints


def imagined_view(solid: Polyhedron, towards: Array, rig: StereoRig) -> Group | None:
    """The facets that would be measured with the cameras in direction `towards` (3,) of the part, at 400 mm; None when
    no facet faces them. Corners carry the covariance that CORNER_PX of corner error gives at that distance."""
    shown = visible_facets(solid, towards)
    return imagined_group(solid, shown, towards, rig) if shown else None


def visible_facets(solid: Polyhedron, towards: Array, least_facing: float = FACING) -> tuple[int, ...]:
    """The facets that face a camera in direction `towards` (3,), far away, and that no other facet covers in part.

    least_facing: cosine below which a facet is too oblique to be seen.
    """
    return tuple(np.flatnonzero(visible_from(solid, towards[None], least_facing)[0]).tolist())


def visible_from(solid: Polyhedron, directions: Array, least_facing: float = FACING) -> NDArray[np.bool_]:
    """(D, F) visible_facets for many directions (D, 3) at once."""
    seen = directions @ solid.normals.T > least_facing
    for facet, ring in enumerate(solid.rings):
        for other in _before(solid, facet):
            seen[:, facet] &= ~_in_front(solid.corners_mm[other], _tried(solid.corners_mm[ring]), directions)
    return np.asarray(seen)


def imagined_group(solid: Polyhedron, shown: Sequence[int], towards: Array, rig: StereoRig) -> Group:
    """These facets as they would be measured from there, untyped by the measurement: they keep their own types."""
    corners = (solid.corners_mm - solid.corners_mm.mean(axis=0)) @ _turned_to(towards).T + [0.0, 0.0, DISTANCE_MM]
    spread_mm2 = _corner_covariance(rig)
    facets = tuple(_facet(corners[list(solid.facets[k])], solid.types[k], spread_mm2, rig) for k in shown)
    return Group(facets, tuple(solid.facets[k] for k in shown))


def _before(solid: Polyhedron, facet: int) -> list[NDArray[np.intp]]:
    """The rings of facets that reach to where they could cover one: in front of its plane."""
    corners = solid.corners_mm[solid.rings[facet][0]]
    beyond = (solid.corners_mm - corners) @ solid.normals[facet] > BEFORE_MM
    return [ring for ring in solid.rings if beyond[ring].any()]


def _tried(corners: Array) -> Array:
    """(2N, 3) where a facet is tried for being covered: its corners and the middles of its sides, drawn in a little."""
    middles = (corners + np.roll(corners, -1, axis=0)) / 2
    middle = corners.mean(axis=0)
    return np.asarray(middle + INSIDE * (np.concatenate([corners, middles]) - middle))


def _in_front(ring: Array, points: Array, directions: Array) -> NDArray[np.bool_]:
    """(D,) whether a ray from any of the points (N, 3) in each direction (D, 3) goes through a polygon (M, 3)."""
    normal = area_vector(ring)
    slope = directions @ normal
    through = np.abs(slope) >= EDGE_ON * np.linalg.norm(normal)
    reach = ((ring[0] - points) @ normal) / np.where(through, slope, 1.0)[:, None]
    level = np.delete(np.arange(3), np.abs(normal).argmax())
    met = points[:, level] + reach[..., None] * directions[:, None, level]
    within = inside(met.reshape(-1, 2), ring[None, :, level])[0].reshape(reach.shape)
    return np.asarray(through & (within & (reach > BEFORE_MM)).any(axis=1))


def spread(count: int) -> Array:
    """(count, 3) unit vectors spread evenly over the sphere (Fibonacci's spiral)."""
    k = np.arange(count) + 0.5
    z, turn = 1 - 2 * k / count, np.pi * (1 + np.sqrt(5)) * k
    radius = np.sqrt(1 - z * z)
    return np.column_stack([radius * np.cos(turn), radius * np.sin(turn), z])


def _turned_to(towards: Array) -> Array:
    """(3, 3) cyclopean_from_part rotation of a part that turns its direction `towards` to the cameras (-z)."""
    z = -towards
    x = np.cross([0.0, 1.0, 0.0] if abs(z[1]) < 0.9 else [1.0, 0.0, 0.0], z)
    x /= np.linalg.norm(x)
    return np.array([x, np.cross(z, x), z])


def _corner_covariance(rig: StereoRig) -> Array:
    focal_px = float(rig.left.matrix[0, 0])
    across = CORNER_PX * DISTANCE_MM / focal_px
    along = np.sqrt(2) * CORNER_PX * DISTANCE_MM**2 / (focal_px * rig.baseline_mm)
    return np.diag([across**2, across**2, along**2])


def _facet(corners_mm: Array, kind: str, covariance: Array, rig: StereoRig) -> Facet:
    count = len(corners_mm)
    left, right = rig.left.project(corners_mm), rig.right.project(corners_mm)
    return Facet(corners_mm, np.repeat(covariance[None], count, axis=0), left, right, np.zeros(count), 0.0, kind)


def _opposite(solid: Polyhedron, towards: Array) -> tuple[int, str]:
    """The facet that points most away from a direction."""
    k = int(np.argmin(solid.normals @ towards))
    return k, solid.types[k]
