"""One operator's turns: order, what is for now, questions one after the other, and a stop that waits for nothing."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

import pytest

from daemon.commands.step_mode import READ_S
from daemon.console.interpreter import CommandResult, ConsoleCommand, Interpreter
from daemon.console.notices import Notices
from daemon.frontends.client import STOP_ANSWER_S
from daemon.frontends.command_queue import MOST_TASKS, STOP_PENDING_EVERY_S, CommandQueue
from tests.fakes.in_time import lived


class Operator:
    """Somebody at a frontend: what they are shown and answered, and commands that end when they are let."""

    name, who, may, asks = "test", "ann", "all", True

    def __init__(self) -> None:
        self.shown: list[str | None] = []
        self.answers: list[str] = []
        self.done: list[str] = []
        self.interrupts: list[tuple[str, bool]] = []
        self.may_end = asyncio.Event()
        self.stops = self.signs = 0
        self.said: list[str] = []
        self.awaits_confirmation_s: float | None = None
        self.rest_reports = 0

        async def slow(_: Any, words: list[str], __: Any) -> CommandResult:
            await self.may_end.wait()
            self.done.append(" ".join(words))
            return CommandResult(f"done {' '.join(words)}")

        async def ask(_: Any, words: list[str], __: Any) -> CommandResult:
            return CommandResult(f"{words[0]}: {await self.queue.ask(words[0])!r}")

        async def now(_: Any, __: list[str], ___: Any) -> CommandResult:
            return CommandResult("now")

        commands = [
            ConsoleCommand("go", "go", "", slow, "move"), ConsoleCommand("read", "read", "", slow),
            ConsoleCommand("ask", "ask", "", ask),
            ConsoleCommand("status", "status", "", now, at_once=True),
            ConsoleCommand("step", "step on|off", "", now, "move", most=1, at_once=True),
            ConsoleCommand("stop", "stop", "", now, "move", at_once=True),
            ConsoleCommand("resume", "resume", "", ask, at_once=True),
            ConsoleCommand("disable", "disable", "", now, "move", at_once=True),
        ]  # fmt: skip
        context: Any = SimpleNamespace(
            log=SimpleNamespace(record=lambda *_, **__: None),
            cycle=SimpleNamespace(supervisor=self),
            notices=Notices(),
        )
        interpreter = Interpreter(context, commands)
        self.queue = CommandQueue(interpreter, self, self.interrupt, self.shown.append, self.sign)  # type: ignore[arg-type]

    async def interrupt(self, who: str, about_to_move: bool) -> str:
        self.interrupts.append((who, about_to_move))
        return "stopped"

    def sign(self) -> None:
        self.signs += 1

    async def say(self, text: str) -> None:
        self.said.append(text)

    async def answered(self, answer: CommandResult) -> None:
        self.answers.append(answer.text)

    def types(self, *lines: str) -> None:
        for line in lines:
            if not self.queue.answer(line):
                self.queue.take(line, self.answered)


def play(script: Callable[[Operator], Awaitable[None]]) -> Operator:
    async def run() -> Operator:
        operator = Operator()
        await script(operator)
        operator.may_end.set()
        operator.queue.leave()
        await operator.queue.end()
        return operator

    return lived(run())


async def a_moment() -> None:
    for _ in range(20):
        await asyncio.sleep(0)


def test_commands_are_done_in_the_order_typed_and_what_is_for_now_beside_them() -> None:
    async def script(operator: Operator) -> None:
        operator.types("go 1", "go 2", "read 3", "status")
        await a_moment()
        assert operator.answers == ["now"]
        operator.may_end.set()
        await a_moment()

    assert play(script).answers == ["now", "done 1", "done 2", "done 3"]


def test_who_only_hears_has_what_they_asked_for_done_in_turn_and_answers_no_question() -> None:
    async def script(operator: Operator) -> None:
        operator.types("ask sure?")
        await a_moment()
        operator.queue.take("go 1", operator.answered)
        operator.queue.take("ask really?", operator.answered)
        operator.queue.input_ended()
        operator.may_end.set()
        await a_moment()

    operator = play(script)
    assert operator.answers == ["sure?: ''", "done 1", "really?: ''"]
    assert operator.shown == ["sure?", None]


def test_a_pasted_block_is_done_line_by_line_to_the_first_that_is_not_done() -> None:
    async def script(operator: Operator) -> None:
        for line in ("go 1", "status", "flurb", "go 2"):
            operator.queue.take(line, operator.answered, block=7)
        operator.types("read 3")
        await a_moment()
        assert operator.answers == [], "not even what is for now is done before its turn"
        operator.may_end.set()
        await a_moment()
        operator.queue.take("go 4", operator.answered, block=7)
        operator.queue.take("go 5", operator.answered, block=8)
        await a_moment()

    operator = play(script)
    not_done = "not done; an earlier line of the same paste was not done"
    assert operator.answers[:2] == ["done 1", "now"]
    assert sorted(operator.answers[2:]) == sorted(
        [
            "flurb: no such command; `help all` lists every command",
            f"go 2: {not_done}",
            "done 3",
            f"go 4: {not_done}",
            "done 5",
        ]
    )
    assert operator.done == ["1", "3", "5"]


def test_a_stop_waits_for_nothing_drops_what_was_typed_ahead_and_answers_the_question_by_nothing() -> None:
    async def script(operator: Operator) -> None:
        operator.types("ask sure?")
        await a_moment()
        assert operator.shown == ["sure?"]
        operator.queue.take("go 2", operator.answered)
        operator.types("stop")
        await a_moment()

    operator = play(script)
    assert operator.answers == ["now", "sure?: ''", "go 2: not done; the arm was stopped after you typed it"]
    assert operator.shown == ["sure?", None]
    assert operator.done == []


@pytest.mark.parametrize("text", ["disable", "DISABLE", " disa "])
def test_whoever_disables_answers_no_question_and_it_is_not_asked_any_more(text: str) -> None:
    """Whoever takes the arm's leave to move while asked whether it may is not told to say y or n first."""

    async def script(operator: Operator) -> None:
        operator.types("ask sure?")
        await a_moment()
        operator.types(text)
        await a_moment()
        assert operator.answers == ["now", "sure?: ''"]
        assert operator.shown == ["sure?", None]

    play(script)


