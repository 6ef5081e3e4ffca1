"""The motion monitor against planted violations, one of each kind, and against runs that hold none."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest

from drivers.puma560 import PUMA560, READY_RAD, ArmGeometry, elbow_mm, forward, link_frames
from drivers.rigid import rigid, turn
from drivers.simcell.arm import SimulatedArm
from drivers.simcell.cell import SimulatedCell
from drivers.simcell.controller import Controller, Machine, Manners
from drivers.simcell.gripper import finger_rods
from drivers.simcell.history import KEPT, DropRecord, GraspRecord, MotionRecord, ReleaseRecord, StopRecord
from drivers.simcell.motion_monitor import SAMPLE_MM, TYPING_S, ArmSpheres, MotionMonitor
from drivers.simcell.truth import Box, Rod, load_truth, rigid_matrix
from tests.fakes.simulated_time import SimulatedLoop

TRUTH = load_truth(Path(__file__).parents[3] / "etc" / "simcell.yaml")
ABOVE_TABLE = "DO MOVE TRANS(520,0,-100,0,90,0)"


class Cell:
    """A controller, somebody who types at it, and the motion monitor. The arm may move; TOOL is set."""

    def __init__(self, manners: Manners | None = None, **safety: object) -> None:
        geometry = ArmGeometry(flange_from_tool=rigid_matrix(TRUTH.arm.flange_from_tool))
        arm = SimulatedArm(geometry, READY_RAD)
        self.controller, self.now_s = Controller(Machine(arm, manners)), 0.0
        rules = msgspec.structs.replace(TRUTH.safety, **({"longest_step_mm": 2000.0} | safety))
        body = ArmSpheres([*rules.body, *finger_rods(TRUTH.gripper)], geometry, np.zeros(6))
        self.motion_monitor = MotionMonitor(self.controller.machine.history, body, rules, TRUTH.table)
        self.motion_monitor.motion_permitted(0.0, True)
        self.types("DO NOFLIP", 0.1)

    def types(self, line: str, wait_s: float = 30.0, by_others: bool = False) -> None:
        """A line, and time for it."""
        self.controller.receive(line.encode() + b"\r", self.now_s, by_others)
        self.now_s += wait_s
        self.controller.tick(self.now_s)

    def found(self) -> list[str]:
        """The rules broken so far."""
        return [violation.rule for violation in self.motion_monitor.violations(self.now_s)]


def test_a_day_s_work_breaks_no_rule() -> None:
    cell = Cell()
    for line in (
        ABOVE_TABLE,
        "SPEED 30",
        "DO MOVES TRANS(540,20,-200,0,90,0)",
        "DO CLOSEI",
        "DO DEPARTS 80",
        "DO OPENI",
    ):
        cell.types(line)
    assert len([event for event in cell.controller.machine.history if isinstance(event, MotionRecord)]) == 3
    assert cell.motion_monitor.violations(cell.now_s) == ()


@pytest.mark.parametrize("line", ["DO READY", ABOVE_TABLE, "DO DRIVE 1,5,50", "DO OPENI", "DO CLOSEI"])
def test_what_moves_while_nothing_may_is_found_with_the_line_it_came_of(line: str) -> None:
    cell = Cell()
    cell.types("DO DRIVE 2,-20,50")
    cell.motion_monitor.motion_permitted(cell.now_s, False)
    cell.types(line)
    assert cell.found() == ["not permitted"]
    assert f"`{line}`" in str(cell.motion_monitor.violations(cell.now_s)[0])


def test_what_was_begun_and_is_not_over_is_found_already_and_once() -> None:
    cell = Cell()
    cell.motion_monitor.motion_permitted(0.05, False)
    cell.types("DO DRIVE 2,-80,1", 0.2)
    assert cell.found() == ["not permitted"]
    cell.types("ABORT")
    assert cell.found() == ["not permitted"]


def test_calibrating_counts_as_moving() -> None:
    cell = Cell()
    cell.motion_monitor.motion_permitted(0.05, False)
    cell.types("CAL", 1.0)
    cell.types("Y")
    assert cell.found() == ["not permitted"]


def test_what_was_typed_while_nothing_might_move_and_moves_nothing_is_no_matter() -> None:
    cell = Cell()
    cell.motion_monitor.motion_permitted(0.05, False)
    for line in (
        "WHERE",
        "STATUS",
        "DO BREAK",
        "DO SET P = HERE",
        "SPEED 10",
        "ABORT",
        "DO MOVE TRANS(9999,0,0,0,0,0)",
    ):
        cell.types(line)
    assert cell.found() == []


@pytest.mark.parametrize("stop", ["ABORT", "abo", "\x03"])
@pytest.mark.parametrize("manners", [Manners(), Manners(prompt_after_move="end")])
def test_a_motion_after_a_stop_is_found_unless_somebody_said_that_it_may_move_again(
    stop: str, manners: Manners
) -> None:
    cell = Cell(manners)
    cell.types("DO DRIVE 2,-40,20", 0.5)
    cell.types(stop)
    assert cell.found() == []
    cell.types("DO DRIVE 2,-5,20")
    assert cell.found() == ["motion after stop"]
    cell.motion_monitor.motion_permitted(cell.now_s, True)
    cell.types("DO DRIVE 2,-5,20")
    assert cell.found() == ["motion after stop"]


@pytest.mark.parametrize(("stop", "found"), [("ABORT", ["motion after stop"]), ("\x03", [])])
def test_a_character_that_stops_may_be_noise_where_the_line_is_spoiled_and_a_word_may_not(
    stop: str, found: list[str]
) -> None:
    """A noisy echo of a line that is typed again has no operator behind it."""
    cell = Cell()
    cell.motion_monitor.line_works(cell.now_s, False)
    cell.types(stop)
    cell.types("DO DRIVE 2,-5,20")
    assert cell.found() == found


def test_a_stop_the_controller_does_not_know_counts_when_the_test_says_so() -> None:
    cell = Cell()
    cell.types("DO DRIVE 2,-40,5", 0.5)
    cell.types("HALT!!", 0.1)
    cell.motion_monitor.stop_received(cell.now_s - 0.1, "HALT!!")
    cell.types("DO BREAK")
    assert cell.found() == ["stopped too late"]
    cell.types("DO DRIVE 1,5,50")
    assert cell.found() == ["stopped too late", "motion after stop"]


def test_an_arm_that_brakes_too_long_after_a_stop_is_found() -> None:
    cell = Cell(rest_within_s=0.05)
    cell.types("DO DRIVE 2,-80,100", 0.5)
    cell.types("ABORT")
    assert cell.found() == ["stopped too late"]


def test_an_arm_that_goes_on_when_it_might_not_move_any_more_is_found() -> None:
    cell = Cell()
    cell.types("DO DRIVE 2,-80,10", 0.5)
    cell.motion_monitor.motion_permitted(0.5, False)
    cell.types("DO BREAK")
    assert cell.found() == ["stopped too late"]


def test_a_speed_typed_by_somebody_else_is_found_at_the_next_move() -> None:
    cell = Cell()
    cell.motion_monitor.limit_speed(cell.now_s, 20.0)
    cell.types("SPEED 20")
    cell.types("DO DRIVE 2,-20,20")
    assert cell.found() == []
    cell.types("SPEED 100")
    cell.types(ABOVE_TABLE)
    assert cell.found() == ["too fast"]


def test_a_tool_faster_than_allowed_is_found_whatever_the_percent_say() -> None:
    cell = Cell(fastest_mm_s=250.0)
    cell.types("DO DRIVE 2,-40,10")
    assert cell.found() == []
    cell.types("DO DRIVE 2,40,50")
    assert cell.found() == ["too fast"]


def test_a_step_is_measured_as_it_was_commanded_even_if_it_was_cut_short() -> None:
    cell = Cell()
    cell.motion_monitor._safety = msgspec.structs.replace(cell.motion_monitor._safety, longest_step_mm=450.0)
    cell.types(ABOVE_TABLE, 0.1)
    start = cell.controller.arm.reported_pose_at(0.0)
    cell.types("ABORT")
    assert np.linalg.norm(cell.controller.machine.pose()[:3, 3] - start[:3, 3]) < 300.0
    assert cell.found() == ["step too long"]


@pytest.mark.parametrize(
    ("line", "rule", "part"),
    [
        ("DO MOVE TRANS(520,0,-295,0,90,0)", "below the table", "finger"),
        ("DO MOVES TRANS(520,0,-295,0,90,0)", "below the table", "finger"),
        ("DO MOVE TRANS(520,0,-220,90,0,180)", "below the table", "camera bar"),
        ("DO MOVE TRANS(700,0,-270,90,0,0)", "below the table", "forearm"),
        ("DO DRIVE 1,-90,100", "outside the room", ""),
    ],
)
def test_a_body_where_it_must_not_be_is_found_by_name(line: str, rule: str, part: str) -> None:
    cell = Cell(room=Box([-400.0, -400.0, -1000.0], [1000.0, 800.0, 1250.0]))
    cell.types(ABOVE_TABLE)
    cell.types(line)
    found = cell.motion_monitor.violations(cell.now_s)
    assert rule in [violation.rule for violation in found], found
    assert any(part in violation.text for violation in found)


def test_the_way_is_judged_and_not_only_its_ends() -> None:
    """Half round the column between two poses that are both well above the table, past a post that stands between."""
    post = Box([600.0, -60.0, -300.0], [680.0, 60.0, 300.0])
    cell = Cell(keep_out=[post], room=Box([-2000.0] * 3, [2000.0] * 3))
    cell.types("DO MOVE TRANS(400,-450,0,0,90,0)")
    assert cell.found() == []
    cell.types("DO MOVE TRANS(400,450,0,0,90,0)")
    assert cell.found() == ["in keep-out box 1"]


def test_what_is_let_go_high_is_found_unless_over_the_bin_or_told() -> None:
    cell = Cell()
    history, motion_monitor = cell.controller.machine.history, cell.motion_monitor
    history.add(DropRecord(1.0, "DO OPENI", "cube", 2.0, False))
    history.add(DropRecord(2.0, "DO OPENI", "cube", 90.0, True))
    cell.now_s = 9.0
    assert cell.found() == []
    history.add(DropRecord(3.0, "DO OPENI", "cube", 90.0, False))
    assert cell.found() == ["dropped"]
    motion_monitor.drop_permitted(4.0)
    history.add(DropRecord(5.0, "DO OPENI", "cube", 90.0, False))
    assert cell.found() == ["dropped"]


def test_a_part_let_go_in_the_cell_is_on_record_with_its_height() -> None:
    with SimulatedCell(Path(__file__).parents[3] / "etc" / "simcell.yaml", seed=1) as cell:
        tool = cell.world_from_tool()
        cell.world.put("cube", tool @ rigid(turn([1, 0, 0], np.pi), [0.0, 0.0, 0.0]))
        cell.world.close_hand(tool)
        assert cell.world.held is not None
        cell.motion_monitor.motion_permitted(0.0, True)
        with cell.server.controller() as controller:
            controller.machine.by = "DO OPENI"
            controller.machine.hand(closed=False)
    for _ in ("the cell may be gone by then", "and asked again"):
        assert [violation.rule for violation in cell.violations()] == ["dropped"]


def cell_that_holds_a_cube(loop: SimulatedLoop) -> SimulatedCell:
    """The arm is 40 mm above the table, the cube's lowest corners 15 mm below the tool centre point."""
    cell = SimulatedCell(Path(__file__).parents[3] / "etc" / "simcell.yaml", seed=1, loop=loop)
    cell.motion_monitor.motion_permitted(0.0, True)
    tool = cell.world_from_tool()
    cell.world.put("cube", tool @ rigid(turn([1, 0, 0], np.pi), [0.0, 0.0, 0.0]))
    cell.world.close_hand(tool)
    assert cell.world.held is not None
    return cell


