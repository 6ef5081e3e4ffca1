"""Wishes made true on a device's controls, or refused with what it offers."""

from __future__ import annotations

import pytest

from drivers.camera import controls
from drivers.camera.pair import CameraError
from tests.fakes.pretend_video import PretendControl, PretendDevice, PretendNode, PretendSystem

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


def test_more_light_is_gathered_by_exposure_with_its_automatism_off_and_never_longer_than_a_frame() -> None:
    node = webcam()
    assert controls.brighten(node, "left", 1.5, 0.066) == pytest.approx(1.5)
    assert controls.exposure_s(node) == pytest.approx(0.0375)
    assert {c.name: c.value for c in controls.list_controls(node)}["auto_exposure"] == 1, "manual"
    assert controls.brighten(node, "left", 8.0, 0.066) == pytest.approx(660 / 375, rel=0.01)
    assert controls.exposure_s(node) == pytest.approx(0.066)
    assert controls.brighten(node, "left", 1e-4, 0.066) == pytest.approx(3 / 660)


def test_gain_stands_in_where_a_camera_has_no_exposure_and_nothing_where_it_has_neither() -> None:
    device = PretendDevice("tester", controls={GAIN: PretendControl("Gain", 0, 255, 100)})
    node = PretendNode(device, PretendSystem({"/dev/video0": device}))
    assert controls.brighten(node, "left", 0.5, 0.066) == pytest.approx(0.5)
    assert controls.brighten(node, "left", 10.0, 0.066) == pytest.approx(255 / 50)
    device.controls.clear()
    assert controls.brighten(node, "left", 2.0, 0.066) is None


def test_a_control_goes_by_the_name_it_had_before_linux_5_16_and_by_the_new_one_on_an_older_kernel() -> None:
    node, wishes = webcam(), {"exposure_auto": 1, "focus_auto": 0}
    took = controls.apply(node, "left", wishes)
    assert took == {"auto_exposure": 1, "focus_automatic_continuous": 0}
    assert controls.renamed(wishes, took) == {
        "exposure_auto": "auto_exposure",
        "focus_auto": "focus_automatic_continuous",
    }
    node.device.controls[EXPOSURE_AUTO] = PretendControl("Exposure, Auto", 0, 3, 3, menu={1: "Manual", 3: "Aperture"})
    assert controls.apply(node, "left", {"auto_exposure": 1}) == {"exposure_auto": 1}
