"""Wished controls are applied and read back; names find their device wherever it is; refusals say what there is."""

from __future__ import annotations

import errno

import pytest

from drivers.camera import controls
from drivers.camera.find import find, list_devices
from drivers.camera.pair import CameraError
from tests.worlds.pretend_video import PretendControl, PretendDevice, PretendNode, PretendSystem

EXPOSURE, EXPOSURE_AUTO, GAIN, FOCUS, FOCUS_AUTO = 0x009A0902, 0x009A0901, 0x00980913, 0x009A090A, 0x009A090C


def webcam(**more: PretendControl) -> PretendNode:
    offered = {
        EXPOSURE_AUTO: PretendControl("Auto Exposure", 0, 3, 3, menu={1: "Manual Mode", 3: "Aperture Priority Mode"}),
        EXPOSURE: PretendControl("Exposure Time, Absolute", 3, 2047, 250),
        GAIN: PretendControl("Gain", 0, 255, 0, step=4),
        FOCUS: PretendControl("Focus, Absolute", 0, 250, 0, step=5),
        FOCUS_AUTO: PretendControl("Focus, Automatic Continuous", 0, 1, 1),
    }
    device = PretendDevice("webcam", controls=offered | {int(k): v for k, v in more.items()})
    return PretendNode(device, PretendSystem({"/dev/video0": device}))


def test_a_wished_exposure_turns_the_automatism_off_and_is_set_in_the_devices_unit() -> None:
    node = webcam()
    took = controls.apply(node, "left", {"exposure_us": 12_500})
    assert took == {"auto_exposure": 1, "exposure_time_absolute": 125}
    assert controls.exposure_s(node) == pytest.approx(0.0125)


def test_a_value_between_the_devices_steps_is_taken_as_the_device_rounds_it() -> None:
    assert controls.apply(webcam(), "left", {"gain": 18})["gain"] == 16


def test_any_other_control_goes_by_the_name_that_the_listing_gives() -> None:
    assert controls.apply(webcam(), "left", {"focus_absolute": 100}) == {"focus_absolute": 100}


def test_a_value_out_of_range_is_refused_with_the_range() -> None:
    with pytest.raises(
        CameraError, match=r"left camera: cannot set gain to 300: the device offers gain 0\.\.255 step 4"
    ):
        controls.apply(webcam(), "left", {"gain": 300})
    with pytest.raises(CameraError, match=r"exposure_us to 100 \(1 in the device's unit\).*3\.\.2047"):
        controls.apply(webcam(), "left", {"exposure_us": 100})


def test_a_menu_refuses_a_line_it_does_not_have_and_says_which_it_has() -> None:
    with pytest.raises(CameraError, match="1 = Manual Mode, 3 = Aperture Priority Mode"):
        controls.apply(webcam(), "left", {"auto_exposure": 2})


def test_a_control_that_is_not_there_is_refused_with_those_that_are() -> None:
    with pytest.raises(
        CameraError, match=r"right camera: cannot set white_balance_k.*It offers: .*focus_absolute 0\.\.250"
    ):
        controls.apply(webcam(), "right", {"white_balance_k": 4000})


def test_a_control_that_reads_back_another_value_is_trouble() -> None:
    node = webcam()
    node.device.controls[GAIN].stuck_at = 90
    with pytest.raises(CameraError, match="gain was set to 16 but reads back 90"):
        controls.apply(node, "left", {"gain": 16})


def test_an_automatism_runs_between_looks_and_holds_still_during_one() -> None:
    node, wishes = webcam(), {"exposure_us": "auto"}
    exposure, automatic = node.device.controls[EXPOSURE], node.device.controls[EXPOSURE_AUTO]
    controls.apply(node, "left", wishes)
    exposure.value = 77  # what the camera found
    controls.hold(node, wishes)
    assert (automatic.value, exposure.value) == (1, 77)
    controls.release(node, wishes)
    assert automatic.value == 3


def test_a_camera_with_only_the_full_automatism_gets_that_one() -> None:
    node = webcam()
    node.device.controls[EXPOSURE_AUTO] = PretendControl("Auto Exposure", 0, 1, 1, menu={0: "Auto", 1: "Manual"})
    assert controls.apply(node, "left", {"exposure_us": "auto"}) == {"auto_exposure": 0}


LEFT, RIGHT = (
    "/dev/v4l/by-path/pci-0000:00:14.0-usb-0:1:1.0-video-index0",
    "/dev/v4l/by-id/usb-Maker_Cam_0042-video-index0",
)


def two_cameras() -> PretendSystem:
    devices = {
        "/dev/video0": PretendDevice("Cam"),
        "/dev/video1": PretendDevice("Cam", captures=False),
        "/dev/video2": PretendDevice("Other"),
    }
    return PretendSystem(devices, {LEFT: "/dev/video0", RIGHT: "/dev/video2"})


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
        find("C920", "left", PretendSystem({}))


def test_the_listing_has_every_capture_node_with_formats_and_controls_and_no_other() -> None:
    system = two_cameras()
    system.devices["/dev/video0"].controls[GAIN] = PretendControl("Gain", 0, 255, 7)
    devices, notes = list_devices(system)
    assert [d.path for d in devices] == ["/dev/video0", "/dev/video2"]
    assert notes == []
    assert str(devices[0].formats[0]) == "GREY 8x4"
    assert str(devices[0].controls[0]) == "gain 0..255 (now 7)"
    assert all(device.opened == 0 for device in system.devices.values())
