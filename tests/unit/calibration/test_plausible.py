"""Rigs that no hand has are told apart from those that are only unusual, each with its cause."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from daemon import frames
from daemon.calibration.plausible import changed_parameters, implausible_rig
from daemon.calibration.stereo import rig_of
from daemon.vision.geometry import StereoRig
from tests.fakes.rigs import rig, thesis_rig, unlike_rig


def told(one: StereoRig) -> str:
    return "; ".join(wrong.problem for wrong in implausible_rig(one))


@pytest.mark.parametrize("one", [rig(), unlike_rig(), thesis_rig()], ids=["usual", "unlike", "thesis"])
def test_rigs_that_there_are_are_plausible(one: StereoRig) -> None:
    assert told(one) == ""


@given(
    base_mm=st.floats(15, 400), focal_px=st.floats(300, 2500), turn_rad=st.floats(-0.05, 0.35),
    cx=st.floats(260, 380), cy=st.floats(195, 285),
)  # fmt: skip
def test_no_ordinary_rig_is_refused(base_mm: float, focal_px: float, turn_rad: float, cx: float, cy: float) -> None:
    assert told(rig(base_mm, turn_rad, (focal_px, focal_px), ((cx, cy), (cx, cy)))) == ""


def with_left(**fields: Any) -> StereoRig:
    return replace(rig(), left=replace(rig().left, **fields))


def exchanged() -> StereoRig:
    """As files named in the wrong order give it: the cyclopean frame is turned by 180 degrees."""
    one = rig()
    left_from_right = frames.inverse(one.right.cyclopean_from_camera) @ one.left.cyclopean_from_camera
    right, left = ((camera.matrix, camera.distortion) for camera in (one.right, one.left))
    return rig_of(right, left, left_from_right, one.image_size)


def turned_across() -> StereoRig:
    """One camera above the other."""
    about_z = np.eye(4)
    about_z[:2, :2] = [[0.0, -1.0], [1.0, 0.0]]
    one = rig()
    left, right = (
        replace(camera, cyclopean_from_camera=camera.cyclopean_from_camera @ about_z)
        for camera in (one.left, one.right)
    )
    return replace(one, left=left, right=right)


def tipped_down() -> StereoRig:
    """The right camera looks across the left one's axis, side by side with it, as where a rotation was transposed."""
    about_x, one = np.eye(4), rig()
    about_x[1:3, 1:3] = [[0.0, -1.0], [1.0, 0.0]]
    right = replace(one.right, cyclopean_from_camera=one.right.cyclopean_from_camera @ about_x)
    return replace(one, right=right)


def matrix(**cells: float) -> np.ndarray:
    found = rig().left.matrix.copy()
    for name, value in cells.items():
        found[{"fx": (0, 0), "fy": (1, 1), "cx": (0, 2), "cy": (1, 2), "skew": (0, 1)}[name]] = value
    return found


@pytest.mark.parametrize(
    ("one", "words"),
    [
        (rig(60_000.0), "baseline of 60000 mm.*mm taken for m"),
        (rig(2.4), "baseline of 2.4 mm.*squares of a board"),
        (exchanged(), "--swap"),
        (
            turned_across(),
            "the baseline is turned by 90 degrees against a camera's rows: mount the cameras side by side",
        ),
        (tipped_down(), "the cameras look 90 degrees apart: a rotation that was transposed"),
        (replace(rig(), image_size=(480, 640)), "--size 640x480"),
        (replace(rig(), image_size=(1280, 960)), "of images of some 640x480"),
        (with_left(matrix=matrix(fx=70_000.0, fy=70_000.0)), "field of view of 0.5 degrees"),
        (with_left(matrix=matrix(fx=7.0, fy=7.0)), "field of view of 177"),
        (with_left(matrix=matrix(fy=1400.0)), "far from square"),
        (with_left(matrix=matrix(skew=30.0)), "skew of 30"),
        (with_left(matrix=matrix(fx=1600.0, fy=1600.0)), "two cameras of a pair are alike"),
        (with_left(distortion=np.array([-3.0, 0, 0, 0, 0])), "folds within its corners"),
    ],
)
def test_each_rig_that_cannot_be_is_told_with_its_cause(one: StereoRig, words: str) -> None:
    assert re.search(words, told(one)), told(one)


