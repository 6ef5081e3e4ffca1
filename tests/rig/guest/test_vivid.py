"""In the guest: the kernel's own test cameras, which have controls, can be busy, be unplugged and be made to fail."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from pathlib import Path

import loopback
import pytest

from drivers.camera import controls, v4l2
from drivers.camera.find import find, list_devices
from drivers.camera.node import LINUX, FileNode
from drivers.camera.pair import CameraError
from drivers.camera.settings import CameraSettings
from drivers.camera.v4l2_stereo import V4L2StereoCamera

SIZE = {"width": 320, "height": 180, "fps": 15.0, "max_skew_ms": 60.0}


@pytest.fixture(scope="module", autouse=True)
def two_devices() -> Iterator[None]:
    loopback.modprobe("vivid", "n_devs=2", "node_types=0x1,0x1")
    yield
    loopback.modprobe("-r", "vivid")


@pytest.fixture
def camera() -> Iterator[V4L2StereoCamera]:
    cameras = V4L2StereoCamera(CameraSettings("0", "1", **SIZE))  # type: ignore[arg-type]
    yield cameras
    cameras.close()


def press(name: str, path: str = "/dev/video1") -> None:
    """Push one of vivid's buttons for trouble."""
    node = FileNode(path)
    try:
        button = next(c for c in controls.list_controls(node) if c.name == name)
        v4l2.set_control(node, button.id, 1)
    finally:
        node.close()


def test_two_cameras_of_one_card_name_are_refused_with_what_tells_them_apart(camera: V4L2StereoCamera) -> None:
    with pytest.raises(CameraError, match=r"2 devices are called `vivid`; name one by its path: .*by-path"):
        V4L2StereoCamera(CameraSettings("vivid", "vivid", **SIZE)).open()  # type: ignore[arg-type]
    assert camera.grab(time.monotonic(), 20.0).left.pixels.shape == (180, 320)


def test_a_name_under_by_path_leads_to_its_device() -> None:
    link = next(Path("/dev/v4l/by-path").iterdir())
    assert find(link.name, "left", LINUX) == find(str(link), "left", LINUX) == os.path.realpath(link)


def test_the_listing_shows_formats_sizes_rates_and_controls() -> None:
    devices, notes = list_devices(LINUX)
    assert notes == []
    first = devices[0]
    offered = {offer.code: " ".join(offer.sizes) for offer in first.formats}
    assert {"GREY", "Y16", "YUYV"} <= set(offered)
    assert "320x180" in offered["GREY"]
    assert "fps" in offered["GREY"]
    assert {"brightness", "gain", "gain_automatic"} <= {c.name for c in first.controls}


def test_gain_is_locked_and_reads_back() -> None:
    cameras = V4L2StereoCamera(CameraSettings("0", "1", **SIZE, controls={"gain": 77, "brightness": 99}))  # type: ignore[arg-type]
    cameras.open()
    try:
        for row in cameras.rows():
            assert row["controls"] == {"gain_automatic": 0, "gain": 77, "brightness": 99}
    finally:
        cameras.close()


def test_more_light_is_asked_of_both_devices_at_once_by_gain_where_there_is_no_exposure() -> None:
    """vivid's picture does not follow its gain: what is proven is that the kernel takes it and reads it back."""
    cameras = V4L2StereoCamera(CameraSettings("0", "1", **SIZE))  # type: ignore[arg-type]
    nodes = [FileNode(path) for path in ("/dev/video0", "/dev/video1")]
    try:
        for node in nodes:
            controls.apply(node, "either", {"gain": 100})
        cameras.open()
        assert cameras.expose(0.5, 2.0) == (0.5, 2.0)
        assert [v4l2.get_control(node, controls.KNOWN["gain"].control) for node in nodes] == [50, 200]
        assert cameras.expose(1.0, 9.0) == (1.0, 255 / 200)
        cameras.grab(time.monotonic(), 20.0)
    finally:
        cameras.close()
        for node in nodes:
            node.close()


def test_an_exposure_the_device_does_not_have_is_refused_with_what_it_has() -> None:
    wish = CameraSettings("0", "1", **SIZE, controls={"exposure_us": 10_000})  # type: ignore[arg-type]
    with pytest.raises(CameraError, match=r"cannot set exposure_us.*It offers: .*brightness 0\.\.255"):
        V4L2StereoCamera(wish).open()


def test_a_size_the_device_does_not_have_is_refused_with_those_it_has() -> None:
    with pytest.raises(CameraError, match=r"cannot give 333x222 .*; it offers: .*GREY 320x180 \("):
        V4L2StereoCamera(CameraSettings("0", "1", width=333, height=222)).open()


def test_a_camera_that_another_program_streams_from_is_busy_and_the_program_is_named(camera: V4L2StereoCamera) -> None:
    camera.open()
    with pytest.raises(CameraError, match=r"left camera /dev/video0 is busy: \S+ \(\d+\) has it; stop that first"):
        V4L2StereoCamera(CameraSettings("0", "1", **SIZE)).open()  # type: ignore[arg-type]


def test_a_frame_the_driver_marks_as_damaged_is_looked_past(camera: V4L2StereoCamera) -> None:
    camera.grab(time.monotonic(), 20.0)
    press("inject_v4l2_buf_flag_error")
    for _ in range(3):
        camera.grab(time.monotonic(), 20.0)
    assert camera.rows()[1]["damaged"] == 1


@pytest.mark.parametrize("trouble", ["disconnect", "inject_fatal_streaming_error"])
def test_a_camera_that_fails_in_mid_stream_is_said_and_taken_up_again(camera: V4L2StereoCamera, trouble: str) -> None:
    camera.grab(time.monotonic(), 20.0)
    press(trouble)
    with pytest.raises(CameraError, match=r"(left|right) camera /dev/video\d is gone"):
        camera.grab(time.monotonic(), 5.0)
    assert camera.grab(time.monotonic(), 20.0).left.pixels.shape == (180, 320)
