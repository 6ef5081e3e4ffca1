"""The controller's own terminal through the daemon: key by key, logged, stopped by control-C, moving only what may."""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import AsyncIterator, Iterator
from itertools import count
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from daemon.arm import Fault, capsule_around
from daemon.arm.belief import BeliefSource
from daemon.arm.body import PERHAPS_HELD
from daemon.cell.no_arm import CellError
from daemon.cell.val2_arm import Val2Arm
from daemon.commands.controller_terminal import LEFT, SPOIL, Typist, monitor, shown
from daemon.commands.step_mode import READ_S
from daemon.pick.cycle import PickCycle
from daemon.pick.settings import Settings
from daemon.store.runs import check_wire, list_runs, read_run
from drivers.simcell.arm import SimulatedArm
from drivers.simcell.controller import Controller, Machine
from drivers.val2.commands import moves_the_arm, turns_over, works_the_hand
from drivers.val2.link import Link
from tests.fakes.fake_cell import TruthRecogniser, World, build
from tests.fakes.fake_context import FakeFrontend, FakeLog
from tests.fakes.person import Person
from tests.fakes.running import Running, judged_daemon
from tests.fakes.waiting import until, until_so


def standing(fault: str | None = None, enabled: bool = True) -> Any:
    """As much of a context as a typist sees."""
    cycle = PickCycle(build(World(np.random.default_rng(0))), Settings())
    if enabled:
        cycle.supervisor.enable()
    cycle.supervisor.permission.fault = None if fault is None else Fault(fault)
    controller = SimpleNamespace(
        asks_whether_to_move=False, moves_the_arm=moves_the_arm, turns_over=turns_over, works_the_hand=works_the_hand
    )
    hardware = SimpleNamespace(clock=count().__next__, robot=SimpleNamespace(controller=controller))
    return SimpleNamespace(cycle=cycle, hardware=hardware, log=FakeLog())


def typed(context: Any, *keys: bytes, apart_s: float = 1.0) -> tuple[bytes, FakeFrontend]:
    sent, frontend = bytearray(), FakeFrontend()
    context.hardware.clock = count(0.0, apart_s).__next__
    typist = Typist(context, context.hardware.robot.controller, frontend, sent.extend)
    for some in keys:
        typist.typed(some)
    return bytes(sent), frontend


def test_every_line_goes_out_as_it_was_typed_and_into_the_log() -> None:
    context = standing()
    sent, _ = typed(context, b"WHE", b"RX\x7fE\r", b"DO MOVE P1\r", b"y", b"\r")
    assert sent == b"WHERX\x7fE" + SPOIL + b"WHERE\rDO MOVE P1\r\r", "what was edited is spoiled, and typed anew"
    assert [fields["text"] for kind, fields in context.log.records] == ["WHERE", "DO MOVE P1"]
    assert {fields["door"] for _, fields in context.log.records} == {"test, monitor"}
    assert {fields["who"] for _, fields in context.log.records} == {"tester"}


@pytest.mark.parametrize("context", [standing("stopped by an operator"), standing(enabled=False)])
@pytest.mark.parametrize(
    "line",
    [
        b"DO MOVE P1",
        b"do  ready",
        b" EX PROG",
        b"CAL",
        b"PROCEED",
        b"XX\x7f\x08DO NEST",
        b"D MOVE P1",
        b"EXEC PROG",
        b"CALI",
    ],
)
def test_a_line_that_would_move_an_arm_that_may_not_is_taken_back_and_told(context: Any, line: bytes) -> None:
    context.log.records.clear()
    sent, frontend = typed(context, line + b"\r")
    assert sent == line + b"\x15!!\r"
    assert "not sent" in frontend.said[0]
    assert context.log.records[0][1]["text"].startswith("not sent: ")


