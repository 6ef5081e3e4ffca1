"""Which views are still missing, and from where the arm looks at a board."""

from __future__ import annotations

import numpy as np
import pytest

from daemon import frames
from daemon.calibration.guide import Shown, is_new, missing
from daemon.calibration.hand_eye import LEAST_TURN_DEG, diversity_deg
from daemon.calibration.tour import in_order, looks_at, spread_out

Array = frames.Array


def shown(tilt_x: float = 0.0, tilt_y: float = 0.0, z: float = 300.0, at: tuple[float, float] = (0.5, 0.5)) -> Shown:
    turn = frames.rotation_from_vector(np.radians([tilt_x, tilt_y, 0.0]))
    return Shown(frames.rigid(turn, np.array([0.0, 0, z])), np.array([at]))


def test_nothing_shown_wants_every_kind_of_view() -> None:
    wants = missing([])
    assert sum("tilt the board" in w for w in wants) == 4
    assert sum("of the image" in w for w in wants) == 4
    assert "nearer" in wants[-1]


@pytest.mark.parametrize(
    ("tilt", "side"),
    [((0, -20), "right side"), ((0, 20), "left side"), ((20, 0), "lower side"), ((-20, 0), "upper side")],
)
def test_a_tilt_that_was_shown_is_no_longer_wanted(tilt: tuple[float, float], side: str) -> None:
    view = shown(*tilt)
    farther = view.cyclopean_from_board[:3, :3] @ {
        "right side": [1, 0, 0], "left side": [-1, 0, 0], "lower side": [0, 1, 0], "upper side": [0, -1, 0]
    }[side]  # fmt: skip
    assert farther[2] > 0.3
    assert not any(side in w for w in missing([view]))
    assert sum("tilt the board" in w for w in missing([view])) == 3


def test_all_kinds_shown_want_nothing_more() -> None:
    views = [shown(0, 20), shown(0, -20), shown(20, 0), shown(-20, 0, z=450.0)]
    views += [shown(at=at) for at in ((0.1, 0.1), (0.9, 0.1), (0.1, 0.9), (0.9, 0.9))]
    assert missing(views) == []


def test_the_same_view_again_is_not_new() -> None:
    assert not is_new([shown()], shown(1.0).cyclopean_from_board)
    assert is_new([shown()], shown(20.0).cyclopean_from_board)


def test_a_tour_turns_the_hand_about_two_axes_and_keeps_the_board_in_view() -> None:
    world_from_board = frames.rigid(np.diag([1.0, -1.0, -1.0]), np.array([480.0, 40.0, -296.0]))
    centre = np.array([64.0, 40.0, 0.0])
    looks = looks_at(world_from_board, centre, np.array([0.0, 1.0, 0.0]))
    chosen = spread_out(looks, 20, lambda _: True, looks[0])
    assert len(chosen) == 20
    assert diversity_deg(chosen) > 1.5 * LEAST_TURN_DEG
    for look in chosen:
        np.testing.assert_allclose(look[:3, :3] @ look[:3, :3].T, np.eye(3), atol=1e-9)
        seen = frames.apply(frames.inverse(look), frames.apply(world_from_board, centre))
        assert np.abs(seen[:2]).max() < 40.0
        assert 250.0 < seen[2] < 420.0
        assert look[2, 3] > -296.0 + 150.0


def test_poses_that_are_not_allowed_are_left_out_and_the_others_are_chosen_once() -> None:
    world_from_board = frames.rigid(np.diag([1.0, -1.0, -1.0]), np.zeros(3))
    looks = looks_at(world_from_board, np.zeros(3), np.array([0.0, 1.0, 0.0]))
    chosen = spread_out(looks, 12, lambda pose: pose[0, 3] > 0, looks[0])
    assert len(chosen) == 12
    assert all(pose[0, 3] > 0 for pose in chosen)
    ordered = in_order(chosen, looks[0])
    assert {id(p) for p in ordered} == {id(p) for p in chosen}
