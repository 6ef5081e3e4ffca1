"""Make a part from looks all round it: its solid, what was never seen, its deviation from a drawing, and an STL. Pure.

daemon/pick/around.py makes the tour.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daemon import frames
from daemon.arrays import Array, Real
from daemon.teaching.closed_surface import in_triangles
from daemon.teaching.mesh import STL_ROW
from daemon.vision.facets import FusedLooks
from daemon.vision.geometry import Fits, Polyhedron, measure
from daemon.vision.model import FacetLibrary, TeachError, correspondences, fit_shared, type_facet

AT_TABLE_MM = 3.0
"""An edge with both ends this near to the table is where the part touches it."""
MIN_SEEN, MIN_OPEN = 2, 4
"""Least number of places from which a side must be seen to be learnt, unless others close it in: one seen once may be a
shadow. The second number applies where nothing is known beyond one of its edges above the table, and another side of
the part is in front of it, whose shadow may end there; then all its corners must have been measured, too."""
IN_PLANE_MM = 1.0
DOUBTFUL_MM = 1.5  # a side with a corner no better known than this is not learnt
FIT_MM = 0.5


@dataclass(frozen=True, eq=False)
class LearntPart:
    """A part learnt from all round. solid: in the base frame's axes, about its middle, typed; looks (F,): from how many
    places each side was seen; lain: number of its edges that end at the table; open_edges: (facet, count) of others
    beyond which nothing was seen; left_out: number of sides seen too little; sigma_mm: of its corners, the median
    against their common middle."""

    solid: Polyhedron
    looks: tuple[int, ...]
    table_edges: int
    open_edges: tuple[tuple[int, int], ...]
    left_out: int
    sigma_mm: float


def learn_from_looks(fused: FusedLooks | None, table_mm: float, library: FacetLibrary) -> LearntPart:
    """The one part that looks from all round measured. Raises TeachError where they show none."""
    if fused is None:
        raise TeachError("none of the places showed a facet of it")
    sides = fused.seen.sum(0)
    doubt_mm = np.sqrt(np.trace(fused.polyhedron.covariance_mm2, axis1=1, axis2=2) / 3)
    closed = _closed_in(fused.polyhedron, table_mm)
    sure = [k for k, ring in enumerate(fused.polyhedron.rings) if doubt_mm[ring].max() < DOUBTFUL_MM]
    part = fused.only([k for k in sure if sides[k] >= MIN_SEEN or k in closed])
    closed, seen = _closed_in(part.polyhedron, table_mm), part.seen.sum(0)
    part = part.only([k for k in range(len(seen)) if k in closed or _ends(part, k, int(seen[k]))])
    whole = max(part.connected_facets(), key=len, default=[])
    if len(whole) < 2:
        raise TeachError("fewer than two sides of it were seen well enough; light it from above, from several sides")
    part = part.only(whole)
    solid = part.polyhedron
    alone = [edge for edge in solid.edges if edge[::-1] not in solid.edges]
    table_edges = [edge for edge in alone if _at_table(solid, edge, table_mm)]
    others = [solid.edges[edge][0] for edge in alone if edge not in table_edges]
    middle = solid.corners_mm.mean(0)
    count = len(solid.corners_mm)
    centring = np.kron(np.eye(count) - 1 / count, np.eye(3))
    every = (centring @ part.covariance_mm2 @ centring.T).reshape(count, 3, count, 3)
    blocks = np.asarray(every[range(count), :, range(count), :])
    types = tuple(type_facet(solid.corners_mm[r], blocks[r], library)[0].name for r in solid.rings)
    return LearntPart(
        Polyhedron(solid.corners_mm - middle, solid.facets, blocks, types),
        tuple(int(n) for n in part.seen.sum(0)),
        len(table_edges),
        tuple((k, others.count(k)) for k in sorted(set(others))),
        len(sides) - len(whole),
        float(np.median(np.sqrt(np.trace(blocks, axis1=1, axis2=2) / 3))),
    )


def _at_table(solid: Polyhedron, edge: tuple[int, int], table_mm: float) -> bool:
    return bool(np.abs(solid.corners_mm[list(edge), 2] - table_mm).max() < AT_TABLE_MM)


def _closed_in(solid: Polyhedron, table_mm: float) -> set[int]:
    """The facets whose every edge another one shares, or the table ends."""
    open_ones = {
        facet
        for edge, (facet, _) in solid.edges.items()
        if edge[::-1] not in solid.edges and not _at_table(solid, edge, table_mm)
    }
    return set(range(len(solid.facets))) - open_ones


def _ends(part: FusedLooks, facet: int, look_count: int) -> bool:
    """Whether a facet that others do not close in really ends where it was seen to: nothing is in front of it and no
    open edge of another one lies in its plane; or it was measured often."""
    solid = part.polyhedron
    ring, normal = solid.rings[facet], solid.normals[facet]
    off = (solid.corners_mm - solid.centres_mm[facet]) @ normal
    goes_on = any(
        max(abs(off[list(edge)])) < IN_PLANE_MM
        for edge, (owner, _) in solid.edges.items()
        if owner != facet and edge[::-1] not in solid.edges
    )
    free = off.max() < IN_PLANE_MM and not goes_on
    return bool(free or (look_count >= MIN_OPEN and part.looks_at[ring].all()))


@dataclass(frozen=True, eq=False)
class Deviation:
    """One learnt side compared with the drawing's. facet: the drawn side; off_mm: largest distance of its corners from
    the drawn ones after both solids are aligned; length_mm, angle_deg: largest
    differences of its side lengths and angles."""

    facet: int
    off_mm: float
    length_mm: float
    angle_deg: float


def deviations(learnt: Polyhedron, drawn: Polyhedron) -> tuple[Deviation | None, ...]:
    """Compare each learnt side with the drawing's, None for one that the drawing does not have; all None where the two
    cannot be aligned."""
    candidates = [
        correspondence
        for correspondence in correspondences(learnt, drawn, may_add=True)
        if (correspondence.corners >= 0).sum() > 2
    ]
    if not candidates:
        return (None,) * len(learnt.facets)
    fits = [(_fit(learnt, drawn, correspondence.corners), correspondence) for correspondence in candidates]
    fit, correspondence = min(fits, key=lambda pair: (-pair[1].explained, float(pair[0].rms_mm[0])))
    there = frames.apply(fit.poses[0], drawn.corners_mm)
    found = list[Deviation | None]()
    for ring, facet in zip(learnt.rings, correspondence.facets, strict=True):
        to = correspondence.corners[ring]
        if facet < 0 or (to < 0).any():
            found.append(None)
            continue
        one, other = learnt.corners_mm[ring], there[to]
        lengths, angles = (np.abs(a - b) for a, b in zip(_measures(one), _measures(other), strict=True))
        off = np.linalg.norm(one - other, axis=1)
        found.append(Deviation(facet, float(off.max()), float(lengths.max()), float(np.degrees(angles.max()))))
    return tuple(found)


def stl_of(solid: Polyhedron) -> bytes:
    """A binary STL of the known facets, mm; open where nothing was seen."""
    fans = [solid.corners_mm[list(one)] for ring in solid.facets for one in in_triangles(solid.corners_mm, list(ring))]
    rows = np.zeros(len(fans), STL_ROW)
    if fans:
        rows["corners"] = np.array(fans)
        corners: Real = rows["corners"]
        normals: Real = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        rows["normal"] = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    return bytes(80) + len(fans).to_bytes(4, "little") + rows.tobytes()


def solid_json(solid: Polyhedron) -> dict[str, Any]:
    """A solid as JSON values, to a micrometre; `solid_from` reads them."""
    return {
        "corners_mm": solid.corners_mm.round(4).tolist(),
        "covariance_mm2": solid.covariance_mm2.round(8).tolist(),
        "facets": [list(ring) for ring in solid.facets],
        "types": list(solid.types),
    }


def solid_from(values: Mapping[str, Any]) -> Polyhedron:
    """Read what solid_json wrote. Raises TeachError for anything else."""
    try:
        corners, covariance = np.array(values["corners_mm"], float), np.array(values["covariance_mm2"], float)
        rings = tuple(tuple(int(k) for k in ring) for ring in values["facets"])
        types = tuple(str(name) for name in values["types"])
        inside = all(0 <= k < len(corners) for ring in rings for k in ring)
        if corners.shape != (len(corners), 3) or covariance.shape != (len(corners), 3, 3) or not rings or not inside:
            raise ValueError
        if len(types) != len(rings) or min(map(len, rings)) < 3 or not np.isfinite(corners).all():
            raise ValueError
    except (KeyError, TypeError, ValueError):
        raise TeachError("the part learnt by `teach --around` cannot be read; `forget` it and teach it again") from None
    return Polyhedron(corners, rings, covariance, types)


def _fit(learnt: Polyhedron, drawn: Polyhedron, corners: NDArray[np.intp]) -> Fits:
    """learnt_from_drawn by the corners that both have."""
    both = np.flatnonzero(corners >= 0)
    return fit_shared(learnt, both, drawn, corners[both], FIT_MM)


def _measures(ring: Array) -> tuple[Array, Array]:
    """Lengths of sides (N,), mm, and angles (N,), rad."""
    found = measure(ring)
    return found.sides, found.angles
