"""After a camera's fault: which camera is offered, that nothing is looked with that was not allowed, and the way
back."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Coroutine
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from daemon.arm import CameraName, JobEvent, RefusedError, operator_command
from daemon.arm.belief import BeliefSource
from daemon.commands import camera_selection
from daemon.commands.camera_selection import UNMEASURED, cameras
from daemon.commands.cycle_observer import CycleObserver
from daemon.commands.maintaining import doctor
from daemon.commands.moving import resume
from daemon.commands.observing import look
from daemon.commands.teaching import teach
from daemon.errors import CommandError
from daemon.events.codes import BY_OPERATOR, CauseCode, FaultCause
from daemon.events.pick_order import ALL, PickOrder
from daemon.service import Service
from drivers.simcell.camera import CameraFault
from tests.fakes.fake_context import FakeFrontend
from tests.fakes.simulated_cell import CONFIG
from tests.fakes.simulated_hours import Hours, cell_in_time
from tests.fakes.simulated_time import SimulatedLoop
from tests.fakes.waiting import until_so

FAULT = "CameraError: simulated pair: no frame within 5.00 s (right camera unplugged)"
UNPLUGGED = FaultCause(CauseCode.CAMERA_LOST, source="CameraError")


def lived(story: Callable[[Hours], Awaitable[Any]]) -> Any:
    async def life() -> Any:
        async with cell_in_time(5) as here:
            here.cell.place_for_teaching("cube", 0)
            return await story(here)

    with asyncio.Runner(loop_factory=SimulatedLoop) as runner:
        return runner.run(life())


def broken(here: Hours) -> None:
    """The right camera was torn off, and the arm was stopped for it."""
    here.cell.camera.set_fault("right", "away")
    here.cycle.supervisor.latch(FAULT, UNPLUGGED)


def test_resume_offers_the_camera_that_is_left_says_what_it_costs_and_looks_with_it_after_a_yes() -> None:
    async def story(here: Hours) -> None:
        broken(here)
        frontend = FakeFrontend(answers=["y"])
        answer = await resume.run(here.context, [], frontend)
        assert "right camera does not work" in frontend.asked[0]
        assert "a third longer" in frontend.asked[0]
        assert "Using the left camera alone" in answer.text
        assert here.cycle.supervisor.fault_text is None
        assert (here.context.hardware.cameras.alone, here.cycle.cell.alone) == ("left", "left")
        assert here.log.said("eyes")[0]["alone"] == "left"
        assert "left camera alone" in here.context.troubles.active["eyes"]
        assert not here.log.said("move")

    lived(story)


@pytest.mark.parametrize("stopped", [False, True])
def test_nobody_looks_while_the_cameras_are_changed_and_a_stop_leaves_them_as_they_were(stopped: bool) -> None:
    """The cameras were closed and one of them opened again for seconds: a look that began meanwhile had its one picture
    for both cameras', and the change was refused as `busy`."""

    async def story(here: Hours) -> None:
        change = here.context.hardware.cameras.use

        async def slowly(alone: CameraName | None) -> None:
            await change(alone)
            await asyncio.sleep(2.0)

        here.context.hardware.cameras.use = slowly
        changing = asyncio.create_task(here.context.look_with("left", "a test"))
        await asyncio.sleep(0.1)
        with pytest.raises(RefusedError, match="busy: change cameras"):
            await here.cycle.look()
        with pytest.raises(RefusedError, match="busy: change cameras; cameras are changed only when that has ended"):
            await here.context.look_with(None, "somebody else")
        if stopped:
            await here.cycle.supervisor.stop()
        await asyncio.wait([changing])
        assert isinstance(changing.exception(), RefusedError) is stopped
        alone = None if stopped else "left"
        assert (here.context.hardware.cameras.alone, here.cycle.cell.alone) == (alone, alone)

    lived(story)


def test_after_a_no_the_fault_stands_and_both_cameras_stay() -> None:
    async def story(here: Hours) -> None:
        broken(here)
        with pytest.raises(CommandError, match="fault is not cleared"):
            await resume.run(here.context, [], FakeFrontend(answers=["n"]))
        assert here.cycle.supervisor.fault_text == FAULT
        assert here.cycle.cell.alone is None

    lived(story)


