"""Many polygons in one array: what is done to all at once is what would be done to each."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon.vision.geometry.polygon import areas, convex, different, met, rings

seeds = st.integers(0, 2**31)


def star(rng: np.random.Generator, count: int, dented: bool = False) -> np.ndarray:
    """(count, 2) px: a polygon round a point, anticlockwise as seen (v points down); dented: one corner pulled in."""
    angle = -np.sort(np.arange(count) + rng.uniform(0.1, 0.4, count)) * 2 * np.pi / count
    radius = np.full(count, 40.0)
    if dented:
        radius[0] = 4.0
    return np.array([320.0, 240.0]) + radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])


def some(rng: np.random.Generator) -> list[np.ndarray]:
    return [star(rng, int(rng.integers(3, 9))) for _ in range(int(rng.integers(1, 7)))]


@given(seeds)
def test_neighbours_go_round_each_polygon_and_never_into_the_next(seed: int) -> None:
    polygons = some(np.random.default_rng(seed))
    shape = rings(polygons)
    for split, own, following, before in zip(
        shape.split(),
        polygons,
        shape.split(shape.corners[shape.next]),
        shape.split(shape.corners[shape.before]),
        strict=True,
    ):
        assert split == pytest.approx(own)
        assert following == pytest.approx(np.roll(own, -1, axis=0))
        assert before == pytest.approx(np.roll(own, 1, axis=0))


@given(seeds)
def test_sums_and_least_values_are_those_of_each_polygon(seed: int) -> None:
    polygons = some(np.random.default_rng(seed))
    shape = rings(polygons)
    assert shape.sums(shape.corners) == pytest.approx(np.stack([p.sum(0) for p in polygons]))
    assert shape.least(shape.corners[:, 0]) == pytest.approx([p[:, 0].min() for p in polygons])


@given(seeds)
def test_an_area_is_negative_anticlockwise_as_seen_and_that_of_its_triangles(seed: int) -> None:
    polygons = some(np.random.default_rng(seed))
    expected = []
    for p in polygons:
        a, b = p[1:-1] - p[0], p[2:] - p[0]
        expected.append(float((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum() / 2))
    found = areas(rings(polygons))
    assert found == pytest.approx(expected)
    assert (found < 0).all()
    assert areas(rings([p[::-1] for p in polygons])) == pytest.approx(-found)


@given(seeds, st.integers(5, 8))
def test_a_dent_a_turn_the_other_way_and_a_second_turn_are_not_convex(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    good, dented = star(rng, count), star(rng, count, dented=True)
    pentagram = np.array([np.cos(t := -4 * np.pi * k / 5) * 40 + 1j * np.sin(t) * 40 for k in range(5)])
    twice = np.column_stack([pentagram.real, pentagram.imag])
    assert convex(rings([good, dented, good[::-1], twice])).tolist() == [True, False, False, False]


@given(seeds)
def test_the_lines_of_neighbouring_sides_meet_in_the_corner_between_them(seed: int) -> None:
    rng = np.random.default_rng(seed)
    polygons = [star(rng, count) for count in (3, 4, 6)]
    shape = rings(polygons)
    chord = shape.corners[shape.next] - shape.corners
    start, end = shape.corners + 0.2 * chord, shape.corners + 0.7 * chord
    assert met(shape, start, end) == pytest.approx(shape.corners, abs=1e-6)


def test_parallel_sides_meet_far_away_and_nothing_divides_by_nothing() -> None:
    shape = rings([np.array([[0.0, 0], [10, 0], [10, 10]])])
    along = np.array([[0.0, 0], [5, 0], [9, 0]])
    assert np.isfinite(met(shape, along, along + np.array([1.0, 0]))).all()


def test_a_side_two_polygons_share_is_told_once_and_which_way_it_runs() -> None:
    start = np.array([[0.0, 0], [10, 0], [10.2, 0.1], [50, 50]])
    end = np.array([[10.0, 0], [10, 10], [0.1, 0.1], [60, 50]])
    kept, which, backwards = different(start, end, 0.5)
    assert kept.tolist() == [0, 1, 3]
    assert which.tolist() == [0, 1, 0, 2]
    assert backwards.tolist() == [False, False, True, False]


def test_of_no_sides_none_differ() -> None:
    """A camera of many in which no outline was left ended the look."""
    kept, which, backwards = different(np.zeros((0, 2)), np.zeros((0, 2)), 0.5)
    assert len(kept) == len(which) == len(backwards) == 0
