"""Corners that run round a circle are an arc, named after its sector, wherever it lies and however it is numbered."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daemon import frames
from daemon.arrays import Array
from daemon.store.library import load_facets
from daemon.vision.model.arcs import MIN_CORNERS, find_arc
from daemon.vision.model.facet_types import type_facet
from daemon.vision.model.ring_names import NAME_STEP_DEG

motions = st.builds(
    lambda turn, place: frames.rigid(frames.rotation_from_vector(np.array(turn)), np.array(place)),
    st.tuples(*[st.floats(-3, 3)] * 3),
    st.tuples(*[st.floats(-500, 500)] * 3),
)
radii = st.floats(15.0, 60.0)


LIBRARY = load_facets()


def name_of(corners: Array, covariance: Array) -> str:
    return type_facet(corners, covariance, LIBRARY)[0].name


def spread(count: int, sigma_mm: float = 0.05) -> Array:
    return np.tile(sigma_mm**2 * np.eye(3), (count, 1, 1))


def disc(count: int, radius: float) -> Array:
    angle = 2 * np.pi * np.arange(count) / count
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.zeros(count)])


def slice_of_cake(sector_deg: float, count: int, radius: float) -> Array:
    """A sector: count corners on the arc and the tip, anticlockwise, the tip drawn out so that it is on no circle."""
    angle = np.radians(sector_deg) * np.arange(count) / (count - 1)
    arc = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.zeros(count)])
    middle = np.radians(sector_deg / 2)
    return np.vstack([arc, -0.5 * radius * np.array([[np.cos(middle), np.sin(middle), 0.0]])])


@settings(max_examples=30, deadline=None)
@given(st.integers(9, 24), radii, motions, st.integers(0, 23))
def test_a_disc_is_an_arc_of_360_degrees(count: int, radius: float, motion: Array, by: int) -> None:
    corners = np.roll(frames.apply(motion, disc(count, radius)), by, axis=0)
    arc = find_arc(corners, spread(count))
    assert arc is not None
    assert (arc.count, arc.sector_rad) == (count, 2 * np.pi)
    assert arc.radius_mm == pytest.approx(radius, rel=1e-6)
    assert name_of(corners, spread(count)) == "disc"


@given(st.integers(6, 14), st.integers(9, 14), radii, motions, st.integers(0, 14))
@settings(max_examples=40, deadline=None)
def test_a_sector_is_named_after_its_angle_to_the_step(
    steps: int, count: int, radius: float, motion: Array, by: int
) -> None:
    sector_deg = NAME_STEP_DEG * steps
    flat = slice_of_cake(sector_deg, count, radius)
    corners = np.roll(frames.apply(motion, flat), by, axis=0)
    arc = find_arc(corners, spread(len(corners)))
    assert arc is not None
    assert np.rad2deg(arc.sector_rad) == pytest.approx(sector_deg, abs=1e-6)
    assert {(arc.first + k) % len(flat) for k in range(arc.count)} == {(by + k) % len(flat) for k in range(count)}
    assert f"a{sector_deg}" in name_of(corners, spread(len(corners)))


@settings(max_examples=30, deadline=None)
@given(st.integers(9, 20), st.floats(1.0, 3.0), motions)
def test_an_arc_stays_one_when_it_is_larger(count: int, scale: float, motion: Array) -> None:
    corners = disc(count, 30.0)
    grown = frames.apply(motion, scale * corners)
    assert name_of(corners, spread(count)) == name_of(grown, scale**2 * spread(count)) == "disc"


@settings(max_examples=30, deadline=None)
@given(st.integers(3, MIN_CORNERS - 1), radii, motions)
def test_a_polygon_of_few_corners_is_no_arc(count: int, radius: float, motion: Array) -> None:
    assert find_arc(frames.apply(motion, disc(count, radius)), spread(count)) is None


@settings(max_examples=30, deadline=None)
@given(st.integers(MIN_CORNERS, 16), radii, st.integers(0, 15))
def test_corners_in_and_out_of_a_circle_are_no_arc(count: int, radius: float, by: int) -> None:
    zigzag = disc(2 * (count // 2), radius) * np.tile([[1.0], [0.8]], (count // 2, 1))
    assert find_arc(np.roll(zigzag, by, axis=0), spread(len(zigzag))) is None


@settings(max_examples=30, deadline=None)
@given(st.integers(9, 20), motions)
def test_a_facet_of_many_corners_on_a_circle_is_typed_by_its_arc(count: int, motion: Array) -> None:
    assert name_of(frames.apply(motion, disc(count, 30.0)), spread(count)) == "disc"