@pytest.mark.parametrize(
    "line", [b"DO CLOSEI", b"D CLOSEI", b"DO CLOS", b"DO MOVET P1,0", b"DO SIGNAL 3", b"DO", b"EXEC PROG", b"PROCEED"]
)
def test_a_hand_that_was_worked_here_is_asked_about_later(line: bytes) -> None:
    context = standing()
    typed(context, b"WHERE\rDO MOVE P1\r")
    assert context.cycle.belief.holds_part is False
    typed(context, line + b"\r", b"n")
    assert context.cycle.belief.holds_part is False
    typed(context, line + b"\r", b"y")
    assert context.cycle.belief.holds_part is None


def test_what_is_held_after_the_hand_was_worked_here_is_guarded_as_what_nobody_saw_grasped() -> None:
    """A part that was known to be in it stood for whatever was put there instead, however long."""
    context = standing()
    known = capsule_around(np.eye(3), "a part")
    context.cycle.supervisor.mover.beliefs.learn(BeliefSource.COMMANDED, held_shape=(known,))
    typed(context, b"DO MOVE P1\r", b"y")
    assert context.cycle.supervisor.mover.belief.capsules == (known,)
    typed(context, b"DO CLOSEI\r", b"y")
    context.cycle.recogniser = TruthRecogniser(World(np.random.default_rng(0)))
    context.cycle.guard_the_hand()
    assert [capsule.name for capsule in context.cycle.supervisor.mover.belief.capsules] == [PERHAPS_HELD]


def test_who_leaves_sees_that_at_once_and_not_only_when_the_arm_is_at_rest() -> None:
    """Nothing was shown for as long as that took."""
    context, frontend, said = standing(), FakeFrontend(answers=["y"]), list[list[str]]()

    async def at_once(typed: Any) -> None:
        typed(b"WHERE\r")

    @contextlib.asynccontextmanager
    async def terminal(show: Any, tell: Any) -> AsyncIterator[Any]:
        yield len
        said.append(frontend.said[-1:])
        tell("ended")

    frontend.terminal = at_once
    robot = context.hardware.robot
    robot.connected, robot.controller.question, robot.controller.terminal = True, None, terminal
    told = asyncio.run(monitor(context, frontend))
    assert said == [[LEFT]]
    assert told.text == "\nBack at the console; 1 line sent to the controller.\nended"


@pytest.mark.parametrize("line", [b"DO FLIP", b"d lef", b"DO BEL", b"DO R"])
def test_a_word_that_turns_the_next_way_over_is_not_sent(line: bytes) -> None:
    """The guard had looked along another: half a turn of the wrist came with it."""
    sent, frontend = typed(standing(), line + b"\r", b"y\r")
    assert b"\r" not in sent.replace(SPOIL, b"").removesuffix(b"y\r")
    assert "may turn shoulder, elbow or wrist over" in frontend.said[0]


def test_a_yes_to_a_program_that_asks_may_work_the_hand() -> None:
    """It was taken for what it had been before the program went on."""
    context = standing()
    context.hardware.robot.controller.asks_whether_to_move = True
    typed(context, b"N\r")
    assert context.cycle.belief.holds_part is False
    typed(context, b"Y\r")
    assert context.cycle.belief.holds_part is None


@pytest.mark.parametrize("keys", [[b"DO READY\r", b"n"], [b"DO READY\ry"], [b"DO READY\r", b" ", b"y"]])
def test_a_line_that_may_move_the_arm_is_sent_after_a_yes_to_the_question_that_was_shown(keys: list[bytes]) -> None:
    sent, frontend = typed(standing(), *keys, apart_s=0.2 if len(keys) == 1 else 1.0)
    assert "Send it? [y/n]" in frontend.said[0]
    assert b"\r" not in sent.replace(SPOIL, b"")


@pytest.mark.parametrize("meanwhile", ["nothing", "pause", "fault", "line opened anew"])
def test_a_line_that_may_move_the_arm_is_held_like_a_move_also_after_the_yes(meanwhile: str) -> None:
    context = standing()
    supervisor = context.cycle.supervisor
    sent, frontend = bytearray(), FakeFrontend()
    typist = Typist(context, context.hardware.robot.controller, frontend, sent.extend)
    typist.typed(b"DO READY\r")
    if meanwhile == "pause":
        supervisor.hold.pause()
    elif meanwhile == "fault":
        supervisor.latch("stopped by bob")
    elif meanwhile == "line opened anew":
        supervisor.mover.cell.robot.permission.stop_tests = 0
    typist.typed(b"y")
    assert (bytes(sent) == b"DO READY\r") is (meanwhile == "nothing")
    assert ("not sent" in frontend.said[-1]) is (meanwhile != "nothing")