TAKEN: tuple[Callable[[SimulatedCell], object], ...] = (
    lambda cell: cell.world.open_hand(cell.world_from_tool()),
    lambda cell: cell.world.remove(cell.world.parts[0].name),
    lambda cell: cell.scatter(["cube"]),
    lambda cell: cell.place_for_teaching("cube", 0),
    lambda cell: cell.bring_back(()),
)


@pytest.mark.parametrize("take", TAKEN)
def test_whatever_takes_a_part_out_of_the_gripper_the_motion_monitor_knows(take: Callable[[SimulatedCell], object]):
    """What slipped out, or was taken as parts were scattered anew, was judged as if it were still held."""
    loop = SimulatedLoop()
    cell = cell_that_holds_a_cube(loop)
    assert cell.violations() == ()
    assert cell.motion_monitor.carried_label == "cube", "also what nobody closed the jaws on by a line"
    take(cell)
    assert cell.violations() == ()
    assert cell.motion_monitor.carried_label is None
    loop.close()


def test_a_part_that_slips_on_the_way_is_pressed_into_nothing_behind_that() -> None:
    cell = Cell()
    cell.types(ABOVE_TABLE)
    corners = np.array([[x, y, 40.0] for x in (-20.0, 20.0) for y in (-20.0, 20.0)])
    history = cell.controller.machine.history
    for slips_after_s, found in ((0.05, []), (30.0, ["pressed"])):
        history.add(GraspRecord(cell.now_s, "", "cube", corners))
        began_s = cell.now_s
        cell.types("DO MOVE TRANS(520,0,-270,0,90,0)")
        history.add(ReleaseRecord(began_s + slips_after_s, ""))
        assert cell.found() == found
        cell.types(ABOVE_TABLE)


