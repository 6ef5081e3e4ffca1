"""What a simulated cell says of its own truth beside what the daemon saw."""

from __future__ import annotations

import numpy as np
import pytest

from daemon.cell.simulated_operator import SimulatedOperator
from drivers.rigid import rigid, turn
from drivers.simcell.cell import SimulatedCell
from drivers.simcell.drawn import drawn_shape
from drivers.simcell.world import PartPlace
from tests.fakes.drawn import prism
from tests.fakes.simulated_cell import CONFIG


def test_the_true_error_of_a_set_down_is_that_of_the_part_nearest_to_the_place() -> None:
    with SimulatedCell(CONFIG.parent / "simcell.yaml", seed=1) as cell:
        hand = SimulatedOperator(cell)
        corners = cell.world.shape("cube").hull.vertices
        poses = [rigid(turn([0, 0, 1], k * np.pi / 2), [400.0, -200.0, -275.0]) for k in range(4)]
        assert hand.place_error("cube", poses, corners) is None, "no cube is there"
        cell.world.put("cube", rigid(np.eye(3), [500.0, 0.0, -275.0]))
        cell.world.put("cube", rigid(turn([0, 0, 1], np.radians(91.0)), [400.3, -200.4, -275.0]))
        cell.world.put("cube", poses[0], PartPlace.BIN)
        cell.world.put("pyramid", poses[0])
        assert hand.place_error("cube", poses, corners) == pytest.approx((0.5, 1.0), abs=1e-6)


def test_a_body_of_revolution_is_truly_at_its_place_in_any_turn_about_its_axis_and_no_other() -> None:
    """A disc that the look at its place found right was recorded as degrees off."""
    around = np.arange(24) * np.pi / 12
    rim = list(zip(25.0 * np.cos(around), 25.0 * np.sin(around), strict=True))
    disc = drawn_shape("disc", *prism(rim, 10.0))
    with SimulatedCell(CONFIG.parent / "simcell.yaml", seed=1) as cell:
        hand = SimulatedOperator(cell)
        cell.world.draw([disc])
        corners, axis = disc.hull.vertices, np.array([0.0, 0.0, 1.0])
        place = rigid(np.eye(3), [400.0, -200.0, -290.0])
        cell.world.put("disc", place @ rigid(turn(axis, np.radians(3.0)), [0.0, 0.0, 0.0]))
        assert hand.place_error("disc", [place], corners) == pytest.approx((0.0, 3.0), abs=1e-3)
        assert hand.place_error("disc", [place], corners, axis) == pytest.approx((0.0, 0.0), abs=1e-3)
        tilted = place @ rigid(turn([1, 0, 0], np.radians(2.0)), [0.0, 0.0, 0.0])
        assert hand.place_error("disc", [tilted], corners, axis) == pytest.approx((0.0, 2.0), abs=0.05)
