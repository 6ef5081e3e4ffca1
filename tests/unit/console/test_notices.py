"""What operators hear unasked reaches every open frontend once, but not whoever gets it as an answer."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import pytest

from daemon.arm import RefusedError, Waiting
from daemon.commands import step_mode
from daemon.commands.moving import report_end
from daemon.commands.step_mode import report_waiting_move, with_questions
from daemon.console.context import CommandContext
from daemon.console.notices import NoticeLevel, Notices
from daemon.events.outcomes import BROUGHT
from daemon.events.pick_order import PickOrder
from daemon.pick.transitions import PickState
from tests.fakes.in_time import lived
from tests.fakes.waiting import until_so

HOME = Waiting("home: joints", Mock(), 0.0)


class Frontend:
    """Keeps what it is told; answers nothing."""

    asks = True

    def __init__(self) -> None:
        self.heard: list[str] = []
        self.asked: list[str] = []
        self.said: list[str] = []
        self.withdrawn = 0

    def notice(self, text: str) -> None:
        self.heard.append(text)

    async def say(self, text: str) -> None:
        self.said.append(text)

    async def ask(self, question: str) -> str:
        self.asked.append(question)
        try:
            await asyncio.Event().wait()
        finally:
            self.withdrawn += 1
        return ""


def test_every_open_frontend_is_told_and_a_closed_one_no_longer() -> None:
    notices, frontends = Notices(), [Frontend(), Frontend()]
    for frontend in frontends:
        notices.listen(frontend)
    notices.tell("FAULT one")
    notices.leave(frontends[0])
    notices.leave(frontends[0])
    notices.tell("FAULT two")
    assert [frontend.heard for frontend in frontends] == [["FAULT one"], ["FAULT one", "FAULT two"]]


def test_who_waits_for_an_outcome_hears_faults_but_not_the_outcome() -> None:
    notices, asked, other = Notices(), Frontend(), Frontend()
    notices.listen(asked)
    notices.listen(other)
    with notices.answered(asked):
        notices.tell("picked: cube", NoticeLevel.OUTCOMES)
        notices.tell("STOPPED by ann")
    notices.tell("picked: pyramid", NoticeLevel.OUTCOMES)
    assert asked.heard == ["STOPPED by ann", "picked: pyramid"]
    assert other.heard == ["picked: cube", "STOPPED by ann", "picked: pyramid"]


def test_who_waits_for_a_motion_reads_its_refusal_in_the_answer_and_others_in_a_notice() -> None:
    notices, asked, other = Notices(), Frontend(), Frontend()
    notices.listen(asked)
    notices.listen(other)
    refused = "refused, not_enabled: the arm is not enabled: `enable` first"
    with notices.answered(asked):
        notices.tell(refused, refusal=True)
    assert (asked.heard, other.heard) == ([], [refused])
    notices.tell(refused, refusal=True)
    assert (asked.heard, other.heard) == ([refused], [refused, refused])


def test_each_frontend_hears_as_much_as_its_operator_wants_and_faults_always() -> None:
    notices, frontends = Notices(), [Frontend(), Frontend(), Frontend()]
    for frontend, level in zip(frontends, NoticeLevel, strict=True):
        notices.listen(frontend)
        notices.set_level(frontend, level)
    frontends[2].who = "ann"  # type: ignore[attr-defined]
    for text, level in (
        ("FAULT", NoticeLevel.FAULTS),
        ("picked", NoticeLevel.OUTCOMES),
        ("bob: train", NoticeLevel.ALL),
    ):
        notices.tell(text, level)
    notices.tell("ann: train", NoticeLevel.ALL, by="ann")
    assert [frontend.heard for frontend in frontends] == [
        ["FAULT"],
        ["FAULT", "picked"],
        ["FAULT", "picked", "bob: train"],
    ]
    notices.leave(frontends[0])
    assert notices.level(frontends[0]) is None


def test_who_stops_is_answered_and_not_told_the_same_once_more() -> None:
    notices, ann, bob = Notices(), Frontend(), Frontend()
    notices.listen(ann)
    notices.listen(bob)
    alarm = "STOPPED by ann; NOT CONFIRMED: no answer: press the emergency stop"
    with notices.stopping(ann, "ann"):
        for text in ("STOPPED by ann", "STOPPED by control-C of ann", alarm, "STOPPED by bob"):
            notices.tell(text)
    assert ann.heard == [alarm, "STOPPED by bob"]
    assert len(bob.heard) == 4


def end(outcome: str) -> Any:
    return SimpleNamespace(
        outcome=outcome,
        brought=outcome in BROUGHT,
        label="cube",
        stops=3,
        seconds=12.0,
        predicted_mm=None,
        predicted_deg=None,
        why="because",
        ended_by=None,
        place=None,
    )


def test_an_empty_table_is_no_news_and_a_fault_is_told_once() -> None:
    context: Any = SimpleNamespace(notices=Notices())
    frontend = Frontend()
    context.notices.listen(frontend)
    for outcome in ("empty", "fault", "picked", "missed"):
        report_end(context, end(outcome))
    assert frontend.heard == ["picked: cube, 3 looks, 12.0 s", "missed: cube, 3 looks, 12.0 s (because)"]


def test_the_end_of_an_auto_is_told_with_what_it_brought() -> None:
    async def auto(*_: Any) -> list[Any]:
        await asyncio.sleep(0)
        return [end("picked"), end("missed"), end("picked"), end("empty")]

    async def run() -> list[str]:
        context: Any = SimpleNamespace(cycle=SimpleNamespace(begin_auto=auto), notices=Notices(), _auto=None)
        context.cycle.supervisor, context.cycle.skipped = (
            SimpleNamespace(fault_text=None),
            [],
        )
        context._auto_ended = lambda task: CommandContext._auto_ended(context, task)
        context.auto_end = lambda ends: CommandContext.auto_end(context, ends)
        frontend = Frontend()
        context.notices.listen(frontend)
        await CommandContext.begin_auto(context)
        await context._auto
        await asyncio.sleep(0)
        return frontend.heard

    assert lived(run()) == ["Auto has ended: 2 parts picked; the table is empty."]


@pytest.mark.parametrize(
    ("outcomes", "count", "fault", "left", "told"),
    [
        (["picked", "empty"], None, None, 0, "1 part picked; the table is empty."),
        (["empty"], None, None, 2, "0 parts picked; nothing more to pick: 2 parts left alone, `status` says why."),
        (["picked", "picked"], 2, None, 1, "2 parts picked; that is as many as requested."),
        (["picked"], 3, None, 0, "1 part picked; ended by `auto off`."),
        (["picked", "unknown"], None, None, 0, "1 part picked; the last one ended as unknown: because."),
        (["picked", "fault"], 3, "stopped by ann", 0, "1 part picked; stopped by ann."),
        ([], 3, None, 0, "0 parts picked; stopped before the first pick."),
        (["picked", "aborted"], 3, None, 0, "1 part picked; the last one ended as aborted: because."),
    ],
)
def test_each_end_of_an_auto_says_why(
    outcomes: list[str], count: int | None, fault: str | None, left: int, told: str
) -> None:
    cycle = SimpleNamespace(supervisor=SimpleNamespace(fault_text=fault), skipped=[None] * left)
    context: Any = SimpleNamespace(_begun=PickOrder(count), cycle=cycle)
    assert CommandContext.auto_end(context, [end(outcome) for outcome in outcomes]) == told


def test_an_auto_that_may_not_begin_is_not_waited_for_in_place_of_the_one_that_is_on() -> None:
    """`auto resume` beside an auto was refused as busy; `auto wait` then said at once that 0 parts had been picked."""
    free, end_of_first = [True], asyncio.Event()

    async def ended() -> list[Any]:
        await end_of_first.wait()
        return [end("picked")]

    def auto(*_: Any) -> Coroutine[Any, Any, list[Any]]:
        if not free:
            raise RefusedError("busy: auto")
        free.clear()
        return ended()

    async def run() -> list[Any]:
        context: Any = SimpleNamespace(cycle=SimpleNamespace(begin_auto=auto), notices=Notices(), _auto=None)
        context.cycle.supervisor, context.cycle.skipped = (
            SimpleNamespace(fault_text=None),
            [],
        )
        context._auto_ended = lambda task: CommandContext._auto_ended(context, task)
        context.auto_end = lambda ends: CommandContext.auto_end(context, ends)
        await CommandContext.begin_auto(context)
        with pytest.raises(RefusedError, match="busy"):
            await CommandContext.begin_auto(context)
        waiting = asyncio.ensure_future(CommandContext.auto_ends(context))
        await asyncio.sleep(0)
        assert not waiting.done()
        end_of_first.set()
        return await waiting

    assert [one.outcome for one in lived(run())] == ["picked"]


def waited_for(waiting: Waiting | None = None) -> Any:
    """A context in which this move waits."""
    supervisor = SimpleNamespace(hold=SimpleNamespace(waiting=waiting))
    cycle = SimpleNamespace(supervisor=supervisor, target=None, state=PickState.SURVEY)
    return SimpleNamespace(cycle=cycle, notices=Notices())


def test_a_question_is_taken_back_where_somebody_else_decides() -> None:
    decided = asyncio.Event()
    context = waited_for(HOME)
    frontend = Frontend()

    async def move() -> str:
        await decided.wait()
        return "moved"

    async def run() -> str:
        waiting = asyncio.create_task(with_questions(context, move(), frontend))  # type: ignore[arg-type]
        await until_so(lambda: frontend.asked)
        context.cycle.supervisor.hold.waiting = None
        await until_so(lambda: frontend.withdrawn)
        decided.set()
        return await waiting

    assert lived(run()) == "moved"
    assert frontend.asked == ["home: joints. Send it? [y/n]"]


def test_who_waits_for_a_move_that_somebody_else_holds_is_told_so_each_time() -> None:
    """Nothing was said: whoever went to the arm to see why stood there when it was let go."""
    context = waited_for()
    frontend = Frontend()

    async def move() -> None:
        for held in (PickState.SURVEY, PickState.PAUSED) * 2:
            context.cycle.state = held
            await asyncio.sleep(2.5 * step_mode.POLL_S)

    lived(with_questions(context, move(), frontend))  # type: ignore[arg-type]
    assert frontend.said == ["Paused before the next move: `resume` continues."] * 2


def test_a_frontend_that_fails_keeps_no_other_from_hearing() -> None:
    class Broken:
        asks = False

        def notice(self, text: str) -> None:
            raise OSError("gone")

    notices, frontend = Notices(), Frontend()
    notices.listen(Broken())
    notices.listen(frontend)
    notices.tell("FAULT")
    assert frontend.heard == ["FAULT"]


def test_a_move_that_waits_where_nobody_is_asked_is_told_there_and_at_every_frontend_and_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A script, or an auto, in step mode would hang without a word of what is waited for."""
    monkeypatch.setattr(step_mode, "CHECK_WAITING_S", 0.0)
    monkeypatch.setattr(step_mode, "REMIND_S", 0.1)
    context = waited_for(HOME)
    script, console = Frontend(), Frontend()
    script.asks = False
    context.notices.listen(console)
    line = "Waiting for confirmation: home: joints. `confirm` (y) sends it, `refuse` (n) cancels it."

    async def run() -> None:
        confirmed = asyncio.Event()
        watching = asyncio.create_task(report_waiting_move(context))
        moving_on = asyncio.create_task(with_questions(context, confirmed.wait(), script))  # type: ignore[arg-type]
        await until_so(
            lambda: script.said[:3] == console.heard[:3] == [line, step_mode.STILL_WAITING, step_mode.STILL_WAITING]
        )
        asked = asyncio.create_task(with_questions(context, confirmed.wait(), console))  # type: ignore[arg-type]
        await until_so(lambda: bool(console.asked))
        heard, said = len(console.heard), len(script.said)
        await until_so(lambda: len(script.said) > said + 2)
        assert len(console.heard) == heard, "who is asked is not told as well"
        context.cycle.supervisor.hold.waiting = None
        confirmed.set()
        await asyncio.gather(moving_on, asked)
        watching.cancel()

    asyncio.run(run())
