"""Whether the measured edges of a named part are those of one like it in another size, which nobody taught.

In: a part's edges as both images have them, measured where it was named. Out: nats by which one of its sizes, free to
differ, fits better than the taught one within the tolerance. A pose gives way to a few per cent of a size, so that each
edge lies within a pixel of its place; all of them together do not. Worn edges draw back alike, which is asked as well.
"""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from daemon.arrays import Array
from daemon.vision.geometry import Polyhedron, solve, whitener
from daemon.vision.image import MODEL_PX
from daemon.vision.refine import LINE_SIGMAS, PRIOR, WORN_MM, EdgeObservation

OTHER_MM = 5.0
"""By how much a size of a part that was not taught differs, a standard deviation."""
OUTLIER, PASSES = 5.0, 8
"""Sigmas off at which a line counts a quarter: at a size that is not the part's many are three off; and how often lines
are weighed anew."""

OF_TOLERANCE = 0.5
"""The share of what naming allows corners to be off that a radius may be."""

PARALLEL, LOOSE = 0.98, 0.01
"""Cosine from which on a flat facet goes on from a curved surface; and the share of how firmly its surfaces hold a
corner at most below which they leave it free."""


def other_radius_nats(
    solid: Polyhedron, pose: Array, observed: Sequence[EdgeObservation], tolerance_mm: float
) -> float:
    """Log likelihood ratio, in nats, of another radius of the arcs in a part's outline against the taught one, from
    edges that both cameras observed, at cyclopean_from_part (4, 4); 0 where it has no arc, or no edge was measured."""
    ways = _growths(solid)
    if not len(ways):
        return 0.0
    taught_mm2 = np.einsum("mki,kij,mkj->m", ways, solid.covariance_mm2, ways) / (ways**2).sum((1, 2)) ** 2
    known_mm = np.sqrt((OF_TOLERANCE * tolerance_mm) ** 2 + taught_mm2)
    taught, other = _misfits(pose, observed, tolerance_mm, ways, known_mm)
    return float((taught - other).max())


def other_size_nats(solid: Polyhedron, pose: Array, observed: Sequence[EdgeObservation], tolerance_mm: float) -> float:
    """Log likelihood ratio, in nats, of another size along or across one direction of the part against the taught size,
    from edges that both cameras observed, at cyclopean_from_part (4, 4); 0 where none was measured."""
    taught, other = _misfits_of_sizes(solid, pose, observed, tolerance_mm)
    return float((taught - other).max())


def misfit_nats(solid: Polyhedron, pose: Array, observed: Sequence[EdgeObservation], tolerance_mm: float) -> float:
    """How far from a part's edges, at cyclopean_from_part (4, 4), both cameras observed them, in nats; an edge that is
    not there counts as one that is far off."""
    missing = sum(np.count_nonzero(~seen.there & seen.edges.sharp) for seen in observed)
    return float(_misfits_of_sizes(solid, pose, observed, tolerance_mm)[0].min() + missing * OUTLIER**2 / 2)


def _misfits_of_sizes(
    solid: Polyhedron, pose: Array, observed: Sequence[EdgeObservation], tolerance_mm: float
) -> tuple[Array, Array]:
    """_misfits along the ways of _stretches."""
    ways = _stretches(solid)
    return _misfits(pose, observed, tolerance_mm, ways, np.full(len(ways), np.sqrt(2) * tolerance_mm))


