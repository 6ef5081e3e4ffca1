"""What each kind of gripper says of itself and of its grasps: the same questions, answered from its own dimensions."""

from __future__ import annotations

import numpy as np
import pytest

from daemon.pick.grippers.gripper import Gripper, HoldingVolume, PlannedGrasp
from daemon.pick.grippers.suction import CupGrasp, SuctionCup
from daemon.pick.grippers.two_fingers import SLIPS_DEG, FingerGrasp, TwoFingers

FINGERS = TwoFingers(opening_mm=90.0, finger_width_mm=16.0, finger_thick_mm=7.0, pad_back_mm=40.0, tip_mm=12.0)
CUP = SuctionCup(cup_radius_mm=9.0, cup_length_mm=55.0, dwell_s=0.4, blow_off_s=0.1)


@pytest.mark.parametrize(
    ("gripper", "outside", "held_about", "widest_mm", "tip_mm"),
    [
        (FINGERS, ("opening_mm", 52.0), HoldingVolume(40.0, 12.0, 16.0), 90.0, 12.0),
        (CUP, ("cup_radius_mm", 9.0), HoldingVolume(0.0, 0.0, 18.0), None, 0.0),
    ],
)
def test_how_far_it_reaches_and_what_it_holds_is_of_its_own_dimensions(
    gripper: Gripper, outside: tuple[str, float], held_about: HoldingVolume, widest_mm: float | None, tip_mm: float
) -> None:
    assert gripper.outside == outside
    assert gripper.holding_volume == held_about
    assert (gripper.widest_mm, gripper.tip_mm) == (widest_mm, tip_mm)


def test_a_look_can_tell_closed_fingers_with_nothing_between_and_no_cup() -> None:
    closed = FINGERS.empty
    np.testing.assert_allclose(closed.corners_mm.min(axis=0), [-8.0, -7.0, -40.0])
    np.testing.assert_allclose(closed.corners_mm.max(axis=0), [8.0, 7.0, 12.0])
    assert CUP.empty is None


def test_a_vacuum_takes_its_time_to_come_and_to_go_and_fingers_have_theirs_elsewhere() -> None:
    assert [CUP.work_time_s(closed) for closed in (True, False)] == [0.4, 0.1]
    assert [FINGERS.work_time_s(closed) for closed in (True, False)] == [0.0, 0.0]


HELD = FingerGrasp(np.eye(4), 10.0, width_mm=41.6, slip_deg=9.0)
SUCKED = CupGrasp(np.eye(4), 20.0, facet=3, room_mm=14.25, load=0.42)


@pytest.mark.parametrize(
    ("grasp", "risk", "words", "figures"),
    [
        (
            HELD,
            9.0 / SLIPS_DEG,
            "42 mm wide, tilted 10 degrees, contacts 9 degrees off perpendicular",
            {"slip_deg": 9.0},
        ),
        (
            SUCKED,
            0.42,
            "by facet 3, tilted 20 degrees, room for a lip of 14.2 mm radius, 42 % of what the cup holds",
            {"facet": 3, "room_mm": 14.25, "load": 0.42},
        ),
    ],
)
def test_a_grasp_is_told_in_words_and_figures_and_how_near_it_is_to_slipping(
    grasp: PlannedGrasp, risk: float, words: str, figures: dict[str, float]
) -> None:
    assert grasp.risk == pytest.approx(risk)
    assert grasp.description == words
    assert grasp.figures == figures
