"""What the tests of the arm's line share: a controller on a pseudo-terminal, a link to it."""

from collections.abc import Iterator
from typing import Any

import pytest

from drivers.puma560 import READY_RAD
from drivers.simcell.arm import SimulatedArm
from drivers.simcell.controller import Controller, Faults, Machine, Manners, PtyServer
from tests.fakes.arm_line import ArmLine, MakesLine, line_in_time


def controller_that(manners: Manners | None, cold: bool, joints_rad: Any) -> tuple[Controller, Faults, list[bool]]:
    """A controller, its faults, and the commands that its gripper gets."""
    faults, hand = Faults(), list[bool]()
    return Controller(Machine(SimulatedArm(joints_rad=joints_rad), manners, hand.append, faults, cold)), faults, hand


@pytest.fixture
def arm_line() -> Iterator[MakesLine]:
    """Builds lines: arm_line(manners, cold=False, time_scale=20, joints_rad=READY_RAD)."""
    servers: list[PtyServer] = []

    def build(
        manners: Manners | None = None,
        cold: bool = False,
        time_scale: float = 20.0,
        joints_rad: Any = READY_RAD,
    ) -> ArmLine:
        controller, faults, hand = controller_that(manners, cold, joints_rad)
        servers.append(PtyServer(controller, time_scale=time_scale))
        return ArmLine(servers[-1], faults, hand)

    yield build
    for server in servers:
        server.stop()


@pytest.fixture
def timed_line() -> MakesLine:
    """The same on simulated time, for a coroutine that `lived` runs: nobody waits for it."""

    def build(
        manners: Manners | None = None,
        cold: bool = False,
        time_scale: float = 20.0,
        joints_rad: Any = READY_RAD,
    ) -> ArmLine:
        controller, faults, hand = controller_that(manners, cold, joints_rad)
        return line_in_time(controller, faults, hand, time_scale)

    return build
