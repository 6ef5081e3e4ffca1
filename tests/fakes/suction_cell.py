"""The simulated cell with a suction cup: parts from drawings, the vacuum switch read as a cell's controller is."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml

from daemon.pick.outcome import CycleEnd
from daemon.signals.input_form import InputForm
from daemon.signals.production_line import ProductionLine
from daemon.signals.settings import SignalSettings
from daemon.store import folders
from daemon.teaching.solid_from_mesh import Drawing
from daemon.vision.model.model import Model
from drivers.simcell.parts import PartShape
from drivers.simcell.truth import Works
from tests.fakes.machined import drawing, shown_shape, taught_from
from tests.fakes.simulated_cell import Rig, rig

CONFIG = folders.HOUSE / "etc" / "suction" / "facetd.yaml"
SWITCH = {"vacuum": SignalSettings(number=1011, role="part_held")}
NO_VALVES: Mapping[str, SignalSettings] = {}
VALVES = {"valve": SignalSettings(number=11, role="vacuum"), "blow": SignalSettings(number=12, role="blow_off")}


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
    return taught_from({part.label: part.drawing for part in parts})


@contextlib.asynccontextmanager
async def suction_rig(
    seed: int,
    parts: Sequence[Drawn],
    truth: Path | None = None,
    sensor: bool = True,
    time_scale: float = 20.0,
    valves: Mapping[str, SignalSettings] = NO_VALVES,
) -> AsyncIterator[Rig]:
    """A cell whose cup may pick these parts; sensor: whether its vacuum switch is wired; valves: outputs that work it.
    The motion monitor must have found nothing at the end."""
    async with rig(seed, model_of(parts), file=CONFIG, truth=truth, time_scale=time_scale) as here:
        here.cell.world.draw([part.shape for part in parts])
        if sensor or valves:
            form = InputForm("LISTR SIG({number})", "0", "-1")
            cycle, log = here.cycle, here.log
            cycle.production_line = ProductionLine(
                {**(SWITCH if sensor else {}), **valves}, here.robot, form, cycle.cell.clock, log.record
            )
        yield here


def with_valves(folder: Path) -> Path:
    """The truth of a cell whose cup outputs 11 and 12 work, written there."""
    truth = yaml.safe_load((CONFIG.parent / "simcell.yaml").read_text())
    truth["suction"] |= {"vacuum_output": 11, "blow_off_output": 12}
    path = folder / "with-valves.yaml"
    path.write_text(yaml.safe_dump(truth))
    return path


def picked(
    seed: int,
    part: Drawn,
    switch: Works = "works",
    valve: Works = "works",
    truth: Path | None = None,
    valves: Mapping[str, SignalSettings] = NO_VALVES,
) -> tuple[CycleEnd, str, Rig]:
    """One part, laid at random, picked by suction: how it ended, where the part is, and the cell as it was. truth,
    valves: of a cup that outputs work."""

    async def story() -> tuple[CycleEnd, str, Rig]:
        async with suction_rig(seed, [part], truth, valves=valves) as here:
            here.cell.switch, here.cell.valve = switch, valve
            here.cell.scatter([part.label], np.random.default_rng(seed))
            end = await here.cycle.pick()
            return end, here.lies(part.label), here

    return asyncio.run(story())
