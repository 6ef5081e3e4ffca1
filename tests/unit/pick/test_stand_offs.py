"""From how far a part is looked at: as near as is needed, and as often."""

from dataclasses import replace

import numpy as np

from daemon.pick.planning.stand_offs import is_certain_enough, next_stand_off
from daemon.pick.pose_fusion import fuse
from daemon.pick.settings import StandOffs
from tests.unit.pick.test_pose_fusion import DOUBT, looked

VERTICAL = np.array([0.0, 0.0, 1.0])


def test_a_good_first_look_goes_straight_to_the_nearest_stop_that_is_enough():
    rng = np.random.default_rng(5)
    first = looked(rng, 450.0, np.zeros(9))
    easy, hard = StandOffs(enough_mm=1.2), StandOffs(enough_mm=0.05)
    assert next_stand_off([], DOUBT, easy) == 450.0
    assert next_stand_off([first], DOUBT, easy) == 200.0
    assert next_stand_off([first], DOUBT, hard) == 300.0
    assert next_stand_off([first] * 5, DOUBT, hard) == 200.0


def test_the_least_number_of_looks_is_kept_though_the_first_would_do():
    rng = np.random.default_rng(6)
    stops = StandOffs(enough_mm=1e6, enough_deg=1e6, least_looks=3)
    looks = [looked(rng, d, np.zeros(9)) for d in (450.0, 300.0, 200.0)]
    estimate = fuse(looks, DOUBT)
    assert [is_certain_enough(estimate, n, stops) for n in (1, 2, 3)] == [False, False, True]


def test_how_a_part_is_turned_about_the_vertical_need_not_be_known_where_it_is_held_however_that_is():
    estimate = fuse([looked(np.random.default_rng(7), 200.0, np.zeros(9))], DOUBT)
    unturned = replace(estimate, at_grasp=estimate.at_grasp + np.diag([0, 0, 0, 0, 0, 0.1]))
    leaning = replace(estimate, at_grasp=estimate.at_grasp + np.diag([0, 0, 0, 0.1, 0, 0]))
    stops = StandOffs(enough_mm=1e6)
    assert is_certain_enough(estimate, 1, stops)
    assert [is_certain_enough(one, 1, stops) for one in (unturned, leaning)] == [False, False]
    assert [is_certain_enough(one, 1, stops, VERTICAL) for one in (unturned, leaning)] == [True, False]


def test_what_an_unknown_turn_does_to_an_origin_beside_the_axis_does_not_count_where_the_turn_does_not():
    estimate = fuse([looked(np.random.default_rng(7), 200.0, np.zeros(9))], DOUBT)
    beside = np.array([0.0, 4.0, 0.0, 0.0, 0.0, 1.0])
    unturned = replace(estimate, at_grasp=estimate.at_grasp + 0.5 * np.outer(beside, beside))
    stops = StandOffs()
    assert is_certain_enough(estimate, 1, stops)
    assert unturned.predicted_mm > 2.0 * stops.enough_mm
    assert is_certain_enough(unturned, 1, stops, VERTICAL)


def test_how_far_the_arm_turns_it_at_the_grasp_counts_whether_or_not_its_turn_does():
    looks = [looked(np.random.default_rng(7), 200.0, np.zeros(9))]
    stops = StandOffs(enough_mm=1e6)
    for free_axis in (None, VERTICAL):
        assert is_certain_enough(fuse(looks, DOUBT), 1, stops, free_axis)
        assert not is_certain_enough(fuse(looks, replace(DOUBT, arm_deg=2.0 * stops.enough_deg)), 1, stops, free_axis)
