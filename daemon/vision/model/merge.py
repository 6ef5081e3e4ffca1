"""Several taught views of one part -> one metric model in the part's own frame, its corners made to agree with what its
facets are: plane, and as regular as their type says.

In: the views' solids, each in the cyclopean frame of its look. Out: the merged solid and which views went into it.
"""

from dataclasses import dataclass, replace

import numpy as np

from daemon.arrays import Array, Index
from daemon.vision.geometry import (
    Fits,
    OutlineArc,
    Polyhedron,
    chi_square_limit,
    fit_poses,
    measure,
    newell_normal,
    solve,
)
from daemon.vision.model.correspond import Correspondence, correspondences
from daemon.vision.model.facet_types import FALSE_ALARM, SIGMA_SCALE, FacetLibrary, conditions
from daemon.vision.settings import TOLERANCE_MM

ALWAYS_MM, NEVER_MM, SIGMAS = 3.0, 8.0, 4.0
"""Corners this near are one, farther apart never; in between, those within so many predicted errors."""
ALIKE_MM, ALIKE_SHARE = 2.0, 0.02
"""Largest difference of the distances between corners of one shape, in mm and as a share of the largest."""
FLAT_MM = 0.05  # how far a corner of a real facet lies off its plane
STEPS = 4


@dataclass(frozen=True, eq=False)
class MetricModel:
    """All that is known of a part's shape. solid: in the part frame; joined: indices of the views it was made from."""

    solid: Polyhedron
    joined: tuple[int, ...]


def merge_views(
    views: tuple[Polyhedron, ...], library: FacetLibrary, tolerance_mm: float = TOLERANCE_MM
) -> MetricModel:
    """Join the views of one part, the first one first; a view that shares no facet with the rest stays out.

    A join that could be made in several ways is made only where all of them lead to the same shape (a symmetric part).
    """
    whole, joined, waiting = views[0], [0], list(range(1, len(views)))
    while waiting:
        for index in waiting:
            grown = _join(whole, views[index], tolerance_mm)
            if grown is not None:
                whole = grown
                joined.append(index)
                waiting.remove(index)
                break
        else:
            break
    return MetricModel(in_part_frame(regularise(whole, library)), tuple(sorted(joined)))


def corresponding_facets(view: Polyhedron, whole: Polyhedron, tolerance_mm: float) -> tuple[int, ...] | None:
    """The facet of `whole` behind each facet of a view of it, laid edge to edge where it fits best; None where not all
    of them fit together. A facet beyond an edge behind which `whole` knows another is followed from that."""
    candidates = [candidate for candidate in correspondences(view, whole) if candidate.explained == len(view.facets)]
    if not candidates:
        return None
    fits = [_fit(whole, view, candidate, tolerance_mm) for candidate in candidates]
    best = min(range(len(candidates)), key=lambda k: float(fits[k].chi2[0]))
    limit = chi_square_limit(int(fits[best].dof[0]), FALSE_ALARM) * SIGMA_SCALE**2
    return candidates[best].facets if fits[best].chi2[0] < limit else None


def _join(whole: Polyhedron, view: Polyhedron, tolerance_mm: float) -> Polyhedron | None:
    """`whole` with the view's facets in it, or None where they do not fit together in one definite way."""
    candidates = [c for c in correspondences(view, whole, may_add=True) if (c.corners >= 0).sum() >= 3]
    ranked = sorted(candidates, key=lambda c: -c.explained)
    for explained in sorted({c.explained for c in ranked}, reverse=True):
        fitting = [
            (float(fit.chi2[0]), _united(whole, view, candidate, fit))
            for candidate, fit in ((w, _fit(whole, view, w, tolerance_mm)) for w in ranked if w.explained == explained)
            if fit.chi2[0] < chi_square_limit(int(fit.dof[0]), FALSE_ALARM) * SIGMA_SCALE**2
        ]
        if fitting:
            fitting.sort(key=lambda pair: pair[0])
            spans = [_spans(one) for _, one in fitting]
            limit = ALIKE_MM + ALIKE_SHARE * spans[0].max()
            same = all(one.shape == spans[0].shape and np.abs(one - spans[0]).max() < limit for one in spans[1:])
            return fitting[0][1] if same else None
    return None


