"""The simulated controller without a line: what it says to what is typed, and what the arm does then."""

import numpy as np
import pytest

from drivers.puma560 import NEST_RAD, READY_RAD
from drivers.simcell.arm import SimulatedArm
from drivers.simcell.controller import Controller, Faults, LineFault, Machine, Manners, Mishap
from drivers.simcell.controller.machine import PENDANT
from drivers.simcell.controller.manners import drawn
from drivers.simcell.history import CONTROL_C, GripperRecord, MotionRecord, StopRecord
from drivers.val2.location import Location, apart, location_from_matrix
from drivers.val2.wire import Prompt, Reader, WhereTable
from tests.bench.fuzz_val2 import fuzz_controller, fuzz_reader, pieces

TABLE = "DO MOVE TRANS(520,0,-100,0,90,0)"


class Terminal:
    """Somebody at the controller's terminal, with all the time there is."""

    def __init__(self, manners: Manners | None = None, faults: Faults | None = None, cold: bool = False) -> None:
        self.hand: list[bool] = []
        self.arm = SimulatedArm()
        self.controller = Controller(Machine(self.arm, manners, self.hand.append, faults, cold))
        self.now_s = 0.0
        self.controller.output(0.0)

    def types(self, text: str, end: str = "\r") -> str:
        self.controller.receive((text + end).encode("latin-1"), self.now_s)
        return self.printed()

    def waits(self, seconds: float) -> str:
        self.now_s += seconds
        self.controller.tick(self.now_s)
        return self.printed()

    def printed(self) -> str:
        return self.controller.output(self.now_s).decode("ascii")

    def place(self) -> Location:
        return location_from_matrix(self.arm.reported_pose_at(self.now_s))

    def goes(self, text: str) -> Location:
        assert self.types(text).endswith("\r\n.")
        self.waits(60.0)
        return self.place()


@pytest.fixture
def terminal() -> Terminal:
    return Terminal()


def test_a_command_is_echoed_and_answered_by_a_dot_at_the_start_of_a_line(terminal: Terminal) -> None:
    assert terminal.types("SPEED 50") == "SPEED 50\r\n."


def test_where_is_the_table_clients_count_from_its_end(terminal: Terminal) -> None:
    answer = terminal.types("WHERE").removeprefix("WHERE\r\n")
    lines = answer.split("\r\n")
    assert lines[0].split() == ["X", "Y", "Z", "O", "A", "T"]
    assert lines[2].split() == ["JT1", "JT2", "JT3", "JT4", "JT5", "JT6"]
    assert [len(line.split()) for line in lines[:4]] == [6, 6, 6, 6]
    assert lines[4] == "."
    np.testing.assert_allclose([float(v) for v in lines[3].split()], np.degrees(NEST_RAD), atol=1e-3)
    reader = Reader()
    events = reader.receive(answer.encode()) + reader.silence()
    assert [type(event) for event in events] == [WhereTable, Prompt]


@pytest.mark.parametrize("end", ["\r", "\n\r", "\r\n"])
@pytest.mark.parametrize("text", ["where", "Where", "WHERE", "wh", "  where "])
def test_any_case_and_any_of_the_line_ends_in_use_are_served(terminal: Terminal, text: str, end: str) -> None:
    assert "JT6" in terminal.types(text, end)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("FOO", "*Illegal command*"),
        ("S", "*Ambiguous name*"),
        ("DO", "*Syntax error*"),
        ("DO FOO", "*Illegal command*"),
        ("DO MOVE", "*Syntax error*"),
        ("DO MOVE P", "*Undefined value*"),
        ("DO MOVE #P", "*Undefined value*"),
        ("DO MOVE TRANS(1,2", "*Syntax error*"),
        ("DO MOVE TRANS(1,2,3,4,5,6,7)", "*Syntax error*"),
        ("DO MOVE TRANS(520,0,-1OO,0,90,0)", "*Syntax error*"),
        ("DO MOVE TRANS(1E99,0,0,0,0,0)", "*Illegal value*"),
        ("DO MOVE TRANS(2000,0,0,0,0,0)", "*Location out of range*"),
        ("DO MOVES TRANS(2000,0,0,0,0,0)", "*Location out of range*"),
        ("DO MOVE TRANS(-700,0,0,-90,0,0)", "*Joint 1 out of range*"),
        ("DO MOVE PPOINT(0,0,0,0,110,0)", "*Joint 5 out of range*"),
        ("DO SET P", "*Syntax error*"),
        ("DO SET P=Q", "*Undefined value*"),
        ("DO DRIVE 7,10,50", "*Illegal value*"),
        ("DO DRIVE 1,500,50", "*Joint 1 out of range*"),
        ("DO DRIVE 1,10", "*Syntax error*"),
        ("SPEED 0", "*Illegal value*"),
        ("DO SPEED 301 ALWAYS", "*Illegal value*"),
        ("DO SPEED 50 EVER", "*Syntax error*"),
        ("SPEED 101", "*Illegal value*"),
        ("SPEED FAST", "*Syntax error*"),
        ("SPEED", "*Syntax error*"),
        ("WHERE NOW", "*Syntax error*"),
        ("EXECUTE PICK", "*Undefined program*"),
        ("POINT 1A", "*Syntax error*"),
        ("WHERE" + "!" * 90, "*Illegal command*"),
    ],
)
def test_an_error_is_a_message_between_asterisks_and_nothing_moves(terminal: Terminal, text: str, message: str) -> None:
    assert terminal.types(text).endswith(f"\r\n{message}\r\n.")
    terminal.waits(30)
    np.testing.assert_array_equal(terminal.arm.joints_at(terminal.now_s), NEST_RAD)


