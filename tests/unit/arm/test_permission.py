"""Whether arm and gripper may move: what grants it, and what each end of the line withholds it for."""

import pytest

from daemon.arm.permission import Fault, Grant, MotionPermission


def granted(what: Grant = Grant.ALL) -> MotionPermission:
    permission = MotionPermission()
    permission.stop_tests = 3
    permission.grant(what)
    return permission


def test_nothing_is_permitted_before_an_operator_grants_it():
    permission = MotionPermission()
    assert permission.withheld
    assert (permission.granted, permission.enabled, permission.typed_lines_only) == (False, False, False)


@pytest.mark.parametrize(
    ("what", "enabled", "by_hand"),
    [(Grant.ALL, True, False), (Grant.TYPED_LINES, False, True), (Grant.NOTHING, False, False)],
)
def test_what_was_granted_is_what_may_move(what, enabled, by_hand):
    permission = granted(what)
    assert (permission.enabled, permission.typed_lines_only, permission.withheld) == (
        enabled,
        by_hand,
        what is Grant.NOTHING,
    )


def test_what_was_granted_with_no_stop_seen_to_work_permits_nothing():
    permission = MotionPermission()
    permission.grant(Grant.ALL)
    assert permission.granted
    assert permission.withheld


def lose_the_stop(permission: MotionPermission) -> None:
    permission.stop_tests = 0


def see_another_stop(permission: MotionPermission) -> None:
    permission.stop_tests = 4


def fault(permission: MotionPermission) -> None:
    permission.fault = Fault("stopped")


@pytest.mark.parametrize(
    "event",
    [
        MotionPermission.withdraw,
        MotionPermission.stop_begins,
        MotionPermission.require_wait,
        lose_the_stop,
        see_another_stop,
        fault,
    ],
)
def test_each_of_these_withholds_what_was_released_before(event):
    permission = granted()
    permission.release()
    assert not permission.withheld
    event(permission)
    assert permission.withheld


def test_of_two_stops_both_must_have_ended():
    permission = granted()
    permission.why = "by ann"
    permission.stop_begins()
    permission.stop_begins()
    permission.stop_ends()
    assert permission.stopping
    assert permission.blocked
    assert permission.refusal().text == "the arm is being stopped (by ann): try again when it is at rest"
    permission.stop_ends()
    assert not permission.blocked
    assert not permission.withheld


def test_a_hold_is_over_with_the_next_move_that_is_released():
    permission = granted()
    permission.require_wait()
    permission.require_wait()
    assert permission.must_wait
    permission.release()
    assert not permission.must_wait


@pytest.mark.parametrize("typed", [False, True])
def test_a_fault_is_what_hinders_first(typed):
    permission = MotionPermission()
    permission.stop_begins()
    permission.fault = Fault("cameras: no frame")
    permission.stop_ends()
    assert permission.blocked
    permission.stop_begins()
    assert permission.refusal(typed).text == "a fault is active (cameras: no frame): `resume` first"
    permission.fault = None
    assert permission.refusal(typed).rule == "fault_active"


@pytest.mark.parametrize(
    ("what", "commanded", "typed"),
    [
        (Grant.ALL, None, None),
        (Grant.TYPED_LINES, "calibrate hand-eye first", None),
        (Grant.NOTHING, "`enable` first", "`enable` first"),
    ],
)
def test_a_motion_that_was_not_granted_is_refused_with_what_to_do(what, commanded, typed):
    permission = granted(what)
    for refusal, remedy in ((permission.refusal(), commanded), (permission.refusal(typed=True), typed)):
        assert (refusal is None) == (remedy is None)
        assert refusal is None or (refusal.rule == "not_enabled" and remedy in refusal.text)
