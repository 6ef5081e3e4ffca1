"""`signal`: what it shows, finds and tests, and what it refuses."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from daemon.arm import Fault
from daemon.commands import every_command
from daemon.commands.signals import reset_by_line
from daemon.console.interpreter import CommandResult, Interpreter
from daemon.events.codes import BY_OPERATOR, CauseCode, FaultCause
from daemon.signals.input_form import load_form
from daemon.signals.production_line import ProductionLine
from daemon.signals.settings import SignalSettings
from tests.fakes.fake_context import FakeFrontend, fake_context


class Robot:
    """A controller at which the answer to one form follows a person's switch: here at each third reading."""

    def __init__(self) -> None:
        self.typed: list[Any] = []
        self.asked = 0

    async def set_outputs(self, numbers: Sequence[int]) -> None:
        self.typed.append(list(numbers))

    work_valves = set_outputs

    async def ask_input(self, text: str) -> str:
        if not text.startswith("DO TYPE"):
            return "always the same"
        self.asked += 1
        return "ON" if self.asked == 2 else "OFF"


@pytest.fixture
def context(tmp_path: Path) -> Any:
    context, robot = fake_context(tmp_path), Robot()
    signals = {"permit": SignalSettings(number=1001, role="permit_pick"), "busy": SignalSettings(number=1, role="busy"),
               "valve": SignalSettings(number=11, role="vacuum")}  # fmt: skip
    context.cycle.production_line = ProductionLine(signals, robot, None, lambda: 0.0, lambda *_, **__: None)
    context.hardware.robot = robot
    context.config = SimpleNamespace(state=tmp_path)

    async def run(doing: str, work: Any, moves: bool = True) -> Any:
        assert not moves, doing
        return await work

    context.cycle.run = run
    return context


def say(context: Any, text: str, frontend: FakeFrontend | None = None) -> CommandResult:
    return asyncio.run(Interpreter(context, every_command()).interpret(text, frontend or FakeFrontend()))


def test_how_inputs_are_read_is_found_with_a_person_and_kept(context: Any, tmp_path: Path) -> None:
    person = FakeFrontend(answers=["y", "y", "y"])
    answer = say(context, "signal find permit", person)
    assert answer.status == 0, answer.text
    assert answer.data == {"form": "DO TYPE SIG({number})", "off": "OFF", "on": "ON"}
    assert [text.partition(" at the line")[0] for text in person.asked] == [
        "Switch permit (input 1001) off", "Switch permit (input 1001) on", "Switch permit (input 1001) off again"
    ]  # fmt: skip
    assert load_form(tmp_path) == context.cycle.production_line.form
    assert "permit  input 1001, permit_pick: off" in say(context, "signal read").text


def test_where_no_answer_follows_or_nobody_switches_nothing_is_kept(context: Any, tmp_path: Path) -> None:
    context.hardware.robot.asked = 5
    answer = say(context, "signal find permit", FakeFrontend(answers=["y", "y", "y"]))
    assert answer.status == 1
    assert "no answer changed with input 1001 (off / on / off)" in answer.text
    assert "None" not in answer.text
    assert say(context, "signal find permit", FakeFrontend(answers=["n"])).text == "Nothing was changed."
    assert load_form(tmp_path) is None


def test_an_output_is_tested_and_is_as_before_afterwards(context: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("daemon.commands.signals.TEST_S", 0.0)
    assert say(context, "signal test busy", FakeFrontend(answers=["y"])).status == 0
    assert context.hardware.robot.typed == [[1], [-1]]
    assert say(context, "signal test busy", FakeFrontend(answers=["n"])).text == "Nothing was changed."


@pytest.mark.parametrize(
    ("text", "want"),
    [
        ("signal find busy", "busy: no such input"),
        ("signal test permit", "permit: no such output"),
        ("signal test valve", "valve works the gripper: `hand close` and `hand open` switch it"),
        ("signal read", "`signal find permit` at a console"),
        ("signal show more", "one word too many"),
    ],
)
def test_what_cannot_be_meant_says_what_can(context: Any, text: str, want: str) -> None:
    answer = say(context, text)
    assert answer.status != 0
    assert want in answer.text


def test_a_cell_without_signals_says_where_they_are_written(tmp_path: Path) -> None:
    assert "section `signals` of facetd.yaml" in say(fake_context(tmp_path), "signal").text


LOST = FaultCause(CauseCode.CAMERA_LOST)


@pytest.mark.parametrize(
    ("causes", "paused", "holds", "cleared"),
    [
        ((LOST,), False, False, True),
        ((LOST,), False, None, False),
        ((LOST,), True, False, False),
        ((BY_OPERATOR,), False, False, False),
        ((BY_OPERATOR, LOST), False, False, False),
        ((LOST, BY_OPERATOR), False, False, False),
        ((FaultCause(CauseCode.RESTARTED),), False, False, False),
    ],
)
def test_the_line_clears_no_stop_or_pause_by_a_person_and_none_with_an_unknown_gripper(
    causes: tuple[FaultCause, ...], paused: bool, holds: bool | None, cleared: bool
) -> None:
    """A person's stop after which a camera was lost was cleared by the line: the last cause alone was asked."""
    resumed: list[int] = []
    told: list[str] = []
    permission, hold = SimpleNamespace(fault=Fault("a fault", causes)), SimpleNamespace(paused=paused)
    supervisor = SimpleNamespace(permission=permission, hold=hold, stops=3, resume=resumed.append)
    cycle = SimpleNamespace(supervisor=supervisor, belief=SimpleNamespace(holds_part=holds))
    context: Any = SimpleNamespace(cycle=cycle, notices=SimpleNamespace(tell=lambda text, level: told.append(text)))
    reset_by_line(context)
    assert resumed == ([3] if cleared else [])
    assert told[0].startswith("The line has cleared the fault" if cleared else "The line's reset was refused")


def test_the_lines_reset_without_a_fault_ends_no_pause_and_says_what_it_found() -> None:
    for paused, told in (
        (False, "The line asked for a reset; no fault is active."),
        (True, "The line's reset was ref"),
    ):
        notices: list[str] = []
        supervisor = SimpleNamespace(permission=SimpleNamespace(fault=None), hold=SimpleNamespace(paused=paused))
        context: Any = SimpleNamespace(
            cycle=SimpleNamespace(supervisor=supervisor),
            notices=SimpleNamespace(tell=lambda text, level, notices=notices: notices.append(text)),
        )
        reset_by_line(context)
        assert notices[0].startswith(told)
