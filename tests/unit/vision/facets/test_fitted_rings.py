"""Rings of sides and arcs: where elements meet, and how a ring moves."""

from __future__ import annotations

import numpy as np
import pytest

from daemon.arrays import Array
from daemon.vision.facets.one_look.fitted_rings import FittedRing

NO_CENTRE = [np.nan, np.nan]


def ring(direction_deg: list[float], out: list[float], radius: list[float], centre: list[list[float]]) -> FittedRing:
    count = len(direction_deg)
    numbers = (np.radians(direction_deg), np.array(out), np.array(radius), np.array(centre))
    return FittedRing(
        np.array([0.0, 0.0, 300.0]), np.array([[1.0, 0, 0], [0, -1.0, 0]]), *numbers, np.tile([1.0, -1.0], (count, 1))
    )


def block(radius: float) -> FittedRing:
    """20 x 20 mm, of which the corner behind the first side, the lower one, is rounded."""
    return ring([0, 90, 180, 270], [10.0] * 4, [radius, 0, 0, 0], [NO_CENTRE] * 4)


def flat(ring_: FittedRing) -> Array:
    return np.asarray((ring_.places()[0] - ring_.origin) @ ring_.axes.T)


def test_an_arc_touches_both_sides_beside_it() -> None:
    begin, end = block(4.0).ends
    assert end[0] == pytest.approx([6.0, -10.0])
    assert begin[1] == pytest.approx([10.0, -6.0])
    centre, first, sweep = block(4.0).arcs
    assert centre == pytest.approx(np.array([[6.0, -6.0]]))
    assert (first[0], sweep[0]) == pytest.approx((-np.pi / 2, np.pi / 2))


def test_an_arc_with_a_centre_begins_and_ends_on_the_side() -> None:
    d = ring([0], [3.0], [5.0], [[0.0, 0.0]])
    (begin,), (end,) = d.ends
    assert (*begin, *end) == pytest.approx((-4.0, -3.0, 4.0, -3.0))
    assert d.arcs[2][0] == pytest.approx(2 * np.pi - 2 * np.arctan2(4.0, 3.0))
    assert d.is_sound()


def test_a_ring_of_which_nothing_is_left_between_its_arcs_is_not_sound() -> None:
    assert block(4.0).is_sound()
    assert not block(21.0).is_sound()


def test_a_ring_moves_by_what_its_unknowns_say() -> None:
    one = block(4.0)
    step = np.zeros(one.unknowns)
    step[0], step[3 + 4], step[-1] = 2.0, 1.0, 0.5  # its plane, the lower side outwards, the radius
    moved = one.moved(step)
    assert moved.origin == pytest.approx(one.origin + 2.0 * np.cross(*one.axes))
    assert moved.ends[1][0] == pytest.approx([10.0 - 4.5, -11.0])
    lowest = [flat(own)[:, 1].min() for own in (one, moved)]
    assert lowest == pytest.approx([-10.0, -11.0])


@pytest.mark.parametrize("one", [block(4.0), ring([0], [3.0], [5.0], [[0.0, 0.0]])])
def test_rings_moved_side_by_side_move_as_each_alone(one: FittedRing) -> None:
    steps = np.random.default_rng(1).normal(0, 0.1, (3, one.unknowns))
    for own, together in zip(map(one.moved, steps), one.moved(steps).places()[0], strict=True):
        np.testing.assert_allclose(own.places()[0], together, atol=1e-9)