@pytest.mark.parametrize("line", [b"stop", b"STOP!", b"sto", b"halt"])
def test_a_stop_typed_at_the_controllers_terminal_is_ours(line: bytes) -> None:
    context = standing()
    wire = context.cycle.supervisor.mover.cell.robot.world.wire

    async def story() -> bytes:
        sent, _ = typed(context, line + b"\r")
        await until_so(lambda: context.cycle.supervisor.fault_text and wire)
        return sent

    assert b"\r" not in asyncio.run(story())
    assert wire == [("abort", None)]
    assert context.cycle.supervisor.fault_text == "stopped by tester"


@pytest.mark.parametrize("apart_s", [0.01, 1.0])
@pytest.mark.parametrize("line", [b"stop", b"STOP!", b"sto", b"halt", b"\x7fstop"])
def test_a_stop_typed_at_the_question_whether_a_line_may_be_sent_stops_the_arm(line: bytes, apart_s: float) -> None:
    """Its first letter was taken for a no, or all of it came too soon for an answer; what was left was no stop."""
    context = standing()
    wire = context.cycle.supervisor.mover.cell.robot.world.wire

    async def story() -> bytes:
        sent, frontend = typed(context, b"DO OPENI\r" + line + b"\r", apart_s=apart_s)
        assert "not sent" in frontend.said[-1]
        await until_so(lambda: context.cycle.supervisor.fault_text and wire)
        return sent

    assert b"\r" not in asyncio.run(story()).replace(SPOIL, b"")
    assert wire == [("abort", None)]
    assert context.cycle.supervisor.fault_text == "stopped by tester"


WORDS = [b"DO MOVE TRANS(400,0,0,0,90,0)", b"DO READY", b"EXECUTE", b"CAL", b"Y", b"WHERE", b"SPEED 50", b"DO ",
         b"READY", b"\r", b"\n", b"\x15", b"\x7f", b"\x08", b"\x1b[A", b"\x00", b"\x11", b"P", b"!!", b" ",
         b"D READY", b"CALI"]  # fmt: skip


@settings(max_examples=300)
@example(keys=[b"\x80", b"DO MOVE TRANS(400,0,0,0,90,0)", b"\r"])
@given(keys=st.lists(st.sampled_from(WORDS) | st.binary(max_size=4), max_size=30))
def test_whatever_keys_are_pressed_an_arm_that_may_not_move_does_not(keys: list[bytes]) -> None:
    sent, _ = typed(standing(enabled=False), *keys)
    controller = Controller(Machine(SimulatedArm()))
    before = controller.arm.joints_at(0.0)
    for now_s, byte in enumerate(sent):
        controller.receive(bytes([byte]), now_s * 0.05)
    end_s = len(sent) * 0.05 + 1000.0
    controller.tick(end_s)
    assert np.array_equal(controller.arm.joints_at(end_s), before)


def lines_read(sent: bytes, known: frozenset[int]) -> list[str]:
    """The lines that a controller reads which knows these keys and passes over those it does not."""
    line, lines = bytearray(), []
    for byte in sent:
        if byte in b"\r\n":
            lines.append(line.decode())
            line.clear()
        elif byte in known:
            del line[-1 if byte in b"\x08\x7f" else 0 :]
        elif byte >= 0x20 and byte != 0x7F:
            line.append(byte)
    return lines


