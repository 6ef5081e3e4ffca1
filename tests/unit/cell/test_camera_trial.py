"""Which camera is to be trusted, by its own pictures: each alone after a fault, and both before they are looked
with."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from daemon.calibration.file import load_calibration
from daemon.cell.camera_trial import camera_faults, pair_fault, shutters
from daemon.cell.cameras import StereoPair, ThreadedCameras
from drivers.camera.pair import Frame
from drivers.simcell.cell import SimulatedCell
from tests.fakes.moving_texture import FPS, frame
from tests.fakes.simulated_cell import CONFIG
from tests.fakes.simulated_time import SimulatedLoop

RIG = load_calibration(CONFIG.parent / "calibration.yaml").rig


def tried(
    prepare: Callable[[SimulatedCell], None], ask: Callable[[ThreadedCameras, SimulatedLoop], Awaitable[Any]]
) -> Any:
    """What is answered over a table with parts, and which cameras are looked with afterwards."""
    with asyncio.Runner(loop_factory=SimulatedLoop) as runner:
        loop = runner.get_loop()
        assert isinstance(loop, SimulatedLoop)
        with SimulatedCell(CONFIG.parent / "simcell.yaml", 3, loop=loop) as cell:
            cell.place_for_teaching("cube", 0)
            cameras = ThreadedCameras(cell.camera, loop.time)

            async def story() -> Any:
                await cameras.open()
                await cameras.grab(0.0, 1.0)
                prepare(cell)
                return await ask(cameras, loop), cameras.alone

            return runner.run(story())


def break_camera(how: str) -> Callable[[SimulatedCell], None]:
    return lambda cell: cell.camera.cover("left") if how == "black" else cell.camera.set_fault("left", how)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("how", "told"), [("away", "unplugged"), ("black", "covered"), ("frozen", "frozen"), ("half", "half a frame")]
)
def test_the_camera_that_fails_is_named_with_what_it_has_and_the_other_is_not(how: str, told: str) -> None:
    wrong, alone = tried(break_camera(how), lambda cameras, loop: camera_faults(cameras, loop.time))
    assert list(wrong) == ["left"]
    assert told in wrong["left"]
    assert alone is None, "nobody said to look with one"


def test_of_two_cameras_that_see_nothing_is_said() -> None:
    assert tried(lambda _: None, lambda cameras, loop: camera_faults(cameras, loop.time)) == ({}, None)


async def back(cameras: ThreadedCameras, loop: SimulatedLoop) -> Any:
    await cameras.use("left")
    return await pair_fault(cameras, RIG, loop.time)


def test_both_cameras_are_trusted_where_they_show_one_scene_as_calibrated() -> None:
    assert tried(lambda _: None, back) == (None, None)


def test_a_camera_that_came_back_knocked_is_not_trusted() -> None:
    wrong, alone = tried(lambda cell: cell.camera.displace("right", np.array([0.8, 0.0, 0.0])), back)
    assert "knocked" in wrong
    assert alone == "left"


def test_a_camera_that_came_back_dark_is_not_trusted() -> None:
    wrong, alone = tried(lambda cell: cell.camera.cover("right"), back)
    assert "covered" in wrong
    assert alone == "left"


def test_over_an_empty_table_both_cameras_are_not_trusted_yet() -> None:
    wrong, alone = tried(lambda cell: cell.clear(), back)
    assert "no common object in view" in wrong
    assert alone == "left"


def moved_before(readout_s: dict[str, float]) -> Any:
    """Cameras before which a print goes to and fro; each exposes its last row so long after its first."""
    rng, taken = np.random.default_rng(7), iter(range(100))

    def way_px(at_s: float) -> float:
        return 40.0 * float(np.sin(2 * np.pi * at_s))

    async def grab(after_s: float, _: float) -> StereoPair:
        number = next(taken)
        at_s = number / FPS
        assert at_s > after_s or number == 0
        left, right = (Frame(frame(way_px, at_s, rng, readout_s[camera]), at_s, number) for camera in ("left", "right"))
        return StereoPair(left, right)

    return SimpleNamespace(grab=grab, alone=None)


def test_the_camera_with_a_rolling_shutter_is_named_and_the_other_is_not() -> None:
    found = asyncio.run(shutters(moved_before({"left": 0.0, "right": 0.025}), lambda: 0.0))
    assert [found["left"][:14], found["right"][:15]] == ["global shutter", "rolling shutter"]
