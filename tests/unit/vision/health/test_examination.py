"""Each thing that can be wrong with a picture is found by its name, and a good picture is left in peace."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from daemon.vision.geometry.rig import StereoRig
from daemon.vision.health.blur import measure_blur
from daemon.vision.health.camera_order import Assignment, assignment, matched_points
from daemon.vision.health.examination import MEASURES, examine, findings_json, misleading, troubles
from tests.fakes import rigs

Image = np.ndarray


def picture(seed: int = 0, shift_px: float = 0.0) -> Image:
    """A few grey polygons on a grey table, a little blurred, with a sensor's noise."""
    random = np.random.default_rng(7)
    canvas = np.full((480 * 4, 640 * 4), 90, np.uint8)
    for _ in range(7):
        centre, size, turn = random.uniform(80, 400, 2) * 4, random.uniform(30, 90) * 4, random.uniform(0, 6.3)
        angles = turn + np.sort(random.uniform(0, 2 * np.pi, 5))
        corners = centre[::-1] + [shift_px * 4, 0] + size * np.stack([np.cos(angles), np.sin(angles)], 1)
        cv2.fillPoly(canvas, [corners.astype(np.int32)], int(random.integers(30, 230)))
    sharp = cv2.GaussianBlur(cv2.resize(canvas, (640, 480), interpolation=cv2.INTER_AREA).astype(float), (0, 0), 0.6)
    return np.clip(sharp + np.random.default_rng(seed).normal(0, 2, sharp.shape), 0, 255).astype(np.uint8)


LEFT, RIGHT = picture(1), picture(2, 25.0)


def bad(left: Image, right: Image = RIGHT, **more: object) -> set[str]:
    return {f.name for f in examine((left, right), **more) if not f.good}  # type: ignore[arg-type]


def noisy(image: Image) -> Image:
    return np.clip(image + np.random.default_rng(9).normal(0, 2, image.shape), 0, 255).astype(np.uint8)


def torn(image: Image) -> Image:
    return np.vstack([image[:230], np.roll(image, 25, axis=1)[230:]])


def half(image: Image) -> Image:
    broken = image.copy()
    broken[300:] = 0
    return broken


def test_a_good_pair_has_nothing_wrong() -> None:
    assert bad(LEFT, before=(picture(3), picture(4, 25.0))) == set()


