"""The whole daemon through several frontends at once, with random operators and mishaps, under the motion monitor."""

from __future__ import annotations

import os

import pytest
from hypothesis import settings

from tests.fakes.surprises import HOUSE, STEPS, Surprises, live, shortest

pytestmark = pytest.mark.long

ALL_STEPS = int(os.environ.get("FACETD_STEPS", "3000"))


@pytest.mark.timeout(900)
def test_in_thousands_of_random_steps_the_arm_never_surprises() -> None:
    always_alike = settings(HOUSE, max_examples=ALL_STEPS // STEPS * 14 // 10, derandomize=True)
    before = Surprises.steps
    live(Surprises, always_alike)
    assert Surprises.steps - before >= ALL_STEPS


def test_of_a_story_that_surprises_only_what_it_takes_is_told() -> None:
    script = [(f"rule {number}", {"door": number}) for number in range(60)]
    needed = [script[0], script[17], script[18], script[55]]
    tried = []

    def fails(some: list) -> bool:
        tried.append(some)
        return all(call in some for call in needed)

    assert shortest(script, fails) == needed
    assert len(tried) < 60
