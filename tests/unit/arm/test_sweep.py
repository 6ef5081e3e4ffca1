"""The whole way of a move: proven clear or refused, against a look at every half millimetre (tests/fakes/swept.py)."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daemon import frames
from daemon.arm import sweep
from daemon.arm.belief import Reading
from daemon.arm.body import Capsule, KeepOut, body_of
from daemon.arm.guard import ArmState, Limits, MoveCommand, refuse
from daemon.arm.permission import Refusal
from daemon.arm.sweep import SLACK_MM, gaps_of, lever_arms_mm, path_of, path_refusal
from daemon.pick.grippers.two_fingers import tool_rotation
from drivers import puma560
from tests.fakes.chosen import few
from tests.fakes.swept import ARM, ROBOT, Travel, random_travel, truth_of

SEEDS = st.integers(0, 2**32 - 1)
LIMITS = Limits()
LEVEL_MM = 100.0
OVER_TABLE = replace(LIMITS, box_low_mm=(0.0, -650.0, -400.0))
"""The table alone limits how low the hand may be."""


def hand(x, y, z, tilt_deg=0.0, heading_deg=0.0):
    heading = np.radians(heading_deg)
    rotation = tool_rotation(np.array([np.cos(heading), np.sin(heading), 0.0]), np.radians(tilt_deg))
    return frames.rigid(rotation, np.array([x, y, z], float))


def reading(pose):
    return Reading(pose, puma560.inverse(pose, puma560.Configuration(), ARM))


def travel(start, target, straight=True, limits=LIMITS):
    return Travel(reading(start), MoveCommand(target, straight, 50.0, "test"), limits)


def asked(some):
    return path_refusal(some.command, some.standing, some.start, ROBOT, some.limits)


def rule(some):
    refusal = asked(some)
    return None if refusal is None else refusal.rule


@pytest.mark.parametrize("travels", few([60, 200], 1))
def test_what_is_allowed_keeps_clear_all_the_way_and_what_is_refused_does_not(travels):
    drawn = given(seed=SEEDS, things=st.sampled_from([0, 1, 3]), room=st.booleans())
    settings(max_examples=travels, deadline=None)(drawn(keeps_clear_or_is_refused))()


def keeps_clear_or_is_refused(seed, things, room):
    some = random_travel(np.random.default_rng(seed), things, room=room)
    truth, refusal = truth_of(some), asked(some)
    if refusal is None:
        assert not truth.reached or truth.touch_mm >= some.limits.clearance_mm - SLACK_MM
        assert not truth.reached or truth.box_mm >= -SLACK_MM
    elif refusal.rule != "no_way":
        assert truth.touch_mm < some.limits.clearance_mm or truth.box_mm < 0
        assert "on the way" in refusal.text


@settings(max_examples=60, deadline=None)
@given(seed=SEEDS, straight=st.booleans())
def test_no_point_of_the_body_goes_farther_between_two_places_than_is_bounded(seed, straight):
    goes_no_farther_than_bounded(random_travel(np.random.default_rng(seed), 0, straight))


def goes_no_farther_than_bounded(some):
    """The way, None where there is none."""
    body = body_of(some.limits.capsules, some.limits.body_mm)
    joints = ROBOT.reachable(some.command.world_from_tool, some.start.joints_rad)
    way = path_of(some.start, some.command, joints, ROBOT, body)
    shares, fine = np.linspace(0, 1, 41), np.linspace(0, 1, 401)
    if isinstance(way, Refusal):
        return None
    links = way.links(fine)
    if not np.isfinite(links).all():
        return None
    gone = np.linalg.norm(np.diff(body.placed(links), axis=0), axis=-1).max(axis=-1)
    gone = gone.reshape(40, 10, -1).sum(axis=1)
    assert (gone <= way.travel_mm(shares) + 1e-6).all()
    return way


def test_an_elbow_that_goes_farther_than_the_hand_is_bounded_as_an_elbow():
    """From a stretched arm the hand comes in evenly, and the elbow rises fast."""
    way = goes_no_farther_than_bounded(travel(hand(835, -150, -130), hand(735, -150, -130)))
    assert way is not None
    fine = way.links(np.linspace(0, 1, 200))
    elbow_mm, hand_mm = (np.linalg.norm(np.diff(fine[:, k, :3, 3], axis=0), axis=1).sum() for k in (2, 7))
    assert elbow_mm > 1.1 * hand_mm, "or it shows nothing"


@pytest.mark.parametrize(
    "axis", [(1.0, 0, 0), (0, 1.0, 0), (-1.0, 0, 0), (0, -1.0, 0), (0.6, 0.6, 0.5), (-0.5, 0.7, 1.0)]
)
@pytest.mark.parametrize("y_mm", [-300.0, 0.0, 300.0])
def test_where_the_hand_turns_in_its_place_the_arm_goes_round_it_no_farther_than_bounded(axis, y_mm):
    start = hand(500, y_mm, -100, 20.0, 40.0)
    target = start.copy()
    target[:3, :3] = frames.rotation_from_vector(np.array(axis) * 0.6) @ start[:3, :3]
    goes_no_farther_than_bounded(travel(start, target))


def test_what_is_bounded_is_the_same_wherever_the_arm_faces():
    """Arm and way turned about the arm's foot together: no length in between is taken along one axis of the world."""
    start, target = hand(500, -150, -100, 30.0, 40.0), hand(600, 100, 50, 10.0, 75.0)
    found = []
    for angle in (0.0, 0.5, 1.3):
        about = frames.rigid(frames.rotation_from_vector(np.array([0.0, 0.0, angle])), np.zeros(3))
        some = travel(about @ start, about @ target)
        way: Any = path_of(some.start, some.command, None, ROBOT, body_of(LIMITS.capsules, LIMITS.body_mm))
        found.append(way.moved_mm[-1])
    for turned in found[1:]:
        np.testing.assert_allclose(turned, found[0], rtol=1e-6)


