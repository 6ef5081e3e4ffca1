"""The whole daemon through several doors at once, random operators and mishaps, against the judge of the cell."""

from __future__ import annotations

import os

import pytest
from hypothesis import settings
from hypothesis.stateful import run_state_machine_as_test

from tests.worlds.surprises import HOUSE, STEPS, Surprises

pytestmark = pytest.mark.slow

ALL_STEPS = int(os.environ.get("FACETD_STEPS", "10000"))


@pytest.mark.timeout(900)
def test_in_ten_thousand_random_steps_the_arm_never_surprises() -> None:
    always_alike = settings(HOUSE, max_examples=ALL_STEPS // STEPS * 11 // 10, derandomize=True, database=None)
    before = Surprises.steps
    run_state_machine_as_test(Surprises, settings=always_alike)
    assert Surprises.steps - before >= ALL_STEPS