def _misfits(
    pose: Array, observed: Sequence[EdgeObservation], tolerance_mm: float, ways: Array, known_mm: Array
) -> tuple[Array, Array]:
    """(M,) nats by which observed edges miss those of the taught size, and of another, along each of M ways
    (M, K, 3), in the part's frame, along which the taught size is known to known_mm (M,); noughts where no edge was
    measured."""
    stretches = ways @ pose[:3, :3].T
    lines = [seen for seen in observed if seen.sides is not None and len(seen.off)]
    if not lines:
        return np.zeros(len(stretches)), np.zeros(len(stretches))
    rows, off, doubts, use = [], [], [], []
    for seen in lines:
        edges = seen.edges
        worn = -edges.jacobian[..., :3] @ edges.outward[..., None]
        by_size = (edges.by_corner[None] * stretches[:, edges.ends][:, :, None]).sum((3, 4))  # (modes, E, 2)
        pose_and_wear = np.concatenate([edges.jacobian, np.zeros((*worn.shape[:2], 1)), worn], 2)
        each = np.repeat(pose_and_wear[None], len(stretches), 0)
        each[..., 6] = by_size
        rows.append(each)
        off.append(seen.off)
        known_px = (tolerance_mm / 4 * edges.px_per_mm) ** 2 + MODEL_PX**2
        doubts.append(LINE_SIGMAS**2 * seen.sides.covariance + known_px[:, None, None] * np.eye(2))  # type: ignore[union-attr]
        use.append(seen.there & edges.sharp)
    whiten = whitener(np.concatenate(doubts))
    design = whiten @ np.concatenate(rows, 1)
    far = np.repeat((whiten @ np.concatenate(off)[..., None])[None, ..., 0], 2 * len(stretches), 0)
    used = np.repeat(np.concatenate(use)[None].astype(float), len(far), 0)
    held = np.zeros((len(far), 8, 8))
    held[:, :6, :6], held[:, 7, 7] = PRIOR, WORN_MM**-2
    held[: len(stretches), 6, 6], held[len(stretches) :, 6, 6] = known_mm**-2.0, OTHER_MM**-2
    found = solve(np.concatenate([design, design]), far, used, held, passes=PASSES, grows=False, outlier=OUTLIER)
    misfit = (used * OUTLIER**2 * found.miss / (OUTLIER**2 + found.miss)).sum(1)
    misfit += (found.unknowns[:, None] @ held @ found.unknowns[..., None])[:, 0, 0]
    return misfit[: len(stretches)] / 2, misfit[len(stretches) :] / 2


@lru_cache(maxsize=256)
def _stretches(solid: Polyhedron) -> Array:
    """(M, K, 3) how corners move, in the part's frame, for each mm that it is longer along one of its directions, or
    wider across it."""
    from_middle = solid.corners_mm - (solid.corners_mm.max(0) + solid.corners_mm.min(0)) / 2
    found = list[Array]()
    for way in solid.directions:
        along = (from_middle @ way)[:, None] * way
        found += [one / max(2 * np.linalg.norm(one, axis=1).max(), 1e-9) for one in (along, from_middle - along)]
    return np.array(found)


@lru_cache(maxsize=256)
def _growths(solid: Polyhedron) -> Array:
    """(M, K, 3) how corners move, in the part's frame, for each mm by which one of the radii of the arcs in its outline
    is larger: with the curved surface, and with flat facets that go on from it."""
    ends, circles = solid.lines[0], solid.circles
    radii, found = np.round(circles[:, 3], 1), list[Array]()
    of_corner = np.array([[k in ring for ring in solid.facets] for k in range(len(solid.corners_mm))])
    for radius in np.unique(radii[radii > 0]):
        (arcs,) = np.nonzero(radii == radius)
        corners = ends[arcs].ravel()
        spokes = solid.corners_mm[corners] - circles[arcs, :3].repeat(2, 0)
        spokes /= np.linalg.norm(spokes, axis=1, keepdims=True)
        along = spokes @ solid.normals.T
        goes_on = (np.abs(along) > PARALLEL) & of_corner[corners]
        out = np.sign((along * goes_on).sum(0))  # by how much facets move along their normals
        rows = of_corner[..., None] * solid.normals  # (K, F, 3): a corner stays on all of its surfaces
        held, towards = rows.swapaxes(1, 2) @ rows, rows.swapaxes(1, 2) @ out
        np.add.at(held, corners, spokes[:, :, None] * spokes[:, None])
        np.add.at(towards, corners, spokes)
        found.append((np.linalg.pinv(held, rcond=LOOSE, hermitian=True) @ towards[..., None])[..., 0])
    return np.array(found).reshape(len(found), *solid.corners_mm.shape)