def test_whoever_looks_as_soon_as_the_cameras_are_changed_looks_with_those_that_the_arm_is_reckoned_with() -> None:
    """The look began in between: with one camera's pictures, taken for both's; and the change was undone amid it."""

    async def story(here: Hours) -> None:
        supervisor = here.cycle.supervisor
        changing = asyncio.create_task(here.context.look_with("left", "a test"))
        while not supervisor.busy:
            await asyncio.sleep(0)
        while supervisor.busy:
            await asyncio.sleep(0)
        seen = await here.cycle.look("a test")
        await changing
        assert here.cycle.cell.alone == here.context.hardware.cameras.alone == "left"
        assert seen.taken.moved is not None

    lived(story)


def test_a_yes_to_teach_a_new_part_moves_no_camera_where_the_arm_was_stopped_since_it_was_asked_for() -> None:
    """`abort` leaves no fault: the arm moved the camera aside after it."""

    async def story(here: Hours) -> None:
        await cameras.run(here.context, ["left"], FakeFrontend())
        here.context.hardware = replace(here.context.hardware, operator=None)
        known = SimpleNamespace(labels=lambda: ())
        here.context.trainer = SimpleNamespace(parts={}, model=SimpleNamespace(labels=()), model_store=known)  # type: ignore[assignment]
        frontend = FakeFrontend(answers=["y", "n"])

        async def asked(question: str) -> str:
            await here.cycle.supervisor.abort()
            return frontend.answers.pop(0)

        frontend.ask = asked
        with (
            operator_command("teach", here.cycle.supervisor.stops),
            pytest.raises(RefusedError, match="type `teach` again"),
        ):
            await teach.run(here.context, ["bolt"], frontend)
        assert not here.log.said("move")

    lived(story)


def test_a_frontend_that_cannot_ask_is_told_the_word_and_nothing_changes() -> None:
    async def story(here: Hours) -> None:
        broken(here)
        answer = await resume.run(here.context, [], FakeFrontend())
        assert "`cameras left` uses it" in answer.text
        assert here.cycle.cell.alone is None

    lived(story)


@pytest.mark.parametrize(("fault", "cause"), [(FAULT, UNPLUGGED), ("stopped by tester", BY_OPERATOR)])
def test_where_both_cameras_see_or_no_camera_was_to_blame_nothing_is_offered(fault: str, cause: FaultCause) -> None:
    async def story(here: Hours) -> None:
        here.cycle.supervisor.latch(fault, cause)
        frontend = FakeFrontend(answers=["y"])
        await resume.run(here.context, [], frontend)
        assert not frontend.asked
        assert here.cycle.cell.alone is None

    lived(story)


def test_a_stop_by_a_person_on_top_of_a_camera_s_fault_leaves_the_offer() -> None:
    async def story(here: Hours) -> None:
        here.cell.camera.set_fault("right", "away")
        await here.cycle.supervisor.fail("cameras", "no frame", FaultCause(CauseCode.CAMERA_LOST))
        await here.cycle.supervisor.stop("by tester")
        frontend = FakeFrontend(answers=["y"])
        await resume.run(here.context, [], frontend)
        assert "right camera does not work" in frontend.asked[0]

    lived(story)


@pytest.mark.parametrize(
    ("cause", "hinted"),
    [
        (FaultCause(CauseCode.CAMERA_KNOCKED, source="MisleadingImagesError"), True),
        (FaultCause(CauseCode.LOOKS_DISAGREE, source="SuspectError"), True),
        (FaultCause(CauseCode.PART_MOVED, source="SuspectError"), False),
    ],
)
def test_after_a_mechanical_shock_resume_names_the_command_for_one_camera(cause: FaultCause, hinted: bool) -> None:
    async def story(here: Hours) -> None:
        here.cycle.supervisor.latch("a fault", cause)
        answer = await resume.run(here.context, [], FakeFrontend())
        assert ("`cameras left` or `cameras right`" in answer.text) is hinted

    lived(story)


def test_a_camera_is_looked_with_again_only_after_both_showed_one_scene() -> None:
    async def story(here: Hours) -> None:
        broken(here)
        await resume.run(here.context, [], FakeFrontend(answers=["y"]))
        with pytest.raises(CommandError, match="cannot be used yet"):
            await cameras.run(here.context, ["both"], FakeFrontend())
        assert here.cycle.cell.alone == "left"
        here.cell.camera.set_fault("right", None)
        assert (await cameras.run(here.context, ["both"], FakeFrontend())).text == "Using both cameras."
        assert here.cycle.cell.alone is None
        assert here.cycle.cell.rig is here.context.calibration.rig
        assert "eyes" not in here.context.troubles.active

    lived(story)


