"""How soon an arm is identified: from good first guesses, so that an operator does not wait."""

from typing import Any

import numpy as np
import pytest

from daemon.calibration import arm_from_readings
from daemon.calibration.arm_from_readings import poses
from daemon.calibration.least_squares import minimise
from tests.fakes.chosen import few
from tests.unit.calibration.test_arm_from_readings import HIGH, LOW, Truth, geometry, read, walk

CONVENTIONS = 8


@pytest.mark.parametrize("seed", few(range(4), 2))
def test_the_first_few_guesses_at_an_arms_zeros_are_enough(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Readings in small steps of each joint, as at a first contact: their horizontal turns give joint 1's zero and with
    it the tool. Without, ten times as many guesses are refined, and some arms are not found."""
    rng, refined = np.random.default_rng(seed), minimise
    lengths = (431.8, 20.3, 150.05, 431.8)
    truth = Truth(geometry(lengths, rng, tilted=True), rng.choice([-1.0, 1.0], 6), rng.uniform(-180, 180, 6))
    fits = 0

    def counted(*of: Any) -> Any:
        nonlocal fits
        fits += 1
        return refined(*of)

    monkeypatch.setattr(arm_from_readings, "minimise", counted)
    found, places, printed = read(truth, walk(list(rng.uniform(LOW, HIGH) / 2), 4.0, 2))
    assert np.abs(poses(found, printed) - places).max() < 0.1
    assert fits <= CONVENTIONS * (arm_from_readings.STARTS[0] + 1)
