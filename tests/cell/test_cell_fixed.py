"""A cell whose cameras are fixed over the table, from the first look to the bin."""

from __future__ import annotations

import asyncio
from typing import Any

import numpy as np
import pytest

from daemon.cli.demo import PARTS
from daemon.pick.cycle import PickCycle
from tests.fakes.simulated_cell import FIXED, rig

pytestmark = pytest.mark.slow


def test_it_picks_four_parts_each_by_one_look_and_the_arm_touches_nothing(model: Any) -> None:
    """The motion monitor of the cell, which knows where its cameras hang, finds nothing (see rig)."""

    async def story() -> Any:
        async with rig(seed=23, model=model, file=FIXED, time_scale=40.0) as here:
            here.cell.scatter(PARTS)
            ends = await here.cycle.auto()
            errors = [here.grasp_error(end) for end in ends[-2:-1]]
            return ends, errors, [here.lies(label) for label in PARTS], here.log.said("look"), out_of_view(here.cycle)

    ends, errors, lie, looks, home = asyncio.run(story())
    assert lie == ["bin"] * 4
    assert [end.outcome for end in ends[:-1]].count("missed") == 0
    assert {end.stops for end in ends if end.label is not None} == {1}
    assert max(mm for mm, _ in errors) < 2.0
    assert all(np.allclose(look["where"], home, atol=0.5) for look in looks)


def out_of_view(cycle: PickCycle) -> Any:
    return cycle.settings.home.pose()


def test_a_person_s_look_waits_until_the_arm_is_out_of_the_view(model: Any) -> None:
    async def story() -> Any:
        async with rig(seed=24, model=model, file=FIXED, time_scale=40.0) as here:
            here.cell.scatter(PARTS[:1])
            await here.cycle.go("bin")
            with pytest.raises(Exception, match="in the fixed cameras' view: `go home` first"):
                await here.cycle.look()
            await here.cycle.go("home")
            return await here.cycle.look()

    assert [part.recognition.label for part in asyncio.run(story()).scene.parts] == ["cube"]
