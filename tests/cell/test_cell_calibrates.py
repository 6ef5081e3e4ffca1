"""Calibrating with the simulated arm and a board; a knock noticed in the looks of an ordinary day."""

import asyncio

import numpy as np
import pytest

from daemon import frames
from daemon.calibration.board import Board
from daemon.calibration.drift import DriftWatch
from daemon.calibration.file import load_calibration
from daemon.calibration.session import CalibrationSession, SessionError, solve_camera, solve_hand_eye, verify, view_tour
from daemon.cli.demo import PARTS
from tests.fakes import simulated_cell
from tests.fakes.simulated_cell import rig
from tests.fakes.simulated_hours import cell_in_time
from tests.fakes.simulated_time import SimulatedLoop

pytestmark = pytest.mark.slow


BOARD = Board(9, 6, 16.0)


async def silence(_: str) -> None:
    """Nobody listens."""


def session(here, believed):
    return CalibrationSession(
        here.cycle.supervisor, here.cycle.prepare_to_move, here.cycle.settings.settling, BOARD, believed
    )


def test_a_board_passes_the_true_calibration_and_fails_it_once_a_camera_was_knocked():
    async def story():
        believed = simulated_cell.true_calibration()
        async with rig(seed=11, believed=believed, time_scale=40.0) as here:
            await here.cycle.go("survey")
            here.cell.show_board()
            good = verify(await view_tour(session(here, believed), 5, silence, 100.0), BOARD, believed)
            here.cell.camera.displace("right", (0.2, 0.0, 0.0))
            await here.cycle.go("survey")
            bad = verify(await view_tour(session(here, believed), 5, silence, 100.0), BOARD, believed)
            return good, bad

    good, bad = asyncio.run(story())
    assert good.passed, good.failures
    assert not bad.passed
    assert any("a camera has moved" in failure for failure in bad.failures)


def test_without_a_board_in_view_the_arm_does_not_move():
    async def story():
        async with rig(seed=12) as here:
            await here.cycle.go("survey")
            before = here.cell.world_from_tool()
            with pytest.raises(SessionError, match="do not see the board"):
                await view_tour(session(here, simulated_cell.true_calibration()), 5, silence, 100.0)
            return abs(here.cell.world_from_tool() - before).max()

    assert asyncio.run(story()) < 0.2


@pytest.mark.long
def test_a_knock_of_a_fifth_of_a_degree_is_noticed_within_twenty_looks_at_ordinary_parts(model):
    async def story():
        async with rig(seed=13, model=model) as here:
            here.cell.scatter(PARTS[:2])
            watch, places = DriftWatch(), [p for p in here.cycle.positions() if p.startswith("survey")]
            for number in range(24):
                if number % 8 == 0:
                    await here.cycle.go(places[number // 8 % len(places)])
                assert watch.add((await here.cycle.look()).clue, "08:00") is None
            here.cell.camera.displace("right", (0.2, 0.0, 0.0))
            for number in range(20):
                if number % 7 == 0:
                    await here.cycle.go(places[number // 7 % len(places)])
                if watch.add((await here.cycle.look()).clue, "09:12") is not None:
                    return number + 1, watch.drift
            return None, None

    looks, drift = asyncio.run(story())
    assert looks is not None
    assert "pitched" in drift.text
    assert "since 09:12" in drift.text


@pytest.mark.long
def test_a_cell_with_one_camera_is_calibrated_by_a_tour_and_verified_from_new_poses():
    believed = load_calibration(simulated_cell.CONFIG.parent / "calibration.yaml")
    truth = simulated_cell.true_calibration()

    async def story():
        async with cell_in_time(14, alone="left") as here:
            await here.cycle.go("survey")
            here.cell.show_board()
            views = await view_tour(session(here, believed), 14, silence, 100.0)
            after, result = solve_camera(views, BOARD, believed)
            after, hand_eye = solve_hand_eye(views, BOARD, after)
            await here.cycle.go("survey")
            return (
                after,
                result,
                hand_eye,
                verify(await view_tour(session(here, after), 5, silence, 100.0), BOARD, after),
            )

    with asyncio.Runner(loop_factory=SimulatedLoop) as runner:
        after, result, hand_eye, verified = runner.run(story())
    assert after.alone == "left"
    assert result.rms_px < 0.2
    assert abs(after.rig.left.matrix[0, 0] - truth.rig.left.matrix[0, 0]) < 4 * result.focal_sigma_px + 0.3
    assert verified.passed, verified.failures
    camera = after.tool_from_cyclopean @ after.rig.left.cyclopean_from_camera
    off = frames.difference(camera, truth.tool_from_cyclopean @ truth.rig.left.cyclopean_from_camera)
    assert np.linalg.norm(off[:3]) < 4 * hand_eye.sigma_mm
    assert np.degrees(np.linalg.norm(off[3:])) < 4 * hand_eye.sigma_deg
