"""A facet's outline is where planes meet, whatever its pieces were cut to."""

from __future__ import annotations

import numpy as np
import pytest

from daemon.vision.facets.many_looks.outlining import Plane, assumed_plane, fit_facet_plane, outlines
from daemon.vision.geometry import Polyhedron
from tests.fakes.observed_around import solid
from tests.fakes.solids import CUBE, L_BASE, prism

BOX = solid(CUBE)
L_PART = solid(prism(L_BASE, 40.0))


def seen(part: Polyhedron, facet: int, pieces: list[np.ndarray] | None = None, looks: int = 1) -> Plane:
    """A facet's plane of exact pieces; its whole outline where no pieces are given."""
    shown = [part.corners_mm[part.rings[facet]]] if pieces is None else pieces
    return fit_facet_plane(shown, [np.full(len(piece), 0.05) for piece in shown], looks)


def same(ring: np.ndarray, true: np.ndarray) -> bool:
    apart = np.linalg.norm(ring[:, None] - true, axis=2)
    return len(ring) == len(true) and bool(apart.min(1).max() < 0.05)


def cut(corners: np.ndarray, share: float) -> np.ndarray:
    """A quadrangle less what lies beyond that share of its first side."""
    a, b, c, d = corners
    return np.array([a, a + share * (b - a), d + share * (c - d), d])


@pytest.mark.parametrize("part", [BOX, L_PART], ids=["cube", "l"])
def test_whole_facets_stay_what_they_are(part: Polyhedron) -> None:
    planes = [seen(part, k) for k in range(len(part.facets))]
    for k, rings in enumerate(outlines(planes)):
        (ring,) = rings
        assert same(ring, part.corners_mm[part.rings[k]])


def test_a_lone_facet_is_its_own_outline() -> None:
    ((ring,),) = outlines([seen(L_PART, 1)])
    assert same(ring, L_PART.corners_mm[L_PART.rings[1]])


def test_a_shadow_across_a_facet_is_no_edge() -> None:
    facet = BOX.corners_mm[BOX.rings[1]]
    lit, dark = cut(facet, 0.6), facet.copy()
    dark[0], dark[3] = lit[1], lit[2]
    planes = [seen(BOX, k) for k in range(len(BOX.facets)) if k != 1]
    ((ring,), *_) = outlines([seen(BOX, 1, [lit, dark], looks=2), *planes])
    assert same(ring, facet)


def test_what_no_look_shows_is_filled_where_the_facets_beyond_its_edges_reach() -> None:
    facet = BOX.corners_mm[BOX.rings[1]]
    planes = [seen(BOX, k) for k in range(len(BOX.facets)) if k != 1]
    ((ring,), *_) = outlines([seen(BOX, 1, [cut(facet, 0.6)]), *planes])
    assert same(ring, facet)


def test_a_notch_that_nothing_was_seen_of_is_not_filled() -> None:
    outer = [k for k in range(2, 8) if np.abs(L_PART.normals[k] @ L_PART.corners_mm.T).max() < 40]
    ((ring,), *_) = outlines([seen(L_PART, 1), *(seen(L_PART, k) for k in outer[:2])])
    assert len(ring) == 6


def test_a_side_measured_wrongly_by_one_look_of_six_is_outvoted() -> None:
    facet = BOX.corners_mm[BOX.rings[1]]
    wrong = facet.copy()
    wrong[0] += 0.12 * (facet[0] - facet[1])
    wrong[3] += 0.12 * (facet[3] - facet[2])
    ((ring,),) = outlines([seen(BOX, 1, [facet] * 5 + [wrong], looks=6)])
    assert same(ring, facet)


def test_a_plane_nobody_saw_ends_a_facet_only_where_pieces_end() -> None:
    facet = BOX.corners_mm[BOX.rings[1]]
    through = assumed_plane(facet.mean(0), facet[1] - facet[0])
    ((ring,),) = outlines([seen(BOX, 1)], [through])
    assert same(ring, facet)


def test_what_one_look_saw_cuts_nothing_from_what_several_saw() -> None:
    several = [seen(BOX, k, looks=3) for k in range(6)]
    a, b, c, d = BOX.corners_mm[BOX.rings[0]]
    into = 8.0 * BOX.normals[0]
    false = fit_facet_plane([np.array([a, b, c - into, d - into])], [np.full(4, 0.1)], 1)
    for rings, true in zip(outlines([*several, false])[:6], BOX.rings, strict=True):
        (ring,) = rings
        assert same(ring, BOX.corners_mm[true])