def test_a_move_s_prompt_comes_at_its_start_or_at_its_end_as_systems_differ() -> None:
    early, late = (
        Terminal(Manners(prompt_after_move="start")),
        Terminal(Manners(prompt_after_move="end")),
    )
    assert early.types(TABLE).endswith("\r\n.")
    assert late.types(TABLE).endswith(")\r\n")
    assert late.waits(0.2) == ""
    assert late.waits(30) == "."


def test_break_gives_the_prompt_when_the_arm_is_at_rest(terminal: Terminal) -> None:
    terminal.types(TABLE)
    assert terminal.types("DO BREAK") == "DO BREAK\r\n"
    terminal.waits(terminal.arm.rests_s - terminal.now_s - 0.01)
    assert terminal.printed() == ""
    assert terminal.waits(0.02) == "."


def test_a_move_ends_where_it_was_sent(terminal: Terminal) -> None:
    assert apart(terminal.goes(TABLE), Location(520, 0, -100, 0, 90, 0)) == pytest.approx((0, 0), abs=1e-5)


def test_a_straight_move_by_way_of_a_variable_ends_where_it_was_sent(terminal: Terminal) -> None:
    terminal.goes(TABLE)
    terminal.types("DO SET P = TRANS(540,20,-180,5,80,10)")
    assert apart(terminal.goes("DO MOVES P"), Location(540, 20, -180, 5, 80, 10)) == pytest.approx((0, 0), abs=1e-5)


def test_a_second_move_waits_for_the_first(terminal: Terminal) -> None:
    terminal.types(TABLE)
    assert not terminal.types("DO READY").endswith(".")
    terminal.waits(60)
    np.testing.assert_allclose(terminal.arm.joints_at(terminal.now_s), READY_RAD, atol=1e-12)


def test_speed_slows_moves_down(terminal: Terminal) -> None:
    terminal.types("DO READY")
    full_s = terminal.arm.rests_s
    slow = Terminal()
    slow.types("SPEED 10")
    slow.types("DO READY")
    assert slow.arm.rests_s > 5 * full_s


def test_a_programs_speed_multiplies_the_monitors_once_or_always_and_no_arm_is_faster_than_it_can() -> None:
    def seconds(*typed: str) -> float:
        terminal = Terminal()
        for text in typed:
            terminal.types(text)
        terminal.goes(TABLE)
        terminal.types("DO READY")
        return terminal.arm.rests_s - terminal.now_s

    slow_s, full_s = seconds("SPEED 10"), seconds("SPEED 100")
    assert seconds("SPEED 10", "DO SPEED 300") == pytest.approx(slow_s), "the motion before had it"
    assert seconds("SPEED 10", "DO SPEED 300 ALWAYS") < 0.5 * slow_s
    assert seconds("SPEED 10", "DO SPEED 300 ALWAYS", "DO SPEED 100 ALWAYS") == pytest.approx(slow_s)
    assert seconds("SPEED 100", "DO SPEED 300 ALWAYS") == pytest.approx(full_s)