def test_how_the_wrist_centre_goes_for_a_turn_of_each_joint_is_as_it_goes():
    joints, step = np.radians([20.0, 40.0, -70.0, 10.0, 30.0, 5.0]), 1e-6
    told = sweep.jacobians_mm(ROBOT.frames(joints[None]))[0]
    for joint in range(3):
        ends = ROBOT.frames(joints + np.array([[-0.5], [0.5]]) * step * np.eye(6)[joint])[:, sweep.FLANGE, :3, 3]
        np.testing.assert_allclose(told[joint], (ends[1] - ends[0]) / step, atol=1e-3)


def test_a_line_that_is_easy_is_followed_once_and_one_near_the_stretched_arm_more_closely_where_it_must(monkeypatch):
    asked_for = []

    def along(poses, joints_rad):
        asked_for.append(len(poses))
        return ROBOT.along(poses, joints_rad)

    robot: Any = SimpleNamespace(**vars(ROBOT) | {"along": along})
    body = body_of(LIMITS.capsules, LIMITS.body_mm)
    for some, count in (
        (travel(hand(500, -100, 100), hand(500, 100, 100)), 1),
        (travel(hand(835, -150, -130), hand(665, -150, -130)), 2),
    ):
        asked_for.clear()
        assert not isinstance(path_of(some.start, some.command, None, robot, body), Refusal)
        assert len(asked_for) == count


def test_a_line_so_near_to_the_stretched_arm_that_it_would_be_asked_for_in_more_places_than_any_is_given_up_before():
    asked_for = []

    def along(poses, joints_rad):
        asked_for.append(len(poses))
        return ROBOT.along(poses, joints_rad)

    joints = np.radians([50.36, 2.15, -79.03, -111.98, 97.42, 119.58])
    pose = puma560.forward(joints, ARM)
    command = MoveCommand(
        frames.perturb(pose, np.array([176.5, -35.65, -163.5, -0.07, -0.215, -1.034])), True, 50.0, "a"
    )
    robot: Any = SimpleNamespace(**vars(ROBOT) | {"along": along})
    body = body_of(LIMITS.capsules, LIMITS.body_mm)
    found = path_of(Reading(pose, joints), command, None, robot, body)
    assert isinstance(found, Refusal)
    assert found.rule == "no_way"
    assert "near to a singular position" in found.text
    assert sum(asked_for) < 100


LINES = (
    (hand(500, -100, 100), hand(500, 100, 100)),
    (hand(420, -100, -50, 10.0, 0.0), hand(560, 60, -120, 40.0, 70.0)),
    (hand(500, 200, -100, 30.0, 40.0), hand(505, 200, -100, -20.0, -30.0)),  # turns in its place
    (hand(835, -150, -130), hand(665, -150, -130)),  # from the stretched arm
)


def along(ends, shares):
    """What a line is bounded by at these shares: motion (6,), places (N, 8, 4, 4), Jacobians, the wrist's way each."""
    start = reading(ends[0])
    motion = frames.difference(ends[1], ends[0])
    places = ROBOT.frames(sweep.joints_along(ROBOT, start, motion, shares, start.joints_rad))
    wrists_mm = (np.linalg.norm(motion[:3]) + np.linalg.norm(motion[3:]) * 130.0) * np.diff(shares)
    return motion, places, sweep.jacobians_mm(places), wrists_mm


def test_joints_asked_for_near_to_others_are_the_turn_they_have_come_to_as_if_followed_all_the_way():
    start, motion = LINES[1][0], frames.difference(LINES[1][1], LINES[1][0])
    poses = np.array([frames.perturb(start, share * motion) for share in np.linspace(0.0, 1.0, 30)])
    followed = ROBOT.along(poses, reading(start).joints_rad)
    np.testing.assert_allclose(ROBOT.along(poses[1:], followed[:-1]), followed[1:], atol=1e-12)
    free = replace(ARM, limits_rad=3.0 * ARM.limits_rad)
    turned = followed + np.array([0.0, 0.0, 0.0, 2.0, 0.0, -2.0]) * np.pi
    np.testing.assert_allclose(puma560.inverse_along(poses[1:], turned[:-1], free), turned[1:], atol=1e-12)


def joints_along(ends, shares):
    start, motion = ends[0], frames.difference(ends[1], ends[0])
    return ROBOT.along(np.array([frames.perturb(start, share * motion) for share in shares]), reading(start).joints_rad)


@pytest.mark.parametrize("ends", LINES)
def test_the_least_lever_arm_is_nowhere_less_between_two_places_however_far_apart_than_is_bounded(ends):
    for count in (3, 9, 41):
        shares, fine = np.linspace(0.0, 1.0, count), np.linspace(0.0, 1.0, 40 * (count - 1) + 1)
        _, places, jacobians, wrist_mm = along(ends, shares)
        bend_mm, _ = sweep.bends_mm(sweep.origins_off_mm(places[0])[:3, 6])
        least, falls = sweep.least_squared(jacobians, bend_mm * wrist_mm)
        singular = np.linalg.svd(along(ends, fine)[2], compute_uv=False)[:, -1] ** 2
        within = np.lib.stride_tricks.sliding_window_view(singular, 41)[::40]
        assert (least <= within.min(axis=1) + 1e-6).all()
        np.testing.assert_allclose(least, (1.0 - falls) * (within[:, 0] + within[:, -1]) / 2, rtol=1e-9)


