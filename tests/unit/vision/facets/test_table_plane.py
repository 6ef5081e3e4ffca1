"""What lies in the table is no part; what stands on it stays, and falls apart where only the table held it together."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from daemon import frames
from daemon.vision.facets.table_plane import TablePlane, without_table
from daemon.vision.values import FacetView, Group
from tests.fakes.solids import measured

TABLE = TablePlane(np.array([0.0, 0.0, -1.0]), -350.0)
SQUARE = 25.0 * np.array([[-1.0, -1, 0], [-1, 1, 0], [1, 1, 0], [1, -1, 0]])


def square_at(x: float, height_mm: float, tilt_rad: float = 0.0, rng: np.random.Generator | None = None):
    turn = frames.rotation_from_vector(np.array([tilt_rad, 0.0, 0.0]))
    return measured(frames.apply(frames.rigid(turn, np.array([x, 0.0, 350.0 - height_mm])), SQUARE), rng)


@given(st.integers(0, 2**31), st.floats(-40, 40))
def test_a_shadow_lies_in_the_table_whatever_the_noise(seed: int, x: float) -> None:
    assert TABLE.holds(square_at(x, 0.0, rng=np.random.default_rng(seed)))


@given(st.integers(0, 2**31), st.floats(8, 60))
def test_the_top_of_a_flat_part_does_not(seed: int, height_mm: float) -> None:
    assert not TABLE.holds(square_at(0.0, height_mm, rng=np.random.default_rng(seed)))


def test_a_facet_that_only_touches_the_table_with_an_edge_does_not_lie_in_it() -> None:
    assert not TABLE.holds(square_at(0.0, 25.0, tilt_rad=np.pi / 2 - 0.3))


def test_a_group_held_together_by_its_shadow_falls_apart_and_the_shadow_is_told() -> None:
    left, shadow, right = square_at(-60.0, 30.0), square_at(0.0, 0.0), square_at(60.0, 40.0)
    held = Group((left, shadow, right), ((0, 1, 2, 3), (4, 2, 1, 5), (6, 4, 5, 7)))
    assert held.touching.tolist() == [[False, True, False], [True, False, True], [False, True, False]]
    alone = Group((square_at(0.0, 50.0),), ((0, 1, 2, 3),))
    view = FacetView((held, alone), (), (), (), 2.0)
    found = without_table(view, TABLE)
    assert {len(g.facets) for g in found.groups} == {1}
    assert {id(f) for g in found.groups for f in g.facets} == {id(left), id(right), id(alone.facets[0])}
    assert [r.reason for r in found.rejected] == ["lies in the table"]
    assert found.rejected[0].corners_px is shadow.left_px