def test_a_part_in_the_gripper_that_is_carried_into_a_box_is_found() -> None:
    """The box and the part's corners are below the tips; nothing of the arm comes there."""
    cell = Cell(keep_out=[Box([480.0, -40.0, -200.0], [560.0, -10.0, -150.0])])
    cell.types(ABOVE_TABLE)
    corners = np.array([[x, y, 70.0] for x in (-15.0, 15.0) for y in (-20.0, 20.0)])
    cell.controller.machine.history.add(GraspRecord(cell.now_s, "", "cube", corners))
    cell.types("DO MOVE TRANS(520,0,-98,0,90,0)")
    assert cell.found() == ["in keep-out box 1"]


def test_a_part_that_somebody_else_had_the_gripper_close_on_is_carried_by_our_next_motion() -> None:
    cell = Cell()
    cell.types(ABOVE_TABLE)
    corners = np.array([[x, y, 40.0] for x in (-20.0, 20.0) for y in (-20.0, 20.0)])
    cell.types("DO CLOSEI", by_others=True)
    cell.controller.machine.history.add(GraspRecord(cell.now_s, "DO CLOSEI", "cube", corners))
    cell.types("DO MOVE TRANS(520,0,-270,0,90,0)")
    assert cell.found() == ["pressed"]


def test_a_part_that_somebody_else_pressed_into_the_table_is_lifted_out_of_it_and_pressed_no_deeper() -> None:
    corners = np.array([[x, y, 40.0] for x in (-20.0, 20.0) for y in (-20.0, 20.0)])
    for then_z_mm, found in ((-240.0, []), (-275.0, ["pressed"])):
        cell = Cell()
        cell.types(ABOVE_TABLE)
        cell.controller.machine.history.add(GraspRecord(cell.now_s, "", "cube", corners))
        cell.types("DO MOVE TRANS(520,0,-270,0,90,0)", by_others=True)
        cell.types(f"DO MOVE TRANS(520,0,{then_z_mm:g},0,90,0)")
        assert cell.found() == found
    cell = Cell()
    cell.types(ABOVE_TABLE)
    cell.controller.machine.history.add(GraspRecord(cell.now_s, "", "cube", corners))
    cell.types("DO MOVE TRANS(520,0,-270,0,90,0)", by_others=True)
    cell.types(ABOVE_TABLE)
    cell.types("DO MOVE TRANS(520,0,-270,0,90,0)")
    assert cell.found() == ["pressed"], "once it came clear, nothing of by_others counts"