@pytest.mark.parametrize("up", [True, False])
def test_what_the_jacobian_changes_for_a_radian_is_bounded_and_on_an_arm_straight_up_just_that(up):
    """There the levers of joints 2 and 3 lie level, and each joint turns all of them."""
    step, straight = 1e-4, np.radians([20.0, 90.0, -90.0 + np.degrees(np.arctan2(20.3, 431.8)), 10.0, 30.0, 5.0])
    for joints in [straight] if up else np.random.default_rng(3).uniform(-2, 2, (20, 6)):
        ends = [sweep.jacobians_mm(ROBOT.frames(joints + half * step * np.eye(6)[:3])) for half in (-0.5, 0.5)]
        changes = np.linalg.norm((ends[1] - ends[0]) / step, axis=(1, 2))
        links = ROBOT.frames(joints[None])[0]
        levers = np.linalg.norm(sweep.jacobians_mm(links[None])[0], axis=1)
        assert (levers <= sweep.origins_off_mm(links)[:3, 6] + 1e-6).all()
        true, told = (np.hypot(changes[1], changes[2]), np.linalg.norm(changes)), sweep.bends_mm(levers)
        assert (true <= np.array(told) * (1.0 + 1e-6)).all()
        if up:
            np.testing.assert_allclose(true, told, rtol=1e-3)
    assert sweep.bends_mm(np.array([3.0, 0.0, 0.0])) == (0.0, 3.0), "joint 1 bends only what joint 1 moves"


@pytest.mark.parametrize("ends", LINES)
def test_how_fast_the_arm_s_own_joints_turn_on_a_line_is_as_they_do(ends):
    middle, step = 0.4, 1e-4
    motion, places, jacobians, _ = along(ends, np.array([0.0, middle]))
    off = sweep.wrist_from_tcp(places)
    np.testing.assert_allclose(off, -130.0 * places[:, 7, :3, 2], atol=1e-9)
    told = sweep.joint_rates(jacobians, motion[:3] + np.cross(motion[3:], off))[1]
    before, after = joints_along(ends, np.array([middle - step, middle + step]))
    np.testing.assert_allclose(told, np.abs(after - before)[:3] / (2 * step), rtol=1e-4, atol=1e-6)


def test_between_two_places_a_joint_gets_faster_for_half_a_stretch_at_most_and_never_faster_than_the_fastest():
    rates = np.array([[0.1, 0.4, 0.0], [0.3, 0.2, 0.0], [0.3, 0.2, 0.0]])
    told = sweep.most_turned(rates, np.array([0.5, 0.25]), np.array([9.0, 0.07]), np.array([0.02, 0.02]))
    np.testing.assert_allclose(told, [[0.16, 0.21, 0.01], [0.07, 0.06, 0.01]])


def test_where_the_least_lever_arm_could_fall_by_much_is_looked_at_in_so_many_parts_that_it_cannot():
    falls = np.array([0.0, 0.5, 0.74, 0.75, 1.0, 1.2, 5.9, 6.1, 1e9])
    assert sweep.subdivisions(falls).tolist() == [1, 1, 1, 2, 2, 3, 12, 12, 12]


def bounded(ends, capsules=LIMITS.capsules):
    some = travel(ends[0], ends[1], limits=replace(LIMITS, capsules=capsules))
    return path_of(some.start, some.command, None, ROBOT, body_of(capsules, LIMITS.body_mm))


def test_who_stays_in_place_goes_nowhere_and_what_hangs_on_the_hand_goes_as_the_hand_does():
    here = hand(500, -100, 100)
    still = bounded((here, here))
    assert not still.moved_mm.any()
    assert still.first().tolist() == [0.0, 0.5, 1.0]
    body = body_of(LIMITS.capsules, LIMITS.body_mm)
    of_hand = body.frame > 3
    straight = bounded((here, hand(500, 100, 100)))
    assert len(straight.first()) == 35, "six millimetres each, of two hundred"
    np.testing.assert_allclose(straight.moved_mm[-1][of_hand], 200.0)
    turn = np.array([0.0, 0.5, 0.0])
    turned = here @ frames.rigid(frames.rotation_from_vector(turn), np.zeros(3))
    from_tcp = np.where(body.frame[:, None, None] == 6, [0.0, 0.0, 130.0], 0.0)
    off_mm = np.linalg.norm(body.ends_mm - from_tcp, axis=-1).max(axis=1) + body.radius_mm
    np.testing.assert_allclose(bounded((here, turned)).moved_mm[-1][of_hand], 0.5 * off_mm[of_hand])


def test_a_joint_s_way_is_looked_at_every_25_mm_of_what_goes_farthest_to_begin_with():
    for speed_mm, places in ((0.0, 3), (49.0, 3), (51.0, 4), (100.0, 5), (100.1, 6), (1e9, 121)):
        way = sweep.JointPath(ROBOT, np.zeros(6), np.zeros(6), np.array([1.0, speed_mm]))
        np.testing.assert_allclose(way.first(), np.linspace(0.0, 1.0, places))


def test_an_arm_too_far_stretched_out_to_know_its_elbow_s_way_is_refused():
    refused = bounded((hand(862, -150, -130), hand(800, -150, -130)))
    assert isinstance(refused, Refusal)
    assert refused.rule == "no_way"
    assert refused.text == "after 0 % of the way the arm is stretched too far to predict the path of its elbow"
    hand_only = tuple(capsule for capsule in LIMITS.capsules if capsule.link in ("wrist", "tool"))
    assert not isinstance(bounded((hand(862, -150, -130), hand(800, -150, -130)), hand_only), Refusal)


def test_a_line_begins_where_the_arm_is_whatever_way_the_robot_would_have_it_stand_there():
    """As with a wrist so straight that no move may end there: it may leave."""

    def along(poses, joints_rad):
        found = ROBOT.along(poses, joints_rad)
        found[0] = np.nan
        return found

    robot: Any = SimpleNamespace(**vars(ROBOT) | {"along": along})
    some = travel(hand(500, -100, 100), hand(500, 100, 100))
    way: Any = path_of(some.start, some.command, None, robot, body_of(LIMITS.capsules, LIMITS.body_mm))
    np.testing.assert_allclose(way.places[0], ROBOT.frames(some.start.joints_rad[None])[0])