@pytest.mark.parametrize(("text", "pose"), [("DO READY", READY_RAD), ("DO NEST", NEST_RAD)])
def test_it_goes_to_the_poses_it_knows_by_name(terminal: Terminal, text: str, pose: list[float]) -> None:
    terminal.goes(TABLE)
    terminal.goes(text)
    np.testing.assert_allclose(terminal.arm.joints_at(terminal.now_s), pose, atol=1e-12)


def test_drive_moves_one_joint(terminal: Terminal) -> None:
    terminal.goes("DO DRIVE 1, 25.5, 50")
    np.testing.assert_allclose(
        np.degrees(terminal.arm.joints_at(terminal.now_s) - NEST_RAD), [25.5, 0, 0, 0, 0, 0], atol=1e-9
    )


@pytest.mark.parametrize(
    ("text", "z_mm"),
    [
        ("DO DEPART 50", -50),
        ("DO DEPARTS 50", -50),
        ("DO APPRO TRANS(520,0,-120,0,90,0),20", -100),
        ("DO APPROS TRANS(520,0,-120,0,90,0),-10", -130),
    ],
)
def test_depart_and_appro_go_back_along_the_tool_s_own_z(terminal: Terminal, text: str, z_mm: float) -> None:
    terminal.goes(TABLE)
    assert terminal.goes(text).z_mm == pytest.approx(z_mm, abs=1e-5)


def test_a_compound_location_is_taken_in_the_frame_before_it(terminal: Terminal) -> None:
    terminal.types("DO SET F = TRANS(520,0,-100,0,90,0)")
    assert terminal.goes("DO MOVE F:TRANS(0,0,-30,0,0,0)").z_mm != pytest.approx(-100)


def test_a_place_is_remembered_by_here_and_listed(terminal: Terminal) -> None:
    place = terminal.goes(TABLE)
    terminal.types("HERE P")
    terminal.types("HERE #Q")
    listed = terminal.types("LISTL")
    assert "P  " in listed
    assert "#Q" in listed
    terminal.goes("DO READY")
    assert apart(terminal.goes("DO MOVE P"), place) == pytest.approx((0, 0), abs=1e-5)
    terminal.goes("DO READY")
    assert apart(terminal.goes("DO MOVE #Q"), place) == pytest.approx((0, 0), abs=1e-5)


def test_a_precision_point_is_typed_in_and_ended_by_an_empty_line(terminal: Terminal) -> None:
    assert terminal.types("POINT #x").endswith("Change? ")
    answer = terminal.types("10, 100, -190, 0, -30, 5")
    assert "-190.000" in answer
    assert answer.endswith("Change? ")
    assert terminal.types("").endswith("\r\n.")
    terminal.goes("do move #x")
    np.testing.assert_allclose(
        np.degrees(terminal.arm.joints_at(terminal.now_s)), [10, 100, -190, 0, -30, 5], atol=1e-9
    )


def test_a_precision_point_may_be_typed_ahead_of_the_questions(terminal: Terminal) -> None:
    answer = terminal.types("point #x\n\r1, 90, -90, 0, -5, 0\n\r\n\rdo move #x", "\n\r")
    assert answer.endswith("\r\n.")
    terminal.waits(30)
    np.testing.assert_allclose(np.degrees(terminal.arm.joints_at(terminal.now_s)), [1, 90, -90, 0, -5, 0], atol=1e-9)


def test_the_hand_acts_after_the_motion_and_its_owner_is_told(terminal: Terminal) -> None:
    terminal.types(TABLE)
    terminal.types("DO CLOSEI")
    assert terminal.hand == []
    assert terminal.waits(60).endswith(".")
    terminal.types("DO OPENI")
    terminal.waits(1)
    assert terminal.hand == [True, False]


def test_configurations_hold_from_the_next_joint_move_on(terminal: Terminal) -> None:
    terminal.goes("DO FLIP")
    terminal.goes("DO MOVE TRANS(520,0,-100,0,80,0)")
    assert terminal.arm.joints_at(terminal.now_s)[4] > 0
    terminal.goes("DO NOFLIP")
    terminal.goes("DO MOVE TRANS(520,0,-100,0,80,0)")
    assert terminal.arm.joints_at(terminal.now_s)[4] < 0


