"""Curved surfaces are no facets, and hide what lies behind them all the same."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from daemon.store.library import load_facets
from daemon.store.model import from_bytes, to_bytes
from daemon.teaching.solid_from_mesh import read_drawing
from daemon.vision.geometry import Polyhedron, area_vector, visible_from
from daemon.vision.geometry.visibility import hidden
from daemon.vision.hypotheses.junctions import indistinguishable_turns
from daemon.vision.model import empty_model, learn_solid
from tests.fakes import drawn

LIBRARY = load_facets()
TURNS = np.radians(np.linspace(-90, 90, 19))
D_SHAPE = [(0.0, -20.0), *((20 * np.cos(t), 20 * np.sin(t)) for t in TURNS[1:-1]), (0.0, 20.0)]


@pytest.fixture
def half_round() -> Polyhedron:
    """Half a cylinder of radius 20 along z, its flat side at x = 0 before it was moved to its middle."""
    return read_drawing("d.obj", drawn.obj(*drawn.prism(D_SHAPE, 30.0)), "mm", LIBRARY).solid


def test_a_rounding_is_covered_all_round_by_quadrilaterals_that_look_outwards(half_round: Polyhedron) -> None:
    assert 6 <= len(half_round.covers) <= 8
    areas = np.array([area_vector(cover) for cover in half_round.covers])
    assert (areas[:, 0] > -1.0).all()
    assert np.allclose(areas.sum(axis=0), [40 * 30, 0, 0], atol=1.0)
    assert not half_round.convex


def test_what_lies_behind_a_rounding_is_hidden_and_what_lies_before_it_is_not(half_round: Polyhedron) -> None:
    flat = int(np.flatnonzero(half_round.normals @ [-1.0, 0, 0] > 0.99)[0])
    corners = half_round.corners_mm[half_round.rings[flat]]
    points = corners + 0.3 * (corners.mean(axis=0) - corners)
    behind, before = np.array([300.0, 0.0, 0.0]), np.array([-300.0, 0.0, 0.0])
    assert hidden(half_round, points, behind).all()
    assert not hidden(half_round, points, before).any()
    assert not hidden(replace(half_round, covers=np.zeros((0, 4, 3))), points, behind).any()


def test_a_face_behind_a_boss_is_in_view_only_from_beside_it() -> None:
    ring = 2 * np.pi * np.arange(36) / 36
    boss = drawn.prism([(12 * np.cos(t), 12 * np.sin(t)) for t in ring], 40.0)
    covers = read_drawing("b.obj", drawn.obj(*boss), "mm", LIBRARY).solid.covers
    plate = read_drawing("p.obj", drawn.obj(*drawn.box(10, 10, 10)), "mm", LIBRARY).solid
    side = int(np.flatnonzero(plate.normals @ [1.0, 0, 0] > 0.99)[0])
    whole = replace(plate, covers=covers + np.array([40.0, 0.0, 0.0]))
    directions = np.array([[1.0, 0.0, 0.0], [0.6, 0.8, 0.0]])
    assert visible_from(whole, directions)[:, side].tolist() == [False, True]
    assert visible_from(plate, directions)[:, side].tolist() == [True, True]


def test_covers_go_with_the_part_into_its_frame_and_its_file(half_round: Polyhedron) -> None:
    model = learn_solid(empty_model(LIBRARY), half_round, "half")
    kept = from_bytes(to_bytes(model)).model.metric["half"].solid

    def distances(solid: Polyhedron) -> np.ndarray:
        return np.linalg.norm(solid.covers.reshape(-1, 1, 3) - solid.corners_mm, axis=2)

    assert len(kept.covers) == len(half_round.covers)
    assert np.allclose(distances(kept), distances(half_round), atol=0.05)


def test_turns_of_a_part_that_shows_only_corners_along_a_rounding_are_told() -> None:
    """A corner between sides that do not show has no two edges: a look that met one first ended in a traceback."""
    outline = [(-20.0, -15.0), *((20 + 15 * np.cos(t), 15 * np.sin(t)) for t in TURNS), (-20.0, 15.0)]
    solid = read_drawing("s.obj", drawn.obj(*drawn.prism(outline, 25.0)), "mm", LIBRARY).solid
    some = replace(solid, smooth=frozenset((min(a, b), max(a, b)) for a, b in solid.edges))
    assert np.allclose(indistinguishable_turns(some, tuple(range(len(some.corners_mm)))), np.eye(4))
    for facet in solid.facets:
        turns = indistinguishable_turns(solid, facet)
        assert np.allclose(turns[0], np.eye(4))
