"""`calibrate` looks whether its result can be kept before the arm is moved, and says how far the arm errs."""

from __future__ import annotations

import asyncio
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml

from daemon import frames
from daemon.arm import InWorld, OnHand
from daemon.calibration.arm_error import ArmError
from daemon.calibration.file import load_calibration
from daemon.calibration.session import CalibrationSession, VerificationResult
from daemon.commands import calibrating, every_command
from daemon.commands.calibrating import arm_line, grasp_lines, verification_result
from daemon.console.interpreter import CommandResult, Interpreter
from daemon.errors import CommandError, FacetdError
from daemon.pick.following import CameraMount
from daemon.pick.pose_fusion import Doubt
from daemon.pick.settings import Settings
from daemon.store.calibrations import Calibrations
from tests.fakes.fake_context import FakeFrontend, fake_context

ETC = Path(__file__).parents[3] / "etc"


@pytest.fixture
def context(tmp_path: Path) -> Any:
    async def reload(who: str | None, change: Any = None) -> str:
        put_back = await change()
        try:
            return await made.taking_over()
        except FacetdError:
            put_back()
            raise

    async def taken_over() -> str:
        return "Taken over."

    made = fake_context(tmp_path, reload)
    made.taking_over = taken_over
    made.config.calibrations = Calibrations(tmp_path, "real", ETC / "calibration.yaml")
    return made


def say(context: Any, text: str, frontend: FakeFrontend | None = None) -> CommandResult:
    return asyncio.run(Interpreter(context, every_command()).interpret(text, frontend or FakeFrontend()))


def test_where_the_reload_is_refused_the_calibration_before_is_in_use_again(context: Any) -> None:
    calibrations = context.config.calibrations
    calibrations.keep((ETC / "calibration.yaml").read_bytes())
    told: list[int] = []

    async def refused() -> str:
        told.append(calibrations.current)
        raise FacetdError("not now")

    context.taking_over = refused
    assert say(context, "calibrate use 0").text == "not now"
    assert (told, calibrations.current) == ([0], 1)


@pytest.mark.parametrize("kind", ["stereo", "hand-eye", "by-hand"])
def test_where_the_result_could_not_be_kept_no_tour_is_begun(context: Any, tmp_path: Path, kind: str) -> None:
    (tmp_path / "calibration").write_text("in the way")
    answer = say(context, f"calibrate {kind}")
    assert answer.status == 1
    assert "a calibration cannot be stored here" in answer.text
    assert context.cycle.told == []


def test_calibrations_are_listed_and_gone_back_to(context: Any) -> None:
    calibrations = context.config.calibrations
    calibrations.keep((ETC / "calibration.yaml").read_bytes())
    calibrations.keep(b"version: 1\n")
    assert say(context, "calibrate use 1").text == "Calibration 1 is in use. Taken over."
    rows = say(context, "calibrate list", FakeFrontend(may="look")).text.splitlines()
    assert len(rows) == 4
    assert "in use" in rows[2]
    broken = say(context, "calibrate use 2")
    assert broken.status == 1
    assert calibrations.current == 1, "what cannot be used is not taken over"
    assert say(context, "calibrate use 7").status == 2
    assert "is read-only" in say(context, "calibrate use 0", FakeFrontend(may="look")).text


@pytest.mark.parametrize(
    ("cameras", "alone", "kind", "told"),
    [
        ("left right", "left", "hand-eye", "only one camera is in use"),
        ("left right", None, "camera", "this cell has two cameras: `calibrate stereo`"),
        ("left", "left", "stereo", "this cell has one camera: `calibrate camera`"),
        ("left", "left", "by-hand", "this cell has one camera: `calibrate camera`"),
        ("left", "left", "verify", "`calibrate camera` first"),
        ("right", "right", "camera", "name the only camera cameras.left"),
    ],
)
def test_only_the_cameras_that_are_there_are_calibrated(
    context: Any, cameras: str, alone: str | None, kind: str, told: str
) -> None:
    context.config.values.cameras = dict.fromkeys(cameras.split(), "x")
    context.hardware.cameras.alone = alone
    answer = say(context, f"calibrate {kind}")
    assert answer.status == 1
    assert told in answer.text
    assert context.cycle.told == []


def test_an_arm_that_is_worse_than_the_configuration_has_it_is_told_with_the_line_to_write() -> None:
    assert "write" not in arm_line(ArmError(0.12, 0.02), Doubt(arm_mm=0.1, arm_deg=0.02))
    told = arm_line(ArmError(0.31, 0.02), Doubt(arm_mm=0.1, arm_deg=0.02))
    assert "0.31 mm and 0.020 degrees" in told
    written = yaml.safe_load(told.split("`")[1])
    assert written == {"pick": {"doubt": {"arm_mm": 0.31, "arm_deg": 0.02}}}


