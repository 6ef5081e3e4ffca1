"""A camera is prepared once: whatever was made is kept for whoever asks next."""

from __future__ import annotations

import numpy as np
import pytest

from daemon.vision.image.grey import VisionError
from daemon.vision.image.segments import find_segments
from daemon.vision.image.stereo_images import CameraImage, fitted_outlines, open_stereo, outlines_near
from daemon.vision.settings import VisionSettings
from tests.fakes.painted import paint_pair
from tests.fakes.printed import print_pair, straight_rig
from tests.fakes.rigs import rig
from tests.fakes.solids import CUBE, pose


def cube_seen() -> CameraImage:
    direction = np.array([0.45, 0.6, -0.66])
    return open_stereo(*paint_pair([(CUBE, pose(direction, 0.4))], np.random.default_rng(11)), rig()).left


def test_outlines_and_what_was_fitted_to_them_are_kept() -> None:
    view, brief = cube_seen(), VisionSettings().coarse()
    (outlines,) = outlines_near([(view, view.rough(brief))], brief)
    first = fitted_outlines([(view, outlines)])[0]
    assert len(outlines) >= 3
    assert view.rough(brief) is view.rough(brief)
    assert outlines_near([(view, view.rough(brief))], brief) == [outlines]
    assert all(a is b for a, b in zip(fitted_outlines([(view, outlines)])[0], first, strict=True))


def test_a_part_on_a_plain_table_is_uncluttered_and_a_patterned_table_is_not() -> None:
    assert cube_seen().uncluttered(VisionSettings())
    patterned = print_pair(CUBE, pose(np.array([0.45, 0.6, -0.66]), 0.4), speckled=True)
    assert not open_stereo(*patterned, straight_rig()).left.uncluttered(VisionSettings())


def test_nothing_is_measured_before_it_is_asked_for_and_nothing_twice() -> None:
    view = cube_seen()
    assert not {"noise", "smooth", "exposure"} & set(vars(view))
    assert view.smooth is view.smooth
    assert view.scale(2) is view.scale(2)


def test_a_camera_that_sees_nothing_is_not_smoothed() -> None:
    grey = np.random.default_rng(2).normal(120, 2, (480, 640)).round().astype(np.uint8)
    view = CameraImage(cube_seen().rectified, grey)
    assert view.rough(VisionSettings()) == []
    assert "smooth" not in vars(view)


def test_segments_are_where_they_are_in_the_image_and_sought_near_edges_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    view, searched = cube_seen(), list[int]()
    every = find_segments(view.grey)

    def noted(grey: np.ndarray) -> object:
        searched.append(grey.size)
        return find_segments(grey)

    monkeypatch.setattr("daemon.vision.image.stereo_images.find_segments", noted)
    found = view.segments
    assert searched[0] < 0.5 * view.grey.size
    for start, end in zip(every.start[:5], every.end[:5], strict=True):
        assert np.hypot(*(found.start - start).T).min() < 2.5
        assert np.hypot(*(found.end - end).T).min() < 2.5


def test_a_camera_that_sees_nothing_has_no_segments() -> None:
    grey = np.random.default_rng(2).normal(120, 2, (480, 640)).round().astype(np.uint8)
    assert len(CameraImage(cube_seen().rectified, grey).segments.start) == 0


def test_a_pair_of_another_size_than_calibrated_is_refused() -> None:
    with pytest.raises(VisionError, match="right image: expected 640x480"):
        open_stereo(np.zeros((480, 640), np.uint8), np.zeros((300, 640), np.uint8), rig())
