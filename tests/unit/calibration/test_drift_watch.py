"""The watch over the calibration, fed with what looks hint at of it."""

from __future__ import annotations

import numpy as np
import pytest

from daemon.calibration.drift import DriftWatch
from daemon.vision.health.clues import Clue, health_fields


def clue(pitch_deg: float, rng: np.random.Generator) -> Clue:
    turn = np.radians([pitch_deg + rng.normal(0, 0.004), rng.normal(0, 0.05), rng.normal(0, 0.02)])
    return Clue(turn, np.radians([0.004, 0.05, 0.02]), "")


def test_a_clue_is_in_the_log_by_name_but_for_what_the_look_says_nothing_of() -> None:
    fields = health_fields(Clue(np.radians([0.1, -0.2, 0.0]), np.radians([0.01, np.inf, 0.02]), "09:12"))
    assert "roll_deg" not in fields
    assert fields["pitch_deg"] == pytest.approx(0.1)
    assert fields["vergence_deg"] == pytest.approx(0.0)
    assert fields["pitch_sigma_deg"] == pytest.approx(0.01)
    assert fields["vergence_sigma_deg"] == pytest.approx(0.02)


def test_a_knock_is_told_with_its_time_and_stops_picking() -> None:
    rng, watch = np.random.default_rng(1), DriftWatch()
    for _ in range(30):
        assert watch.add(clue(0.0, rng), "08:00") is None
    for minute in range(20):
        watch.add(clue(0.2, rng), f"09:{12 + minute}")
    assert watch.drift is not None
    assert watch.drift.stops
    assert abs(watch.drift.degrees - 0.2) < 0.02
    assert "right camera pitched by +" in watch.drift.text
    assert "since 09:1" in watch.drift.text


def test_looks_that_say_nothing_raise_nothing() -> None:
    watch = DriftWatch()
    nothing = Clue(np.zeros(3), np.full(3, np.inf), "")
    assert all(watch.add(nothing, "08:00") is None for _ in range(50))


def test_of_one_camera_it_is_told_that_it_sits_otherwise_on_the_hand():
    watch, drift = DriftWatch(alone="left"), None
    for k in range(60):
        turn = np.radians([0.3 if k > 30 else 0.0, 0.0, 0.0])
        drift = watch.add(Clue(turn, np.radians([0.02, 0.02, np.inf]), ""), "10:00")
    assert drift is not None
    assert "left camera no longer as calibrated on the gripper" in drift.text
    assert drift.stops