def test_what_changed_against_the_file_before_is_told() -> None:
    assert changed_parameters(rig(), rig()) == []
    assert "baseline" in changed_parameters(rig(90.0), rig())[0]
    assert "images of 1280x960" in changed_parameters(replace(rig(), image_size=(1280, 960)), rig())[0]


def keys(one: StereoRig) -> list[tuple[str | int, ...]]:
    return [wrong.keys for wrong in implausible_rig(one)]


@pytest.mark.parametrize(
    ("base_mm", "cause"),
    [
        (0.06, "m taken for mm (--unit m), or squares of a board taken for mm (--unit N, where one is N mm)?"),
        (2.0, "cm taken for mm (--unit cm), or inch taken for mm (--unit inch), or squares of a board taken for mm"),
        (9.9, "cm taken for mm (--unit cm), or inch taken for mm (--unit inch), or squares"),
        (501.0, "inch taken for m (--unit inch)?"),
        (1000.0, "cm taken for m (--unit cm), or inch taken for m (--unit inch)?"),
        (60_000.0, "mm taken for m (--unit mm)?"),
        (1e7, "a wrong projection matrix?"),
    ],
)
def test_a_baseline_that_no_gripper_has_names_the_units_that_would_make_it_one(base_mm: float, cause: str) -> None:
    assert f"a baseline of {base_mm:g} mm: cameras on a gripper are 10 to 500 mm apart; {cause}" in told(rig(base_mm))
    assert keys(rig(base_mm))[0] == ("right", "cyclopean_from_camera")


@pytest.mark.parametrize("base_mm", [10.0 + 1e-9, 500.0 - 1e-9])
def test_a_baseline_within_its_limits_is_one(base_mm: float) -> None:
    assert "baseline" not in told(rig(base_mm))


@given(cx=st.floats(0.0, 640.0), cy=st.floats(0.0, 480.0))
def test_a_centre_may_be_off_by_14_percent_of_the_image(cx: float, cy: float) -> None:
    off = max(abs(cx + 0.5 - 320.0) / 640.0, abs(cy + 0.5 - 240.0) / 480.0)
    assume(abs(off - 0.14) > 1e-6)
    one = with_left(matrix=matrix(cx=cx, cy=cy))
    assert (f"its centre {cx:.0f}, {cy:.0f} is far from the middle of 640x480 px" in told(one)) == (off > 0.14)
    assert (("left", "camera_matrix") in keys(one)) == (off > 0.14)


@given(st.floats(300.0, 1500.0), st.floats(300.0, 1500.0))
def test_pixels_are_square_within_a_fifth_and_two_cameras_alike_within_its_cube(fx: float, fy: float) -> None:
    usual_px = float(rig().right.matrix[0, 0])
    assume(all(abs(np.log(ratio) / np.log(1.2) - edge) > 1e-6 for ratio in (fx / fy,) for edge in (-1, 1)))
    one = with_left(matrix=matrix(fx=fx, fy=fy))
    assert ("far from square" in told(one)) == (not 1 / 1.2 < fx / fy < 1.2)
    alike = 1.2**-3 < fx / usual_px < 1.2**3
    assert (f"focal lengths of {fx:.0f} and {usual_px:.0f} px: two cameras of a pair are alike" in told(one)) != alike


@given(st.floats(-3.0, 3.0))
def test_a_camera_has_a_skew_of_a_thousandth_at_most(skew: float) -> None:
    one = with_left(matrix=matrix(skew=skew))
    fx = float(one.left.matrix[0, 0])
    assert (f"a skew of {skew:g}: no camera has one" in told(one)) == (abs(skew) > fx / 1000)


@given(st.floats(50.0, 10_000.0))
def test_a_lens_sees_from_6_to_150_degrees(fx: float) -> None:
    view = 2 * np.degrees(np.arctan(320.0 / fx))
    assume(min(abs(view - 6.0), abs(view - 150.0)) > 1e-6)
    one = with_left(matrix=matrix(fx=fx, fy=fx))
    assert (f"is a field of view of {view:.1f} degrees across 640 px" in told(one)) == (not 6.0 < view < 150.0)


