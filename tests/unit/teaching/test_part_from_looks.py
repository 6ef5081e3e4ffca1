"""What was seen all round becomes a solid: closed where it was seen, open where it lay, and told beside a drawing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from daemon.store.library import load_facets
from daemon.teaching.mesh import read_mesh
from daemon.teaching.part_from_looks import deviations, learn_from_looks, solid_from, solid_json, stl_of
from daemon.vision.facets import FusedLooks, fuse
from daemon.vision.geometry import Polyhedron
from daemon.vision.model import TeachError
from tests.fakes.observed_around import DOUBT, solid, tour
from tests.fakes.solids import CUBE, L_BASE, prism

LIBRARY = load_facets()
L_PART = solid(prism(L_BASE, 40.0))
LOW_MM = -20.0


@pytest.fixture(scope="module")
def fused() -> FusedLooks:
    known = fuse(tour(L_PART, 10, np.random.default_rng(4)), DOUBT.shared(), LOW_MM)
    assert known is not None
    return known


def sure(part: Polyhedron) -> Polyhedron:
    return replace(part, covariance_mm2=np.repeat(0.02**2 * np.eye(3)[None], len(part.corners_mm), axis=0))


def test_all_sides_but_the_one_it_lies_on_are_learnt(fused: FusedLooks) -> None:
    part = learn_from_looks(fused, fused.polyhedron.corners_mm[:, 2].min(), LIBRARY)
    assert len(part.solid.facets) == len(L_PART.facets) - 1
    assert part.table_edges == 6
    assert part.open_edges == ()
    assert part.left_out == 0
    assert part.sigma_mm < 0.1
    assert sorted(part.solid.types).count("rectangle") + part.solid.types.count("square") == 6


def test_a_missing_side_is_told_by_the_edges_it_leaves_open(fused: FusedLooks) -> None:
    upright = [k for k, ring in enumerate(fused.polyhedron.rings) if len(ring) == 4]
    rest = fused.only([k for k in range(len(fused.polyhedron.facets)) if k != upright[0]])
    part = learn_from_looks(rest, fused.polyhedron.corners_mm[:, 2].min(), LIBRARY)
    assert sum(count for _, count in part.open_edges) + part.table_edges == part.solid.open_edges


def test_a_side_with_a_corner_that_nothing_holds_is_left_out(fused: FusedLooks) -> None:
    solid_seen = fused.polyhedron
    spread = solid_seen.covariance_mm2.copy()
    corner = solid_seen.facets[-1][0]
    spread[corner] += 9.0 * np.eye(3)
    wide = replace(fused, polyhedron=replace(solid_seen, covariance_mm2=spread))
    part = learn_from_looks(wide, solid_seen.corners_mm[:, 2].min(), LIBRARY)
    assert part.left_out >= sum(corner in ring for ring in solid_seen.facets)


def test_nothing_seen_is_nothing_learnt() -> None:
    with pytest.raises(TeachError, match="none of the places"):
        learn_from_looks(None, 0.0, LIBRARY)


def test_a_learnt_solid_lies_on_its_drawing_side_by_side(fused: FusedLooks) -> None:
    part = learn_from_looks(fused, fused.polyhedron.corners_mm[:, 2].min(), LIBRARY)
    beside = deviations(part.solid, sure(L_PART))
    assert len({one.facet for one in beside if one}) == len(L_PART.facets) - 1
    assert max(one.off_mm for one in beside if one) < 0.3


def test_a_side_that_is_off_shows_on_the_sides_that_share_its_corners() -> None:
    part = sure(solid(CUBE))
    corners = part.corners_mm.copy()
    corners[list(part.facets[1])] += [0.0, 0.0, 1.0]
    beside = deviations(replace(part, corners_mm=corners), part)
    assert all(one is not None for one in beside)
    assert max(one.length_mm for one in beside if one) == pytest.approx(1.0, abs=1e-6)
    assert min(one.length_mm for one in beside if one) == pytest.approx(0.0, abs=1e-6)


def test_what_has_other_sides_cannot_be_laid_on_the_drawing() -> None:
    octagon = sure(solid(prism(30 * np.array([[np.cos(a), np.sin(a)] for a in np.arange(8) * np.pi / 4]), 30.0)))
    beside = deviations(octagon, sure(L_PART))
    assert [beside[k] for k, ring in enumerate(octagon.facets) if len(ring) == 8] == [None, None]


def test_the_stl_holds_every_triangle_of_what_was_seen() -> None:
    mesh = read_mesh("part.stl", stl_of(L_PART))
    assert len(mesh.polygons) == 2 * 4 + 6 * 2
    assert np.linalg.norm(mesh.corners_mm[:, None] - L_PART.corners_mm, axis=2).min(1).max() < 1e-4
    opened = replace(L_PART, facets=L_PART.facets[1:])
    assert len(read_mesh("part.stl", stl_of(opened)).polygons) == len(mesh.polygons) - 4


def test_a_solid_is_kept_and_read_again() -> None:
    part = replace(sure(L_PART), types=("polygon6",) * 2 + ("rectangle",) * 6)
    again = solid_from(solid_json(part))
    assert again.facets == part.facets
    assert again.types == part.types
    assert np.abs(again.corners_mm - part.corners_mm).max() < 1e-3


@pytest.mark.parametrize("harm", ["facets", "corners_mm", "types", "covariance_mm2"])
def test_a_damaged_note_is_told_and_not_learnt(harm: str) -> None:
    values = solid_json(replace(sure(L_PART), types=("polygon6",) * 8))
    for wrong in ([], None, [[99, 0, 1]], "x"):
        with pytest.raises(TeachError, match="teach it again"):
            solid_from({**values, harm: wrong})
