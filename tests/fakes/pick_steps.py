"""Run a pick state by state on the fake cell, to test each handler alone."""

from __future__ import annotations

import asyncio

from daemon.pick.cycle import HANDLERS
from daemon.pick.settings import Settings
from daemon.pick.transitions import PickEvent, PickState, follows
from daemon.pick.world import PickContext, WorldModel
from tests.fakes.fake_cell import World, cycle_of


def begun(fake: World, settings: Settings | None = None) -> tuple[PickContext, WorldModel]:
    """A pick before its survey, the arm enabled and its place known."""
    cycle = cycle_of(fake, settings)
    mover = cycle.supervisor.mover
    asyncio.run(mover.wait_until_at_rest())
    assert cycle.recogniser is not None
    return PickContext(cycle.cell, mover, cycle.recogniser, cycle.settings, None, cycle=1), WorldModel([])


def step(context: PickContext, world: WorldModel, state: PickState) -> PickEvent:
    """What the state's handler returns."""

    async def handled() -> PickEvent:
        return await HANDLERS[state](context, world)

    return asyncio.run(handled())


def brought_to(state: PickState, context: PickContext, world: WorldModel) -> None:
    """Go on from the survey until the state is entered."""
    here = PickState.SURVEY
    for _ in range(40):
        if here is state:
            return
        here = follows(here, step(context, world, here), PickState.IDLE)
    raise AssertionError(f"{state} was not reached")