def _fit(whole: Polyhedron, view: Polyhedron, correspondence: Correspondence, tolerance_mm: float) -> Fits:
    """whole_from_view by the corners both have."""
    shared = np.nonzero(correspondence.corners >= 0)[0]
    return fit_shared(whole, correspondence.corners[shared], view, shared, tolerance_mm)


def fit_shared(onto: Polyhedron, there: Index, one: Polyhedron, own: Index, tolerance_mm: float) -> Fits:
    """onto_from_one by corners that two solids share, by their numbers in either (K,)."""
    used = np.ones((1, len(own)), bool)
    corners, spread = one.corners_mm[own][None], one.covariance_mm2[own][None]
    return fit_poses(onto.corners_mm[there], onto.covariance_mm2[there], corners, spread, used, tolerance_mm)


def _united(whole: Polyhedron, view: Polyhedron, correspondence: Correspondence, fit: Fits) -> Polyhedron:
    """Shared corners by their weighted mean, new ones appended; new facets get the view's types."""
    turn, shift = fit.poses[0, :3, :3], fit.poses[0, :3, 3]
    moved = view.corners_mm @ turn.T + shift
    spread = turn @ view.covariance_mm2 @ turn.T
    owners = _owners(whole, moved, spread, correspondence)
    corners, covariance = whole.corners_mm.copy(), whole.covariance_mm2.copy()
    for k in np.nonzero(owners < len(corners))[0]:
        there = owners[k]
        one, two = np.linalg.inv(covariance[there]), np.linalg.inv(spread[k])
        covariance[there] = np.linalg.inv(one + two)
        corners[there] = covariance[there] @ (one @ corners[there] + two @ moved[k])
    extra, known = owners >= len(whole.corners_mm), {frozenset(ring) for ring in whole.facets}
    rings = {f: tuple(owners[view.rings[f]].tolist()) for f, g in enumerate(correspondence.facets) if g < 0}
    new = [f for f, ring in rings.items() if frozenset(ring) not in known]
    arcs = (
        OutlineArc(len(whole.facets) + n, arc.points_mm @ turn.T + shift)
        for n, f in enumerate(new)
        for arc in view.arcs
        if arc.facet == f
    )
    return Polyhedron(
        np.concatenate([corners, moved[extra]]),
        whole.facets + tuple(rings[f] for f in new),
        np.concatenate([covariance, spread[extra]]),
        whole.types + tuple(view.types[f] for f in new),
        arcs=(*whole.arcs, *arcs),
    )


def _owners(whole: Polyhedron, moved: Array, spread: Array, correspondence: Correspondence) -> Index:
    """(K,) the corner of `whole` each corner of the view is, or the index it gets when it is new.

    Corners that no shared edge leads to are the same where they coincide in space within their errors.
    """
    owners = correspondence.corners.copy()
    free = set(range(len(whole.corners_mm))) - set(owners[owners >= 0].tolist())
    new = len(whole.corners_mm)
    for k in np.nonzero(owners < 0)[0]:
        apart = {j: float(np.linalg.norm(whole.corners_mm[j] - moved[k])) for j in free}
        near = min(apart, key=lambda j: apart[j], default=None)
        if near is not None and apart[near] < _most_apart_mm(whole.covariance_mm2[near] + spread[k]):
            owners[k] = near
            free.discard(near)
        else:
            owners[k], new = new, new + 1
    return owners


def _most_apart_mm(covariance: Array) -> float:
    """How far two corners of one place may be measured from each other, by the sum (3, 3) of their covariances."""
    return min(NEVER_MM, max(ALWAYS_MM, SIGMAS * float(np.sqrt(np.trace(covariance)))))