@pytest.mark.parametrize("fixed", [False, True])
def test_what_calibration_and_arm_leave_at_a_grasp_is_told_beside_what_a_grasp_needs(fixed: bool) -> None:
    known = load_calibration(ETC / "calibration.yaml")
    settings = Settings(doubt=Doubt(hand_eye_mm=0.2, hand_eye_deg=0.03))
    at = frames.rigid(np.diag([1.0, -1.0, -1.0]), np.array([500.0, 0.0, 150.0]))
    mounting = InWorld(at, np.eye(4), at[:3, 3]) if fixed else OnHand(known.tool_from_cyclopean)
    told = grasp_lines(CameraMount(known.rig, mounting), settings)
    assert len(told) == 1
    far, middle, near = (float(mm) for mm in re.findall(r"([\d.]+) mm and [\d.]+ deg from", told[0]))
    assert far > middle > near > np.sqrt(3) * 0.2
    assert "1 mm and 1 deg" in told[0]
    worse = replace(settings, doubt=replace(settings.doubt, hand_eye_mm=1.0))
    assert grasp_lines(CameraMount(known.rig, mounting), worse)[1].startswith("No look can be accurate enough to grasp")


@pytest.mark.parametrize("kind", ["stereo", "hand-eye", "verify", "touch"])
def test_what_may_be_in_the_hand_is_guarded_before_a_tour_sets_out(
    context: Any, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    """After a restart with a part in the hand the tour's ways were looked along without it."""
    context.cycle.settings = SimpleNamespace(settling=None)

    async def prepare_to_move() -> None:
        context.cycle.told.append("set out")

    async def tour(session: CalibrationSession, *_: Any, **__: Any) -> Any:
        await session.prepare_to_move()
        raise CommandError("far enough")

    context.cycle.prepare_to_move = prepare_to_move
    monkeypatch.setattr(calibrating, "view_tour", tour)
    assert say(context, f"calibrate {kind}").text == "far enough"
    assert context.cycle.told == ["set out"]


def test_the_last_way_down_to_the_touch_test_is_a_small_straight_one(
    context: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It went down on the board as fast as the arm travels."""
    context.cycle.prepare_to_move = None
    context.cycle.settings = SimpleNamespace(settling=None)
    context.calibration = None
    context.config.values.pick = SimpleNamespace(
        limits=SimpleNamespace(table_z_mm=-300.0), gripper=SimpleNamespace(tip_mm=10.0)
    )

    async def tour(*_: Any, **__: Any) -> Any:
        return [None]

    monkeypatch.setattr(calibrating, "view_tour", tour)
    board_lies = np.array([500.0, 20.0, -296.0])
    monkeypatch.setattr(calibrating, "board_in_world", lambda *_: frames.rigid(np.eye(3), board_lies))
    answer = say(context, "calibrate touch", FakeFrontend(answers=["0.3 -0.4"]))
    assert answer.text.startswith("0.50 mm off: good")
    assert context.cycle.told == ["touch test, 2 mm above the corner, from over it: [500.0, 20.0, -226.0]"]
    assert context.cycle.at[:3, 3].tolist() == [500.0, 20.0, -284.0]


def test_a_calibration_that_was_solved_while_another_was_taken_over_is_kept_and_not_used(
    context: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Who had gone back to an older one was told that it is in use, and seconds after it was not."""
    calibrations, known = context.config.calibrations, load_calibration(ETC / "calibration.yaml")
    calibrations.keep((ETC / "calibration.yaml").read_bytes())
    context.calibration = known
    context.cycle.prepare_to_move = None
    context.cycle.settings = SimpleNamespace(settling=None)

    async def shown(*_: Any) -> Any:
        return []

    def solved(*_: Any) -> Any:
        context.calibration = replace(known, tool_from_cyclopean=np.eye(4))
        return known, SimpleNamespace(stereo_rms_px=0.1, epipolar_px=0.1, sigmas={})

    monkeypatch.setattr(calibrating, "views_by_hand", shown)
    monkeypatch.setattr(calibrating, "solve_stereo", solved)
    monkeypatch.setattr(calibrating, "_stereo_lines", lambda _: [])
    answer = say(context, "calibrate by-hand")
    assert answer.status == 1
    assert "stored as calibration 2, not in use: another calibration came into use meanwhile" in answer.text
    assert calibrations.current == 1


def test_a_verification_counts_the_poses_that_it_announced() -> None:
    """It announced 8 poses and reported 9: the first view, from where the arm stood, counts as well."""
    text = verification_result(VerificationResult(9, -0.0029, 0.16, 0.05, 0.48, ())).text
    assert text.startswith("From 8 new poses and the first one: lengths 0.16 mm off (scale -0.29 %)")