def test_nothing_is_answered_for_of_a_line_of_somebody_else_s_and_all_of_the_same_line_typed_later() -> None:
    cell = Cell(fastest_percent=40.0)
    cell.motion_monitor.motion_permitted(0.0, False)
    for line in ("DO DRIVE 1,5,100", "DO CLOSEI", "ABORT"):
        cell.types(line, by_others=True)
    cell.motion_monitor.motion_permitted(cell.now_s, True)
    cell.types("DO OPENI")
    assert cell.found() == [], "nor is a stop of by_others one of ours"
    cell.types("DO DRIVE 1,5,100")
    assert cell.found() == ["too fast"]


def test_a_motion_of_ours_that_was_typed_right_behind_one_of_theirs_answers_for_no_way_that_began_elsewhere() -> None:
    cell = Cell(longest_step_mm=20.0)
    cell.types("DO DRIVE 1,25,100", 0.2, by_others=True)
    assert cell.found() == [], "nor while it is under way"
    cell.types("DO DRIVE 1,25,100")
    assert cell.found() == []
    cell.types("DO DRIVE 1,25,100")
    assert cell.found() == ["step too long"]


def test_the_forearm_ends_at_the_elbow_and_at_the_wrist() -> None:
    rng = np.random.default_rng(0)
    for joints in rng.uniform(-2, 2, (20, 6)):
        wrist, elbow = forward(joints)[:3, 3], elbow_mm(joints)
        assert np.linalg.norm(wrist - elbow) == pytest.approx(np.hypot(431.8, 20.3), abs=1e-6)
        turned = joints + np.array([0.0, 0.0, 0.7, 0.0, 0.0, 0.0])
        assert elbow_mm(turned) == pytest.approx(elbow), "the elbow does not move when the forearm turns about it"


