"""What an operator reads of `look around`, on a wide terminal and on a narrow one."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from daemon.commands.observing import around_result
from daemon.pick.world import InformationGain

BEFORE, AFTER = "block_60 67 %, cut_60 17 %, step_60 17 %, not taught 0 %", "block_60 99.8 %"


def known() -> Any:
    """A cube found at once, and a block that a second look settled."""

    def part(label: str, x: float) -> Any:
        told = SimpleNamespace(confidence=0.998, reason="fits")
        return SimpleNamespace(
            label=label, named=label != "unknown", recognition=told, centre=np.array([x, 0.0, -280.0])
        )

    gained = [InformationGain("what lies at 560, -20", BEFORE, AFTER, 1.25, 0.0, 0.74, 2.5)]
    found = [part("cube", 500.0), part("block_60", 560.0), part("unknown", 600.0)]
    return SimpleNamespace(looks=[None, None], gained=gained, found=found)


@pytest.mark.parametrize("columns", [40, 80])
def test_each_look_says_what_was_thought_before_it_and_what_after(columns: int) -> None:
    answer = around_result(known(), columns)
    lines = answer.text.splitlines()
    assert max(map(len, lines)) < columns
    text = " ".join(line.strip() for line in lines)
    assert f"Look 2, at what lies at 560, -20. Before: {BEFORE}. Now: {AFTER}." in text
    assert "cube (99.8 %) at world x 500 y 0 z -280 mm" in text
    assert "without a name at world x 600 y 0 z -280 mm: fits" in text
    assert lines[-1] == "2 looks: 1 block_60, 1 cube, 1 without a name." or columns == 40
    assert answer.status == 1, "something has no name yet"


def test_as_values_it_has_the_bits() -> None:
    data = around_result(known(), 80).data
    assert data is not None
    assert data["gained"][0]["bits_before"] == 1.25
    assert [part["label"] for part in data["parts"]] == ["cube", "block_60", "unknown"]
