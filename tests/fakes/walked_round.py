"""Run `teach LABEL --around` on parts from drawings, in the simulated cell on simulated time."""

from __future__ import annotations

import contextlib
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import numpy as np

from daemon import frames
from daemon.arrays import Array
from daemon.store.library import load_facets
from daemon.store.model_store import ModelStore
from daemon.teaching.trainer import Trainer
from daemon.vision.geometry import Polyhedron, exact
from drivers.simcell.drawn import drawn_shape
from tests.fakes.drawn import prism
from tests.fakes.simulated_hours import Hours, cell_in_time

MIDDLE_MM = (520.0, 0.0)
L_BRACKET = [(0.0, 0.0), (60.0, 0.0), (60.0, 22.0), (25.0, 22.0), (25.0, 55.0), (0.0, 55.0)]
WEDGE = [(0.0, 0.0), (58.0, 0.0), (40.0, 34.0), (0.0, 34.0)]
HEXAGON = [(28 * float(np.cos(a)), 28 * float(np.sin(a))) for a in np.arange(6) * np.pi / 3]
KITE = [(0.0, -30.0), (24.0, 0.0), (0.0, 26.0), (-24.0, 0.0)]
TRAPEZE = [(0.0, 0.0), (62.0, 0.0), (48.0, 38.0), (14.0, 38.0)]
PENTAGON = [(0.0, 0.0), (44.0, 0.0), (52.0, 26.0), (22.0, 46.0), (-8.0, 26.0)]
STEP = [(0.0, 0.0), (56.0, 0.0), (56.0, 18.0), (30.0, 18.0), (30.0, 40.0), (0.0, 40.0)]


def centred(corners: Array, facets: Any) -> Polyhedron:
    """The points relative to their middle."""
    return exact(corners - corners.mean(0), facets)


def chamfered() -> Polyhedron:
    """A block with one long edge cut off, by different amounts on its two sides."""
    return centred(*prism([(0, 0), (60, 0), (60, 24), (42, 44), (0, 44)], 36.0))


def frustum() -> Polyhedron:
    """A four-sided pyramid without its top."""
    low = np.array([(-30, -24, 0), (30, -24, 0), (30, 24, 0), (-30, 24, 0)], float)
    high = np.array([(-16, -12, 34), (16, -12, 34), (16, 12, 34), (-16, 12, 34)], float)
    sides = [(k, (k + 1) % 4, 4 + (k + 1) % 4, 4 + k) for k in range(4)]
    return centred(np.vstack([low, high]), [(3, 2, 1, 0), (4, 5, 6, 7), *sides])


DRAWN: dict[str, Polyhedron] = {
    "bracket": centred(*prism(L_BRACKET, 35.0)),
    "wedge": centred(*prism(WEDGE, 40.0)),
    "hexagon": centred(*prism(HEXAGON, 44.0)),
    "kite": centred(*prism(KITE, 48.0)),
    "trapeze": centred(*prism(TRAPEZE, 42.0)),
    "pentagon": centred(*prism(PENTAGON, 38.0)),
    "step": centred(*prism(STEP, 44.0)),
    "brick": centred(*prism([(0, 0), (64, 0), (64, 42), (0, 42)], 28.0)),
    "chamfer": chamfered(),
    "frustum": frustum(),
}
"""Ten parts of six to eight facets; `bracket` and `step` are hollow, and throw shadows on themselves."""


@contextlib.asynccontextmanager
async def drawn_cell(seed: int, folder: Path, alone: Any = None) -> AsyncIterator[Hours]:
    """The cell in simulated time, with all drawn parts and a trainer that keeps what it learns in a folder."""
    async with cell_in_time(seed, alone=alone) as here:
        context = here.context
        library = load_facets(context.config.file(context.config.values.files.facets))
        rig = context.calibration.rig
        context.trainer = Trainer(ModelStore(folder), rig, library, {}, context.config.values.vision)
        here.cell.world.draw([drawn_shape(label, part.corners_mm, part.facets) for label, part in DRAWN.items()])
        here.cell.clear()
        yield here


def lay(here: Hours, label: str, rest: int, turn_rad: float) -> Array:
    """Place one part in the table's middle on one of its stable faces; returns its corners (K, 3), world."""
    here.cell.clear()
    rests = len(here.cell.world.shape(label).rests)
    part = here.cell.world.stand(label, rest % rests, *MIDDLE_MM, turn_rad)
    return frames.apply(part.world_from_part(here.cell.world_from_tool()), DRAWN[label].corners_mm)
