"""A folder of pairs is a camera: both layouts, in order, and a plain word when it is empty, half or at its end."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from drivers.camera.pair import CameraError
from drivers.camera.recorded import RecordedCamera


def save(path: Path, value: int) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), np.full((4, 6), value, np.uint8))


def test_folders_of_left_and_right_come_in_the_order_of_their_numbers(tmp_path: Path) -> None:
    for k in (10, 9, 2):
        save(tmp_path / f"look-{k}" / "left.png", k)
        save(tmp_path / f"look-{k}" / "right.png", 100 + k)
    cameras = RecordedCamera(tmp_path, clock=lambda: 5.0)
    cameras.open()
    pairs = [cameras.grab(0.0, 1.0) for _ in range(3)]
    assert [int(p.left.pixels[0, 0]) for p in pairs] == [2, 9, 10]
    assert [int(p.right.pixels[0, 0]) for p in pairs] == [102, 109, 110]
    assert pairs[0].skew_ms == 0.0


def test_a_runs_images_are_a_camera_too_and_can_begin_again(tmp_path: Path) -> None:
    for k in (1, 2):
        save(tmp_path / f"{k}-left.png", k)
        save(tmp_path / f"{k}-right.png", k)
    cameras = RecordedCamera(tmp_path, again=True)
    assert [int(cameras.grab(0.0, 1.0).left.pixels[0, 0]) for _ in range(3)] == [1, 2, 1]
    once = RecordedCamera(tmp_path)
    for _ in range(2):
        once.grab(0.0, 1.0)
    with pytest.raises(CameraError, match="has no more than 2"):
        once.grab(0.0, 1.0)


def test_a_recorded_pair_counts_as_taken_after_the_arm_came_to_rest(tmp_path: Path) -> None:
    save(tmp_path / "left.png", 1)
    save(tmp_path / "right.png", 1)
    assert RecordedCamera(tmp_path, clock=lambda: 5.0).grab(7.0, 1.0).left.taken_s == 7.0


def test_what_is_missing_or_no_image_is_said_with_its_path(tmp_path: Path) -> None:
    with pytest.raises(CameraError, match="nowhere is not a folder"):
        RecordedCamera(tmp_path / "nowhere").open()
    with pytest.raises(CameraError, match=r"contains neither PAIR/left\.png nor PAIR-left\.png"):
        RecordedCamera(tmp_path).open()
    save(tmp_path / "left.png", 1)
    with pytest.raises(CameraError, match=r"right\.png is missing"):
        RecordedCamera(tmp_path).open()
    (tmp_path / "right.png").write_bytes(b"rubbish")
    with pytest.raises(CameraError, match=r"right\.png is not an image"):
        RecordedCamera(tmp_path).grab(0.0, 1.0)