@pytest.mark.parametrize("term", [1, 2, 3])
@pytest.mark.parametrize("share", [0.97, 1.03])
def test_each_radial_term_folds_a_lens_where_its_largest_image_lies_within_the_corners(term: int, share: float) -> None:
    """r + k r**n, n = 2 term + 1, is largest where -k n r**(n - 1) = 1, and is there r (n - 1) / n."""
    camera, n = rig().left, 2 * term + 1
    corners = np.array([[x, y] for x in (-0.5, 640.0) for y in (-0.5, 480.0)]) - camera.matrix[:2, 2]
    farthest = float(np.linalg.norm(corners / [camera.matrix[0, 0], camera.matrix[1, 1]], axis=1).max())
    distortion = np.zeros(5)
    distortion[{1: 0, 2: 1, 3: 4}[term]] = -1.0 / n * (share * farthest * n / (n - 1)) ** (1 - n)
    assert ("folds" in told(with_left(distortion=distortion))) == (share < 1)


@given(st.floats(-8.0, 0.5))
def test_a_lens_folds_where_its_largest_image_lies_within_the_corners(k1: float) -> None:
    """r + k1 r**3 is largest at r = 1 / sqrt(-3 k1), where it is two thirds of that."""
    one = with_left(distortion=np.array([k1, 0.0, 0.0, 0.0, 0.0]))
    camera = one.left
    corners = np.array([[x, y] for x in (-0.5, 640.0) for y in (-0.5, 480.0)]) - camera.matrix[:2, 2]
    farthest = float(np.linalg.norm(corners / [camera.matrix[0, 0], camera.matrix[1, 1]], axis=1).max())
    largest = np.inf if k1 >= 0.0 else 2.0 / 3.0 / np.sqrt(-3.0 * k1)
    assume(abs(largest / farthest - 1.0) > 0.02)
    assert ("the image folds within its corners" in told(one)) == (largest < farthest)
    assert (("left", "distortion") in keys(one)) == (largest < farthest)


@pytest.mark.parametrize(("scale", "noticed"), [(0.96, True), (0.98, False), (1.02, False), (1.04, True)])
def test_a_baseline_changes_by_three_percent_at_most(scale: float, noticed: bool) -> None:
    lines = [f"the baseline is {scale:.3g} times what it was: other cameras, or another unit?"] if noticed else []
    assert changed_parameters(rig(60.0 * scale), rig(60.0)) == lines


@pytest.mark.parametrize(("scale", "noticed"), [(0.89, True), (0.91, False), (1.09, False), (1.11, True)])
def test_a_focal_length_changes_by_a_tenth_at_most_as_a_share_of_the_image(scale: float, noticed: bool) -> None:
    one = with_left(matrix=matrix(fx=float(rig().left.matrix[0, 0]) * scale))
    lines = [f"the focal length is {scale:.3g} times what it was: other cameras, or another unit?"] if noticed else []
    assert changed_parameters(one, rig()) == lines
    small = replace(one, image_size=(320, 240), left=replace(one.left, matrix=one.left.matrix / 2))
    assert changed_parameters(small, rig()) == ["images of 320x240 px, 640x480 before", *lines]


@given(st.integers(0, 70), st.integers(0, 70))
def test_a_baseline_may_be_turned_against_rows_and_the_views_apart_by_what_has_a_cosine_of_seven_tenths(
    about_z_deg: int, about_x_deg: int
) -> None:
    one = rig(60.0, 0.0)
    turns = [frames.rotation_from_vector(np.radians(v)) for v in ([0.0, 0.0, about_z_deg], [about_x_deg, 0.0, 0.0])]
    turn = frames.rigid(turns[0] @ turns[1], np.zeros(3))
    right = replace(one.right, cyclopean_from_camera=one.right.cyclopean_from_camera @ turn)
    said = told(replace(one, right=right))
    across, apart = np.cos(np.radians([about_z_deg, about_x_deg])) < 0.7
    assert (f"the baseline is turned by {about_z_deg} degrees against a camera's rows" in said) == across
    assert (f"the cameras look {about_x_deg} degrees apart" in said) == (apart and not across)
