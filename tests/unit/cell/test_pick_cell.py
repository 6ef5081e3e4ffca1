"""What a pick works with: built in one place, and as doubtful as the calibration is."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from daemon.calibration.file import Quality, load_calibration
from daemon.calibration.session import SPREAD_LIMIT_MM
from daemon.cell.pick_cell import doubt_of, pick_cell
from daemon.config import load_config
from daemon.pick.fusion import Doubt
from drivers.simcell.truth import load_truth

CONFIG = Path(__file__).resolve().parents[3] / "etc" / "facetd.yaml"


def built(calibration: Any) -> Any:
    hardware: Any = SimpleNamespace(robot="robot", eyes="eyes", clock=None)
    return pick_cell(load_config(CONFIG), calibration, hardware, "log")  # type: ignore[arg-type]


def test_a_pick_doubts_as_much_as_its_calibration_says_of_itself() -> None:
    calibration = load_calibration(CONFIG.parent / "calibration.yaml")
    quality = Quality(reprojection_px=0.11, hand_eye_mm=0.21, hand_eye_deg=0.03)
    workcell, settings = built(replace(calibration, quality=quality))
    assert (settings.doubt.pixels, settings.doubt.hand_eye_mm, settings.doubt.hand_eye_deg) == (0.11, 0.21, 0.03)
    assert settings.doubt.arm_mm == load_config(CONFIG).values.pick.doubt.arm_mm
    assert workcell.tool_from_cyclopean is calibration.tool_from_cyclopean


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
    assert np.array_equal(workcell.tool_from_cyclopean, np.eye(4))


def test_the_simulated_bin_catches_what_is_let_go_over_it_however_it_is_held() -> None:
    truth = load_truth(CONFIG.parent / "simcell.yaml")
    place = load_config(CONFIG).values.pick.bin.pose()[:2, 3]
    room_mm = np.array(truth.bin.size_mm) / 2 - np.abs(place - truth.bin.centre_mm)
    assert room_mm.min() > 80.0 / 2, "half of the longest taught part may stand out to any side of the hand"
