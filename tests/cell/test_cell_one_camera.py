"""A cell with one camera, from teaching to the bin; and one whose other camera fails in mid-auto."""

from __future__ import annotations

import asyncio
from typing import Any

import numpy as np
import pytest

from daemon.commands.moving import resume
from tests.fakes import simulated_cell
from tests.fakes.fake_context import FakeFrontend
from tests.fakes.simulated_hours import Hours, cell_in_time
from tests.fakes.simulated_time import SimulatedLoop

pytestmark = pytest.mark.slow


def run(story: Any) -> Any:
    with asyncio.Runner(loop_factory=SimulatedLoop) as runner:
        return runner.run(story)


def test_what_one_camera_was_taught_it_brings_to_the_bin_and_the_grasp_is_where_it_was_said_to_be() -> None:
    async def story() -> Any:
        async with cell_in_time(31, alone="left") as here:
            await simulated_cell.taught(here)
            simulated_cell.lay(here, "cube", np.random.default_rng(5))
            end = await here.cycle.pick()
            return end, here.lies("cube"), end.grasp is not None and here.grasp_error(end), here.log.said("look")

    end, lies, error, looks = run(story())
    assert (end.outcome, lies) == ("picked", "bin"), end.why
    assert error[0] < 3 * end.predicted_mm
    assert all(look["moved"]["eye"] == "left" for look in looks)


def test_a_camera_frozen_in_mid_auto_stops_the_arm_and_after_a_yes_the_other_clears_the_table(model: Any) -> None:
    async def story() -> Any:
        async with cell_in_time(32, model) as here:
            here.cell.scatter(["cube", "pentagonal_prism"], np.random.default_rng(2))
            await here.context.begin_auto()
            await asyncio.sleep(6.0)
            here.cell.camera.set_fault("right", "frozen")
            first = await here.context.auto_ends()
            moves = len(here.log.said("move"))
            await asyncio.sleep(5.0)
            assert len(here.log.said("move")) == moves, "nothing moves before it is allowed"
            await resume.run(here.context, [], Yes(here))
            await here.context.auto_ends()
            return (
                first,
                here.context.hardware.cameras.alone,
                [here.lies(part) for part in ("cube", "pentagonal_prism")],
            )

    first, alone, lie = run(story())
    assert first[-1].outcome == "fault"
    assert "frozen" in first[-1].why
    assert alone == "left"
    assert lie == ["bin", "bin"]


class Yes(FakeFrontend):
    """Says how the gripper is, and yes to all else."""

    def __init__(self, here: Hours) -> None:
        super().__init__()
        self.here = here

    @property
    def asks(self) -> bool:
        """Somebody sits there."""
        return True

    async def ask(self, question: str) -> str:
        """See the class."""
        return ("y" if self.here.cell.world.held else "n") if "gripper" in question else "y"
