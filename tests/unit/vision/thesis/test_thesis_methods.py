"""The thesis's detectors, depth and silhouettes: each finds what it should on pictures whose truth is known."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from daemon.vision.image import VisionError
from daemon.vision.thesis import by_formula, converging, find_corners, silhouette, slope_corners
from tests.fakes.rigs import thesis_rig
from tests.fakes.thesis_scenes import OUTLINES, silhouette_picture

PENTAGON = np.array([[60.0, 30], [150, 40], [170, 120], [100, 170], [40, 110]])


def pentagon(noise: float = 1.0) -> np.ndarray:
    image = np.full((200 * 4, 220 * 4), 200.0, np.float32)
    cv2.fillPoly(image, [np.rint((PENTAGON + 0.5) * 4).astype(np.int32)], 60.0)
    small = cv2.GaussianBlur(cv2.resize(image, (220, 200), interpolation=cv2.INTER_AREA), (0, 0), 0.7)
    return (small + np.random.default_rng(3).normal(0, noise, small.shape)).astype(np.float32)


def test_the_slope_of_a_border_changes_at_the_corners_and_nowhere_else() -> None:
    found = slope_corners(pentagon(), 1.0)
    away = np.linalg.norm(found[:, None] - PENTAGON, axis=2)
    assert away.min(1).max() < 8.0
    assert set(away.argmin(1)) == set(range(5))


def test_a_picture_without_an_edge_has_no_corner() -> None:
    flat = np.random.default_rng(0).normal(120, 2.0, (120, 160)).astype(np.float32)
    assert len(slope_corners(flat, 2.0)) == 0
    assert np.isnan(find_corners(flat, np.array([[50.0, 50.0]]), "slope", 2.0)).all()


def test_slope_corners_near_an_expected_one_are_averaged() -> None:
    found = find_corners(pentagon(), PENTAGON + 2.0, "slope", 1.0)
    assert np.linalg.norm(found - PENTAGON, axis=1).max() < 7.0


def test_measured_readings_correct_the_depth_that_they_were_read_at() -> None:
    rig = thesis_rig()
    at = np.array([500.0, 600.0, 700.0])
    points = np.column_stack([np.zeros((3, 2)), at])
    px = rig.left.project(points), rig.right.project(points)
    bare = by_formula(*px, rig, converging(rig))[:, 2]
    readings = [(float(z), float(z - true) + 5.0) for z, true in zip(bare, at, strict=True)]
    read = by_formula(*px, rig, converging(rig, readings), compensated=True)[:, 2]
    assert read == pytest.approx(at - 5.0, abs=1e-6)


@pytest.mark.parametrize("name", OUTLINES)
def test_a_silhouette_does_not_depend_on_the_place_in_the_picture(name: str) -> None:
    here, there = silhouette(silhouette_picture(name)), silhouette(silhouette_picture(name, shift_px=(40, -25)))
    assert (here * there).sum() > 0.95 * here.sum()


def test_an_empty_picture_has_no_silhouette() -> None:
    with pytest.raises(VisionError, match="nothing stands out"):
        silhouette(np.full((48, 64), 200, np.uint8))