@settings(max_examples=300)
@example(keys=[b"DO READY", b"\x7f" * 8, b"\r"], known=frozenset(b"\x08"))
@example(keys=[b"DO READY", b"\x15", b"\r"], known=frozenset())
@example(keys=[b"WHERE DO READY", b"\x7f" * 14, b"\x08" * 6, b"\r"], known=frozenset(b"\x08"))
@given(
    keys=st.lists(st.sampled_from(WORDS) | st.binary(max_size=4), max_size=30),
    known=st.frozensets(st.sampled_from(b"\x08\x7f\x15")),
)
def test_whichever_keys_the_controller_does_not_know_it_reads_no_line_that_could_move(
    keys: list[bytes], known: frozenset[int]
) -> None:
    """One that passed over the rubouts read all that had been typed, and was sent its end."""
    sent, _ = typed(standing(enabled=False), *keys)
    assert [line for line in lines_read(sent, known) if moves_the_arm(line) and "!!" not in line] == []


def asked_by_cal(context: Any) -> tuple[Typist, bytearray]:
    """A terminal at which CAL was typed and agreed to, so that the controller asks; and what was sent to it."""
    sent = bytearray()
    typist = Typist(context, context.hardware.robot.controller, FakeFrontend(), sent.extend)
    for keys in (b"CAL\r", b"y"):
        typist.typed(keys)
    return typist, sent


@pytest.mark.parametrize("paused", [False, True])
def test_the_yes_to_what_the_controller_asks_before_a_motion_is_held_by_a_pause(paused: bool) -> None:
    context = standing()
    typist, sent = asked_by_cal(context)
    if paused:
        context.cycle.supervisor.hold.pause()
    typist.typed(b"Y\r")
    assert bytes(sent) == b"CAL\r" + (SPOIL if paused else b"Y\r")


@pytest.mark.parametrize("line", [b"Y\r", b"yes\r", b" Y\r", b"Y X\r", b"Yup\r", b"N\x7fY\r"])
def test_of_a_yes_that_is_held_nothing_reaches_the_controller_that_begins_with_one(line: bytes) -> None:
    """A Y that stood there was one, to a controller that knows no key to take it back, whatever spoiled it."""
    context = standing()
    typist, sent = asked_by_cal(context)
    context.cycle.supervisor.hold.pause()
    before = len(sent)
    typist.typed(line)
    assert not any(read.strip().startswith(("Y", "y")) for read in lines_read(bytes(sent[before:]), frozenset()))


def test_the_yes_to_a_question_that_stood_before_the_terminal_was_opened_is_held_where_the_arm_may_not_move() -> None:
    context = standing(enabled=False)
    context.hardware.robot.controller.asks_whether_to_move = True
    sent, frontend = typed(context, b"Y\r")
    assert sent == SPOIL
    assert "not enabled" in frontend.said[0]


def test_in_a_dry_run_no_line_that_may_move_the_arm_is_sent_from_here_either() -> None:
    context = standing()
    context.cycle.supervisor.dry(True)
    sent, frontend = typed(context, b"DO READY\r", b"y")
    assert b"READY\r" not in sent
    assert "dry" in frontend.said[0]


def test_the_property_above_sees_an_arm_that_may_move_moving() -> None:
    sent, _ = typed(standing(), b"DO READY\r", b"y")
    controller = Controller(Machine(SimulatedArm()))
    before = controller.arm.joints_at(0.0)
    controller.receive(sent, 0.0)
    controller.tick(1000.0)
    assert not np.array_equal(controller.arm.joints_at(1000.0), before)


@pytest.fixture
def daemon() -> Iterator[Running]:
    # How far a person sends the arm at the controller's own terminal is theirs to answer for.
    with judged_daemon(seed=3, time_scale=20.0, excused="step too long") as daemon:
        yield daemon


def test_a_person_talks_to_the_controller_and_comes_back(daemon: Running) -> None:
    person = Person(daemon.folder, "robot", "monitor")
    person.sees("control-C stops the arm.")
    person.sees(".")
    assert daemon.do("go home")["status"] == 1, "the daemon stands aside"
    person.types("WHERE\r")
    person.sees("JT1")
    person.sees(".")
    person.types("DO READY\r")
    person.sees("may not move now")
    person.types("SPEED 12\r")
    person.types("\x1d")
    person.sees("You left the controller's terminal")
    person.sees("Back at the console; 2 lines sent to the controller.")
    assert person.leaves() == 0
    assert daemon.do("where")["status"] == 0
    (run,) = list_runs(daemon.runs)
    lines = [r["text"] for r in read_run(run).records if r["kind"] == "command"]
    assert [text for text in lines if not text.startswith("go")] == [
        "robot monitor", "WHERE", "not sent: DO READY", "SPEED 12",
    ]  # fmt: skip
    assert check_wire(run) == []