@settings(max_examples=100, deadline=None)
@given(seed=SEEDS)
def test_nothing_of_the_body_is_ever_farther_from_a_joint_than_its_reach(seed):
    rng = np.random.default_rng(seed)
    body = body_of(LIMITS.capsules, LIMITS.body_mm)
    low, high = ARM.limits_rad.T
    reach = lever_arms_mm(puma560.link_frames(rng.uniform(low, high, (1, 6)), ARM)[0], body)
    links = puma560.link_frames(rng.uniform(low, high, (50, 6)), ARM)
    ends = body.placed(links)
    for joint in range(6):
        axis, origin = links[:, joint, :3, 2], links[:, joint, :3, 3]
        off = np.linalg.norm(np.cross(axis[:, None, None], ends - origin[:, None, None]), axis=-1).max(axis=(0, 2))
        moved = body.frame > joint
        assert (off + body.radius_mm <= reach[joint] + 1e-6)[moved].all()
        assert (reach[joint][~moved] == 0.0).all()


def low_travels(count):
    """Joint-interpolated ones near the table, their ends allowed."""
    rng = np.random.default_rng(4)
    found = []
    while len(found) < count:
        ends = [
            hand(*rng.uniform([200, -500, -296], [800, 500, -230]), *rng.uniform([0, -180], [30, 180]))
            for _ in range(2)
        ]
        try:
            some = travel(ends[0], ends[1], straight=False)
        except puma560.UnreachableError:
            continue
        if ROBOT.reachable(ends[1], some.start.joints_rad) is None:
            continue
        there = MoveCommand(ends[0], False, 50.0, "test")
        if all(refuse(told, some.standing, LIMITS) is None for told in (some.command, there)):
            found.append(replace(some, limits=OVER_TABLE))
    return found


def test_of_travels_between_allowed_places_those_that_sweep_the_table_are_refused():
    swept_mm = []
    body = body_of((), LIMITS.body_mm)
    for some in low_travels(300):
        end = ROBOT.reachable(some.command.world_from_tool, some.start.joints_rad)
        shares = np.linspace(0, 1, 300)[:, None]
        links = ROBOT.frames(some.start.joints_rad + shares * (end - some.start.joints_rad))
        above_mm = float(body.placed(links)[..., 2].min()) - LIMITS.table_z_mm
        if above_mm < 0:
            swept_mm.append(above_mm)
            assert refuse(some.command, some.standing, LIMITS) is None, "the place alone is allowed"
            assert rule(some) == "below_table"
    assert len(swept_mm) >= 8
    assert min(swept_mm) < -15.0


def test_a_refusal_says_which_part_where_into_what_and_by_how_much():
    post = KeepOut("the post", (540.0, -40.0, -300.0), (580.0, 40.0, 200.0))
    refusal = asked(travel(hand(560, -200, 0), hand(560, 200, 0), limits=replace(LIMITS, keep_out=(post,))))
    assert refusal.rule == "kept_out"
    assert refusal.text.startswith("on the way (")
    assert "the post" in refusal.text
    assert " mm too near to" in refusal.text


def test_a_post_between_two_places_is_not_swept_through_and_one_beside_the_way_is_no_matter():
    way = hand(560, -200, 0), hand(560, 200, 0)
    for straight in (True, False):
        assert rule(travel(*way, straight)) is None
        across = replace(LIMITS, keep_out=(KeepOut("post", (545.0, -15.0, -300.0), (575.0, 15.0, 100.0)),))
        assert rule(travel(*way, straight, across)) == "kept_out"
        beside = replace(LIMITS, keep_out=(KeepOut("post", (780.0, -15.0, -300.0), (800.0, 15.0, 100.0)),))
        assert rule(travel(*way, straight, beside)) is None


@pytest.mark.parametrize(
    ("part", "box"),
    [
        ("forearm", ((430.0, -20.0, 280.0), (480.0, 20.0, 330.0))),
        ("wrist", ((540.0, -60.0, 165.0), (580.0, -50.0, 175.0))),
        ("camera", ((650.0, -5.0, 90.0), (655.0, 5.0, 100.0))),
    ],
)
def test_arm_wrist_and_cameras_are_guarded_as_the_fingers_are(part, box):
    way = hand(560, -200, 0), hand(560, 200, 0)
    only = tuple(c for c in LIMITS.capsules if part in c.name)
    assert only
    limits = Limits(body_mm=(), capsules=only, keep_out=(KeepOut("light", *box),))
    struck = [rule(travel(*way, straight, limits)) for straight in (True, False)]
    truths = [truth_of(travel(*way, straight, limits)).touch_mm for straight in (True, False)]
    assert struck == ["kept_out" if mm < 2.0 else None for mm in truths]
    assert "kept_out" in struck


def test_the_tool_centre_point_itself_stays_above_the_table_and_in_the_box():
    bare = Limits(body_mm=(), capsules=())
    low = [replace(some, limits=replace(bare, box_low_mm=OVER_TABLE.box_low_mm)) for some in low_travels(300)]
    dips = [some for some in low if truth_of(some).touch_mm < 0]
    assert dips
    assert {rule(some) for some in dips} == {"below_table"}
    high = replace(bare, box_high_mm=(530.0, 650.0, 1100.0))
    bulging = travel(hand(500, -220, 0), hand(500, 220, 0), False, high)
    assert truth_of(bulging).box_mm < -SLACK_MM
    assert rule(bulging) == "outside_workspace"


INSIDE = KeepOut("neighbour", (500.0, -100.0, -100.0), (700.0, 100.0, 1000.0))
"""Around a hand at 520, 0, 0: some twenty millimetres behind its least x."""
FINGER = Limits(body_mm=(), capsules=(Capsule("finger", "tool", (0, 0, -10), (0, 0, 0), 5.0),), keep_out=(INSIDE,))


