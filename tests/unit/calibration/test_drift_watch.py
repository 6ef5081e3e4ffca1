"""The watch over the calibration, fed with what looks write into the run log."""

from __future__ import annotations

import numpy as np

from daemon.calibration.drift import Clue
from daemon.calibration.drift_watch import DriftWatch, clue_from, health_fields


def health(pitch_deg: float, rng: np.random.Generator) -> dict[str, float]:
    turn = np.radians([pitch_deg + rng.normal(0, 0.004), rng.normal(0, 0.05), rng.normal(0, 0.02)])
    return health_fields(Clue(turn, np.radians([0.004, 0.05, 0.02]), "09:12"))


def test_a_clue_comes_back_from_the_log_as_it_went() -> None:
    clue = Clue(np.radians([0.1, -0.2, 0.0]), np.radians([0.01, np.inf, 0.02]), "09:12")
    fields = health_fields(clue)
    assert "roll_deg" not in fields
    back = clue_from(fields, "09:12")
    np.testing.assert_allclose(back.turn[[0, 2]], clue.turn[[0, 2]])
    np.testing.assert_allclose(back.sigma, clue.sigma)


def test_a_knock_is_told_with_its_time_and_stops_picking() -> None:
    rng, watch = np.random.default_rng(1), DriftWatch()
    for _ in range(30):
        assert watch.seen(health(0.0, rng), "08:00") is None
    for minute in range(20):
        watch.seen(health(0.2, rng), f"09:{12 + minute}")
    assert watch.drift is not None
    assert watch.drift.stops
    assert abs(watch.drift.degrees - 0.2) < 0.02
    assert "right camera pitched by +" in watch.drift.text
    assert "since 09:1" in watch.drift.text


def test_looks_that_say_nothing_raise_nothing() -> None:
    watch = DriftWatch()
    assert all(watch.seen({}, "08:00") is None for _ in range(50))