def test_control_c_at_the_controllers_terminal_stops_the_arm_and_a_fault_stands(daemon: Running) -> None:
    daemon.do("enable")
    person = Person(daemon.folder, "console")
    person.sees("control-D leaves")
    person.types("robot monitor\r")
    person.sees("stops the arm.")
    person.sees(".")
    person.types("SPEED 1\r")
    person.types("DO READY\r")
    person.sees("Send it? [y/n]")
    time.sleep(READ_S)  # an answer that comes sooner is none
    person.types("y")
    until(lambda: (state := daemon.do("status")["data"])["doing"] and not state["pending"])
    person.types("\x03")
    person.sees("Stopped. Nothing moves until `resume`.")
    before = daemon.do("where")["data"]["joints_deg"]
    assert "stopped by control-C" in daemon.do("status")["data"]["fault"]
    assert daemon.do("where")["data"]["joints_deg"] == before
    person.sees("facetd>")
    person.types("quit\r")
    assert person.leaves() == 1


def test_without_a_terminal_one_line_at_a_time_is_offered(daemon: Running) -> None:
    refused = daemon.do("robot monitor")
    assert (refused["status"], "robot monitor TEXT" in refused["text"]) == (2, True)
    assert "Arm power on" in daemon.do("robot monitor STATUS")["text"]


def test_cal_needs_an_arm_that_may_move_is_shown_while_it_runs_and_is_stopped_like_a_move(daemon: Running) -> None:
    refused = daemon.do("robot cal")
    assert (refused["status"], "not enabled" in refused["text"]) == (1, True)
    assert daemon.do("robot monitor DO READY")["status"] == 1
    assert "\rCAL" not in (list_runs(daemon.runs)[0] / "wire.jsonl").read_text()
    daemon.do("enable")
    daemon.do("robot monitor SPEED 1")
    person = Person(daemon.folder, "robot", "monitor", "DO", "READY")
    person.sees("DO READY. Send it? [y/n]")
    person.types("y\r")
    until(lambda: (state := daemon.do("status")["data"])["doing"] == "DO READY" and not state["pending"])
    stopped = daemon.do("stop")
    assert "Stopped" in stopped["text"]
    assert person.leaves() == 1
    before = daemon.do("where")["data"]["joints_deg"]
    assert all(daemon.do("where")["data"]["joints_deg"] == before for _ in range(10))
    assert daemon.do("robot cal")["status"] == 1, "a fault stands"
    daemon.do("resume")
    done = daemon.do("robot cal")
    assert (done["status"], done["text"].splitlines()[-1]) == (
        0,
        "(answered Y) The arm is calibrated and at rest.",
    )


def test_what_the_controller_says_does_not_steer_the_terminal_it_is_shown_at() -> None:
    assert shown(b"\x1b[2J\x1b]0;title\x07\x9b2J.") == b"^[[2J^[]0;title\x07?2J."
    assert shown(b"A\r\n\x08 \x11\x13\x0e\xff") == b"A\r\n\x08 ^Q^S^N?"


@pytest.mark.parametrize("line", ["x" * 80, "TYPE \N{LATIN SMALL LETTER U WITH DIAERESIS}", "DO MOVE " + "A" * 90])
def test_a_line_that_cannot_be_typed_is_refused_in_a_line_and_is_no_fault(line: str) -> None:
    arm = Val2Arm(Link("none"), Mock(), Mock())
    with pytest.raises(CellError, match="the controller takes lines of up to 79 plain characters"):
        arm.check_typable(line)
    arm.check_typable("x" * 79)
