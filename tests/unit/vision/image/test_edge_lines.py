"""Sides and corners to a fraction of a pixel, on images whose truth is known."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from daemon.arrays import Array
from daemon.vision.geometry.polygon import PlanarShape, areas, convex, is_simple, met, rings, tidy
from daemon.vision.image.edge_lines import MeasuredImage, find_sides, fit_sides, line_beside
from daemon.vision.image.grey import FINE, measure_noise
from daemon.vision.image.regions import smoothed, unit_noise
from daemon.vision.thesis.corners import find_corners, mic_response
from tests.fakes.limit import side_bound

FINER = 8


def painted_polygon(
    corners: Array, inside: float, outside: float, sigma: float, seed: int = 0, size: int = 160
) -> NDArray[np.uint8]:
    """A convex polygon (N, 2) px, anti-aliased, blurred by 0.6 px, with noise."""
    v, u = (np.indices((size * FINER, size * FINER)) + 0.5) / FINER - 0.5
    chord = np.roll(corners, -1, 0) - corners
    within = np.ones_like(u, bool)
    for (x, y), (dx, dy) in zip(corners, chord, strict=True):
        within &= dx * (v - y) - dy * (u - x) < 0
    fine = np.where(within, inside, outside).astype(np.float32)
    blurred = cv2.GaussianBlur(fine, (0, 0), 0.6 * FINER)
    small = cv2.resize(blurred, (size, size), interpolation=cv2.INTER_AREA).astype(float)
    small += np.random.default_rng(seed).normal(0, sigma, small.shape)
    return np.asarray(np.clip(np.rint(small), 0, 255), np.uint8)


def exposed(image: NDArray[np.uint8]) -> MeasuredImage:
    """An image of a camera without a lens."""
    return MeasuredImage(np.multiply(image, FINE, dtype=np.uint16), measure_noise(image), None)


def turned_square(angle: float, half: float = 45.0, centre: float = 80.3) -> Array:
    """Corners anticlockwise as seen (v down)."""
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return np.asarray(np.array([[-1.0, -1], [-1, 1], [1, 1], [1, -1]]) * half @ turn.T + centre)


@pytest.mark.parametrize("angle", [0.05, 0.3, 0.7])
@pytest.mark.parametrize(("inside", "outside"), [(60.0, 180.0), (150.0, 120.0)])
def test_a_side_is_found_to_a_few_hundredths_of_a_pixel(angle: float, inside: float, outside: float) -> None:
    truth = turned_square(angle)
    image = painted_polygon(truth, inside, outside, 2.0)
    start = truth + np.random.default_rng(3).uniform(-0.6, 0.6, truth.shape)
    sides = fit_sides([(exposed(image), len(start))], start, np.roll(start, -1, 0))
    shape = rings([truth])
    corners = met(shape, sides.start, sides.end)
    limit = 0.08 if abs(inside - outside) > 100 else 0.25
    assert np.abs(corners - truth).max() < limit
    assert np.sign(sides.step) == pytest.approx(np.sign(outside - inside))


@pytest.mark.parametrize("turned_px", [-0.6, 0.0, 0.6])
@pytest.mark.parametrize("inside_px", [2.5, 3.7])
def test_a_rough_side_far_inside_a_strong_edge_comes_to_lie_along_it_and_not_across(
    inside_px: float, turned_px: float
) -> None:
    """Regions end the farther inside, the stronger their edges are; expected is less, and a line that is tilted until
    it crosses the edge has half of it nearer."""
    truth = turned_square(0.3)
    image = painted_polygon(truth, 220, 33, 1.5)
    smooth = smoothed(unit_noise(image, measure_noise(image)))
    start, end = truth, np.roll(truth, -1, 0)
    chord = end - start
    inwards = np.stack([chord[:, 1], -chord[:, 0]], 1) / np.hypot(*chord.T)[:, None]
    inwards *= np.sign(np.sum(inwards * (80.3 - start), 1))[:, None]
    rough = start + (inside_px + turned_px) * inwards, end + (inside_px - turned_px) * inwards
    side = np.full(len(start), 1.2)
    one, other, slopes = find_sides([(smooth, len(start))], *rough, 4.0, side, side)
    off_px = [np.sum((found - true) * inwards, 1) for found, true in ((one, start), (other, end))]
    assert np.abs(off_px).max() < 2.0
    assert np.abs(slopes).min() > 0.5 * np.abs(slopes).max()


def test_the_predicted_error_of_a_side_is_the_one_that_occurs() -> None:
    truth, found, predicted = turned_square(0.4), [], []
    for seed in range(10):
        image = painted_polygon(truth, 90.0, 130.0, 3.0, seed)
        sides = fit_sides([(exposed(image), len(truth))], truth, np.roll(truth, -1, 0))
        chord = np.roll(truth, -1, 0) - truth
        normal = np.stack([-chord[:, 1], chord[:, 0]], 1) / np.linalg.norm(chord, axis=1)[:, None]
        found.append(np.sum((sides.start + sides.end - truth - np.roll(truth, -1, 0)) / 2 * normal, 1))
        predicted.append(np.sqrt(sides.covariance.mean((1, 2))))
    seen, claimed = float(np.std(found)), float(np.mean(predicted))
    assert 0.6 < seen / claimed < 1.7
    bound = side_bound(3.0, np.array([40.0]), 0.7, np.array([90.0]))[0]
    assert seen > 0.8 * bound


@pytest.mark.parametrize(("from_deg", "to_deg"), [(10.0, 38.0), (100.0, 132.0)])
def test_a_line_along_an_arc_is_where_its_middle_alone_has_it(from_deg: float, to_deg: float) -> None:
    radius, turns = 45.0, np.arange(0.0, 2 * np.pi, 0.06)
    disc = 80.3 + radius * np.column_stack([np.cos(-turns), np.sin(-turns)])
    ends = 80.3 + radius * np.array([[np.cos(a), -np.sin(a)] for a in np.radians([from_deg, to_deg])])
    start, end = ends[0], ends[1]
    sagitta = radius * (1 - np.cos(np.radians(to_deg - from_deg) / 2))
    line = line_beside(np.array([[0.0, sagitta, 0.0]]), np.array([np.linalg.norm(end - start)]))
    out = ((start + end) / 2 - 80.3) / np.linalg.norm((start + end) / 2 - 80.3)
    near = 0.8 * sagitta * out
    sides = fit_sides([(exposed(painted_polygon(disc, 60.0, 180.0, 1.0)), 1)], start[None] + near, end[None] + near)
    found = [(sides.start[0] - start) @ out, (sides.end[0] - end) @ out]
    assert np.mean(found) == pytest.approx(line.mean(), abs=0.1)


def test_a_saturated_face_does_not_push_its_edges_outwards() -> None:
    truth = turned_square(0.3)
    image = painted_polygon(truth, 300.0, 120.0, 2.0)
    sides = fit_sides([(exposed(image), len(truth))], truth, np.roll(truth, -1, 0))
    area = abs(areas(rings([met(rings([truth]), sides.start, sides.end)]))[0])
    outward = (np.sqrt(area) - 90.0) / 2
    assert abs(outward) < 0.22  # half the height, as clipped, would put it 0.24 px out


@given(st.floats(0.0, 1.5), st.integers(3, 8))
@settings(max_examples=40, deadline=None)
def test_lines_through_a_polygons_sides_meet_in_its_corners(angle: float, sides: int) -> None:
    turn = angle - 2 * np.pi * np.arange(sides) / sides
    corners = 50 * np.stack([np.cos(turn), np.sin(turn)], 1) + 70
    shape = rings([corners, corners[::-1] + 3.0])
    assert met(shape, shape.corners, shape.corners[shape.next]) == pytest.approx(shape.corners, abs=1e-6)
    assert areas(shape)[0] < 0 < areas(shape)[1]
    assert convex(shape).tolist() == [True, False]


def test_a_blunted_tip_loses_its_short_side() -> None:
    corners = [(0.0, 0.0), (0.0, 50.0), (48.0, 52.0), (50.0, 50.0), (50.0, 0.0)]
    tidied = tidy(corners, 5.0)
    assert tidied is not None
    assert len(tidied) == 4


def test_crossing_sides_are_not_a_polygon() -> None:
    assert is_simple(np.array([[0.0, 0], [0, 10], [10, 10], [10, 0]]))
    assert not is_simple(np.array([[0.0, 0], [10, 10], [0, 10], [10, 0]]))


def test_a_square_inside_another_is_wholly_covered() -> None:
    big, small = PlanarShape.of(turned_square(0.2)), PlanarShape.of(turned_square(0.2, half=20.0))
    assert big.covers(small) == pytest.approx(1.0, abs=1e-3)
    assert big.union(small) == pytest.approx((20 / 45) ** 2, abs=1e-3)


@pytest.mark.parametrize("detector", ["mic", "median"])
def test_the_thesis_detectors_find_a_corner_to_about_a_pixel(detector: str) -> None:
    truth = turned_square(0.0)
    image = painted_polygon(truth, 40.0, 200.0, 1.0)
    found = find_corners(image.astype(np.float32), truth + 2.0, detector, 1.0)
    assert np.linalg.norm(found - truth, axis=1).max() < 2.0


def test_a_detector_that_sees_no_corner_says_so() -> None:
    flat = np.full((60, 60), 90.0, np.float32)
    assert np.isnan(find_corners(flat, np.array([[30.0, 30.0]]), "mic", 2.0)).all()


def test_mic_is_quiet_along_a_straight_edge_and_loud_at_a_corner() -> None:
    edge = np.zeros((20, 20))
    edge[:, 10:] = 100.0
    corner = np.zeros((20, 20))
    corner[10:, 10:] = 100.0
    assert mic_response(edge).max() == 0.0
    assert mic_response(corner)[10, 10] >= 5000.0