@pytest.mark.parametrize(
    ("to", "told"),
    [
        (hand(440, 0, 0), None),  # out by the nearest side
        (hand(500, 0, 0), None),  # nearer to that side, not yet out
        (hand(560, 0, 0), "kept_out"),  # deeper
        (hand(600, 250, 0), "kept_out"),  # out, but through the thick of it
        (hand(520, 3, 0), None),  # along the side
    ],
)
def test_what_stands_in_a_keep_out_may_leave_it_and_go_no_deeper(to, told):
    assert rule(travel(hand(520, 0, 0), to, True, FINGER)) == told


def test_a_way_is_proven_to_within_half_the_clearance_where_that_is_little():
    wall = KeepOut("wall", (400.0, -400.0, -250.0), (504.9, 400.0, 900.0))
    for clearance_mm, told in ((0.4, "kept_out"), (0.15, None)):
        limits = replace(FINGER, clearance_mm=clearance_mm, keep_out=(wall,))
        assert rule(travel(hand(530, -200, 0), hand(510, -190, 0), True, limits)) == told


def test_where_the_hand_turns_about_its_own_axis_its_points_go_as_far_as_they_reach_out():
    start = hand(560, 0, 0)
    target = start @ frames.rigid(frames.rotation_from_vector(np.array([0.0, 0.0, 1.0])), np.zeros(3))
    some, body = travel(start, target), body_of(LIMITS.capsules, LIMITS.body_mm)
    way: Any = path_of(some.start, some.command, None, ROBOT, body)
    gone = way.travel_mm(np.array([0.0, 1.0]))[0]
    reach_mm = np.linalg.norm(body.ends_mm[..., :2], axis=-1).max(axis=1)
    assert (gone >= reach_mm)[body.frame == 7].all()


class OutAndBack:
    """The tool's x over the shares: ten inside INSIDE, fifty before it, and `back` inside."""

    def __init__(self, back):
        self.back = back

    def first(self):
        return np.linspace(0.0, 1.0, 5)

    def links(self, shares):
        found = np.tile(np.eye(4), (len(shares), 8, 1, 1))
        found[:, 7, 0, 3] = 500.0 + np.interp(shares, [0.0, 0.5, 1.0], [10.0, -50.0, self.back])
        return found

    def travel_mm(self, shares):
        return np.diff(shares)[:, None] * 140.0


def test_what_asking_costs_is_bounded_and_a_way_too_tight_for_that_is_refused(monkeypatch):
    """Along a wall at little more than the clearance: clear, but to prove it would take place after place."""
    places = []
    monkeypatch.setattr(sweep, "gaps_of", lambda links, *rest: places.append(len(links)) or gaps_of(links, *rest))
    wall = KeepOut("wall", (400.0, -400.0, -250.0), (504.75, 400.0, 900.0))
    close = replace(FINGER, clearance_mm=0.2, keep_out=(wall,))
    for limits, told in ((close, "no_way"), (replace(close, keep_out=()), None)):
        places.clear()
        assert rule(travel(hand(510, -200, 0), hand(510, 200, 0), True, limits)) == told
        assert sum(places) <= sweep.MOST_PLACES + 1


def test_a_way_is_looked_at_in_as_many_places_as_are_the_most_and_in_no_more(monkeypatch):
    parts = []

    def closer(falls):
        parts.append(np.where(np.arange(len(falls)) == 0, 3, 1))
        return parts[-1]

    monkeypatch.setattr(sweep, "subdivisions", closer)
    way = travel(hand(500, -150, 100), hand(500, 50, 100))
    assert rule(way) is None
    for most, told in ((parts[0].sum(), None), (parts[0].sum() - 1, "no_way")):
        monkeypatch.setattr(sweep, "MOST_PLACES", most)
        joints = ROBOT.reachable(way.command.world_from_tool, way.start.joints_rad)
        body = body_of(way.limits.capsules, way.limits.body_mm)
        found = path_of(way.start, way.command, joints, ROBOT, body)
        assert (found.rule if isinstance(found, Refusal) else None) == told


@pytest.mark.parametrize(("back", "rules"), [(5.0, ["kept_out"]), (-20.0, [])])
def test_what_has_left_a_keep_out_may_not_come_back_even_less_deep(back, rules):
    bare = replace(FINGER, capsules=())
    body = body_of(bare.capsules, bare.body_mm)
    assert [violation.rule for violation in sweep.violations(OutAndBack(back), body, bare)] == rules


def test_who_left_a_keep_out_may_not_come_back_on_the_same_way():
    limits = replace(FINGER, keep_out=(KeepOut("edge", (500.0, -30.0, -100.0), (700.0, 30.0, 1000.0)),))
    assert rule(travel(hand(500, 32, 0), hand(600, 150, 0), True, limits)) is None
    assert rule(travel(hand(600, 150, 0), hand(600, -150, 0), True, limits)) == "kept_out"


def test_a_straight_way_the_arm_cannot_follow_is_refused():
    behind = travel(hand(250, -300, 0), hand(60, 0, 0))
    assert rule(behind) == "no_way"


def test_a_joint_way_to_a_place_out_of_reach_is_refused():
    start = hand(650, 0, 200)
    far = hand(899, 300, 1099)
    assert ROBOT.reachable(far, reading(start).joints_rad) is None
    wide = replace(LIMITS, max_step_mm=5000.0)
    assert rule(travel(start, far, False, wide)) == "no_way"


def place_clear(there, limits):
    far = reading(hand(600, 50, 100))
    clear = sweep.places_clear(np.stack([far.joints_rad, there.joints_rad]), ROBOT, limits)
    return bool(clear[1])


def test_a_place_is_judged_with_all_of_the_arm_and_by_no_leave_to_get_out():
    lamp = KeepOut("lamp", (430.0, -20.0, 280.0), (480.0, 20.0, 330.0))
    there = reading(hand(560, 0, 0))
    assert place_clear(there, LIMITS)
    assert not place_clear(there, replace(LIMITS, keep_out=(lamp,)))