def test_the_true_arm_is_judged_and_not_the_one_the_controller_believes_in() -> None:
    geometry = ArmGeometry(flange_from_tool=rigid_matrix(TRUTH.arm.flange_from_tool))
    arm = SimulatedArm(geometry, READY_RAD, joint_offsets_rad=np.radians([0.0, 0.5, -0.3, 0.2, 0.1, 0.4]))
    body = ArmSpheres([*TRUTH.safety.body, *finger_rods(TRUTH.gripper)], arm.true_geometry, arm.joint_offsets_rad)
    assert body.at(arm.motion, np.array([1.0]))[1][0] == pytest.approx(arm.pose_at(1.0)[:3, 3])
    assert np.linalg.norm(arm.pose_at(1.0)[:3, 3] - arm.reported_pose_at(1.0)[:3, 3]) > 1.0


def test_no_ball_of_the_body_moves_farther_than_promised_between_two_samples_near_what_it_could_strike() -> None:
    cell = Cell(keep_out=[Box([700.0, 500.0, 0.0], [750.0, 600.0, 50.0])])
    cell.types("DO MOVE TRANS(500,-450,-285,0,90,0)")
    cell.types("DO MOVE TRANS(500,450,-285,0,90,0)")
    times, balls, _ = cell.motion_monitor._sampled_path(cell.controller.arm.motion)
    moved = np.linalg.norm(np.diff(balls, axis=0), axis=2).max(axis=1)
    away = -np.max([deep.max(axis=1) for deep in cell.motion_monitor._depths(balls).values()], axis=0)
    assert np.all((moved <= SAMPLE_MM) | (away[1:] >= 2 * moved))
    assert np.count_nonzero(moved < SAMPLE_MM) > 50
    assert times[0] == cell.controller.arm.motion.started_s
    assert times[-1] == cell.controller.arm.rests_s


def test_more_than_is_kept_between_two_questions_is_no_clean_run() -> None:
    cell = Cell()
    for k in range(KEPT + 1):
        cell.controller.machine.history.add(StopRecord(float(k), "ABORT"))
    cell.now_s = 1e6
    assert cell.found() == ["not checked"]
    assert cell.found() == ["not checked"]


def test_what_was_judged_once_is_not_judged_again() -> None:
    cell = Cell()
    cell.types("DO DRIVE 2,-20,50")
    asked = []
    cell.motion_monitor._body.at = lambda motion, times, at=cell.motion_monitor._body.at: (
        asked.append(1) or at(motion, times)
    )  # type: ignore
    assert cell.found() == []
    once = len(asked)
    assert cell.found() == []
    assert len(asked) == once > 0


@pytest.mark.parametrize(("again_s", "rules"), [(None, []), (1.0, ["stopped too late"]), (60.0, [])])
def test_a_stop_is_late_only_from_when_it_could_get_through(again_s: float | None, rules: list[str]) -> None:
    cell = Cell()
    cell.types("DO DRIVE 2,-80,5", 0.5)
    cell.motion_monitor.line_works(cell.now_s, False)
    cell.motion_monitor.stop_received(cell.now_s + 0.1, "a stop")
    cell.motion_monitor.motion_permitted(cell.now_s + 0.1, False)
    if again_s is not None:
        cell.motion_monitor.line_works(cell.now_s + again_s, True)
    cell.types("DO BREAK", 100.0)
    assert cell.found() == rules
    cell.types("DO OPENI")
    assert cell.found() == [*rules, "not permitted", "motion after stop"], "that something sets out is another matter"