def test_tool_and_base_change_what_where_says(terminal: Terminal) -> None:
    terminal.goes(TABLE)
    terminal.types("TOOL TRANS(0,0,160,-90,90,0)")
    assert terminal.place().z_mm != pytest.approx(-100)
    terminal.types("TOOL")
    terminal.types("BASE 0,0,700,0")
    assert terminal.place().z_mm == pytest.approx(600)


def test_status_tells_speed_power_and_calibration(terminal: Terminal) -> None:
    terminal.types("SPEED 35")
    status = terminal.types("STATUS")
    assert "35.0" in status
    assert "power on" in status
    assert "\r\nCalibrated" in status


# Power-up, calibration, power


def test_power_up_asks_twice_before_the_first_prompt() -> None:
    terminal = Terminal(cold=True)
    assert terminal.types("x").endswith("floppy (Y/N)? ")
    assert terminal.types("y").endswith("Initialize (Y/N)? ")
    assert terminal.types("y").endswith("\r\n.")


def test_without_calibration_nothing_moves() -> None:
    terminal = Terminal(cold=True)
    terminal.types("y\ry")
    assert "*Arm power off*" in terminal.types("DO READY")
    terminal.controller.machine.arm_power = True
    assert "*Not calibrated*" in terminal.types("DO READY")
    terminal.waits(30)
    np.testing.assert_array_equal(terminal.arm.joints_at(terminal.now_s), NEST_RAD)


def test_cal_asks_needs_arm_power_and_takes_its_time() -> None:
    terminal = Terminal(Manners(arm_power_after_s=2.0), cold=True)
    terminal.types("y\ry")
    assert terminal.types("cal").endswith("Are you sure (Y/N)? ")
    assert "*Arm power off*" in terminal.types("y")
    terminal.waits(3.0)
    terminal.types("cal")
    assert terminal.types("y") == "y\r\n"
    assert terminal.waits(1.0) == ""
    assert terminal.waits(10.0) == "."
    assert terminal.goes("DO READY")


def test_cal_answered_by_n_does_nothing() -> None:
    terminal = Terminal(cold=True)
    terminal.types("y\ry\rCAL")
    assert terminal.types("N").endswith("\r\n.")
    assert not terminal.controller.machine.calibrated


def test_a_slow_person_at_the_pendant_delays_calibration() -> None:
    terminal = Terminal(faults=Faults(pendant_s=45.0))
    terminal.types("CAL\ry")
    assert terminal.waits(44.0) == ""
    terminal.waits(2.0)
    assert terminal.waits(10.0) == "."


# Stopping


@pytest.mark.parametrize("manners", [Manners(prompt_after_move="start"), Manners(prompt_after_move="end")])
@pytest.mark.parametrize("stop", ["ABORT\r", "abo\r", "\x03"])
def test_abort_and_control_c_stop_the_arm_in_mid_move(manners: Manners, stop: str) -> None:
    terminal = Terminal(manners)
    terminal.types("DO READY")
    terminal.waits(0.4)
    terminal.types(stop, "")
    terminal.waits(1.0)
    stopped = terminal.arm.joints_at(terminal.now_s)
    assert terminal.arm.at_rest(terminal.now_s)
    assert np.abs(stopped - READY_RAD).max() > 0.1
    assert "JT6" in terminal.types("WHERE")
    terminal.waits(30)
    np.testing.assert_array_equal(terminal.arm.joints_at(terminal.now_s), stopped)


def test_abort_drops_what_was_typed_ahead() -> None:
    terminal = Terminal(Manners(prompt_after_move="end"))
    terminal.types("DO READY\rDO NEST\rDO READY")
    terminal.waits(0.2)
    terminal.types("ABORT")
    terminal.waits(1)
    stopped = terminal.arm.joints_at(terminal.now_s)
    terminal.waits(60)
    np.testing.assert_array_equal(terminal.arm.joints_at(terminal.now_s), stopped)