def test_the_elbow_stays_in_the_room_where_the_hand_is_well_inside_it():
    """Near the column the elbow goes far out behind: a look around went through a wall with it, 29 mm."""
    near_column = travel(hand(320, -250, 100), hand(200, -150, 200), False)
    target = near_column.command.world_from_tool
    joints = ROBOT.reachable(target, near_column.start.joints_rad)
    links = puma560.link_frames(joints[None], ARM)
    body = body_of(LIMITS.capsules, LIMITS.body_mm)
    least = float((body.placed(links)[0].min(axis=1) - body.radius_mm[:, None])[:, 0].min())
    assert least < -400.0
    for low_mm, told in ((least + 5.0, "outside_room"), (least - 10.0, None)):
        room = replace(LIMITS, room_low_mm=(low_mm, -900.0, -2000.0))
        refusal = asked(replace(near_column, limits=room))
        assert (refusal and refusal.rule) == told
        assert told is None or "the elbow" in refusal.text
        assert place_clear(Reading(target, joints), room) is (told is None)


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("side", ["room_low_mm", "room_high_mm"])
def test_each_side_of_the_room_holds_what_sticks_out_farthest_to_it_by_the_clearance(axis, side):
    """Of each of the six alone, to the mm and a half that a way is proven to; rods from the hand, whose far ends leave
    first."""
    out = 1.0 if side == "room_high_mm" else -1.0
    start, target = hand(500, 0, 100), hand(500, 0, 100)
    target[axis, 3] += 40.0 * out
    rod = target[:3, :3].T @ (60.0 * out * np.eye(3)[axis])
    bare = replace(LIMITS, capsules=(Capsule("rod", "tool", (0.0, 0.0, 0.0), tuple(rod.tolist()), 4.0),), body_mm=())
    for short_mm, told in ((1.0, "outside_room"), (-1.0, None)):
        sides = list(getattr(bare, side))
        sides[axis] = float(target[axis, 3]) + out * (60.0 + 4.0 + LIMITS.clearance_mm - short_mm)
        room: Any = {side: tuple(sides)}
        assert rule(travel(start, target, True, replace(bare, **room))) == told


def test_a_gap_goes_by_the_travel_of_what_it_is_told_of():
    """Were the elbow's gap to a wall thought to change as a finger goes, it would be proven where it is not so."""
    limits = replace(LIMITS, keep_out=(KeepOut("post", (600.0, 0.0, 0.0), (700.0, 9.0, 9.0)),))
    body = body_of(limits.capsules, limits.body_mm)
    gaps = gaps_of(ROBOT.frames(reading(hand(500, 0, 100)).joints_rad[None]), body, limits)
    parts = ["tool centre point" if thing.endswith("of the box") else part for _, part, thing in gaps.what]
    assert parts == [
        "tool centre point" if rule == "outside_workspace" else body.names[k]
        for (rule, _, _), k in zip(gaps.what, gaps.capsule.tolist(), strict=True)
    ]
    assert {k for (rule, _, _), k in zip(gaps.what, gaps.capsule, strict=True) if rule == "outside_workspace"} == {
        len(body.names) - 1
    }


def test_what_is_outside_the_room_may_come_in_and_go_no_farther_out():
    room = replace(LIMITS, capsules=(), body_mm=((0.0, 0.0, 0.0),), room_high_mm=(2000.0, 100.0, 2000.0))
    assert rule(travel(hand(500, 120, 0), hand(500, 60, 0), True, room)) is None
    assert rule(travel(hand(500, 120, 0), hand(500, 140, 0), True, room)) == "outside_room"


def test_the_rules_of_the_moment_go_before_the_way():
    some = travel(hand(560, -200, 0), hand(560, 200, 0))
    fault = ArmState(Refusal("fault_active", "stopped"), some.start.world_from_tool, 0.0)
    assert path_refusal(some.command, fault, some.start, ROBOT, LIMITS).rule == "fault_active"
    lost = ArmState(None, None, 0.0)
    assert path_refusal(some.command, lost, None, ROBOT, LIMITS).rule == "arm_lost"


def test_a_way_in_the_free_is_looked_at_in_few_places(monkeypatch):
    places = []
    asked_of = ROBOT.frames
    monkeypatch.setattr(ROBOT, "frames", lambda joints: places.append(len(joints)) or asked_of(joints))
    for straight in (True, False):
        places.clear()
        assert rule(travel(hand(500, -200, LEVEL_MM), hand(500, 200, LEVEL_MM), straight)) is None
        assert sum(places) < 100


def test_the_bound_is_what_keeps_it_true(monkeypatch):
    """Were the travel between two places taken for nothing, a post between them would be passed through."""
    post = KeepOut("post", (550.0, -104.0, -300.0), (570.0, -96.0, 10.0))
    through = travel(hand(560, -200, 0), hand(560, 200, 0), False, replace(LIMITS, keep_out=(post,)))
    assert rule(through) == "kept_out"
    monkeypatch.setattr(sweep, "FIRST_MM", 1000.0)
    assert rule(through) == "kept_out"
    honest = sweep.JointPath.travel_mm
    monkeypatch.setattr(sweep.JointPath, "travel_mm", lambda way, *at: 0.0 * honest(way, *at))
    assert rule(through) is None


LOW = Capsule("finger", "tool", (0.0, 0.0, -50.0), (0.0, 0.0, -50.0), 0.0)


class Dip:
    """A hand that goes straight down by so much and up again, seen at its ends only to begin with, where what is lowest
    of it has so much to spare."""

    def __init__(self, gap_mm, dip_mm, limits):
        self.parts, below_mm = len(limits.capsules) + 1, 50.0 * len(limits.capsules)
        self.high_mm = limits.table_z_mm + limits.clearance_mm + below_mm + gap_mm
        self.dip_mm, self.asked = dip_mm, []

    def first(self):
        return np.array([0.0, 1.0])

    def links(self, shares):
        self.asked += list(shares)
        frames = np.tile(np.eye(4), (len(shares), 8, 1, 1))
        frames[:, :, 0, 3] = 400.0
        frames[:, :, 2, 3] = (self.high_mm - self.dip_mm * (1.0 - np.abs(2.0 * shares - 1.0)))[:, None]
        return frames

    def travel_mm(self, shares):
        return np.tile(2.0 * self.dip_mm * np.diff(shares)[:, None], self.parts)


