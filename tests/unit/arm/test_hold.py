"""What holds the next move, by itself: a pause and step mode; with the arm behind it in test_supervisor.py."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from functools import partial
from math import inf

import pytest

from daemon.arm.hold import PauseAndStep
from daemon.arm.motion import UnansweredError
from daemon.arm.operators import JobEvent, OperatorRefusedError, RefusedError
from daemon.arm.permission import MotionPermission
from tests.fakes.in_time import lived


def waits(hold: PauseAndStep, ask: bool, then: Callable[[asyncio.Task[None]], object]) -> str:
    """What became of a move that waits, after what is said then."""

    async def told() -> str:
        move = asyncio.create_task(hold.wait("to the bin", ask=ask))
        await asyncio.sleep(0)
        await asyncio.sleep(0)
        then(move)
        try:
            async with asyncio.timeout(0.05):
                await move
        except OperatorRefusedError as no:
            return str(no)
        except TimeoutError:
            return "waits"
        return "goes"

    return lived(told())


def test_a_pause_holds_until_it_is_let_go_and_tells_both() -> None:
    said: list[JobEvent] = []
    act: Callable[[PauseAndStep], None]
    for act, becomes in ((lambda _: None, "waits"), (PauseAndStep.end_pause, "goes")):
        hold = PauseAndStep(MotionPermission(), said.append)
        hold.pause()
        assert waits(hold, False, partial(lambda hold, act, _: act(hold), hold, act)) == becomes
    assert said == [JobEvent.PAUSE, JobEvent.PAUSE, JobEvent.RESUME]


def test_how_long_ago_moves_were_held_is_known_and_endless_where_they_never_were(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    now_s = 50.0
    monkeypatch.setattr("daemon.arm.hold.time.monotonic", lambda: now_s)
    hold = PauseAndStep(MotionPermission(), lambda _: None)
    assert hold.paused_s == inf
    hold.pause("anna")
    now_s = 53.0
    assert (hold.paused_s, hold.paused_by, hold.pauses) == (3.0, "anna", 1)


def test_what_lets_go_by_an_older_pause_lets_nothing_go() -> None:
    hold = PauseAndStep(MotionPermission(), lambda _: None)
    hold.pause()
    decided = hold.pauses
    hold.pause()
    hold.end_pause(decided)
    assert hold.paused
    hold.end_pause(hold.pauses)
    assert not hold.paused


@pytest.mark.parametrize("ask", [False, True])
def test_in_step_mode_or_where_told_to_a_move_waits_for_a_yes(ask: bool) -> None:
    hold = PauseAndStep(MotionPermission(), lambda _: None)
    hold.step(not ask)
    assert waits(hold, ask, lambda _: None) == "waits"
    assert waits(hold, ask, lambda _: hold.confirm()) == "goes"
    assert waits(hold, ask, lambda _: hold.refuse()) == "somebody answered no to: to the bin"
    assert (hold.waiting, hold.pending_s) == (None, inf)


def test_a_yes_sends_nothing_that_a_pause_holds_by_then() -> None:
    hold = PauseAndStep(MotionPermission(), lambda _: None)
    hold.step(True)

    def paused_before_the_yes(_: object) -> None:
        hold.pause()
        hold.confirm()

    assert waits(hold, False, paused_before_the_yes) == "waits"


def test_a_second_answer_and_one_to_nothing_are_refused() -> None:
    hold = PauseAndStep(MotionPermission(), lambda _: None)
    with pytest.raises(RefusedError, match="no move is waiting"):
        hold.confirm()
    hold.step(True)

    def twice(_: object) -> None:
        hold.confirm()
        with pytest.raises(RefusedError, match="no move is waiting"):
            hold.refuse()

    assert waits(hold, False, twice) == "goes"


def test_a_hold_said_after_a_move_was_let_go_is_seen_until_the_next_is() -> None:
    hold = PauseAndStep(MotionPermission(), lambda _: None)
    assert waits(hold, False, lambda _: None) == "goes"
    assert not hold._permission.must_wait
    for said in (hold.pause, lambda: hold.step(True)):
        said()
        assert hold._permission.must_wait
    hold.end_pause()
    hold.step(False)
    assert waits(hold, False, lambda _: None) == "goes"
    assert not hold._permission.must_wait


def test_a_yes_counts_while_the_look_is_valid_and_nobodys_silence_is_none() -> None:
    hold = PauseAndStep(MotionPermission(), lambda _: None)
    hold.step(True)

    async def story(answer: Callable[[], None]) -> tuple[str, bool]:
        move = asyncio.create_task(hold.wait("stand-off", valid_s=20.0))
        await asyncio.sleep(8.0)
        waiting = hold.waiting
        assert waiting is not None
        asked_outside.append(lambda: waiting.text)
        text = waiting.text
        answer()
        await move
        return text, isinstance(waiting.answer.exception(), UnansweredError)

    asked_outside = list[Callable[[], str]]()

    assert lived(story(hold.confirm)) == ("stand-off; its look is valid for 12 s", False)
    assert asked_outside[0]() == "stand-off; its look is valid for 12 s", "asked for by what runs no event loop"
    with pytest.raises(UnansweredError):
        lived(story(lambda: None))
    assert hold.waiting is None
