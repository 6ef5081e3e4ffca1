"""The cycle on a fake cell: picks, skips, retries, stops."""

import asyncio

import numpy as np
import pytest
from cell_fakes import TruthSight, World, build

from daemon.cycle import HANDLERS, NEXT, TABLE, Cycle, RefusedError, printed_table
from daemon.plan import Settings
from daemon.vision.data import Recognition
from drivers.simcell import parts


def cleared(world: World, settings: Settings | None = None, **options):
    cycle = Cycle(build(world), settings or Settings(), TruthSight(world))
    cycle.enable()
    return cycle, asyncio.run(cycle.auto(**options))


def four_parts(seed: int) -> World:
    rng = np.random.default_rng(seed)
    world = World(rng)
    for label, (x, y) in zip(parts.TAUGHT, ((430, -100), (430, 100), (590, -90), (590, 90)), strict=True):
        world.put(label, x, y, rng.uniform(0, 6.28), int(rng.integers(len(parts.part_shape(label).rests))))
    return world


@pytest.mark.parametrize("seed", range(8))
def test_a_table_of_four_parts_is_cleared(seed):
    world = four_parts(seed)
    _, ends = cleared(world)
    assert sorted(world.binned) == sorted(parts.TAUGHT), [(e.outcome, e.why) for e in ends]
    assert [e.outcome for e in ends] == ["picked"] * 4 + ["empty"]
