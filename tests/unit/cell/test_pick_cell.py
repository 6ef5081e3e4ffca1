"""What a pick works with: built in one place, and as doubtful as the calibration is."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml

from daemon.arm import ARM
from daemon.calibration.file import Quality, load_calibration
from daemon.calibration.session import SPREAD_LIMIT_MM
from daemon.cell.pick_cell import doubt_of, pick_cell
from daemon.cell.puma_arm import PumaArm
from daemon.cell.sections import arm_geometry, guarded
from daemon.config import load_config
from daemon.pick.pose_fusion import Doubt
from drivers.puma560 import PUMA560, ArmGeometry
from drivers.simcell.truth import load_truth
from tests.fakes.first_day import arm_yaml

CONFIG = Path(__file__).resolve().parents[3] / "etc" / "facetd.yaml"


def built(calibration: Any, alone: str | None = None) -> Any:
    hardware: Any = SimpleNamespace(
        robot=SimpleNamespace(kinematics=PumaArm(PUMA560)), cameras=SimpleNamespace(alone=alone), clock=None
    )
    return pick_cell(load_config(CONFIG), calibration, hardware, "log", "compute")  # type: ignore[arg-type]


def test_a_pick_doubts_as_much_as_its_calibration_says_of_itself() -> None:
    calibration = load_calibration(CONFIG.parent / "calibration.yaml")
    quality = Quality(reprojection_px=0.11, hand_eye_mm=0.21, hand_eye_deg=0.03)
    workcell, settings = built(replace(calibration, quality=quality))
    assert settings.doubt.pixels == 0.11
    over_three_axes = np.sqrt(3) * np.array([settings.doubt.hand_eye_mm, settings.doubt.hand_eye_deg])
    np.testing.assert_allclose(over_three_axes, [0.21, 0.03])
    assert settings.doubt.arm_mm == load_config(CONFIG).values.pick.doubt.arm_mm
    assert workcell.mounting.tool_from_cyclopean is calibration.tool_from_cyclopean


def test_a_calibration_that_says_nothing_of_itself_counts_as_the_worst_that_verification_passes() -> None:
    doubt = doubt_of(Quality(), Doubt(arm_mm=0.07))
    assert doubt.arm_mm == 0.07
    shared = doubt.shared()
    assert np.isclose(np.sqrt(np.trace(shared[:3, :3])), SPREAD_LIMIT_MM)
    across_mm = 330.0 * np.sqrt(np.trace(shared[3:5, 3:5]))
    assert np.isclose(across_mm, SPREAD_LIMIT_MM)


def test_without_a_hand_eye_there_is_still_a_workcell_to_look_with() -> None:
    calibration = load_calibration(CONFIG.parent / "calibration.yaml")
    workcell, _ = built(replace(calibration, tool_from_cyclopean=None))
    assert np.array_equal(workcell.mounting.tool_from_cyclopean, np.eye(4))


@pytest.mark.parametrize("alone", ["left", "right"])
def test_with_one_camera_places_are_planned_for_its_usual_pair_and_the_camera_stays_where_it_is(alone: str) -> None:
    calibration = load_calibration(CONFIG.parent / "calibration.yaml")
    workcell, _ = built(calibration, alone)
    assert workcell.alone == alone
    camera = getattr(calibration.rig, alone)
    assert np.allclose(
        workcell.mounting.tool_from_cyclopean @ workcell.rig.left.cyclopean_from_camera,
        calibration.tool_from_cyclopean @ camera.cyclopean_from_camera,
    )
    assert workcell.rig.left.matrix is workcell.rig.right.matrix is camera.matrix


def test_the_simulated_bin_catches_what_is_let_go_over_it_however_it_is_held() -> None:
    truth = load_truth(CONFIG.parent / "simcell.yaml")
    place = load_config(CONFIG).values.pick.bin.pose()[:2, 3]
    room_mm = np.array(truth.bin.size_mm) / 2 - np.abs(place - truth.bin.centre_mm)
    assert room_mm.min() > 80.0 / 2, "half of the longest taught part may stand out to any side of the hand"


def test_the_guard_s_body_is_of_the_arm_that_stands_there_and_what_was_typed_stays(tmp_path) -> None:
    for path in CONFIG.parent.glob("*.yaml"):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    (tmp_path / "arm.yaml").write_text(yaml.safe_dump(arm_yaml(ArmGeometry(203.2, 0.0, -127.0, 203.2))))
    (tmp_path / "facetd.yaml").write_text("version: 1\narm: {file: arm.yaml}\n")
    config = load_config(tmp_path / "facetd.yaml")
    guard = guarded(config, PumaArm(arm_geometry(config)))
    shoulder, usual = guard.capsules[0], ARM[0]
    assert shoulder.from_mm[0] == pytest.approx(usual.from_mm[0] * 203.2 / 431.8)
    assert shoulder.from_mm[2] == pytest.approx(-usual.from_mm[2] * 127.0 / 150.05)
    assert guard.capsules[-1] == ARM[-1]
    mine = "{name: mine, link: %s, from_mm: [0, 0, 0], to_mm: [9, 0, 0], radius_mm: 50}"
    typed = ", ".join(mine % link for link in ("upper_arm", "forearm", "wrist", "tool"))
    own = f"version: 1\narm: {{file: arm.yaml}}\npick: {{limits: {{capsules: [{typed}]}}}}\n"
    (tmp_path / "facetd.yaml").write_text(own)
    config = load_config(tmp_path / "facetd.yaml")
    assert {capsule.name for capsule in guarded(config, PumaArm(arm_geometry(config))).capsules} == {"mine"}
