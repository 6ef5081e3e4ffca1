"""Ellipses of one image: whole and partly hidden, small and large; straight edges and noise are none."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from daemon.arrays import Array
from daemon.vision.image import Ellipse, open_stereo
from tests.fakes.rigs import rig


def ellipses(*shapes: tuple[str, Array]) -> list[Ellipse]:
    """Those found in the left of two images of light shapes on dark: polygons, (N, 2) px, under a blur and noise."""
    image = np.full((480 * 4, 640 * 4), 60.0, np.float32)
    for kind, corners in shapes:
        fine = np.rint(16 * (4 * corners + 1.5)).astype(np.int32)  # the middle of a pixel is between its four by four
        cv2.fillPoly(image, [fine], 160.0 if kind == "light" else 60.0, cv2.LINE_8, 4)
    small = cv2.resize(cv2.GaussianBlur(image, (0, 0), 2.4), (640, 480), interpolation=cv2.INTER_AREA)
    noisy = np.clip(small + np.random.default_rng(3).normal(0, 2, small.shape), 0, 255).astype(np.uint8)
    return open_stereo(noisy, noisy, rig()).left.ellipses


def ring(x: float, y: float, a: float, b: float, turn: float = 0.0) -> Array:
    """(N, 2) px on an ellipse."""
    t = 2 * np.pi * np.arange(200) / 200
    axes = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    return np.array([x, y]) + np.column_stack([a * np.cos(t), b * np.sin(t)]) @ axes


@pytest.mark.parametrize(("a", "b"), [(60.0, 35.0), (11.0, 7.0), (5.5, 4.5)])
def test_an_ellipse_is_found_to_a_tenth_of_a_pixel(a: float, b: float) -> None:
    (found,) = ellipses(("light", ring(300.3, 220.6, a, b, 0.4)))
    assert found.centre == pytest.approx([300.3, 220.6], abs=0.1)
    assert sorted(found.radii) == pytest.approx([b, a], abs=0.25)  # blur draws a small one in
    off, _ = found.off_px(found.places)
    assert np.sqrt((off**2).mean()) < 0.2


def test_half_of_an_ellipse_is_enough() -> None:
    below = np.array([[0, 230.0], [639, 230], [639, 479], [0, 479]])
    (found,) = ellipses(("light", ring(320, 230, 50, 40)), ("dark", below))
    assert found.centre == pytest.approx([320, 230], abs=1.5)


def test_polygons_and_noise_are_no_ellipses() -> None:
    hexagon = ring(320, 240, 80, 60)[::33][:6]
    assert ellipses(("light", hexagon), ("light", np.array([[50.0, 50], [150, 60], [140, 150], [45, 140]]))) == []


def test_round_ends_are_found_though_straight_edges_run_on_into_them() -> None:
    left, right = ring(250, 240, 40, 40), ring(390, 240, 40, 40)
    stadium = np.vstack([left[50:151], right[150:], right[:51]])
    found = ellipses(("light", stadium))
    for x in (250.0, 390.0):
        (near,) = (one for one in found if np.linalg.norm(one.centre - [x, 240]) < 2)
        assert near.radii == pytest.approx([40, 40], rel=0.015)  # straight edges beside them draw none out
