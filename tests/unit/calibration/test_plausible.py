"""Rigs that no hand has are told apart from those that are only unusual, each with its cause."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon import frames
from daemon.calibration.plausible import changed, implausible_rig
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


def with_left(**fields: object) -> StereoRig:
    return replace(rig(), left=replace(rig().left, **fields))


def exchanged() -> StereoRig:
    """As files named in the wrong order give it: the cyclopean frame is turned by 180 degrees."""
    one = rig()
    left_from_right = frames.inverse(one.right.cyclopean_from_camera) @ one.left.cyclopean_from_camera
    right, left = ((eye.matrix, eye.distortion) for eye in (one.right, one.left))
    return rig_of(right, left, left_from_right, one.image_size)


def turned_across() -> StereoRig:
    """One camera above the other."""
    about_z = np.eye(4)
    about_z[:2, :2] = [[0.0, -1.0], [1.0, 0.0]]
    one = rig()
    eyes = {
        name: replace(eye, cyclopean_from_camera=eye.cyclopean_from_camera @ about_z)
        for name, eye in (("left", one.left), ("right", one.right))
    }
    return replace(one, **eyes)


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
    assert changed(rig(), rig()) == []
    assert "baseline" in changed(rig(90.0), rig())[0]
    assert "images of 1280x960" in changed(replace(rig(), image_size=(1280, 960)), rig())[0]
