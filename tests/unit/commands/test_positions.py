"""Small moves and named places: where the arm is sent, and what is refused before anything is."""

from __future__ import annotations

import asyncio
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from daemon import frames
from daemon.commands import every_command
from daemon.console.interpreter import CommandResult, Interpreter
from tests.fakes.fake_context import FakeFrontend, fake_context


@pytest.fixture
def context(tmp_path: Path) -> Any:
    return fake_context(tmp_path)


def say(context: Any, text: str, frontend: FakeFrontend | None = None) -> CommandResult:
    return asyncio.run(Interpreter(context, every_command()).interpret(text, frontend or FakeFrontend()))


@pytest.mark.parametrize(
    ("text", "there"),
    [
        ("jog z -5", [0, 0, -5]),
        ("jog x 2.5mm world", [2.5, 0, 0]),
        ("jog rz 30deg", [0, 0, 0]),
        ("jog z 5 tool", [0, 0, -5]),
        ("jog x 1 tool", [-1, 0, 0]),
        ("jog rz 30", [0, 0, 0]),
    ],
)
def test_a_jog_is_reckoned_from_where_the_arm_is_in_world_or_tool(context: Any, text: str, there: list[float]) -> None:
    before = context.cycle.at
    assert say(context, text).status == 0
    assert context.cycle.at[:3, 3] == pytest.approx(there)
    if " r" not in text:
        assert np.array_equal(context.cycle.at[:3, :3], before[:3, :3])


def test_a_turn_is_about_the_point_between_the_fingers(context: Any) -> None:
    context.cycle.at[:3, 3] = [400.0, 0.0, 50.0]
    say(context, "jog rx 90 tool")
    assert context.cycle.at[:3, 3] == pytest.approx([400, 0, 50]), "too much in one go: not moved"
    say(context, "jog rx 30")
    assert context.cycle.at[:3, 3] == pytest.approx([400, 0, 50])
    angle = np.degrees(np.arccos((np.trace(context.cycle.at[:3, :3] @ np.diag([-1.0, 1.0, -1.0])) - 1) / 2))
    assert angle == pytest.approx(30)


@pytest.mark.parametrize(
    ("text", "want"),
    [
        ("jog", "axis is missing"),
        ("jog z 1_0", "DISTANCE: expected a number from -100 to 100 mm, found 1_0"),
        ("jog z \u0663", "DISTANCE: expected a number from -100 to 100 mm, found \u0663"),
        ("jog up 5", "up: no such axis"),
        ("jog z", "DISTANCE: expected a number from -100 to 100 mm, found nothing"),
        ("jog z 0", "found 0"),
        ("jog z nan", "found nan"),
        ("jog z 101", "found 101"),
        ("jog z 5deg", "expected a number from -100 to 100 mm, found 5deg"),
        ("jog rz 5mm", "expected a number from -30 to 30 degrees, found 5mm"),
        ("jog z 5mmdeg", "found 5mmdeg"),
        ("jog rz 31", "expected a number from -30 to 30 degrees, found 31"),
        ("jog z 5 part", "part: no such frame; choose from: tool, world"),
        ("jog z 5 tool now", "now: one word too many"),
        ("here", "NAME is missing"),
        ("here Bin 2", "2: one word too many"),
        ("here Bin2", "a position's name is small letters"),
        ("here home", "home is a position of the configuration"),
        ("go bin2", "bin2: no such position"),
        ("positions drop bin2", "bin2: no such named position"),
        ("positions bin2", "bin2: no such named position"),
    ],
)
def test_what_cannot_be_meant_moves_nothing(context: Any, text: str, want: str) -> None:
    answer = say(context, text)
    assert want in answer.text
    assert answer.status != 0
    assert context.cycle.told == []


def test_a_place_is_kept_with_its_history_and_gone_to(context: Any) -> None:
    context.cycle.at[:3, 3] = [100.0, 200.0, 300.0]
    assert say(context, "here bin2").status == 0
    context.cycle.at = context.cycle.at.copy()
    context.cycle.at[:3, 3] = [100.0, 200.0, 310.0]
    assert say(context, "here bin2", FakeFrontend(answers=["n"])).status == 1, "kept as it is"
    frontend = FakeFrontend(answers=["y"], who="anna")
    assert say(context, "here bin2", frontend).status == 0
    assert frontend.asked == ["bin2 is 10.0 mm from here. Replace it by this position? [y/n]"]
    assert say(context, "go bin2").text == "At bin2."
    assert context.cycle.told == ["move to bin2: [100.0, 200.0, 310.0]"]
    history = say(context, "positions bin2").text.splitlines()
    assert [re.fullmatch(r"\d{4}-\d\d-\d\d \d\d:\d\d UTC  x .* by .*", line) is not None for line in history] == [
        True
    ] * 2
    assert "bin2" in say(context, "positions").text
    assert say(context, "positions drop bin2").status == 0
    assert say(context, "go bin2").status == 2
    assert len(say(context, "positions bin2").text.splitlines()) == 3, "what it was is still known"


def test_a_name_that_has_become_the_configurations_as_well_is_gone_to_under_neither(context: Any) -> None:
    """`positions` showed where it had been named, and `go` went where the new facetd.yaml has one of that name."""
    context.cycle.at[:3, 3] = [400.0, 0.0, 50.0]
    say(context, "here survey2")
    configured, before = context.cycle.positions(), context.cycle.at.copy()
    context.cycle.positions = lambda: {**configured, "survey2": np.eye(4)}
    told = say(context, "go survey2")
    assert (told.status, "positions drop survey2" in told.text) == (1, True)
    assert np.array_equal(context.cycle.at, before)
    assert say(context, "positions").text.count("survey2") == 2
    say(context, "positions drop survey2")
    assert say(context, "go survey2").status == 0


@pytest.mark.parametrize("by", [[-100.0, 0, 0, 0, 0, 0], [0, 0, 0, 0, 0, 0.5]])
def test_a_place_is_not_named_where_the_arm_no_longer_is_once_it_was_asked(context: Any, by: list[float]) -> None:
    """Somebody sent the arm off while the question stood, or turned the hand; `go bin2` came back to where it had been
    before."""
    context.cycle.at[:3, 3] = [400.0, 0.0, 50.0]
    say(context, "here bin2")
    context.cycle.at = context.cycle.at.copy()
    context.cycle.at[2, 3] = 90.0

    class Meanwhile(FakeFrontend):
        async def ask(self, question: str) -> str:
            context.cycle.at = frames.perturb(context.cycle.at, np.array(by))
            return await super().ask(question)

    told = say(context, "here bin2", Meanwhile(answers=["y"]))
    assert (told.status, "has moved since" in told.text) == (1, True)
    assert len(say(context, "positions bin2").text.splitlines()) == 1
