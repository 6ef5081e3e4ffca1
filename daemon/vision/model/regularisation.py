"""Corners made to agree with what their facets are: plane, and as regular as their type says.

In: a solid with measured corners. Out: the same solid, most likely corners. Typing happens elsewhere; a facet of no
known type is only made plane.
"""

from dataclasses import replace

import numpy as np

from daemon.arrays import Array
from daemon.vision.geometry import Polyhedron, measure, newell_normal, solve
from daemon.vision.model.facet_types import FacetLibrary, conditions

FLAT_MM = 0.05  # how far a corner of a real facet lies off its plane
STEPS = 4


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