@pytest.mark.parametrize("text", ["disable now", "di", "resume", "yes"])
def test_what_takes_nothing_away_is_an_answer(text: str) -> None:
    async def script(operator: Operator) -> None:
        operator.types("ask sure?")
        await a_moment()
        operator.types(text)
        await a_moment()

    assert play(script).answers == [f"sure?: {text!r}"]


def test_control_c_says_whether_something_may_be_about_to_move() -> None:
    async def script(operator: Operator) -> None:
        await operator.queue.stop("ann")
        operator.types("read 1")
        await operator.queue.stop("ann")
        operator.may_end.set()
        await a_moment()
        operator.may_end.clear()
        operator.types("go 2")
        await operator.queue.stop("ann")

    assert play(script).interrupts == [("ann", False), ("ann", False), ("ann", True)]


def test_two_questions_are_put_one_after_the_other_and_each_gets_its_own_answer() -> None:
    async def script(operator: Operator) -> None:
        operator.types("ask first?")
        await a_moment()
        operator.queue.take("resume second?", operator.answered)
        await a_moment()
        assert operator.shown == ["first?"]
        operator.types("y")
        await a_moment()
        assert operator.shown == ["first?", None, "second?"]
        operator.types("n")
        await a_moment()

    assert play(script).answers == ["first?: 'y'", "second?: 'n'"]


def test_status_and_the_end_of_step_mode_at_a_question_are_done_and_the_question_put_again_below() -> None:
    """What refuses a move tells people to type `step off`; at the question it was ignored as no answer."""

    async def script(operator: Operator) -> None:
        operator.types("ask sure?")
        await a_moment()
        operator.types("status", "stat", "step off")
        await a_moment()
        assert operator.answers == ["now"] * 3
        assert operator.shown == ["sure?"] * 4
        assert operator.queue.asking
        operator.types("y")
        await a_moment()

    operator = play(script)
    assert operator.answers[3:] == ["sure?: 'y'"]


