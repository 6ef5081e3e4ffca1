"""How long the answer to a move is waited for: long enough for the arm, short enough for a dead controller."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from daemon import frames
from daemon.arm.guard import Command, Limits
from daemon.arm.mover import Arrival
from daemon.arm.workcell import Reading
from drivers import puma560
from drivers.simcell.arm import SingularWristError, plan_joints, plan_straight

START = np.radians([10.0, -120.0, 30.0, 5.0, 60.0, 20.0])


def command(pose, straight, speed):
    return Command(pose, straight, speed, "a test")


@given(
    turns=st.lists(st.floats(-0.6, 0.6), min_size=6, max_size=6), speed=st.floats(10.0, 100.0), straight=st.booleans()
)
def test_every_move_of_the_simulated_arm_ends_before_it_is_given_up(turns, speed, straight):
    geometry = puma560.Puma560()
    end = START + np.array(turns)
    start = Reading(puma560.forward(START, geometry), START)
    target = puma560.forward(end, geometry)
    try:
        way = (plan_straight if straight else plan_joints)(START, target if straight else end, speed / 100.0, geometry)
    except (puma560.UnreachableError, SingularWristError):
        return
    longest_s = Arrival().longest_s(start, command(target, straight, speed), end)
    assert way[1].duration_s < longest_s


def test_a_dead_controller_is_told_within_seconds_even_after_the_longest_move():
    start = Reading(np.eye(4), START)
    limits = Limits()
    farthest = frames.perturb(np.eye(4), np.array([limits.max_step_mm, 0, 0, 0, 0, np.radians(limits.max_turn_deg)]))
    assert Arrival().longest_s(start, command(farthest, True, 100.0), None) < 8.0
