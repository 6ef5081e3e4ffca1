"""The one stop by itself, of an arm that obeys late, refuses, or is not there; with its jobs in test_supervisor.py."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from daemon.arm.permission import MotionPermission
from daemon.arm.robot import StopRefusedError
from daemon.arm.stopping import Stopping
from tests.fakes.in_time import lived

UNSURE = "jog; NOT CONFIRMED: {}: press the emergency stop"


class Arm:
    """Answers each round of telling in turn, an error by raising it; the last answer for ever."""

    def __init__(self, *answers: Exception | None) -> None:
        self.answers, self.told = iter(answers), 0
        self.permission = MotionPermission()
        self._last: Exception | None = None

    async def stop_motion(self) -> None:
        self.told += 1
        self._last = next(self.answers, self._last)
        if self._last is not None:
            raise self._last


@pytest.fixture(autouse=True)
def _soon(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("daemon.arm.stopping.ABORT_S", 0.05)
    monkeypatch.setattr("daemon.arm.stopping.AGAIN_S", 0.01)


def stopped(arm: Any, said: list[str | None]) -> tuple[str | None, bool]:
    """What the stop came to, and whether it was over then."""

    async def told() -> tuple[str | None, bool]:
        stopping = Stopping(lambda: arm, said.append)
        assert stopping.begin("jog")
        assert not stopping.begin("jog"), "who comes later joins in"
        assert arm.permission.stopping
        outcome = await stopping.outcome()
        over = not stopping.under_way
        assert arm.permission.stopping is not over, "nothing is permitted to move until it is over"
        assert stopping.alarm is (outcome is not None and not over)
        if not over and arm.told < 2:
            arm.answers = iter([None])
            await stopping.over()
        return outcome, over

    return lived(told())


def test_an_arm_that_is_seen_at_rest_is_told_no_more_and_no_alarm_sounds() -> None:
    arm, said = Arm(None), list[str | None]()
    assert stopped(arm, said) == (None, True)
    assert (arm.told, said) == (1, [])


def test_one_that_does_not_answer_at_once_is_told_again() -> None:
    arm, said = Arm(OSError("no prompt"), OSError("no prompt"), None), list[str | None]()
    assert stopped(arm, said) == (None, True)
    assert (arm.told, said) == (3, [])


def test_one_that_refuses_is_told_of_at_once_and_told_on_until_it_rests() -> None:
    arm, said = Arm(StopRefusedError("*Illegal command*")), list[str | None]()
    outcome, over = stopped(arm, said)
    assert outcome == UNSURE.format("*Illegal command*") + "; facetd keeps sending the stop"
    assert not over
    assert said == [UNSURE.format("*Illegal command*"), None]
    assert arm.told == 2


def test_one_that_is_not_seen_at_rest_in_time_is_told_of_once_by_its_last_problem() -> None:
    arm, said = Arm(OSError("no echo"), OSError("no prompt")), list[str | None]()
    outcome, _ = stopped(arm, said)
    assert outcome == UNSURE.format("no prompt") + "; facetd keeps sending the stop"
    assert said == [UNSURE.format("no prompt")]
    assert arm.told > 2


@pytest.mark.parametrize(("answers", "within_s"), [(True, 0.8), (False, 0.05)])
def test_where_the_stop_took_long_as_it_was_tried_the_alarm_waits_for_two_of_it_only_where_the_controller_answers(
    answers: bool, within_s: float
) -> None:
    """Controllers whose prompts come late sent their operators to the emergency stop, their arms at rest for long."""

    async def story() -> tuple[float, list[str | None]]:
        said = list[str | None]()
        arm: Any = Arm(OSError("no prompt"))
        arm.permission.stop_took_s, arm.permission.stop_answered = 0.4, 3
        loop = asyncio.get_running_loop()
        stopping = Stopping(lambda: arm, said.append)
        began_s = loop.time()
        stopping.begin("jog")
        assert not stopping.answered, "what was heard before was no answer to this stop"
        arm.permission.stop_answered += answers
        assert stopping.answered is answers
        await stopping.outcome()
        took_s = loop.time() - began_s
        assert not stopping.answered, "the alarm has sounded: nobody is told to wait"
        arm.answers = iter([None])
        await stopping.over()
        return took_s, said

    took_s, said = lived(story())
    assert took_s == pytest.approx(within_s, abs=0.02)
    assert said == [UNSURE.format("no prompt"), None]
