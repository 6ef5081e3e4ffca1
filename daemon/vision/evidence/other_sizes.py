"""Whether the measured edges of a named part are those of one like it in another size, which nobody taught.

In: a part's edges as both images have them, measured where it was named. Out: nats by which one of its sizes, free to
differ, fits better than the taught one within the tolerance. A pose gives way to a few per cent of a size, so that each
edge lies within a pixel of its place; all of them together do not. Worn edges draw back alike, which is asked as well.
"""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from daemon import frames
from daemon.arrays import Array
from daemon.vision.facets import MeasuredCircle, differs_mm
from daemon.vision.geometry import Polyhedron, solve, whitener
from daemon.vision.hypotheses import rims_of
from daemon.vision.image import MODEL_PX
from daemon.vision.refine import LINE_SIGMAS, PRIOR, WORN_MM, EdgeObservation

OTHER_MM = 5.0
"""By how much a size of a part that was not taught differs, a standard deviation."""
OUTLIER, PASSES = 5.0, 8
"""Sigmas off at which a line counts a quarter: at a size that is not the part's many are three off; and how often lines
are weighed anew."""

RIM_MM, RIM_TURN = 2.0, np.cos(np.radians(10.0))
"""How far from a rim of a named part, and how askew, a seen circle of about its radius is that rim."""
OF_RADIUS, OF_TOLERANCE = 0.01, 0.5
"""How far off the radii of seen circles are beyond their covariance, a standard deviation as a share (of 17 arcs half
were within .6 %, of python -m tests.bench.arcs); and the share of what naming allows corners to be off that a radius
may be."""


def other_radius_nats(solid: Polyhedron, pose: Array, circles: Sequence[MeasuredCircle], tolerance_mm: float) -> float:
    """Log likelihood ratio, in nats, of circles that both cameras see against the taught radii of the arcs in a part's
    outline, at cyclopean_from_part (4, 4), of the one that says most: what bends one circle's image bends the others'.
    Edges are fitted one by one, and a pose gives way to a few per cent of a radius."""
    nats = 0.0
    for rim in rims_of(solid):
        at, normal = frames.apply(pose, rim.centre_mm[None])[0], pose[:3, :3] @ rim.normal
        off_mm, variance = min(
            (
                (abs(one.radius_mm - rim.radius_mm), float(one.covariance[5, 5]))
                for one in circles
                if abs(one.normal @ normal) > RIM_TURN  # a rim shows from behind as well, round a curved side
                and np.linalg.norm(one.centre_mm - at) < RIM_MM
                and abs(one.radius_mm - rim.radius_mm) < differs_mm(rim.radius_mm)
            ),
            default=(0.0, 0.0),
        )
        if rim.outer:
            known = (OF_RADIUS * rim.radius_mm) ** 2 + (OF_TOLERANCE * tolerance_mm) ** 2
            nats = max(nats, off_mm**2 / (variance + known) / 2)
    return nats


def other_size_nats(solid: Polyhedron, pose: Array, observed: Sequence[EdgeObservation], tolerance_mm: float) -> float:
    """Log likelihood ratio, in nats, of another size along or across one direction of the part against the taught size,
    from edges that both cameras observed, at cyclopean_from_part (4, 4); 0 where none was measured."""
    taught, other = _misfits(solid, pose, observed, tolerance_mm)
    return float((taught - other).max())


def misfit_nats(solid: Polyhedron, pose: Array, observed: Sequence[EdgeObservation], tolerance_mm: float) -> float:
    """How far from a part's edges, at cyclopean_from_part (4, 4), both cameras observed them, in nats; an edge that is
    not there counts as one that is far off."""
    missing = sum(np.count_nonzero(~seen.there & seen.edges.sharp) for seen in observed)
    return float(_misfits(solid, pose, observed, tolerance_mm)[0].min() + missing * OUTLIER**2 / 2)


def _misfits(
    solid: Polyhedron, pose: Array, observed: Sequence[EdgeObservation], tolerance_mm: float
) -> tuple[Array, Array]:
    """(M,) nats by which observed edges miss those of the taught size, and of another, along each of the M ways of
    _stretches; noughts where no edge was measured."""
    stretches = _stretches(solid) @ pose[:3, :3].T
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
    held[: len(stretches), 6, 6], held[len(stretches) :, 6, 6] = (np.sqrt(2) * tolerance_mm) ** -2, OTHER_MM**-2
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