@pytest.mark.parametrize(
    ("what", "message"),
    [
        (Mishap.POWER_LOST, "*Arm power off*"),
        (Mishap.EMERGENCY_STOP, "*Emergency stop*"),
        (Mishap.ENVELOPE_ERROR, "*Envelope error* Joint 2"),
        (Mishap.POWER_CYCLED, "floppy (Y/N)? "),
    ],
)
@pytest.mark.parametrize("prompt", ["start", "end"])
def test_a_mishap_in_mid_move_stops_the_arm_and_is_told(what: Mishap, message: str, prompt: str) -> None:
    terminal = Terminal(Manners(prompt_after_move=prompt), Faults(in_move=[(0.5, what)]))  # type: ignore[arg-type]
    terminal.types("DO READY")
    said = terminal.waits(5.0)
    assert message in said
    stopped = terminal.arm.joints_at(terminal.now_s)
    assert np.abs(stopped - READY_RAD).max() > 0.05
    terminal.types("DO READY")
    terminal.waits(30)
    np.testing.assert_array_equal(terminal.arm.joints_at(terminal.now_s), stopped)


def test_a_dead_controller_says_nothing_and_its_arm_stands() -> None:
    terminal = Terminal(faults=Faults(in_move=[(0.3, Mishap.DEAD)]))
    terminal.types("DO READY")
    assert terminal.waits(5) == ""
    assert terminal.types("WHERE") == ""
    assert terminal.arm.at_rest(terminal.now_s)


def test_after_a_power_cycle_nothing_is_remembered() -> None:
    terminal = Terminal()
    terminal.types("SPEED 20")
    terminal.types("HERE P")
    terminal.types("TOOL TRANS(0,0,100,0,0,0)")
    terminal.controller.mishap(Mishap.POWER_CYCLED)
    terminal.types("Y\rY")
    assert "*Undefined value*" in terminal.types("DO SET Q=P")
    assert "100.0" in terminal.types("STATUS")
    np.testing.assert_array_equal(terminal.arm.tool, np.eye(4))


# Faults of the line


@pytest.mark.parametrize(
    ("harm", "echoed"), [("drop", "WHRE"), ("double", "WHEERE"), ("flip", "WHDRE"), ("insert", "WHE#RE")]
)
def test_harm_on_the_way_to_the_controller_shows_in_its_echo(harm: str, echoed: str) -> None:
    terminal = Terminal(faults=Faults(line=[LineFault("to_controller", harm, after=2)]))  # type: ignore[arg-type]
    assert terminal.types("WHERE", "") == echoed


def test_harm_on_the_way_to_the_host_leaves_the_command_whole() -> None:
    terminal = Terminal()
    terminal.controller.faults.line.append(LineFault("to_host", "drop", after=1))
    assert terminal.types("SPEED 50").startswith("SEED 50")
    assert terminal.controller.machine.speed_percent == 50


def test_a_swallowed_answer_is_swallowed_with_its_prompt_and_the_next_is_not() -> None:
    terminal = Terminal(faults=Faults(mute_answers=1))
    assert terminal.types("WHERE") == "WHERE\r\n"
    assert "JT6" in terminal.types("WHERE")


def test_a_prompt_may_come_late_after_its_line_end() -> None:
    terminal = Terminal()
    terminal.controller.faults.split_prompt_s = 0.5
    assert terminal.types("SPEED 50") == "SPEED 50\r\n"
    assert terminal.waits(0.4) == ""
    assert terminal.waits(0.2) == "."


def test_a_refusal_can_be_scripted() -> None:
    terminal = Terminal(faults=Faults(refusals=["*Envelope error* Joint 3"]))
    assert "*Envelope error* Joint 3" in terminal.types("DO READY")
    assert terminal.goes("DO READY")


def test_control_u_and_rubout_take_back_what_was_typed(terminal: Terminal) -> None:
    assert terminal.types("DO READY\x15", "").endswith("^U\r\n.")
    assert terminal.types("WHX\x7fERE").endswith(".")
    terminal.waits(30)
    np.testing.assert_array_equal(terminal.arm.joints_at(terminal.now_s), NEST_RAD)


def test_random_bytes_neither_stop_it_nor_move_it() -> None:
    noise = pieces(20_000, 7)
    printed, moved = fuzz_controller(noise, 7)
    assert fuzz_reader(noise, 7) + printed > 0
    assert not moved


def test_after_lf_cr_an_empty_line_is_answered_too_with_a_dot_right_behind_the_dot() -> None:
    controller = Controller(Machine(SimulatedArm(), Manners(line_ends="both", echo=False, calibration_s=1.0)))
    controller.receive(b"cal\n\r", 0.0)
    assert controller.output(0.0).endswith(b"(Y/N)? ")
    controller.receive(b"y\n\r", 0.1)
    assert controller.output(0.2) == b""
    controller.tick(2.0)
    assert controller.output(2.0).endswith(b"..")


