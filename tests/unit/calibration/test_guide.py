"""Which view of the board is wanted next."""

from __future__ import annotations

import numpy as np
import pytest

from daemon import frames
from daemon.calibration.guide import BoardPose, is_new_view, missing_views


def shown(
    tilt_x: float = 0.0, tilt_y: float = 0.0, z: float = 300.0, at: tuple[float, float] = (0.5, 0.5)
) -> BoardPose:
    turn = frames.rotation_from_vector(np.radians([tilt_x, tilt_y, 0.0]))
    return BoardPose(frames.rigid(turn, np.array([0.0, 0, z])), np.array([at]))


def test_nothing_shown_wants_every_kind_of_view() -> None:
    wants = missing_views([])
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
    assert not any(side in w for w in missing_views([view]))
    assert sum("tilt the board" in w for w in missing_views([view])) == 3


def test_all_kinds_shown_want_nothing_more() -> None:
    views = [shown(0, 20), shown(0, -20), shown(20, 0), shown(-20, 0, z=450.0)]
    views += [shown(at=at) for at in ((0.1, 0.1), (0.9, 0.1), (0.1, 0.9), (0.9, 0.9))]
    assert missing_views(views) == []


def test_the_same_view_again_is_not_new() -> None:
    assert not is_new_view([shown()], shown(1.0).cyclopean_from_board)
    assert is_new_view([shown()], shown(20.0).cyclopean_from_board)