def test_a_camera_that_does_not_see_cannot_be_looked_with_alone() -> None:
    async def story(here: Hours) -> None:
        here.cell.camera.cover("right")
        with pytest.raises(CommandError, match=r"right camera cannot be used.*covered"):
            await cameras.run(here.context, ["right"], FakeFrontend())
        assert "right camera:" in (await cameras.run(here.context, [], FakeFrontend())).text
        assert here.context.hardware.cameras.alone is None

    lived(story)


def test_a_frontend_that_may_only_look_does_not_move_the_arm_by_looking_with_one_camera() -> None:
    async def story(here: Hours) -> None:
        await cameras.run(here.context, ["left"], FakeFrontend())
        with pytest.raises(CommandError, match="with one camera a look moves the arm"):
            await look.run(here.context, [], FakeFrontend(may="look"))
        assert not here.log.said("move")
        assert (await look.run(here.context, [], FakeFrontend())).text
        assert len(here.log.said("move")) == len(here.log.said("look")) + 1, "beside for each, and back"

    lived(story)


@pytest.mark.parametrize("blocked_by", [None, "disabled", "hand", "stopped", "paused", "auto off"])
def test_auto_degrade_goes_on_by_itself_only_where_the_arm_may_move_and_nobody_stopped_it(
    blocked_by: str | None,
) -> None:
    async def story(here: Hours) -> None:
        begun: list[Any] = []

        async def begin_auto(pick_order: PickOrder = ALL) -> None:
            begun.append(pick_order)

        context = here.context
        context.begin_auto = begin_auto
        here.cycle.pick_order = PickOrder(3, None)
        broken(here)
        if blocked_by == "disabled":
            await here.cycle.supervisor.disable()
        if blocked_by == "hand":
            here.cycle.beliefs.learn(BeliefSource.COMMANDED, holding=None)
        going = asyncio.create_task(
            CycleObserver(context, Service(CONFIG, simulated=True).in_background).continue_with_one_camera()
        )
        if blocked_by == "stopped":
            await asyncio.sleep(0)
            await here.cycle.supervisor.stop()
        if blocked_by in ("paused", "auto off"):
            await asyncio.sleep(0)
            here.cycle.supervisor.hold.pause() if blocked_by == "paused" else here.cycle.auto_off()
        await going
        assert here.cycle.supervisor.hold.paused is (blocked_by == "paused")
        assert begun == ([] if blocked_by else [PickOrder(3, None)])
        assert (here.cycle.supervisor.fault_text is None) == (blocked_by is None)

    lived(story)


def test_auto_degrade_lets_nothing_go_on_that_was_stopped_while_it_changed_cameras() -> None:
    async def story(here: Hours) -> None:
        begun: list[Any] = []

        async def stopped_meanwhile(alone: CameraName | None, why: str) -> None:
            await here.cycle.supervisor.stop()

        async def begin_auto(pick_order: PickOrder = ALL) -> None:
            begun.append(pick_order)

        here.context.look_with = stopped_meanwhile
        here.context.begin_auto = begin_auto
        here.cycle.pick_order = PickOrder(3, None)
        broken(here)
        await CycleObserver(here.context, Service(CONFIG, simulated=True).in_background).continue_with_one_camera()
        assert here.cycle.supervisor.fault_text is not None
        assert begun == []

    lived(story)


@pytest.mark.parametrize("resumed", [False, True])
def test_auto_degrade_lets_nothing_go_on_that_was_stopped_before_it_began(resumed: bool) -> None:
    """A stop said in the moment in which the pick ended was cleared with the camera's fault; and whoever cleared it,
    told that nothing goes on by itself, had the auto go on."""

    async def story(here: Hours) -> None:
        begun: list[Any] = []

        async def begin_auto(pick_order: PickOrder = ALL) -> None:
            begun.append(pick_order)

        here.context.begin_auto = begin_auto
        here.cycle.pick_order = PickOrder(3, None)
        broken(here)
        going = CycleObserver(here.context, Service(CONFIG, simulated=True).in_background).continue_with_one_camera()
        await here.cycle.supervisor.stop()
        if resumed:
            here.cycle.supervisor.resume()
        await going
        assert (here.cycle.supervisor.fault_text is None) is resumed
        assert begun == []

    lived(story)


