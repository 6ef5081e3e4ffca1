"""What becomes of an arm whose looks crash: one failed look, told in one line; the arm is stopped and under control."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from daemon.arm import MoveRefusedError
from daemon.compute.calls import ComputeError
from daemon.compute.worker import Worker
from daemon.events.codes import CauseCode
from daemon.vision.model.model import Model
from tests.fakes.chosen import few
from tests.fakes.faulty_recogniser import FaultyRecogniser
from tests.fakes.simulated_cell import Rig, rig, taught_once

ROOT = Path(__file__).parents[3]
SAID = {"killed": "was ended by SIGKILL", "exhausted": "ran out of memory", "endless": "took longer than"}


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Model:
    return taught_once(tmp_path_factory)


@pytest.mark.parametrize("fault", few(SAID, 1))
def test_a_look_that_crashes_is_one_failed_look_and_the_arm_stays_under_control(
    fault: str, model: Model, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    orders, worker = tmp_path / "orders", Worker("the look", 60.0)

    async def story(here: Rig) -> None:
        cycle, supervisor = here.cycle, here.cycle.supervisor
        await cycle.go("survey")
        sight = cycle.recogniser
        cycle.use(FaultyRecogniser(sight, orders))  # type: ignore[arg-type]
        here.cell.scatter(["cube"])
        worker.within_s = 4.0 if fault == "endless" else 60.0
        orders.write_text(fault)
        with pytest.raises(ComputeError, match=SAID[fault]) as raised:
            await cycle.look()
        assert "\n" not in str(raised.value)
        worker.within_s = 60.0
        assert supervisor.fault_text is None, "a look that moves nothing and fails is no fault of the arm"

        orders.write_text(fault)
        worker.within_s = 4.0 if fault == "endless" else 60.0
        end = await cycle.pick("cube")
        worker.within_s = 60.0
        assert end.outcome == "fault"
        assert SAID[fault] in end.why
        assert SAID[fault] in (supervisor.fault_text or "")
        assert supervisor.stop_cause.code is CauseCode.COMPUTATION
        assert await supervisor.at_rest()
        with pytest.raises(MoveRefusedError, match="fault_active"):
            await cycle.go("home")

        supervisor.resume()
        assert await cycle.look()
        await cycle.go("home")
        assert (await cycle.pick("cube")).outcome == "picked", "the next pick is as any other"

    async def live() -> None:
        try:
            async with rig(3, model=model, compute=worker) as here:
                await story(here)
        finally:
            worker.close()

    asyncio.run(live())
