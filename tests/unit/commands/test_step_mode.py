"""Waiting for a motion's end: a yes is one to the move that it was asked about."""

from __future__ import annotations

import asyncio
from types import SimpleNamespace
from typing import Any

import pytest

from daemon.arm.hold import PauseAndStep
from daemon.arm.permission import MotionPermission
from daemon.commands import step_mode
from daemon.commands.step_mode import with_questions
from daemon.console.notices import Notices
from daemon.pick.transitions import PickState
from tests.fakes.waiting import PATIENCE_S, until_so


class Asked:
    """A frontend at which a question is answered when it is told to be."""

    name, who, may, asks = "test", "ann", "all", True

    def __init__(self) -> None:
        self.questions: list[asyncio.Future[str]] = []

    async def say(self, text: str) -> None:
        """Nobody reads it."""

    async def ask(self, _: str) -> str:
        self.questions.append(asyncio.get_running_loop().create_future())
        return await self.questions[-1]


def test_a_yes_to_a_move_that_somebody_else_has_sent_is_none_to_one_of_the_same_name(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The hand was to open twice: between two looks at what waits the first one was sent, and the second came up."""
    monkeypatch.setattr(step_mode, "POLL_S", 0.01)
    hold, frontend = PauseAndStep(MotionPermission(), lambda _: None), Asked()
    hold.step(True)
    cycle = SimpleNamespace(supervisor=SimpleNamespace(hold=hold), target=None, state=PickState.SURVEY)
    context: Any = SimpleNamespace(cycle=cycle, notices=Notices())

    async def twice() -> None:
        for _ in range(2):
            await hold.wait("open the hand")

    async def play() -> None:
        motion = asyncio.create_task(with_questions(context, twice(), frontend))  # type: ignore[arg-type]
        await until_so(lambda: frontend.questions)
        first = hold.waiting
        hold.confirm()
        while hold.waiting in (None, first):
            await asyncio.sleep(0)
        frontend.questions[0].set_result("y")
        await until_so(lambda: len(frontend.questions) >= 2)
        assert hold.waiting is not None, "nobody was asked about it"
        frontend.questions[1].set_result("y")
        await asyncio.wait_for(motion, PATIENCE_S)

    asyncio.run(asyncio.wait_for(play(), PATIENCE_S))
