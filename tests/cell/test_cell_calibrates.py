"""Calibrating with the simulated arm and a board; a knock noticed in the looks of an ordinary day."""

import asyncio

import pytest

from daemon.calibration.board import Board
from daemon.calibration.drift_watch import DriftWatch
from daemon.calibration.session import Session, SessionError, verify, view_tour
from daemon.jobs.demo import PARTS
from tests.worlds import simulated_cell
from tests.worlds.simulated_cell import rig

pytestmark = pytest.mark.slow


BOARD = Board(9, 6, 16.0)


async def silence(_: str) -> None:
    """Nobody listens."""


def session(here, believed):
    return Session(here.cycle.supervisor, here.cycle.settings.settling, BOARD, believed)


def test_a_board_passes_the_true_calibration_and_fails_it_once_an_eye_was_knocked():
    async def story():
        believed = simulated_cell.true_calibration()
        async with rig(seed=11, believed=believed, time_scale=40.0) as here:
            await here.cycle.go("survey")
            here.cell.show_board()
            good = verify(await view_tour(session(here, believed), 5, silence, 100.0), BOARD, believed)
            here.cell.camera.knock("right", (0.2, 0.0, 0.0))
            await here.cycle.go("survey")
            bad = verify(await view_tour(session(here, believed), 5, silence, 100.0), BOARD, believed)
            return good, bad

    good, bad = asyncio.run(story())
    assert good.passed, good.failures
    assert not bad.passed
    assert any("an eye has moved" in failure for failure in bad.failures)


def test_without_a_board_in_view_the_arm_does_not_move():
    async def story():
        async with rig(seed=12) as here:
            await here.cycle.go("survey")
            before = here.cell.world_from_tool()
            with pytest.raises(SessionError, match="do not see the board"):
                await view_tour(session(here, simulated_cell.true_calibration()), 5, silence, 100.0)
            return abs(here.cell.world_from_tool() - before).max()

    assert asyncio.run(story()) < 0.2


def test_a_knock_of_a_fifth_of_a_degree_is_noticed_within_twenty_looks_at_ordinary_parts(model):
    async def story():
        async with rig(seed=13, model=model) as here:
            here.cell.scatter(PARTS)
            watch, places = DriftWatch(), [p for p in here.cycle.places() if p.startswith("survey")]
            for number in range(24):
                if number % 8 == 0:
                    await here.cycle.go(places[number // 8 % len(places)])
                assert watch.seen((await here.cycle.look()).clue, "08:00") is None
            here.cell.camera.knock("right", (0.2, 0.0, 0.0))
            for number in range(20):
                if number % 7 == 0:
                    await here.cycle.go(places[number // 7 % len(places)])
                if watch.seen((await here.cycle.look()).clue, "09:12") is not None:
                    return number + 1, watch.drift
            return None, None

    looks, drift = asyncio.run(story())
    assert looks is not None
    assert drift.axis == "pitched"
    assert "since 09:12" in drift.text