def test_what_decides_the_question_that_is_open_is_not_followed_by_that_question() -> None:
    """As `confirm` does with a move that waits; y and n stay answers, though they are that command's other names."""

    async def script(operator: Operator) -> None:
        async def confirm(*_: Any) -> CommandResult:
            operator.queue._withdraw_question()
            return CommandResult("confirmed")

        commands = operator.queue._interpreter.commands
        commands["confirm"] = ConsoleCommand("confirm", "confirm", "", confirm, "move", at_once=True)
        operator.types("ask send?")
        await a_moment()
        operator.types("confirm")
        await a_moment()
        assert operator.shown == ["send?", None]

    assert sorted(play(script).answers) == ["confirmed", "send?: ''"]


def test_who_has_left_is_asked_nothing_and_what_they_typed_ahead_is_not_done() -> None:
    async def script(operator: Operator) -> None:
        operator.types("go 1", "go 2")
        await a_moment()
        operator.queue.leave()
        assert await operator.queue.ask("still there?") == ""

    operator = play(script)
    assert operator.done == ["1"]
    assert operator.shown == []


def test_a_stop_at_another_frontend_voids_what_waits_here() -> None:
    async def script(operator: Operator) -> None:
        operator.types("go 1", "go 2", "read 3")
        await a_moment()
        operator.stops += 1
        operator.types("go 4")
        operator.may_end.set()
        await a_moment()

    operator = play(script)
    assert operator.done == ["1", "4"]
    voided = [f"{text}: not done; the arm was stopped after you typed it" for text in ("go 2", "read 3")]
    assert operator.answers == ["done 1", *voided, "done 4"]


@pytest.mark.parametrize("text", ["sto", "STOP!", "stop '", "halt", "\x00stop", "ystop", "go hostop"])
def test_a_stop_in_haste_waits_for_nothing_either(text: str) -> None:
    async def script(operator: Operator) -> None:
        operator.types("ask sure?")
        await a_moment()
        operator.types(text)
        await a_moment()

    assert play(script).answers == ["now", "sure?: ''"]


def test_a_stop_typed_behind_half_of_a_line_waits_for_nothing() -> None:
    async def script(operator: Operator) -> None:
        operator.types("go 1")
        await a_moment()
        operator.types("go 2stop")
        await a_moment()
        assert operator.answers == ["now"]

    play(script)


