"""A cell that knows several grippers: what follows from the mounted one, and what cannot be meant."""

from __future__ import annotations

import asyncio
from pathlib import Path

import numpy as np
import pytest
import yaml

from daemon.arm import CAMERAS
from daemon.calibration.file import load_calibration, save_calibration
from daemon.cell import sections
from daemon.cell.puma_arm import PumaArm
from daemon.config import Config, gripper_unknown, load_config
from daemon.events.outcomes import Outcome
from daemon.pick.grippers.suction import SuctionCup
from daemon.pick.outcome import CycleEnd
from daemon.store.mounted_gripper import MountedGripper, keep_mounted
from daemon.store.yamlfile import ConfigError
from tests.fakes.simulated_cell import rig
from tests.fakes.suction_cell import bracket, model_of
from tests.fakes.two_grippers import LIP_MM, two_grippers

OUT_MM = LIP_MM - 130.0
"""So much farther out is the lip than the point between the fingers."""


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return two_grippers(tmp_path)


def with_the_cup(path: Path) -> Config:
    keep_mounted(path.parent / "state", MountedGripper("cup", "ann", "2026-11-26T10:00:00+00:00"))
    return load_config(path)


def test_the_mounted_one_is_what_was_said_last_and_nobody_s_word_is_none(path: Path) -> None:
    config = load_config(path)
    assert config.gripper is None
    assert config.values.arm.flange_from_tool[2][3] == 130.0, "until then the first is assumed"
    assert gripper_unknown(config) in config.notes
    sections.check(config)
    config = with_the_cup(path)
    sections.check(config)
    assert config.gripper == "cup"
    assert not config.notes
    assert isinstance(config.values.pick.gripper, SuctionCup)
    assert sections.arm_geometry(config).flange_from_tool[2, 3] == LIP_MM


def test_a_mounted_gripper_that_is_no_longer_described_is_not_said(path: Path) -> None:
    config = with_the_cup(path)
    keep_mounted(config.state, MountedGripper("hook", "ann", "2026-11-26T10:00:00+00:00"))
    config = load_config(path)
    assert config.gripper is None
    assert any("hook is no longer in the section grippers; " in n for n in config.notes)


def test_cameras_and_hand_eye_stay_on_the_wrist_as_grippers_change(path: Path) -> None:
    fingers = load_config(path)
    cup = with_the_cup(path)
    before, after = (sections.calibration_in_use(config) for config in (fingers, cup))
    assert np.array_equal(before.tool_from_cyclopean, load_calibration(fingers.calibration).tool_from_cyclopean)
    one, other = (
        np.array(c.values.arm.flange_from_tool) @ k.tool_from_cyclopean for c, k in ((fingers, before), (cup, after))
    )
    assert np.allclose(one, other, atol=1e-9)
    guard = sections.guarded(cup, PumaArm(sections.arm_geometry(cup)))
    named = {capsule.name: capsule for capsule in guard.capsules}
    assert "left finger" not in named
    for camera in CAMERAS.capsules:
        assert named[camera.name].from_mm[2] == pytest.approx(camera.from_mm[2] - OUT_MM)
    assert CAMERAS.points_mm[0][2] - OUT_MM in [point[2] for point in guard.body_mm]


def test_a_calibration_that_says_its_tool_counts_from_that_one(path: Path, tmp_path: Path) -> None:
    """Also with one gripper: a tool centre point that is set anew does not need another hand-eye."""
    cup = with_the_cup(path)
    made = sections.calibration_in_use(cup)
    save_calibration(made, path.parent / "calibration.yaml")
    again = sections.calibration_in_use(with_the_cup(path))
    assert np.allclose(again.tool_from_cyclopean, made.tool_from_cyclopean, atol=1e-9)
    keep_mounted(cup.state, None)
    flange = np.array(cup.values.arm.flange_from_tool) @ made.tool_from_cyclopean
    fingers = sections.calibration_in_use(load_config(path))
    assert np.allclose(fingers.flange_from_tool @ fingers.tool_from_cyclopean, flange, atol=1e-9)


@pytest.mark.parametrize(
    ("section", "value", "told"),
    [
        (
            "pick",
            {"gripper": {"opening_mm": 80}},
            "pick.gripper: expected this key for each gripper of the section grippers",
        ),
        ("arm", {"flange_from_tool": np.eye(4).tolist()}, "arm.flange_from_tool: expected this key for each gripper"),
        (
            "pick",
            {
                "limits": {
                    "capsules": [
                        {"name": "a", "link": "tool", "from_mm": [0, 0, 0], "to_mm": [0, 0, 9], "radius_mm": 9}
                    ]
                }
            },
            "pick.limits.capsules: expected no piece with the link tool beside the section grippers",
        ),
        (
            "pick",
            {"limits": {"body_mm": [[0, 0, 50]]}},
            "pick.limits.body_mm: expected none beside the section grippers",
        ),
        ("grippers", {"Cup 1": {}}, "grippers"),
        ("grippers", {"cup": {"flange_from_tool": (-np.eye(4)).tolist()}}, "grippers.cup.flange_from_tool: "),
        (
            "grippers",
            {"cup": {"gripper": {"kind": "magnet"}}},
            "grippers.cup.gripper.kind: expected one of fingers, suction",
        ),
    ],
)
def test_what_cannot_be_meant_is_one_line_at_its_key(path: Path, section: str, value: dict, told: str) -> None:
    values = yaml.safe_load(path.read_text())
    path.write_text(yaml.safe_dump(values | {section: value}, sort_keys=False))
    with pytest.raises(ConfigError) as caught:
        sections.check(load_config(path))
    assert told in str(caught.value)
    assert "\n" not in str(caught.value)


def test_each_gripper_of_the_file_is_checked_and_not_the_mounted_one_alone(path: Path) -> None:
    values = yaml.safe_load(path.read_text())
    values["grippers"]["cup"]["flange_from_tool"] = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0.16], [0, 0, 0, 1]]
    path.write_text(yaml.safe_dump(values, sort_keys=False))
    with pytest.raises(ConfigError, match=r"grippers\.cup\.flange_from_tool: expected millimetres"):
        sections.check(load_config(path))


def test_one_gripper_by_its_name_needs_nobody_to_say_it(path: Path) -> None:
    values = yaml.safe_load(path.read_text())
    values["grippers"] = {"cup": values["grippers"]["cup"]}
    path.write_text(yaml.safe_dump(values, sort_keys=False))
    config = load_config(path)
    assert config.gripper == "cup"
    assert isinstance(config.values.pick.gripper, SuctionCup)


@pytest.mark.timeout(300)
def test_after_the_cup_was_mounted_it_picks_with_the_hand_eye_of_the_fingers(path: Path) -> None:
    """The lip is 30 mm farther out than the fingers' grasp: any frame that did not go with it misses by that."""
    config, part = with_the_cup(path), bracket()

    async def story() -> tuple[CycleEnd, str, tuple[float, float]]:
        believed = sections.calibration_in_use(config)
        async with rig(7, model_of([part]), believed=believed, file=path) as here:
            assert here.cell.mounted == "suction"
            here.cell.world.draw([part.shape])
            here.cell.scatter([part.label], np.random.default_rng(3), steady=True)
            end = await here.cycle.pick()
            return end, here.lies(part.label), here.grasp_error(end)

    end, lies, (off_mm, off_deg) = asyncio.run(story())
    assert end.outcome is Outcome.PICKED, end.why
    assert lies == "bin"
    assert off_mm < 2.0
    assert off_deg < 2.0
