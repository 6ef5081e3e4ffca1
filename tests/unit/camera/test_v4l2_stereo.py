"""The pair as the cell uses it: fresh pairs, and a clear word and a fresh start after everything that can go wrong."""

from __future__ import annotations

import errno
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from drivers.camera import v4l2
from drivers.camera.pair import CameraError
from drivers.camera.settings import CameraSettings
from drivers.camera.v4l2_stereo import V4L2StereoCamera
from tests.fakes.pretend_video import Arrival, PretendControl, PretendDevice, PretendSystem

PERIOD_S = 0.1
SETTINGS = CameraSettings("left", "right", 8, 4, fps=10.0)


def frames(first_s: float, count: int, value: int = 0, **more: object) -> list[Arrival]:
    """`count` frames, each filled with value + its number."""
    return [
        Arrival(first_s + k * PERIOD_S, bytes([(value + k) % 256]) * 32, k, **more)  # type: ignore[arg-type]
        for k in range(count)
    ]


def machine(right_late_s: float = 0.004, count: int = 60) -> PretendSystem:
    left = PretendDevice("left", schedule=frames(100.02, count))
    right = PretendDevice("right", schedule=frames(100.02 + right_late_s, count, 100))
    return PretendSystem({"/dev/video0": left, "/dev/video1": right})


def camera(system: PretendSystem, settings: CameraSettings = SETTINGS) -> V4L2StereoCamera:
    nodes: Any = system
    return V4L2StereoCamera(settings, system.clock, nodes)


def test_a_pair_is_two_frames_of_one_moment_with_the_kernels_times_and_numbers() -> None:
    system = machine()
    pair = camera(system).grab(system.now_s, 2.0)
    assert pair.left.sequence == pair.right.sequence
    assert pair.skew_ms == pytest.approx(4.0)
    assert np.all(pair.left.pixels == pair.left.sequence)
    assert np.all(pair.right.pixels == 100 + pair.right.sequence)
    assert pair.left.pixels.shape == (4, 8)


def test_no_light_in_a_pair_is_older_than_the_end_of_the_last_motion() -> None:
    system = machine()
    cameras = camera(system)
    cameras.open()
    for rest_s in (100.5, 101.234, 102.9):
        system.now_s = rest_s  # frames queue up and overflow meanwhile
        pair = cameras.grab(rest_s, 2.0)
        assert min(pair.left.taken_s, pair.right.taken_s) - PERIOD_S / 2 >= rest_s
        assert system.now_s - rest_s <= 2 * PERIOD_S + 0.01


def test_of_several_waiting_pairs_the_newest_is_given() -> None:
    system = machine()
    cameras = camera(system)
    cameras.grab(0.0, 1.0)
    system.now_s = 100.34
    assert cameras.grab(0.0, 1.0).left.sequence == 3
    system.now_s = 103.0  # more frames than buffers: those that wait are the oldest
    assert cameras.grab(0.0, 1.0).left.taken_s > 102.9


def test_frames_that_were_lost_between_looks_are_counted() -> None:
    system = machine()
    cameras = camera(system)
    cameras.grab(100.0, 1.0)
    system.now_s += 3.0
    cameras.grab(system.now_s, 1.0)
    assert cameras.rows()[0]["dropped"] > 10


def test_half_a_frame_is_looked_past_and_counted() -> None:
    system = machine()
    system.devices["/dev/video0"].schedule[1].data = bytes(16)
    system.devices["/dev/video0"].schedule[2].flags |= v4l2.BUFFER_ERROR
    cameras = camera(system)
    pair = cameras.grab(100.0, 1.0)
    assert pair.left.sequence == 3
    assert cameras.rows()[0]["damaged"] == 2


def test_a_camera_that_only_delivers_halves_says_so() -> None:
    system = machine()
    for frame in system.devices["/dev/video1"].schedule:
        frame.data = bytes(16)
    with pytest.raises(
        CameraError, match=r"no frame from the right camera; right: \d+ damaged frames, the last 16 of 32"
    ):
        camera(system).grab(100.0, 1.0)


def test_a_jpeg_that_cannot_be_decoded_is_looked_past() -> None:
    import cv2

    good = cv2.imencode(".jpg", np.full((4, 8), 90, np.uint8))[1].tobytes()
    system = machine()
    for device in system.devices.values():
        device.formats = {"MJPG": [(8, 4)]}
        for frame in device.schedule:
            frame.data = good
    system.devices["/dev/video0"].schedule[1].data = good[:40]
    cameras = camera(system)
    assert np.all(cameras.grab(100.0, 1.0).left.pixels == 90)
    assert cameras.rows()[0]["damaged"] == 1


def test_a_stalled_camera_is_named_and_both_devices_are_let_go() -> None:
    system = machine()
    system.devices["/dev/video1"].schedule.clear()
    with pytest.raises(
        CameraError, match=r"within 0\.5 s from /dev/video0 `left` and /dev/video1 `right`: no frame from"
    ):
        camera(system).grab(100.0, 0.5)
    assert [d.opened for d in system.devices.values()] == [0, 0]
    assert system.now_s == pytest.approx(100.5)


