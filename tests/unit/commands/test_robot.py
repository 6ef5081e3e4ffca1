"""What an operator tells the controller in a word of ours."""

from __future__ import annotations

import asyncio
from types import SimpleNamespace
from typing import Any

import numpy as np

from daemon.commands.controller_terminal import robot
from daemon.console.notices import Notices
from daemon.pick.cycle import PickCycle
from daemon.pick.settings import Settings
from tests.fakes.fake_cell import World, build
from tests.fakes.fake_context import FakeFrontend


def test_a_yes_to_what_is_no_question_of_power_up_leaves_it_open_what_the_hand_holds() -> None:
    """A program may go on by it, and close the hand: the next pick would open it at a stand-off."""
    cycle, answered = PickCycle(build(World(np.random.default_rng(0))), Settings()), list[str]()
    cycle.supervisor.enable()

    async def power_up(replies: list[str]) -> list[str]:
        answered.extend(replies)
        return ["PROGRAM COMPLETED"]

    arm = SimpleNamespace(
        question="Another part (Y/N)?", asks_whether_to_move=True, check_typable=len, power_up=power_up
    )
    hardware = SimpleNamespace(robot=SimpleNamespace(controller=arm))
    context: Any = SimpleNamespace(cycle=cycle, hardware=hardware, notices=Notices())

    assert cycle.status()["holding"] is False
    asyncio.run(robot.run(context, ["power-up", "Y"], FakeFrontend()))
    assert answered == ["Y"]
    assert cycle.status()["holding"] is None