def test_every_manner_that_may_be_drawn_answers_where_so_that_our_reader_reads_it() -> None:
    for seed in range(60):
        manners = drawn(np.random.default_rng(seed))
        controller, reader = Controller(Machine(SimulatedArm(joints_rad=READY_RAD), manners)), Reader()
        end = b"\n" if manners.line_ends == "lf" else b"\r"
        for k, byte in enumerate(b"WHERE" + end):
            controller.receive(bytes([byte]), 1.0 + 0.1 * k)
        controller.tick(3.0)
        events = reader.receive(controller.output(3.0)) + reader.silence()
        table, prompt = next(e for e in events if isinstance(e, WhereTable)), events[-1]
        assert isinstance(prompt, Prompt)
        np.testing.assert_allclose(
            manners.joints_rad(np.array(table.where.joints_deg)), READY_RAD, atol=np.radians(0.51 * 10**-2)
        )


def test_a_program_is_carried_out_instruction_by_instruction_and_what_is_typed_meanwhile_waits(
    terminal: Terminal,
) -> None:
    before = terminal.arm.joints_at(terminal.now_s)
    terminal.controller.machine.memory.programs["SWEEP"] = ("DRIVE 1,20,100", "DRIVE 1,-30,100")
    printed = terminal.types("EXEC SWEEP") + terminal.types("STATUS") + terminal.waits(30)
    assert printed.index("Program completed: Stopped at step 3") < printed.index("Monitor speed")
    turned = np.degrees(terminal.arm.joints_at(terminal.now_s) - before)
    np.testing.assert_allclose(turned, [-10.0, 0, 0, 0, 0, 0], atol=0.1)


def typed_by_others(terminal: Terminal) -> list[tuple[str, bool]]:
    """Of motions, stops and the gripper's acts so far: the line, and whether it was somebody else's."""
    acts = (MotionRecord, StopRecord, GripperRecord)
    return [(e.by, e.by_others) for e in terminal.controller.machine.history if isinstance(e, acts)]


def test_a_line_is_whose_end_it_has_whatever_noise_or_half_a_line_before_it_made_of_it(terminal: Terminal) -> None:
    """What another terminal typed was known by its text: noise made another of it, and the same text typed by the
    daemon later was taken for the other's."""
    controller = terminal.controller
    faults = controller.faults
    controller.receive(b"DO DRIVE 1,", 0.0)
    controller.receive(b"5,50\r", 0.0, by_others=True)
    terminal.waits(10.0)
    faults.line.append(LineFault("to_controller", "flip", after=12))
    controller.receive(b"DO DRIVE 1,-5,50\r", 10.0, by_others=True)
    terminal.waits(10.0)
    controller.receive(b"DO DRIVE 1,5,5", 20.0, by_others=True)
    controller.receive(b"0\r", 20.0)
    terminal.waits(10.0)
    ours, mixed = "DO DRIVE 1,5,50", "DO DRIVE 1,-4,50"
    assert typed_by_others(terminal) == [(ours, True), (mixed, True), (ours, False)]


def test_what_was_typed_ahead_by_another_is_theirs_when_its_turn_comes_and_so_is_their_stop() -> None:
    terminal = Terminal(Manners(prompt_after_move="end"))
    controller = terminal.controller
    controller.receive(b"DO DRIVE 1,5,50\r", 0.0)
    controller.receive(b"DO CLOSEI\r", 0.0, by_others=True)
    controller.receive(b"DO OPENI\r", 0.0)
    terminal.waits(20.0)
    controller.receive(b"DO DRIVE 1,5,50\r", 20.0)
    controller.receive(b"ABORT\r", 20.1, by_others=True)
    terminal.waits(5.0)
    controller.receive(b"\x03", 25.0, by_others=True)
    assert typed_by_others(terminal) == [
        ("DO DRIVE 1,5,50", False),
        ("DO CLOSEI", True),
        ("DO OPENI", False),
        ("DO DRIVE 1,5,50", False),
        ("ABORT", True),
        (CONTROL_C, True),
    ]


def test_what_the_pendant_moves_is_theirs(terminal: Terminal) -> None:
    machine = terminal.controller.machine
    machine.drive_by_pendant(machine.joints() + 0.1)
    assert typed_by_others(terminal) == [(PENDANT, True)]