def test_after_a_stall_the_next_grab_starts_the_streams_again() -> None:
    system = machine()
    right = system.devices["/dev/video1"]
    later, right.schedule = right.schedule, []
    cameras = camera(system)
    with pytest.raises(CameraError):
        cameras.grab(100.0, 0.5)
    right.schedule = later
    assert abs(cameras.grab(system.now_s, 2.0).skew_ms) < 20


def test_an_unplugged_camera_is_said_at_once_and_found_again_under_its_new_number() -> None:
    system = machine(count=200)
    cameras = camera(system)
    cameras.grab(100.0, 1.0)
    gone = system.devices.pop("/dev/video1")
    before_s = system.now_s
    with pytest.raises(CameraError, match="right camera /dev/video1 is gone"):
        cameras.grab(system.now_s, 5.0)
    assert system.now_s - before_s < 0.2
    with pytest.raises(CameraError, match="right camera `right` is not there; there is: /dev/video0 `left`"):
        cameras.grab(system.now_s, 5.0)
    system.devices["/dev/video4"] = PretendDevice("right", schedule=gone.schedule)
    pair = cameras.grab(system.now_s, 2.0)
    assert abs(pair.skew_ms) < 20
    assert "/dev/video4" in cameras.describe()


@pytest.mark.parametrize(
    ("number", "words"),
    [(errno.EACCES, "permission denied: add this user to the group `video`"), (errno.EBUSY, r"ffmpeg \(4711\) has it")],
)
def test_a_device_that_cannot_be_opened_says_what_to_do(number: int, words: str) -> None:
    system = machine()
    system.open_fails["/dev/video0"] = number
    with pytest.raises(CameraError, match=words):
        camera(system, replace(SETTINGS, left="0")).open()


def test_a_device_that_streams_to_another_program_is_busy_and_the_other_camera_is_let_go() -> None:
    system = machine()
    system.devices["/dev/video1"].fails[v4l2.REQBUFS] = errno.EBUSY
    with pytest.raises(CameraError, match=r"right camera /dev/video1 is busy: ffmpeg \(4711\) has it; stop that first"):
        camera(system).open()
    assert [d.opened for d in system.devices.values()] == [0, 0]


def test_two_cameras_that_do_not_fit_on_one_usb_controller_are_told_how_to_fit() -> None:
    system = machine()
    system.devices["/dev/video1"].fails[v4l2.STREAMON] = errno.ENOSPC
    with pytest.raises(
        CameraError, match=r"right camera /dev/video1: the USB controller lacks the bandwidth .* MJPEG first"
    ):
        camera(system).open()
    assert [d.opened for d in system.devices.values()] == [0, 0]


def test_a_wish_that_no_format_meets_is_refused_with_what_the_device_offers() -> None:
    system = machine()
    system.devices["/dev/video0"].formats = {"YUYV": [(4, 4), (16, 8)], "H264": [(8, 4)]}
    with pytest.raises(CameraError, match=r"cannot give 8x4 in GREY, .*; it offers: YUYV 4x4, 16x8; H264 8x4"):
        camera(system).open()


def test_the_first_format_of_the_wish_that_has_the_size_is_taken() -> None:
    system = machine()
    for device in system.devices.values():
        device.formats = {"YUYV": [(8, 4)], "GREY": [(4, 4)], "NV12": [(8, 4)]}
    cameras = camera(system, replace(SETTINGS, formats=("GREY", "NV12", "YUYV")))
    cameras.open()
    assert "NV12 8x4" in cameras.describe()


def test_padded_rows_are_cut() -> None:
    system = machine()
    for device in system.devices.values():
        device.padding = 3
        for frame in device.schedule:
            frame.data = b"".join(bytes([7] * 8 + [200] * 3) for _ in range(4))
    assert np.all(camera(system).grab(100.0, 1.0).left.pixels == 7)


def test_a_node_that_has_ceased_to_capture_is_told_apart_from_one_that_is_gone() -> None:
    system = machine()
    system.devices["/dev/video0"].captures = False
    with pytest.raises(CameraError, match=r"/dev/video0 `left` does not capture video"):
        camera(system, replace(SETTINGS, left="0")).open()


def test_stamps_of_a_clock_that_the_driver_does_not_name_count_once_they_fit_the_streams_own_time() -> None:
    system = machine(right_late_s=0.015)
    for device in system.devices.values():
        for frame in device.schedule:
            frame.flags = v4l2.BUFFER_CLOCK_UNKNOWN
    cameras = camera(system)
    assert cameras.grab(100.0, 2.0).skew_ms == pytest.approx(15.0)
    system.now_s = 100.34
    assert cameras.grab(100.1, 2.0).left.sequence == 3  # had waited, and is known to be fresh enough


def test_a_device_whose_stamps_are_of_another_clock_never_passes_off_an_old_frame_as_new() -> None:
    system = machine()
    for device in system.devices.values():
        for frame in device.schedule:
            frame.flags, frame.stamp_s = 0, 5.0
    cameras = camera(system)
    cameras.open()
    system.now_s = 102.0
    pair = cameras.grab(102.0, 2.0)
    assert pair.left.sequence > 20


