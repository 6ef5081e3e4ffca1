"""What a look back says of the hand: the fingers met, or a part between them, whatever is printed on it."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from daemon.calibration.file import load_calibration
from daemon.config import load_config
from daemon.pick.following import came_back_empty
from daemon.store import places
from daemon.vision.image import open_eyes
from drivers.simcell.cell import SimulatedCell
from drivers.simcell.rigid import rigid, turn
from drivers.simcell.world import Where

ETC = places.HOUSE / "etc"
CONFIG = load_config(ETC / "facetd.yaml", simulated=True)


def seems_empty(seed: int, holds_cube: bool) -> bool:
    """From over a patterned table, the hand upright; the cube's print is the seed's."""
    believed = load_calibration(CONFIG.calibration)
    with SimulatedCell(ETC / "simcell.yaml", seed=seed, table="patterned", parts="printed") as cell:
        cell.world_from_tool = lambda real_s=None: rigid(turn([1, 0, 0], np.pi), [470.0, 0.0, 0.0])  # type: ignore[method-assign]
        if holds_cube:
            cell.world.scatter(["pyramid"], np.random.default_rng(0))
            cell.world.put("cube", rigid(turn([0, 0, 1], np.pi / 2), [0.0, 0.0, 10.0]), Where.HAND)
        cell.world.gap_mm = 50.0 if holds_cube else 0.0
        cell.camera.open()
        pair = cell.camera.grab(0.0, 1.0)
    eyes = open_eyes(pair.left.pixels, pair.right.pixels, believed.rig)
    workcell = SimpleNamespace(tool_from_cyclopean=believed.tool_from_cyclopean)
    return came_back_empty(eyes, workcell, CONFIG.values.pick.gripper)  # type: ignore[arg-type]


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_fingers_that_met_are_seen_over_any_table(seed: int) -> None:
    assert seems_empty(seed, holds_cube=False)


@pytest.mark.parametrize("seed", [1, 10])
def test_print_on_the_held_part_is_not_taken_for_fingers_that_met(seed: int) -> None:
    """Of the print of seed 10 more than three quarters lies where the met fingers' outline would."""
    assert not seems_empty(seed, holds_cube=True)