@pytest.mark.parametrize("capsules", [(), (LOW,)])
@pytest.mark.parametrize(("dip_mm", "violation"), [(10.4, False), (10.6, True), (15.0, True), (40.0, True)])
def test_between_two_places_nothing_is_trusted_that_could_have_gone_farther_than_its_gaps(dip_mm, violation, capsules):
    """Ten millimetres to spare at both ends, and half a millimetre of slack: beyond that it is looked at."""
    limits = Limits(body_mm=(), capsules=capsules)
    way = Dip(10.0, dip_mm, limits)
    found = sweep.violations(way, body_of(capsules, ()), limits)
    assert (len(way.asked) > 2) is violation
    assert ("below_table" in [each.rule for each in found]) is violation


def test_what_is_not_proven_at_the_second_look_is_looked_at_again():
    """A dip in the fourth part of the way: the middle, where it is looked at first, is as high as the ends."""

    class Later(Dip):
        def links(self, shares):
            return super().links(np.interp(shares, [0.0, 0.5, 0.75, 1.0], [0.0, 0.0, 0.5, 1.0]))

        def travel_mm(self, shares):
            return 2.0 * super().travel_mm(shares)

    for capsules in ((), (LOW,)):
        limits = Limits(body_mm=(), capsules=capsules)
        found = sweep.violations(Later(10.0, 12.0, limits), body_of(capsules, ()), limits)
        assert "below_table" in [each.rule for each in found]


class Along:
    """A tool centre point on the way through these places (x, z), asked for at the given shares to begin with; travel:
    what it is said to go in the whole way, mm. lost: the arm does not get to between two of them."""

    def __init__(self, first, at, xz, travel, lost=False):
        self.shares, self.at, self.xz, self.travel, self.lost = np.array(first), at, np.array(xz), travel, lost

    def first(self):
        return self.shares

    def links(self, shares):
        found = np.tile(np.eye(4), (len(shares), 8, 1, 1))
        for axis, values in zip((0, 2), self.xz.T, strict=True):
            found[:, :, axis, 3] = np.interp(shares, self.at, values)[:, None]
        if self.lost:
            found[~np.isin(shares, self.shares)] = np.nan
        return found

    def travel_mm(self, shares):
        return np.diff(np.interp(shares, self.at, self.travel))[:, None]


BARE = Limits(body_mm=(), capsules=(), box_low_mm=(0.0, -650.0, -400.0))
LEAST_MM = BARE.table_z_mm + BARE.clearance_mm


def struck(way, limits=BARE):
    return sweep.violations(way, body_of((), ()), limits)


def test_down_to_just_the_slack_is_proven_and_a_hair_lower_is_not():
    """Half a millimetre down and no more: neither the fall nor what could lie between is beyond what is allowed."""
    for fall_mm, rules in ((0.5, []), (0.5 + 2.0**-40, ["below_table"])):
        way = Along([0.0, 1.0], [0.0, 1.0], [(400.0, LEAST_MM), (400.0, LEAST_MM - fall_mm)], [0.0, 0.5])
        assert [violation.rule for violation in struck(way)] == rules


def test_an_arm_that_does_not_get_to_where_it_is_looked_at_more_closely_is_refused():
    """At both ends there is room enough: only between them the arm cannot follow."""
    ends = [(400.0, LEAST_MM + 1.0)] * 2
    assert struck(Along([0.0, 1.0], [0.0, 1.0], ends, [0.0, 2.9])) == ()
    (violation,) = struck(Along([0.0, 1.0], [0.0, 1.0], ends, [0.0, 3.1], lost=True))
    assert violation == Refusal("no_way", "after 50 % of the way the arm cannot follow in its configuration")


def test_what_is_inside_a_limit_is_held_against_the_least_depth_seen_as_long_as_anything_is_looked_at():
    """The point, six millimetres inside a box, comes half a one nearer to its side and goes in again: between the
    places looked at first, and seen only as the table, which is as near, makes it be looked at more closely."""
    box = KeepOut("box", (500.0, -400.0, -500.0), (900.0, 400.0, 100.0))
    shares = [0.0, 0.25, 0.5, 1.0]
    way = Along(
        [0.0, 0.5, 1.0],
        shares,
        [(506.0, LEAST_MM), (505.5, LEAST_MM - 0.2), (506.0, LEAST_MM - 0.4), (506.3, LEAST_MM - 0.4)],
        [0.0, 0.475, 0.95, 1.3],
    )
    limits = replace(BARE, keep_out=(box,))
    assert [violation.rule for violation in struck(way, limits)] == ["kept_out"]
    assert struck(way) == (), "the table alone is no hindrance"


def test_what_cannot_come_near_is_not_looked_at_nor_what_would_only_just_touch():
    """By half its travel between two places, its radius and the clearance."""
    capsules = tuple(Capsule(f"at {x}", "tool", (x, 0.0, 0.0), (x, 0.0, 0.0), 8.0) for x in (0.0, 64.0))
    body = body_of(capsules, ())
    ends = body.placed(np.tile(np.eye(4), (2, 8, 1, 1)))
    travel_mm = np.array([[16.0, 16.0, 16.0]])
    for side in (-1.0, 1.0):
        for far_mm, told in ((18.0, [2]), (17.0, [0 if side < 0 else 1, 2])):
            low = (-100.0 - far_mm, -5.0, -5.0) if side < 0 else (64.0 + far_mm, -5.0, -5.0)
            box = KeepOut("box", low, (low[0] + 100.0, 5.0, 5.0))
            limits = Limits(keep_out=(box,), capsules=capsules, table_z_mm=-18.0)
            tight = sweep.broad_phase(ends, travel_mm, body, limits)
            assert tight.capsules.tolist() == told
            assert tight.boxes.tolist() == ([0] if len(told) > 1 else [])
    assert sweep.broad_phase(ends, travel_mm, body, Limits(capsules=capsules, table_z_mm=-17.0)).capsules.tolist() == [
        0,
        1,
        2,
    ]


