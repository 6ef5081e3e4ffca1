"""How far points are from segments, which lie off shapes, circles seen along an axis, the directions of a solid."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon import frames
from daemon.vision.geometry import circle_along, exact, off_segments, onto_circles
from tests.fakes.solids import prism

SOMEWHERE = st.tuples(st.floats(-30, 30), st.floats(-30, 30)).map(np.array)


@given(SOMEWHERE, SOMEWHERE, SOMEWHERE)
def test_a_point_is_as_far_from_a_segment_as_from_the_nearest_of_many_places_on_it(
    point: np.ndarray, start: np.ndarray, end: np.ndarray
) -> None:
    places = start + np.linspace(0, 1, 2001)[:, None] * (end - start)
    nearest = np.linalg.norm(places - point, axis=1).min()
    assert off_segments(point, start, end) == pytest.approx(nearest, abs=0.05)


def test_a_circle_seen_along_its_axis_has_its_radius_and_a_point_of_the_axis() -> None:
    turn, axis = frames.rotation_from_vector(np.array([0.3, -0.7, 0.2])), np.array([0.3, -0.5, 0.81])
    axis = axis / np.linalg.norm(axis)
    across = np.linalg.svd(axis[None])[2][1:]
    angles = np.linspace(0, 2.0, 9)
    heights = np.linspace(-3, 4, 9)  # a helix looks like its circle from there
    centre = np.array([5.0, -2.0, 8.0])
    points = centre + 6.0 * np.column_stack([np.cos(angles), np.sin(angles)]) @ across + heights[:, None] * axis
    on_axis, radius, off = circle_along(points @ turn.T, turn @ axis)
    assert radius == pytest.approx(6.0)
    assert off == pytest.approx(0.0, abs=1e-9)
    apart = on_axis - turn @ centre
    np.testing.assert_allclose(apart - (apart @ turn @ axis) * (turn @ axis), 0.0, atol=1e-9)


def test_points_are_moved_onto_their_circle_along_the_radius() -> None:
    circle = np.array([1.0, 2.0, 3.0, 5.0])
    moved = onto_circles(np.array([[4.0, 6.0, 3.0], [1.0, 1.0, 3.0]]), circle)
    np.testing.assert_allclose(moved, [[4.0, 6.0, 3.0], [1.0, -3.0, 3.0]])
    assert onto_circles(np.zeros((0, 3)), np.zeros((0, 4))).shape == (0, 3)


@pytest.mark.parametrize(("corners", "count"), [(4, 3), (6, 7)])
def test_each_direction_of_a_prism_is_told_once(corners: int, count: int) -> None:
    """A block has those across its faces; a hexagonal prism its axis, three across sides, and three along edges."""
    angles = 2 * np.pi * np.arange(corners) / corners
    body = prism(30.0 * np.column_stack([np.cos(angles), np.sin(angles)]), 50.0)
    directions = exact(body.corners_mm, body.facets).directions
    assert len(directions) == count
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1.0)
    alike = np.abs(directions @ directions.T) - np.eye(count)
    assert alike.max() < 0.98