@pytest.mark.parametrize("line", ["DO OPENI", "DO DRIVE 1,5,50"])
@pytest.mark.parametrize(
    ("hears", "typed_s", "rules"),
    [
        (False, 0.0, []),
        (True, 0.0, ["not permitted", "motion after stop"]),
        (False, 0.2, ["not permitted", "motion after stop"]),
    ],
)
def test_what_sets_out_after_a_stop_is_excused_where_the_controller_had_its_line_before_and_could_not_be_told(
    line: str, hears: bool, typed_s: float, rules: list[str]
) -> None:
    """A stop is received 0.1 s from now; the line waits for the end of the motion before it."""
    cell = Cell(rest_within_s=30.0)
    cell.types("DO DRIVE 2,-10,20", 0.1)
    now_s = cell.now_s
    cell.motion_monitor.line_works(now_s, hears)
    cell.motion_monitor.stop_received(now_s + 0.1, "a stop")
    cell.motion_monitor.motion_permitted(now_s + 0.1, False)
    cell.now_s += typed_s
    cell.types(line)
    assert cell.found() == rules


def test_the_answer_to_a_question_counts_as_what_was_typed_and_not_the_question() -> None:
    cell = Cell()
    cell.types("CAL", 1.0)
    cell.motion_monitor.line_works(cell.now_s, False)
    cell.motion_monitor.motion_permitted(cell.now_s, False)
    cell.types("Y")
    assert cell.found() == ["not permitted"]


@pytest.mark.parametrize(("before_s", "rules"), [(1.0, ["rest reported early"]), (0.02, []), (-0.5, [])])
def test_who_says_that_the_arm_is_at_rest_while_it_moves_is_found(before_s: float, rules: list[str]) -> None:
    cell = Cell()
    cell.types("DO DRIVE 2,-40,20", 0.5)
    cell.motion_monitor.rest_reported(cell.controller.arm.rests_s - before_s, "Nothing moves.")
    cell.types("DO BREAK")
    assert cell.found() == rules


def test_where_a_person_sends_the_arm_is_theirs_but_that_it_may_go_and_stops_is_not() -> None:
    cell = Cell(longest_step_mm=50.0)
    cell.motion_monitor.limit_speed(cell.now_s, 20.0)
    cell.types("SPEED 100")
    cell.motion_monitor.typed_by_person(cell.now_s, ABOVE_TABLE)
    cell.types(ABOVE_TABLE)
    assert cell.found() == []
    cell.types("DO DRIVE 1,30,100")
    assert set(cell.found()) == {"too fast", "step too long"}
    before = len(cell.found())
    cell.motion_monitor.motion_permitted(cell.now_s, False)
    cell.types(ABOVE_TABLE)
    assert cell.found()[before:] == ["not permitted"]


def test_the_way_out_of_where_a_person_sent_the_arm_is_nobody_s_fault_as_long_as_it_is_a_way_out() -> None:
    """Their own line takes the fingers into a box: out again is fair, deeper is not, nor is coming back."""
    in_box = "DO MOVE TRANS(520,0,-180,0,90,0)"
    cell = Cell(keep_out=[Box([400.0, -120.0, -400.0], [640.0, 120.0, -170.0])])
    cell.motion_monitor.typed_by_person(cell.now_s, in_box)
    cell.types(ABOVE_TABLE)
    cell.types(in_box)
    cell.types("DO MOVES TRANS(520,0,-176,0,90,0)")
    cell.types("DO MOVES TRANS(520,0,-179,0,90,0)")
    assert cell.found() == []
    cell.types("DO MOVES TRANS(520,0,-185,0,90,0)")
    assert cell.found() == ["in keep-out box 1"]
    cell.types(in_box)
    cell.types("DO MOVES TRANS(520,0,-100,0,90,0)")
    assert len(cell.found()) == 1
    cell.types("DO MOVES TRANS(520,0,-175,0,90,0)")
    assert len(cell.found()) == 2


def test_the_upper_arm_is_judged_from_behind_the_shoulder_to_the_elbow() -> None:
    """A box that only the upper arm comes to: 300 mm from the shoulder, beside the column."""
    cell = Cell(keep_out=[Box([220.0, -260.0, 150.0], [300.0, -180.0, 300.0])])
    cell.types("DO DRIVE 2,-5,50")
    assert cell.found() == []
    cell.types("DO DRIVE 2,-60,50")
    found = cell.motion_monitor.violations(cell.now_s)
    assert {violation.rule for violation in found} == {"in keep-out box 1"}
    assert all("the upper arm" in violation.text for violation in found)


