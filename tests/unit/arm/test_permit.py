"""Whether arm and gripper may move: what grants it, and what each end of the line withholds it for."""

import pytest

from daemon.arm.permit import Grant, MotionPermit


def granted(what: Grant = Grant.ALL) -> MotionPermit:
    permit = MotionPermit()
    permit.stop_seen = 3
    permit.grant(what)
    return permit


def test_nothing_is_permitted_before_an_operator_grants_it():
    permit = MotionPermit()
    assert permit.withheld
    assert (permit.granted, permit.enabled, permit.by_hand_only) == (False, False, False)


@pytest.mark.parametrize(
    ("what", "enabled", "by_hand"),
    [(Grant.ALL, True, False), (Grant.BY_HAND, False, True), (Grant.NOTHING, False, False)],
)
def test_what_was_granted_is_what_may_move(what, enabled, by_hand):
    permit = granted(what)
    assert (permit.enabled, permit.by_hand_only, permit.withheld) == (enabled, by_hand, what is Grant.NOTHING)


def test_what_was_granted_with_no_stop_seen_to_work_permits_nothing():
    permit = MotionPermit()
    permit.grant(Grant.ALL)
    assert permit.granted
    assert permit.withheld


def lose_the_stop(permit: MotionPermit) -> None:
    permit.stop_seen = 0


def see_another_stop(permit: MotionPermit) -> None:
    permit.stop_seen = 4


def fault(permit: MotionPermit) -> None:
    permit.fault = "stopped"


@pytest.mark.parametrize(
    "event",
    [MotionPermit.withdraw, MotionPermit.stop_begins, MotionPermit.hold, lose_the_stop, see_another_stop, fault],
)
def test_each_of_these_withholds_what_was_released_before(event):
    permit = granted()
    permit.release()
    assert not permit.withheld
    event(permit)
    assert permit.withheld


def test_of_two_stops_both_must_have_ended():
    permit = granted()
    permit.why = "by ann"
    permit.stop_begins()
    permit.stop_begins()
    permit.stop_ends()
    assert permit.stopping
    assert permit.blocked
    assert permit.refusal().text == "the arm is being stopped (by ann): try again when it is at rest"
    permit.stop_ends()
    assert not permit.blocked
    assert not permit.withheld


def test_a_hold_is_over_with_the_next_move_that_is_released():
    permit = granted()
    permit.hold()
    permit.hold()
    assert permit.held
    permit.release()
    assert not permit.held


@pytest.mark.parametrize("typed", [False, True])
def test_a_fault_is_what_hinders_first(typed):
    permit = MotionPermit()
    permit.stop_begins()
    permit.fault = "cameras: no frame"
    permit.stop_ends()
    assert permit.blocked
    permit.stop_begins()
    assert permit.refusal(typed).text == "a fault is active (cameras: no frame): `resume` first"
    permit.fault = None
    assert permit.refusal(typed).rule == "fault_active"


@pytest.mark.parametrize(
    ("what", "commanded", "typed"),
    [
        (Grant.ALL, None, None),
        (Grant.BY_HAND, "calibrate hand-eye first", None),
        (Grant.NOTHING, "`enable` first", "`enable` first"),
    ],
)
def test_a_motion_that_was_not_granted_is_refused_with_what_to_do(what, commanded, typed):
    permit = granted(what)
    for refusal, remedy in ((permit.refusal(), commanded), (permit.refusal(typed=True), typed)):
        assert (refusal is None) == (remedy is None)
        assert refusal is None or (refusal.rule == "not_enabled" and remedy in refusal.text)