def _spans(solid: Polyhedron) -> Array:
    """Sorted distances between all corners: the same for congruent solids, mirrored or not."""
    corners = solid.corners_mm
    rows, columns = np.triu_indices(len(corners), 1)
    return np.sort(np.linalg.norm(corners[rows] - corners[columns], axis=1))


def in_part_frame(solid: Polyhedron) -> Polyhedron:
    """A solid in the part frame: its origin at the centroid of all corners, z out of the first facet, x along the first
    side of that."""
    corners, part_from_look = solid.corners_mm, solid.flat_from_solid[0, :3, :3]
    return replace(
        solid,
        corners_mm=(corners - corners.mean(0)) @ part_from_look.T,
        covariance_mm2=part_from_look @ solid.covariance_mm2 @ part_from_look.T,
        covers=(solid.covers - corners.mean(0)) @ part_from_look.T,
        holes=tuple(replace(one, ring_mm=(one.ring_mm - corners.mean(0)) @ part_from_look.T) for one in solid.holes),
        arcs=tuple(replace(one, points_mm=(one.points_mm - corners.mean(0)) @ part_from_look.T) for one in solid.arcs),
    )


def regularise(solid: Polyhedron, library: FacetLibrary) -> Polyhedron:
    """The most likely corners given their measurement, the facets' types and their planes.

    Source: least squares on corners weighted by their covariance plus the conditions of the types.
    """
    count = len(solid.corners_mm)
    measured = np.linalg.inv(solid.covariance_mm2 + 1e-8 * np.eye(3))
    prior = np.zeros((3 * count, 3 * count))
    for k in range(count):
        prior[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] = measured[k]
    measures = (measure(solid.corners_mm[ring]) for ring in solid.rings)
    rules = [conditions(one, name, library) for one, name in zip(measures, solid.types, strict=True)]
    weights = (1.0 / library.angle_tolerance_rad, 1.0 / library.ratio_tolerance)
    corners = solid.corners_mm.copy()
    held = prior
    for _ in range(STEPS):
        rows, misses = list[Array](), list[Array]()
        for ring, (a, b) in zip(solid.rings, rules, strict=True):
            jacobian, miss = _facet_rows(corners[ring], a, b, weights)
            placed = np.zeros((len(miss), 3 * count))
            placed[:, (3 * ring[:, None] + np.arange(3)).ravel()] = jacobian
            rows.append(placed)
            misses.append(-miss)
        off, towards = np.concatenate(misses), prior @ (solid.corners_mm - corners).ravel()
        found = solve(np.concatenate(rows)[None, :, None], off[None, :, None], np.ones((1, len(off))), prior, towards)
        step, held = found.unknowns[0], found.held[0]
        corners = corners + step.reshape(-1, 3)
        if np.abs(step).max() < 1e-4:
            break
    spread: Array = np.asarray(np.linalg.inv(held), float).reshape(count, 3, count, 3)
    here = np.arange(count)
    return replace(solid, corners_mm=corners, covariance_mm2=spread[here, :, here, :])


def _facet_rows(corners: Array, a: Array, b: Array, weights: tuple[float, float]) -> tuple[Array, Array]:
    """Weighted rows (jacobian, miss) of one facet: its type's conditions, then its plane."""
    n = len(corners)
    rows, misses = [np.zeros((0, 3 * n))], [np.zeros(0)]
    if len(b):
        measures = measure(corners)
        scale = np.where(np.abs(a[:, :n]).sum(1) > 0, weights[0], weights[1])
        rows.append(scale[:, None] * (a @ measures.jacobian))
        misses.append(scale * (a @ measures.values - b))
    if n > 3:
        normal = newell_normal(corners)
        centring = np.eye(n) - 1.0 / n
        rows.append((centring[:, :, None] * normal).reshape(n, 3 * n) / FLAT_MM)
        misses.append(centring @ (corners @ normal) / FLAT_MM)
    return np.vstack(rows), np.concatenate(misses)
