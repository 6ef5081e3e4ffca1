"""Judge whether a part is taught well enough: what was never seen, and from where it could be confused. Pure.

The part is turned before imagined cameras. The recogniser gets its known facets as they would be measured, and so
answers as it would in the cell.
"""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from daemon.arrays import Array
from daemon.vision.geometry import FACING, Polyhedron, StereoRig, corner_covariance, visible_from
from daemon.vision.model import Model, spread
from daemon.vision.recognition import recognise_part
from daemon.vision.values import UNKNOWN, Facet, Group

VIEWPOINTS = 60
DISTANCE_MM = 400.0
HIDDEN_FRACTION = 0.9


@dataclass(frozen=True, eq=False)
class Mistake:
    """Viewpoints from which a part is not named: what it is taken for (several where that is ambiguous), which facets
    are in view, and the number of viewpoints."""

    recognised_as: tuple[str, ...]
    facets: tuple[str, ...]
    viewpoints: int


@dataclass(frozen=True, eq=False)
class ViewCoverage:
    """The judgement on one label: facets known, by type; open edges, beyond which nothing was seen; share of viewpoints
    never seen, and named correctly; the mistakes; the facet (index, type) that should point away from the cameras in
    the next view."""

    label: str
    facets: tuple[str, ...]
    open_edges: int
    unseen: float
    named: float
    mistakes: tuple[Mistake, ...]
    turn_away: tuple[int, str] | None

    @property
    def complete(self) -> bool:
        """Whether every side was seen."""
        return self.open_edges == 0


@dataclass(frozen=True, eq=False)
class ConfusablePair:
    """Two parts that could be confused: the most facets in view for which that is so, by type, and from how many
    viewpoints of one part."""

    labels: tuple[str, str]
    facets: tuple[str, ...]
    viewpoints: int


def assess_coverage(model: Model, label: str, rig: StereoRig) -> ViewCoverage:
    """Try to recognise a taught part from all round. Raises KeyError for a label that is not taught."""
    solid = model.metric[label].solid
    unseen, named, mistakes = 0, 0, Counter[tuple[tuple[str, ...], tuple[str, ...]]]()
    best: tuple[float, Array | None] = (0.0, None)
    directions = spread(VIEWPOINTS)
    for towards in directions:
        facing = solid.areas_mm2 @ towards
        front, back = float(facing.clip(0).sum()), float((-facing).clip(0).sum())
        if front < HIDDEN_FRACTION * back:
            unseen += 1
            best = max(best, (back - front, towards), key=lambda pair: pair[0])
            continue
        group = simulated_view(solid, towards, rig)
        if group is None:
            continue
        verdict = recognise_part(group, model).recognition
        if verdict.label == label:
            named += 1
        else:
            labels = tuple(sorted(verdict.candidates)) or (verdict.label,)
            mistakes[labels, tuple(sorted(f.type for f in group.facets))] += 1
    return ViewCoverage(
        label=label,
        facets=solid.types,
        open_edges=solid.open_edges,
        unseen=unseen / len(directions),
        named=named / len(directions),
        mistakes=tuple(Mistake(labels, facets, n) for (labels, facets), n in mistakes.most_common()),
        turn_away=None if best[1] is None else _opposite(solid, best[1]),
    )


def unconnected_facets(group: Group, others: Sequence[Group]) -> tuple[list[Facet], list[Facet]]:
    """Facets in view that share no edge with those of the part: first those that may be its own, as they are nearer to
    it than its size (such a view teaches nothing about them); then those of other objects."""
    corners = np.concatenate([facet.corners_mm for facet in group.facets])
    reach_mm = _apart(corners, corners).max()
    beside = [(facet, _apart(facet.corners_mm, corners).min()) for other in others for facet in other.facets]
    return [f for f, mm in beside if mm < reach_mm], [f for f, mm in beside if mm >= reach_mm]


def _apart(these: Array, those: Array) -> Array:
    """(N, M) mm between points (N, 3) and (M, 3)."""
    return np.asarray(np.linalg.norm(these[:, None] - those, axis=2))


def confusable_pairs(coverages: Iterable[ViewCoverage]) -> tuple[ConfusablePair, ...]:
    """All pairs of parts that could be confused, those with the most shared facets first."""
    worst: dict[tuple[str, str], ConfusablePair] = {}
    for one in coverages:
        for mistake in one.mistakes:
            for other in set(mistake.recognised_as) - {one.label, UNKNOWN}:
                first, second = sorted((one.label, other))
                found = ConfusablePair((first, second), mistake.facets, mistake.viewpoints)
                worst[first, second] = max(worst.get((first, second), found), found, key=_severity)
    return tuple(sorted(worst.values(), key=_severity, reverse=True))


def _severity(two: ConfusablePair) -> tuple[int, int]:
    return len(two.facets), two.viewpoints


def simulated_view(solid: Polyhedron, towards: Array, rig: StereoRig) -> Group | None:
    """The facets measured with the cameras in direction `towards` (3,) of the part, at 400 mm; None when none faces
    them. Corners have the covariance of CORNER_PX of corner error at that distance."""
    facets = visible_facets(solid, towards)
    return simulated_group(solid, facets, towards, rig) if facets else None


def visible_facets(solid: Polyhedron, towards: Array, least_facing: float = FACING) -> tuple[int, ...]:
    """The facets that face a distant camera in direction `towards` (3,), without those that another facet partly
    covers.

    least_facing: cosine below which a facet is too oblique to be seen.
    """
    return tuple(np.flatnonzero(visible_from(solid, towards[None], least_facing)[0]).tolist())


def simulated_group(solid: Polyhedron, indices: Sequence[int], towards: Array, rig: StereoRig) -> Group:
    """These facets as measured from there, with their own types."""
    corners = (solid.corners_mm - solid.corners_mm.mean(axis=0)) @ _cyclopean_from_part(towards).T + [
        0.0,
        0.0,
        DISTANCE_MM,
    ]
    spread_mm2 = corner_covariance(rig, DISTANCE_MM)
    facets = tuple(_facet(corners[list(solid.facets[k])], solid.types[k], spread_mm2, rig) for k in indices)
    return Group(facets, tuple(solid.facets[k] for k in indices))


def _cyclopean_from_part(towards: Array) -> Array:
    """(3, 3) cyclopean_from_part rotation that turns the part's direction `towards` to the cameras (-z)."""
    z = -towards
    x = np.cross([0.0, 1.0, 0.0] if abs(z[1]) < 0.9 else [1.0, 0.0, 0.0], z)
    x /= np.linalg.norm(x)
    return np.array([x, np.cross(z, x), z])


def _facet(corners_mm: Array, kind: str, covariance: Array, rig: StereoRig) -> Facet:
    count = len(corners_mm)
    left, right = rig.left.project(corners_mm), rig.right.project(corners_mm)
    return Facet(corners_mm, np.repeat(covariance[None], count, axis=0), left, right, np.zeros(count), 0.0, kind)


def _opposite(solid: Polyhedron, towards: Array) -> tuple[int, str]:
    """The facet that points farthest away from a direction."""
    k = int(np.argmin(solid.normals @ towards))
    return k, solid.types[k]