def test_a_place_a_little_nearer_than_the_clearance_is_no_place():
    there = reading(hand(560, 0, 0))
    for gap_mm, clear in ((2.001, True), (1.5, False)):
        wall = KeepOut("wall", (560.0 + gap_mm, -400.0, -100.0), (900.0, 400.0, 100.0))
        assert place_clear(there, replace(BARE, keep_out=(wall,))) is clear


def test_a_strike_is_told_with_how_far_along_and_at_its_lowest_end():
    capsules = (Capsule("rod", "tool", (0.0, 10.0, -40.0), (0.0, -30.0, 0.0), 1.0),)
    body = body_of(capsules, ())
    places = [(400.0, LEAST_MM + 50.0), (410.0, LEAST_MM - 9.0)]
    (violation,) = sweep.violations(
        Along([0.0, 1.0], [0.0, 1.0], places, [0.0, 60.0]), body, replace(BARE, capsules=capsules)
    )
    low_mm = LEAST_MM - 9.0 - 40.0
    assert violation.text == f"on the way (100 %) the rod, at 410 10 {low_mm:.0f}, comes 50.0 mm too near to the table"
    half = Along([0.0, 0.5, 1.0], [0.0, 0.5, 1.0], [places[0], places[1], places[0]], [0.0, 60.0, 120.0])
    assert sweep.violations(half, body, replace(BARE, capsules=capsules))[0].text.startswith(
        "on the way (50 %) the rod"
    )


def test_a_line_that_is_clear_at_the_first_look_is_followed_once(monkeypatch):
    asked = []
    monkeypatch.setattr(ROBOT, "along", lambda *way, along=ROBOT.along: asked.append(way) or along(*way))
    assert rule(travel(hand(500, -100, 100), hand(500, 100, 100))) is None
    assert len(asked) == 1


def test_what_is_nearer_than_three_centimetres_to_its_limit_in_a_keep_out_is_told_exactly():
    """A rod beside a wall: the bound that serves farther away would be a fourth of its length short."""
    rod = Capsule("rod", "tool", (0.0, -40.0, 0.0), (0.0, 40.0, 0.0), 5.0)
    links = np.tile(np.eye(4), (1, 8, 1, 1))
    for gap_mm, exact in ((29.0, True), (60.0, False)):
        wall = KeepOut("wall", (5.0 + 2.0 + gap_mm, -400.0, -400.0), (900.0, 400.0, 400.0))
        gaps = sweep.gaps_of(links, body_of((rod,), ()), Limits(capsules=(rod,), keep_out=(wall,)))
        told = gaps.values_mm[0, [what[:2] for what in gaps.what].index(("kept_out", "rod"))]
        assert told == pytest.approx(gap_mm if exact else gap_mm - 20.0)


@pytest.mark.parametrize(("travel_mm", "rules"), [(12.0, []), (120.0, []), (190.0, ["no_way"])])
def test_along_a_limit_a_way_is_proven_in_so_many_stretches_as_it_takes_up_to_five_hundred(travel_mm, rules):
    """At just the clearance all along: with a fifth of a millimetre of slack each 0.4 mm of travel has to be seen."""
    limits = replace(BARE, clearance_mm=0.4)
    at = [(400.0, BARE.table_z_mm + 0.4)] * 2
    way = Along([0.0, 1.0], [0.0, 1.0], at, [0.0, travel_mm])
    assert [violation.rule for violation in struck(way, limits)] == rules


def test_five_hundred_places_are_not_too_many():
    limits = replace(BARE, clearance_mm=0.4)
    at = [(400.0, BARE.table_z_mm + 0.4)] * 2
    assert struck(Along(np.linspace(0.0, 1.0, 51), [0.0, 1.0], at, [0.0, 190.0]), limits) == ()


def test_what_is_within_the_slack_is_not_told_where_something_else_strikes():
    box = KeepOut("box", (500.0, -400.0, -500.0), (900.0, 400.0, 100.0))
    way = Along([0.0, 1.0], [0.0, 1.0], [(400.0, LEAST_MM), (520.0, LEAST_MM - 0.5)], [0.0, 120.0])
    assert [violation.rule for violation in struck(way, replace(BARE, keep_out=(box,)))] == ["kept_out"]


@pytest.mark.parametrize(("over_mm", "looked_at"), [(0.0, [[0, 1, 2], [0, 2]]), (-(2.0**-40), [[0, 1, 2], [0, 1, 2]])])
def test_what_is_proven_at_the_first_look_is_not_looked_at_again_and_what_lacks_a_hair_is(
    over_mm, looked_at, monkeypatch
):
    """A dip of 16 mm: the lowest finger lacks room for it, the other has just enough, or a hair less."""
    asked, gaps_of = [], sweep.Unproven.gaps_of

    def listening(tight, *about):
        asked.append(tight.capsules.tolist())
        return gaps_of(tight, *about)

    monkeypatch.setattr(sweep.Unproven, "gaps_of", listening)
    other = Capsule("other finger", "tool", (0.0, 0.0, -46.5 + over_mm), (0.0, 0.0, -46.5 + over_mm), 0.0)
    limits = Limits(body_mm=(), capsules=(LOW, other), table_z_mm=0.0)

    class Once(Dip):
        def __init__(self):
            super().__init__(12.0, 16.0, replace(limits, capsules=(LOW,)))
            self.parts = 3

    assert sweep.violations(Once(), body_of(limits.capsules, ()), limits) != ()
    assert asked[:2] == looked_at
