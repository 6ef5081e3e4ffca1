"""Who is told of looks and picks: after the record, with the values themselves, and unable to stop anything."""

import asyncio
from typing import Any

import pytest

from daemon.arm.settling import Settling
from daemon.events.codes import CauseCode, FaultCause
from daemon.events.outcomes import Outcome
from daemon.pick.cycle import PickCycle
from daemon.pick.looks import Look
from daemon.pick.outcome import CycleEnd, InGripper, released
from daemon.pick.settings import Settings
from tests.fakes.fake_cell import TruthRecogniser, World, build, one_part


class Watching:
    """Keeps what it is told, and how many records of it there were by then."""

    def __init__(self, world: World) -> None:
        self.world = world
        self.looks: list[tuple[Look, int]] = []
        self.ends: list[tuple[CycleEnd, int]] = []

    def looked(self, look: Look) -> None:
        self.looks.append((look, len(self.world.said("look"))))

    def ended(self, end: CycleEnd) -> None:
        self.ends.append((end, len(self.world.said("cycle_end"))))


class Failing:
    """Whatever it is told, it breaks on."""

    def looked(self, look: Look) -> None:
        raise RuntimeError("the observer broke")

    def ended(self, end: CycleEnd) -> None:
        raise RuntimeError("the observer broke")


def observed(world: World, observer: Any) -> PickCycle:
    cycle = PickCycle(build(world), Settings(settling=Settling()), TruthRecogniser(world), observer)
    cycle.supervisor.enable()
    return cycle


def test_each_look_and_each_end_is_told_once_its_record_is_written():
    world = one_part()
    watching = Watching(world)
    cycle = observed(world, watching)
    end = asyncio.run(cycle.pick())
    asyncio.run(cycle.look())
    assert [count for _, count in watching.looks] == list(range(1, len(world.said("look")) + 1))
    assert watching.ends == [(end, 1)]
    assert watching.looks[-1][0].tracked is None


def test_an_observer_that_breaks_stops_nothing_and_is_reported():
    world = one_part()
    cycle, reported = observed(world, Failing()), []

    async def story() -> CycleEnd:
        asyncio.get_running_loop().set_exception_handler(lambda _, what: reported.append(str(what["exception"])))
        return await cycle.pick()

    assert asyncio.run(story()).outcome == "picked"
    assert cycle.supervisor.fault_text is None
    assert world.binned == ["cube"]
    assert reported == ["the observer broke"] * (len(world.said("look")) + 1)


@pytest.mark.parametrize("code", ["calibration"])
def test_an_observer_that_finds_the_arm_must_stop_asks_the_supervisor_to(code):
    world = one_part()
    asking: list[asyncio.Task[None]] = []

    class Asking(Watching):
        def looked(self, look: Look) -> None:
            if not asking:
                asking.append(
                    asyncio.create_task(
                        cycle.supervisor.fail(code, "a camera has moved", FaultCause(CauseCode.CAMERA_KNOCKED))
                    )
                )

    cycle = observed(world, Asking(world))
    end = asyncio.run(cycle.pick())
    assert end.outcome == "fault"
    assert cycle.status()["fault"] == "calibration: a camera has moved"
    assert world.wire[-1][0] == "abort"


@pytest.mark.parametrize("opened", list(InGripper))
@pytest.mark.parametrize("above", list(InGripper))
def test_a_part_is_picked_only_where_it_showed_above_the_bin_and_no_longer_after(above, opened):
    result = released("cube", above, opened)
    picked = above is InGripper.PART and opened is not InGripper.PART
    assert result.outcome is (Outcome.PICKED if picked else Outcome.RELEASED)
    assert result.code == (None if picked else "release_unconfirmed")
    assert "cube" in result.why
