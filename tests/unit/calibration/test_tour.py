"""The arm's own tour of poses round a board."""

from __future__ import annotations

import asyncio
from types import SimpleNamespace
from typing import Any
from unittest.mock import AsyncMock

import numpy as np
import pytest

from daemon import frames
from daemon.arm.guard import Limits
from daemon.arm.motion import Arrival
from daemon.arm.operators import RefusedError
from daemon.arm.supervisor import Supervisor
from daemon.calibration.hand_eye import MIN_TURN_DEG, diversity_deg
from daemon.calibration.session import view_tour
from daemon.calibration.tour import choose_spread, shortest_order, viewpoints_around
from tests.fakes.fake_cell import World, build


def test_a_tour_turns_the_hand_about_two_axes_and_keeps_the_board_in_view() -> None:
    world_from_board = frames.rigid(np.diag([1.0, -1.0, -1.0]), np.array([480.0, 40.0, -296.0]))
    centre = np.array([64.0, 40.0, 0.0])
    looks = viewpoints_around(world_from_board, centre, np.array([0.0, 1.0, 0.0]))
    chosen = choose_spread(looks, 20, lambda _: True, looks[0])
    assert len(chosen) == 20
    assert diversity_deg(chosen) > 1.5 * MIN_TURN_DEG
    for look in chosen:
        np.testing.assert_allclose(look[:3, :3] @ look[:3, :3].T, np.eye(3), atol=1e-9)
        seen = frames.apply(frames.inverse(look), frames.apply(world_from_board, centre))
        assert np.abs(seen[:2]).max() < 40.0
        assert 250.0 < seen[2] < 420.0
        assert look[2, 3] > -296.0 + 150.0


def test_a_hand_that_reaches_no_steep_tilt_still_turns_enough_for_the_hand_eye() -> None:
    """Near the end of the arm's reach it can tilt by 25 degrees at most: a tour of small tilts only would fail."""
    world_from_board = frames.rigid(np.diag([1.0, -1.0, -1.0]), np.array([480.0, 40.0, -296.0]))
    looks = viewpoints_around(world_from_board, np.array([64.0, 40.0, 0.0]), np.array([0.0, 1.0, 0.0]))
    chosen = choose_spread(looks, 15, lambda look: look[2, 2] < -np.cos(np.radians(25.0)), looks[0])
    assert diversity_deg(chosen) > 1.5 * MIN_TURN_DEG


def test_poses_that_are_not_allowed_are_left_out_and_the_others_are_chosen_once() -> None:
    world_from_board = frames.rigid(np.diag([1.0, -1.0, -1.0]), np.zeros(3))
    looks = viewpoints_around(world_from_board, np.zeros(3), np.array([0.0, 1.0, 0.0]))
    chosen = choose_spread(looks, 12, lambda pose: pose[0, 3] > 0, looks[0])
    assert len(chosen) == 12
    assert all(pose[0, 3] > 0 for pose in chosen)
    ordered = shortest_order(chosen, looks[0])
    assert {id(p) for p in ordered} == {id(p) for p in chosen}


def test_a_tour_that_begins_on_a_moving_arm_takes_no_view() -> None:
    world = World(np.random.default_rng(0))
    supervisor = Supervisor(build(world), Limits(), Arrival(), lambda _: None)
    supervisor.enable()

    async def moving() -> None:
        raise OSError("not at rest within 5 s")

    supervisor.mover.cell.robot.wait_until_at_rest = moving
    session: Any = SimpleNamespace(
        supervisor=supervisor,
        prepare_to_move=supervisor.mover.wait_until_at_rest,
        calibration=SimpleNamespace(hand_eye=np.eye(4)),
        board_in_gripper=False,
    )
    with pytest.raises(OSError, match="not at rest"):
        asyncio.run(view_tour(session, 0, AsyncMock(), 60.0))
    assert not world.said("look")


@pytest.mark.parametrize("count", [0, 8])
def test_while_dry_is_on_no_view_is_taken_for_one_from_where_the_arm_would_be(count: int) -> None:
    """Each of its poses showed the same picture; what was made of them was kept as a calibration."""
    world = World(np.random.default_rng(0))
    supervisor = Supervisor(build(world), Limits(), Arrival(), lambda _: None)
    supervisor.enable()
    supervisor.dry(True)
    session: Any = SimpleNamespace(supervisor=supervisor, calibration=SimpleNamespace(hand_eye=np.eye(4)))
    with pytest.raises(RefusedError, match="dry"):
        asyncio.run(view_tour(session, count, AsyncMock(), 50.0))