@pytest.mark.parametrize(
    ("name", "image"),
    [
        ("saturation", noisy(np.minimum(LEFT.astype(int) * 3, 255))),
        ("darkness", noisy(LEFT // 8)),
        ("covered", noisy(np.full((480, 640), 3))),
        ("focus", noisy(cv2.GaussianBlur(LEFT, (0, 0), 2.0))),
        ("motion", noisy(cv2.filter2D(LEFT, -1, np.ones((1, 13)) / 13))),
        ("half", half(LEFT)),
        ("torn", torn(LEFT)),
    ],
)
def test_what_is_wrong_with_a_picture_is_found_by_its_name(name: str, image: Image) -> None:
    findings = examine((LEFT, image), before=(picture(3), picture(4)))
    assert [f.name for f in findings if not f.good and f.camera == "left"] == []
    assert name in [f.name for f in findings if not f.good and f.camera == "right"]


def test_a_pair_that_repeats_is_frozen_even_when_only_one_camera_does() -> None:
    assert bad(LEFT, before=(LEFT, RIGHT)) == {"frozen"}
    assert bad(LEFT, before=(picture(5), RIGHT)) == {"frozen"}


def test_one_camera_named_twice_is_found() -> None:
    assert "doubled" in bad(LEFT, LEFT.copy())


def test_one_picture_that_is_given_twice_is_one_camera_and_nothing_that_two_would_be_asked_is_asked_of_it() -> None:
    asked = {f.name for f in examine((LEFT, LEFT), None, rig())}
    assert "covered" in asked
    assert not {"doubled", "swapped", "knocked"} & asked


def test_an_empty_bright_table_is_not_a_covered_lens_but_one_blind_camera_is() -> None:
    plain = noisy(np.full((480, 640), 120))
    assert "covered" not in bad(plain, noisy(plain))
    assert "covered" in bad(plain, RIGHT)


def test_only_what_shows_something_that_is_not_there_is_misleading() -> None:
    assert misleading(examine((noisy(LEFT // 8), RIGHT))) == ()
    assert len(misleading(examine((LEFT, RIGHT), before=(LEFT, RIGHT)))) == 1
    assert "covered" in str(misleading(examine((noisy(np.full((480, 640), 3)), RIGHT)))[0])


def test_a_trouble_says_where_what_to_do_and_by_how_much() -> None:
    lines = troubles(examine((noisy(LEFT // 8), RIGHT)))
    assert len(lines) == 1
    assert lines[0].startswith("left: too dark: lengthen exposure_us, raise gain, or add light (darkness ")
    assert lines[0].endswith("grey levels, limit 30)")


def test_the_figures_for_machines_have_every_measure_and_its_limit() -> None:
    rows = findings_json(examine((LEFT, RIGHT)))
    assert {row["name"] for row in rows} <= set(MEASURES)
    assert all(row["limit"] == MEASURES[row["name"]].limit and isinstance(row["good"], bool) for row in rows)


@pytest.mark.parametrize("sigma", [1.0, 1.5, 2.5])
def test_the_blur_of_edges_is_measured_in_pixels_whatever_their_contrast(sigma: float) -> None:
    for contrast in (1.0, 0.4):
        faded = (LEFT.astype(float) - 90) * contrast + 90
        blurred = np.random.default_rng(3).normal(cv2.GaussianBlur(faded, (0, 0), sigma), 1.0)
        measured = measure_blur(np.clip(blurred, 0, 255).astype(np.uint8))
        assert measured.least_px == pytest.approx(np.hypot(sigma, 0.6), rel=0.16)


def test_motion_is_told_from_defocus_by_its_direction() -> None:
    moved = measure_blur(noisy(cv2.filter2D(LEFT, -1, np.ones((13, 1)) / 13)))
    defocused = measure_blur(noisy(cv2.GaussianBlur(LEFT, (0, 0), 2.5)))
    assert moved.motion_px > 8 > 3 * moved.least_px
    assert defocused.motion_px < 6 < 3 * defocused.least_px


def test_the_blur_of_a_picture_without_edges_is_not_measured() -> None:
    assert np.isnan(measure_blur(noisy(np.full((480, 640), 90))).least_px)


def rig(height_mm: float = 0.0) -> StereoRig:
    """Two cameras that converge at 350 mm, the right one's image 5 px lower than the left one's."""
    turn_rad, centres = np.arctan2(30.0, 350.0), ((320.0, 241.0), (320.0, 236.0))
    return rigs.rig(turn_rad=turn_rad, centres_px=centres, distortion=(-0.08, 0.03, 0, 0, 0), raised_mm=height_mm)


def starry(stereo: StereoRig, points: int = 25) -> tuple[Image, Image]:
    """Little textured patches at known points in space, as both cameras see them."""
    random = np.random.default_rng(11)
    places = np.column_stack(
        [random.uniform(-70, 70, points), random.uniform(-60, 60, points), random.uniform(280, 420, points)]
    )
    patches = random.integers(0, 255, (points, 7, 7), np.uint8)
    images = []
    for camera in (stereo.left, stereo.right):
        image = random.normal(100, 2, (480, 640)).astype(np.uint8)
        for (u, v), patch in zip(np.rint(camera.project(places)).astype(int), patches, strict=True):
            if 10 <= u < 630 and 10 <= v < 470:
                image[v - 10 : v + 11, u - 10 : u + 11] = cv2.resize(patch, (21, 21), interpolation=cv2.INTER_CUBIC)
        images.append(image)
    return images[0], images[1]


def test_swapped_cameras_are_found_and_those_the_right_way_round_are_left_in_peace() -> None:
    left, right = starry(rig())
    assert assignment(left, right, rig())[0] is Assignment.RIGHT
    assert assignment(right, left, rig())[0] is Assignment.SWAPPED
    assert "swapped" in bad(right, left, rig=rig())
    assert "swapped" not in bad(left, right, rig=rig())


@pytest.mark.parametrize("pitch_deg", [-1.0, -0.5, 0.32, 1.0])
def test_a_camera_knocked_up_or_down_is_told_from_swapped_cameras(pitch_deg: float) -> None:
    left, right = starry(rig())
    knocked = knocked_right(rig(), pitch_deg)
    way, off_px = assignment(left, right, knocked)
    assert way is Assignment.NEITHER
    assert off_px == pytest.approx(700 * np.radians(abs(pitch_deg)), abs=1.0)
    assert bad(left, right, rig=knocked) == {"knocked"}


def test_dots_of_which_one_is_as_good_as_the_next_are_no_points_to_compare() -> None:
    """They would all be matched one row up where a part's print hangs near the cameras, and a camera called knocked."""
    y, x = np.mgrid[:480, :720]
    dots = 120 + 60 * np.cos(2 * np.pi * y / 28) * np.cos(2 * np.pi * x / 28)
    assert len(matched_points(noisy(dots[:, :640]), noisy(dots[:, 45:685]))[0]) <= 3
    assert len(matched_points(*starry(rig()))[0]) > 20


def knocked_right(stereo: StereoRig, pitch_deg: float) -> StereoRig:
    """What a calibration says from before the right camera was tilted."""
    pose = stereo.right.cyclopean_from_camera.copy()
    pose[:3, :3] = pose[:3, :3] @ cv2.Rodrigues(np.array([np.radians(pitch_deg), 0.0, 0.0]))[0]
    return replace(stereo, right=replace(stereo.right, cyclopean_from_camera=pose))


def test_a_picture_with_little_in_it_does_not_tell_which_camera_is_which() -> None:
    plain = np.random.default_rng(2).normal(100, 2, (480, 640)).astype(np.uint8)
    assert assignment(plain, plain[:, ::-1].copy(), rig())[0] is Assignment.UNKNOWN
