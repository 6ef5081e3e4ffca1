"""The simulated cell with a suction cup: parts from drawings, the vacuum switch read as a cell's controller is."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from daemon.pick.outcome import CycleEnd
from daemon.signals.input_form import InputForm
from daemon.signals.line import LineSignals
from daemon.signals.settings import SignalSettings
from daemon.store import folders
from daemon.store.library import load_facets
from daemon.teaching.solid_from_mesh import Drawing
from daemon.vision.model.model import Model, empty_model, learn_solid
from drivers.simcell.parts import PartShape
from tests.fakes.machined import drawing, shown_shape
from tests.fakes.simulated_cell import Rig, rig

CONFIG = folders.HOUSE / "etc" / "suction" / "facetd.yaml"
SWITCH = {"vacuum": SignalSettings(number=1011, role="part_held")}


@dataclass(frozen=True, eq=False)
class Drawn:
    """A part by its drawing, and as the cell shows it."""

    label: str
    drawing: Drawing
    shape: PartShape


def bracket() -> Drawn:
    """The machined bracket of etc/."""
    made = drawing("machined_bracket.obj", (folders.HOUSE / "etc" / "machined_bracket.obj").read_bytes())
    return Drawn("bracket", made, shown_shape("bracket", made))


def model_of(parts: Sequence[Drawn]) -> Model:
    """These parts, each taught from its drawing."""
    model = empty_model(load_facets())
    for part in parts:
        model = learn_solid(model, part.drawing.solid, part.label)
    return model


@contextlib.asynccontextmanager
async def suction_rig(
    seed: int, parts: Sequence[Drawn], truth: Path | None = None, sensor: bool = True, time_scale: float = 20.0
) -> AsyncIterator[Rig]:
    """A cell whose cup may pick these parts; sensor: whether its vacuum switch is wired. The motion monitor must have
    found nothing at the end."""
    async with rig(seed, model_of(parts), file=CONFIG, truth=truth, time_scale=time_scale) as here:
        here.cell.world.draw([part.shape for part in parts])
        if sensor:
            form = InputForm("LISTR SIG({number})", "0", "-1")
            cycle, log = here.cycle, here.log
            cycle.line = LineSignals(SWITCH, here.robot, form, cycle.cell.clock, log.record)
        yield here


def picked(seed: int, part: Drawn, switch: str = "works") -> tuple[CycleEnd, str, Rig]:
    """One part, laid at random, picked by suction: how it ended, where the part is, and the cell as it was."""

    async def story() -> tuple[CycleEnd, str, Rig]:
        async with suction_rig(seed, [part]) as here:
            here.cell.switch = switch
            here.cell.scatter([part.label], np.random.default_rng(seed))
            end = await here.cycle.pick()
            return end, here.lies(part.label), here

    return asyncio.run(story())
