"""Parts that are to lie on another side at their place, in the simulated cell, held against its own truth; and which
pairs of sides a search by brute force finds a way between. For tests and the bench of regrasps."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from daemon.pick.outcome import CycleEnd
from daemon.pick.plan import stable_sides
from daemon.store.place_file import Manner, Place
from daemon.store.place_status import PlaceState
from daemon.vision.model import Model, learn_solid
from drivers.simcell.parts import TAUGHT
from tests.bench import machined
from tests.fakes.machined import shown_shape
from tests.fakes.set_downs import drawn_model, places_of, true_error
from tests.fakes.simulated_cell import rig

MACHINED = ("bracket", "clevis", "gusset", "lever", "t_nut", "v_block")
PARTS = (*TAUGHT, *MACHINED)
AT = (430.0, -220.0, -300.0)


@cache
def model() -> Model:
    """The demo's parts and six machined ones, each taught from its drawing."""
    taught = drawn_model()
    for label in MACHINED:
        taught = learn_solid(taught, machined.drawings()[label].solid, label)
    return taught


@dataclass(frozen=True, eq=False)
class TurnedOver:
    """One part brought to a place on another side: how the pick ended, how often it was laid down, what is so."""

    label: str
    side: int
    end: CycleEnd
    laid: int
    grasps: int | None
    state: PlaceState
    where: str
    error_mm: float
    error_deg: float
    told: tuple[str, ...] = ()


async def turned_over(label: str, rest: int, side: int, seed: int) -> TurnedOver:
    """A part that lies alone on one of its stable faces (numbered by the simulation), to a place on a side (from 0)."""
    rng = np.random.default_rng(seed)
    with tempfile.TemporaryDirectory() as folder:
        async with rig(seed=seed, model=model()) as here:
            if label in MACHINED:
                here.cell.world.draw([shown_shape(label, machined.drawings()[label])])
            here.cell.clear()
            x, y, turn = rng.uniform(480.0, 560.0), rng.uniform(-60.0, 60.0), rng.uniform(-np.pi, np.pi)
            here.cell.world.stand(label, rest, float(x), float(y), float(turn))
            place = Place("nest", Manner(part=label), np.eye(4), None, side + 1, AT, float(rng.uniform(-180.0, 180.0)))
            table = places_of(here, Path(folder), (place,))
            end = await here.cycle.pick()
            part = next((p for p in here.cell.world.parts if p.label == label), None)
            error = (np.nan, np.nan) if part is None else true_error(table.goals["nest"], part)
            laid = [record for record in here.log.said("laid_down") if record["status"] == "set"]
            chosen = [r.get("grasps") for r in here.log.said("decision") if r["code"] == "chosen"]
            where = "nowhere" if part is None else part.where.value
            planned = chosen[0] if chosen else None
            told = tuple(f"{record['text']}: {record['why']}" for record in here.log.said("decision"))
            return TurnedOver(label, side, end, len(laid), planned, table.statuses.of("nest"), where, *error, told)


def sides_of(label: str) -> list[int]:
    """The sides, from 0, that a part can lie on."""
    return stable_sides(model().metric[label].solid)