def test_the_judge_s_upper_arm_lies_where_the_arm_s_own_geometry_has_it() -> None:
    rng = np.random.default_rng(0)
    ends = [[-PUMA560.a2_mm, 0.0, -PUMA560.d3_mm], [0.0, 0.0, -PUMA560.d3_mm], [0.0, 0.0, 0.0]]
    rods = [Rod("", "upper_arm", end, end, 1.0) for end in ends]
    arm = SimulatedArm(joints_rad=READY_RAD)
    body = ArmSpheres(rods, arm.geometry, np.zeros(6))
    for joints in rng.uniform(-2, 2, (20, 6)):
        resting = SimpleNamespace(joints_at=lambda _, joints=joints: joints)
        links = link_frames(joints[None])[0]
        shoulder, beside, elbow = body.at(resting, np.zeros(1))[0][0, ::2]  # type: ignore[arg-type]
        assert shoulder == pytest.approx(links[0, :3, 3], abs=1e-6)
        assert beside == pytest.approx(links[2, :3, 3], abs=1e-6)
        assert elbow == pytest.approx(elbow_mm(joints), abs=1e-6)


@pytest.mark.parametrize("line", ["DO READY", "DO CLOSEI"])
@pytest.mark.parametrize("after_s", [0.9 * TYPING_S, 1.1 * TYPING_S])
def test_what_is_typed_while_moves_are_held_is_found_once_what_was_let_go_before_must_have_been_typed(
    line: str, after_s: float
) -> None:
    cell = Cell()
    cell.motion_monitor.motion_held(cell.now_s, True)
    cell.types("", after_s)
    cell.types(line)
    assert cell.found() == ["motion while held"] * (after_s > TYPING_S)
    cell.motion_monitor.motion_held(cell.now_s, False)
    cell.types("DO DRIVE 1,5,50")
    assert len(cell.found()) == (after_s > TYPING_S)


def test_a_motion_typed_while_moves_were_held_over_a_line_that_carried_nothing_may_have_been_let_go_before() -> None:
    cell = Cell()
    cell.motion_monitor.line_works(cell.now_s, False)
    cell.motion_monitor.motion_held(cell.now_s, True)
    cell.types("", 3.0)
    cell.motion_monitor.line_works(cell.now_s, True)
    cell.types("DO READY")
    assert cell.found() == []


def test_of_motions_that_each_wait_for_a_yes_no_more_are_made_than_yeses_were_said() -> None:
    cell = Cell()
    cell.motion_monitor.confirmed(cell.now_s)
    cell.types("", 1.0)
    cell.motion_monitor.confirm_each(cell.now_s, True)
    cell.types("DO DRIVE 1,5,50", 3.0)
    cell.motion_monitor.confirmed(cell.now_s)
    cell.types("DO DRIVE 1,5,50")
    assert cell.found() == []
    cell.types("DO CLOSEI")
    assert cell.found() == ["not confirmed"]
    cell.motion_monitor.confirm_each(cell.now_s, False)
    cell.types("DO DRIVE 1,5,50")
    assert cell.found() == ["not confirmed"]


@pytest.mark.parametrize(("z_mm", "found"), [(-259.0, []), (-260.5, []), (-262.5, ["pressed"])])
def test_a_part_in_the_gripper_may_touch_the_table_and_not_be_pressed_into_it(z_mm: float, found: list[str]) -> None:
    """Its corners are 40 mm below the tool centre point; the table is at -300 mm."""
    cell = Cell()
    cell.types(ABOVE_TABLE)
    corners = np.array([[x, y, 40.0] for x in (-20.0, 20.0) for y in (-20.0, 20.0)])
    cell.controller.machine.history.add(GraspRecord(cell.now_s, "DO CLOSEI", "cube", corners))
    cell.types(f"DO MOVE TRANS(520,0,{z_mm:g},0,90,0)")
    assert [v.rule for v in cell.motion_monitor.violations(cell.now_s)] == found
    cell.controller.machine.history.add(ReleaseRecord(cell.now_s, "DO OPENI"))
    cell.types(ABOVE_TABLE)
    assert [v.rule for v in cell.motion_monitor.violations(cell.now_s)] == found
