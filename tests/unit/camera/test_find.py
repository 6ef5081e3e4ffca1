"""Which device a name means, and what a listing shows."""

from __future__ import annotations

import errno
from typing import Any

import pytest

from drivers.camera import v4l2
from drivers.camera.find import find, list_devices
from drivers.camera.pair import CameraError
from tests.fakes.pretend_video import PretendControl, PretendDevice, PretendSystem

GAIN = 0x00980913
LEFT, RIGHT = (
    "/dev/v4l/by-path/pci-0000:00:14.0-usb-0:1:1.0-video-index0",
    "/dev/v4l/by-id/usb-Maker_Cam_0042-video-index0",
)


def machine(*about: Any) -> Any:
    return PretendSystem(*about)


def two_cameras() -> Any:
    devices = {
        "/dev/video0": PretendDevice("Cam"),
        "/dev/video1": PretendDevice("Cam", captures=False),
        "/dev/video2": PretendDevice("Other"),
    }
    return machine(devices, {LEFT: "/dev/video0", RIGHT: "/dev/video2"})


@pytest.mark.parametrize(
    ("name", "path"),
    [("0", "/dev/video0"), ("/dev/video2", "/dev/video2"), ("Other", "/dev/video2"), ("Cam", "/dev/video0"),
     (LEFT, "/dev/video0"), (RIGHT.rpartition("/")[2], "/dev/video2")],
)  # fmt: skip
def test_number_path_link_and_card_name_all_lead_to_the_device(name: str, path: str) -> None:
    assert find(name, "left", two_cameras()) == path


def test_a_stable_name_follows_a_device_that_comes_back_under_another_number() -> None:
    system = two_cameras()
    system.devices["/dev/video7"] = system.devices.pop("/dev/video2")
    system.names[RIGHT] = "/dev/video7"
    assert find("Other", "right", system) == "/dev/video7"
    assert find(RIGHT, "right", system) == "/dev/video7"


def test_two_devices_of_one_card_name_are_refused_with_the_paths_that_tell_them_apart() -> None:
    system = two_cameras()
    system.devices["/dev/video2"].card = "Cam"
    with pytest.raises(CameraError, match=r"2 devices are called `Cam`; name one by its path: .*by-path.*by-id"):
        find("Cam", "left", system)


def test_a_name_that_is_not_there_is_refused_with_what_is() -> None:
    system = two_cameras()
    system.open_fails["/dev/video2"] = errno.EACCES
    with pytest.raises(
        CameraError, match=r"left camera `C920` is not there; there is: /dev/video0 `Cam` .*Permission denied"
    ):
        find("C920", "left", system)
    with pytest.raises(CameraError, match="no video device at all"):
        find("C920", "left", machine({}))


def test_a_device_that_fails_while_it_is_listed_is_noted_and_not_taken_for_one_that_offers_nothing() -> None:
    system = two_cameras()
    system.devices["/dev/video0"].fails[v4l2.ENUM_FMT] = errno.EIO
    system.devices["/dev/video2"].fails[v4l2.QUERYCTRL] = errno.ENODEV
    devices, notes = list_devices(system)
    assert devices == []
    assert notes == ["/dev/video0: Input/output error", "/dev/video2: No such device"]


def test_the_listing_has_every_capture_node_with_formats_and_controls_and_no_other() -> None:
    system = two_cameras()
    system.devices["/dev/video0"].controls[GAIN] = PretendControl("Gain", 0, 255, 7)
    devices, notes = list_devices(system)
    assert [d.path for d in devices] == ["/dev/video0", "/dev/video2"]
    assert notes == []
    assert str(devices[0].formats[0]) == "GREY 8x4"
    assert str(devices[0].controls[0]) == "gain 0..255 (now 7)"
    assert all(device.opened == 0 for device in system.devices.values())
