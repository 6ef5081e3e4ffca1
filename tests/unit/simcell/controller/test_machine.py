"""The device behind the controller's line, without a line: a command is a call, and a minute passes in one more."""

import grimp
import numpy as np
import pytest

from drivers.puma560 import NEST_RAD, READY_RAD
from drivers.simcell.arm import SimulatedArm
from drivers.simcell.controller import Faults, Machine, Manners, Mishap
from drivers.simcell.controller.expressions import MonitorError


def test_a_minute_after_it_set_out_the_arm_is_where_it_was_sent() -> None:
    machine = Machine(SimulatedArm())
    machine.move_joints(READY_RAD)
    assert machine.advance(60.0) is None
    assert machine.at_rest()
    np.testing.assert_allclose(machine.joints(), READY_RAD, atol=1e-12)


def test_time_stops_at_a_mishap_and_so_does_the_arm() -> None:
    machine = Machine(SimulatedArm(), faults=Faults(in_move=[(0.5, Mishap.ENVELOPE_ERROR)]))
    machine.move_joints(READY_RAD)
    ends_s = machine.arm.rests_s
    assert machine.advance(60.0) is Mishap.ENVELOPE_ERROR
    assert machine.now_s == pytest.approx(ends_s / 2)
    machine.advance(60.0)
    assert np.abs(machine.joints() - READY_RAD).max() > 0.05
    with pytest.raises(MonitorError, match="Arm power off"):
        machine.check_ready()


def test_a_dead_machine_stays_dead_until_the_mains_go_off_and_on() -> None:
    machine = Machine(SimulatedArm())
    machine.befall(Mishap.DEAD)
    machine.befall(Mishap.EMERGENCY_STOP)
    assert not machine.alive
    machine.befall(Mishap.POWER_CYCLED)
    assert machine.alive
    assert not machine.calibrated


def test_somebody_comes_to_switch_arm_power_on_where_it_was_missed() -> None:
    machine = Machine(SimulatedArm(), Manners(arm_power_after_s=2.0), cold=True)
    machine.miss_arm_power()
    machine.advance(1.9)
    assert not machine.arm_power
    machine.advance(0.2)
    assert machine.arm_power


def test_what_is_out_of_reach_is_refused_and_nothing_moves() -> None:
    machine = Machine(SimulatedArm())
    with pytest.raises(MonitorError, match="Joint 2 out of range"):
        machine.move_joints(READY_RAD + np.radians([0, 120, 0, 0, 0, 0]))
    machine.advance(60.0)
    np.testing.assert_array_equal(machine.joints(), NEST_RAD)


def test_the_device_knows_nothing_of_its_line_and_no_file_imports_itself_by_a_detour() -> None:
    graph = grimp.build_graph("drivers")
    beneath = graph.find_upstream_modules("drivers.simcell.controller.machine")
    line = {"core", "terminal", "monitor", "instructions", "commands", "server"}
    assert not beneath & {f"drivers.simcell.controller.{name}" for name in line}
    for module in graph.modules:
        assert not any(graph.chain_exists(needed, module) for needed in graph.find_modules_directly_imported_by(module))