def auto_degrading(here: Hours) -> tuple[CycleObserver, list[str]]:
    """What happens between picks where the configuration has one camera go on by itself, and what is begun there."""
    begun: list[str] = []

    def beside(work: Coroutine[Any, Any, None], name: str) -> None:
        work.close()
        begun.append(name)

    values = here.context.config.values
    config = replace(here.context.config, values=replace(values, pick=replace(values.pick, auto_degrade=True)))
    here.context.config = config
    here.cycle.pick_order = PickOrder(3, None)
    return CycleObserver(here.context, beside), begun


def test_auto_degrade_waits_for_the_first_time_that_an_operator_allowed_it() -> None:
    async def story(here: Hours) -> None:
        between, started = auto_degrading(here)
        await here.cycle.supervisor.stop()
        end = await _end(here)
        fault = replace(end, ended_by=JobEvent.ERROR)
        between.ended(fault)
        assert started == []
        here.context.one_camera_allowed = True
        between.ended(end)
        assert started == [], "nothing was wrong with the cameras"
        between.ended(fault)
        assert started == ["one camera"]

    lived(story)


def test_auto_degrade_lets_no_pick_go_on_that_was_aborted_as_it_was_being_stopped_for_the_cameras_fault() -> None:
    async def story(here: Hours) -> None:
        here.cycle.observer, started = auto_degrading(here)
        here.context.one_camera_allowed = True
        here.cell.camera.set_fault("right", "away")
        supervisor = here.cycle.supervisor
        pick = supervisor.begin("pick", here.cycle._run_cycle(ALL))
        await until_so(lambda: supervisor.permission.stopping or pick.done())
        await supervisor.abort()
        assert (await pick).outcome == "fault"
        assert started == []
        supervisor.resume()
        assert (await supervisor.begin("pick", here.cycle._run_cycle(ALL))).outcome == "fault"
        assert started == ["one camera"]

    lived(story)


async def _end(here: Hours) -> Any:
    here.cycle.supervisor.resume()
    here.cell.clear()
    return await here.cycle._run_cycle(ALL)


@pytest.mark.parametrize(
    ("fault", "told"),
    [("auto_exposure", "automatic exposure overrides it"), ("autofocus", "autofocus that is not held"), (None, "")],
)
def test_a_camera_that_does_not_hold_exposure_or_focus_is_told_by_cameras_and_then_by_doctor(
    fault: CameraFault | None, told: str
) -> None:
    async def story(here: Hours) -> None:
        assert "note cameras: not tested whether they hold" in (await doctor.run(here.context, [], FakeFrontend())).text
        here.cell.camera.set_fault("right", fault)
        answer = await cameras.run(here.context, [], FakeFrontend())
        findings = (await doctor.run(here.context, [], FakeFrontend())).text
        assert "not tested whether" not in findings
        if fault is None:
            assert "Exposure and focus are held" in answer.text
            return
        for text in (answer.text, findings):
            assert "right camera" in text
            assert told in text
            assert "left camera:" not in text
        assert list(answer.data["not_held"]) == ["right"]
        here.cell.camera.set_fault("right", None)
        assert "Exposure and focus are held" in (await cameras.run(here.context, [], FakeFrontend())).text

    lived(story)


def test_a_rolling_shutter_is_measured_only_where_something_moves_and_doctor_says_what_was_found(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async def measured(*_: object) -> dict[CameraName, str]:
        return {"left": "rolling shutter: the last row is exposed 20 ms after the first"}

    async def story(here: Hours) -> None:
        still = await cameras.run(here.context, ["moving"], FakeFrontend(answers=["y"]))
        assert still.text.splitlines() == [f"{camera} camera: {UNMEASURED}" for camera in ("left", "right")]
        with pytest.raises(CommandError, match="cancelled; nothing was measured"):
            await cameras.run(here.context, ["moving"], FakeFrontend(answers=["n"]))
        monkeypatch.setattr(camera_selection, "shutters", measured)
        await cameras.run(here.context, ["moving"], FakeFrontend(answers=["y"]))
        await cameras.run(here.context, ["moving"], FakeFrontend(answers=["y"]))
        assert "note left camera: rolling shutter" in (await doctor.run(here.context, [], FakeFrontend())).text

    lived(story)
