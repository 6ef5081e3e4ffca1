"""kill -9 of the daemon while the controller goes on: what it was left with is cancelled, nothing moves unasked."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from tests.bench.outlive import ACTS, harm


@pytest.mark.parametrize("name", ["moving, prompt at the end", "typing, lines not cancelled"])
def test_it_comes_back_to_a_controller_that_went_on_and_knows_where_the_arm_is(name: str) -> None:
    (found,) = harm(1, 5, [name]).values()
    assert found.kills == 1
    assert found.met[str(ACTS[name][2].at)] == 1
    assert found.well, found