@pytest.mark.parametrize("typed", [("read 1", "read 2", "read 3"), ("read 1", "resume a")])
def test_too_much_is_what_waits_or_what_is_done_beside_each_other(
    typed: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("daemon.frontends.command_queue.MOST_WAITING", 2)

    async def script(operator: Operator) -> None:
        for text in typed:
            assert not operator.queue.crowded
            operator.queue.take(text, operator.answered)
            await asyncio.sleep(0)
        assert operator.queue.crowded
        room = {text: operator.queue.has_room_for(text) for text in ("read 9", "stop", "go 2stop")}
        assert room == {"read 9": False, "stop": True, "go 2stop": True}
        operator.queue.leave()

    play(script)


def test_a_question_has_a_number_and_stands_until_it_is_answered() -> None:
    async def script(operator: Operator) -> None:
        for number in (1, 2):
            assert not operator.queue.asking
            operator.types("ask colour")
            while not operator.queue.asking:
                await asyncio.sleep(0)
            assert operator.queue.question == number
            assert operator.queue.answer("blue")
            assert not operator.queue.answer("green"), "it is answered"
            await operator.queue.end()
            assert not operator.queue.busy
        assert not operator.queue.answer("red"), "nothing is asked"

    assert play(script).answers == ["colour: 'blue'"] * 2


def test_what_is_typed_before_a_question_can_be_read_answers_it_only_where_the_one_before_was_answered_here() -> None:
    """Somebody else had settled the one before: the answer to that one was on its way, or under a finger."""

    async def script(operator: Operator) -> None:
        turns = operator.queue
        first = asyncio.ensure_future(turns.ask("send 1?"))
        await a_moment()
        first.cancel()
        second = asyncio.ensure_future(turns.ask("send 2?"))
        await a_moment()
        assert turns.answer("y")
        await a_moment()
        assert not second.done()
        again = "ignored, too soon for an answer: send 2?"
        assert operator.shown == ["send 1?", None, "send 2?", again]
        assert turns.question == 3, "put again, it is another: an answer to it may come at once"
        await asyncio.sleep(READ_S + 0.01)
        assert turns.answer("y")
        assert await second == "y"
        third = asyncio.ensure_future(turns.ask("send 3?"))
        await a_moment()
        assert turns.answer("y")
        assert await third == "y"

    play(script)


def test_the_end_is_when_all_is_done() -> None:
    async def script(operator: Operator) -> None:
        operator.types("read 1")
        ending = asyncio.create_task(operator.queue.end())
        await asyncio.sleep(0.01)
        assert not ending.done()
        operator.may_end.set()
        await ending
        assert operator.answers == ["done 1"]

    play(script)


def test_a_flood_of_stops_while_one_is_under_way_takes_no_more_room_than_a_thousand() -> None:
    """Each is the same stop; a controller that is silent lets none of them end for seconds."""

    async def script(operator: Operator) -> None:
        stopping = asyncio.Event()

        async def interrupt(who: str, about_to_move: bool) -> str:
            operator.interrupts.append((who, about_to_move))
            await stopping.wait()
            return "stopped"

        operator.queue._interrupt = interrupt

        async def stop() -> None:
            await operator.queue.stop("ann")

        for _ in range(5000):
            operator.queue.start_now(stop)
        operator.types("stop")
        await a_moment()
        assert len(operator.interrupts) == len(operator.queue._tasks) == MOST_TASKS
        stopping.set()
        await operator.queue.end()
        operator.types("stop", "go 1")
        operator.may_end.set()
        await operator.queue.end()
        assert operator.answers == ["now", "done 1"], "once they are over all is heard"

    play(script)


@pytest.mark.parametrize("way", ["stop", "disable", "control-C"])
def test_who_waits_for_a_stop_is_told_once_that_it_was_sent_and_hears_signs_of_life_until_it_is_confirmed(
    way: str,
) -> None:
    """From the moment that the controller has answered: a daemon that has sent nothing, or hangs, gives none."""

    async def script() -> Operator:
        operator = Operator()
        confirmed = asyncio.Event()

        async def stop(*_: object) -> Any:
            await confirmed.wait()
            return "stopped" if way == "control-C" else CommandResult("stopped")

        operator.queue._interrupt = stop
        with patch.object(Interpreter, "interpret", stop):
            if way == "control-C":
                stopping = asyncio.ensure_future(operator.queue.stop("ann"))
            else:
                operator.queue.take(way, operator.answered)
            await asyncio.sleep(3.0)
            assert (operator.signs, operator.said) == (0, [])
            operator.awaits_confirmation_s = 12.0
            await asyncio.sleep(5.0)
            assert operator.signs == pytest.approx(5.0 / STOP_PENDING_EVERY_S, abs=1)
            assert operator.said == [
                "stop sent; the controller answers; waiting up to 12 s until it confirms that the arm is at rest"
            ]
            confirmed.set()
            await (stopping if way == "control-C" else operator.queue.end())
        signs = operator.signs
        await asyncio.sleep(5.0)
        assert operator.signs == signs
        return operator

    assert STOP_PENDING_EVERY_S < STOP_ANSWER_S / 2
    assert lived(script()).answers == ([] if way == "control-C" else ["stopped"])


def test_who_presses_control_c_at_an_idle_arm_hears_signs_of_life_as_long_as_the_controller_says_more() -> None:
    """A slow controller took longer to say that the arm is at rest than people wait before they press the emergency
    stop; one that says nothing more gives no sign."""

    async def script() -> Operator:
        operator = Operator()
        at_rest = asyncio.Event()

        async def interrupt(*_: object) -> str:
            await at_rest.wait()
            return "Nothing moves."

        operator.queue._interrupt = interrupt
        stopping = asyncio.ensure_future(operator.queue.stop("ann"))
        await asyncio.sleep(1.0)
        assert operator.signs == 0
        for _ in range(4):
            operator.rest_reports += 3
            await asyncio.sleep(STOP_PENDING_EVERY_S)
        assert operator.signs == pytest.approx(4, abs=1)
        signs = operator.signs
        await asyncio.sleep(4.0)
        assert (operator.signs, operator.said) == (signs, [])
        at_rest.set()
        assert await stopping == "Nothing moves."
        return operator

    lived(script())