def test_a_stamp_that_is_ahead_of_the_time_it_is_read_at_says_nothing_whatever_clock_it_is_said_to_be_of() -> None:
    """What cameras stamp themselves is reckoned into the computer's time by the driver, and now and then far off."""
    system = machine()
    for device in system.devices.values():
        for frame in device.schedule:
            frame.stamp_s = frame.at_s + 1.0
    cameras = camera(system)
    cameras.open()
    cameras.grab(100.0, 2.0)
    system.now_s = 100.34
    assert cameras.grab(100.34, 2.0).left.sequence == 5, "the first that was exposed wholly after that"


def test_a_frame_that_waited_with_a_stamp_ahead_of_the_time_is_of_no_known_age_and_not_looked_at() -> None:
    system = machine()
    for device in system.devices.values():
        device.schedule[3].stamp_s = 102.0
    cameras = camera(system)
    cameras.grab(100.0, 2.0)
    system.now_s = 100.41
    for device in system.devices.values():
        device.advance(100.39)
        device.schedule = [frame for frame in device.schedule if frame.sequence > 4]
    assert cameras.grab(100.25, 2.0).left.sequence == 5, "not 3, which came at 100.32 and was exposed since 100.22"


def test_wished_controls_are_set_on_both_cameras_and_reported() -> None:
    system = machine()
    for device in system.devices.values():
        device.controls[0x00980913] = PretendControl("Gain", 0, 255, 0)
    cameras = camera(system, replace(SETTINGS, controls={"gain": 32}))
    cameras.open()
    assert [row["controls"] for row in cameras.rows()] == [{"gain": 32}, {"gain": 32}]


def exposed(**wishes: float) -> tuple[object, list[int]]:
    """What twice the light left and half of it right comes to, and what the devices' exposure is then."""
    system = machine()
    for device in system.devices.values():
        device.controls[0x009A0902] = PretendControl("Exposure Time, Absolute", 3, 2047, 100)
    cameras = camera(system, replace(SETTINGS, controls=wishes))
    cameras.open()
    took = cameras.expose(2.0, 0.5)
    return took, [device.controls[0x009A0902].value for device in system.devices.values()]


def test_each_camera_gathers_as_much_more_light_as_it_is_told() -> None:
    assert exposed() == ((2.0, 0.5), [200, 50])


def test_an_exposure_that_the_operator_has_set_is_his() -> None:
    assert exposed(exposure_us=5000) == (None, [50, 50])


def test_cameras_without_exposure_or_gain_say_that_there_is_nothing_to_set() -> None:
    cameras = camera(machine())
    cameras.open()
    assert cameras.expose(2.0, 0.5) is None


def test_closing_twice_is_safe_and_frees_the_devices() -> None:
    system = machine()
    cameras = camera(system)
    cameras.open()
    cameras.open()
    assert [d.opened for d in system.devices.values()] == [1, 1]
    cameras.close()
    cameras.close()
    assert [d.opened for d in system.devices.values()] == [0, 0]
    assert cameras.describe() == "closed: left `left`, right `right`"


def test_waiting_for_a_pair_sleeps_instead_of_spinning() -> None:
    system = machine()
    camera(system).grab(101.5, 5.0)
    assert system.waits < 60


@pytest.mark.parametrize(
    ("wrong", "words"),
    [({"formats": ("RGB3",)}, "found RGB3"), ({"formats": ()}, "none")],
)
def test_settings_that_no_camera_could_meet_are_refused(wrong: dict[str, object], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        replace(SETTINGS, **wrong)  # type: ignore[arg-type]


def test_one_camera_alone_gives_its_frame_twice_and_the_other_device_is_not_touched() -> None:
    system = machine()
    del system.devices["/dev/video1"]
    cameras = camera(system, replace(SETTINGS, right=None))
    pair = cameras.grab(system.now_s, 2.0)
    assert pair.left is pair.right
    with pytest.raises(CameraError, match="names only left"):
        cameras.use(None)


def test_a_camera_that_is_torn_off_keeps_nobody_from_looking_with_the_other_and_is_opened_again_for_both() -> None:
    system = machine()
    cameras, torn = camera(system), system.devices.pop("/dev/video0")
    with pytest.raises(CameraError, match="left camera"):
        cameras.grab(system.now_s, 0.5)
    cameras.use("right")
    alone = cameras.grab(system.now_s, 0.5)
    assert alone.left is alone.right
    assert np.all(alone.left.pixels >= 100)
    system.devices["/dev/video0"] = torn
    cameras.use(None)
    assert cameras.grab(system.now_s, 2.0).left.pixels.max() < 100


def test_a_lone_camera_that_falls_silent_is_the_only_one_that_is_named() -> None:
    system = machine(count=3)
    cameras = camera(system)
    cameras.use("left")
    with pytest.raises(CameraError, match="no picture within") as told:
        cameras.grab(system.now_s + 10.0, 11.0)
    assert "right" not in str(told.value)


def test_settings_without_any_camera_are_refused() -> None:
    with pytest.raises(ValueError, match="expected a camera"):
        CameraSettings()
