"""A cell for end-to-end tests and benches: the simulated cell behind its pty, with the daemon's own parts on top.

It builds, teaches, and reports the ground truth.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from daemon import frames
from daemon.calibration.file import Calibration, load_calibration
from daemon.cell import build as cells
from daemon.cell.pick_cell import pick_cell
from daemon.cli.demo import VIEWS
from daemon.compute.calls import Compute
from daemon.config import load_config
from daemon.pick.cycle import PickCycle
from daemon.pick.outcome import CycleEnd
from daemon.pick.recogniser import ModelRecogniser
from daemon.pick.settings import Settings
from daemon.store import folders
from daemon.store.library import load_facets
from daemon.store.model import load, save
from daemon.vision.geometry.rig import Camera, StereoRig
from daemon.vision.model.model import Model, TeachError, empty_model, learn_view
from drivers.simcell.cell import SimulatedCell
from drivers.simcell.truth import load_truth
from tests.fakes.checked_record import checked
from tests.fakes.once import made_once

CONFIG = folders.HOUSE / "etc" / "facetd.yaml"
FIXED = folders.HOUSE / "etc" / "fixed" / "facetd.yaml"
"""The cell whose cameras are fixed over the table."""


@dataclass(eq=False)
class ListLog:
    """A run log in memory, without the images."""

    records: list[dict[str, Any]] = field(default_factory=list)
    wire: list[dict[str, Any]] = field(default_factory=list)
    heard: Callable[[str, dict[str, Any]], None] = lambda kind, fields: None

    def record(self, kind: str, /, **fields: Any) -> None:
        """Keep one record."""
        checked(kind, fields)
        fields.pop("images", None)
        self.heard(kind, fields)
        self.records.append({"kind": kind, **fields})

    def said(self, kind: str) -> list[dict[str, Any]]:
        """The records of one kind."""
        return [r for r in self.records if r["kind"] == kind]


@dataclass(eq=False)
class Rig:
    """The cell and the cycle that works in it."""

    cell: SimulatedCell
    cycle: PickCycle
    log: ListLog
    robot: Any

    def grasp_error(self, end: CycleEnd) -> tuple[float, float]:
        """(mm, degrees): the error of the last grasp against the pick's expectation."""
        assert end.grasp is not None
        assert end.corners is not None
        return self.cell.truth.grasp_pose_error(frames.apply(frames.inverse(end.grasp), end.corners))

    def lies(self, label: str) -> str:
        """Where the part with that label is: table, hand, bin, floor, or nowhere."""
        return next((p.where.value for p in self.cell.world.parts if p.label == label), "nowhere")


def true_calibration() -> Calibration:
    """The calibration that matches the truth exactly."""
    config = load_config(CONFIG, simulated=True)
    truth = load_truth(config.file(config.values.simulated.truth))
    cameras = [
        Camera(np.array(e.camera_matrix), np.array(e.distortion), np.array(e.cyclopean_from_camera))
        for e in (truth.left, truth.right)
    ]
    believed = load_calibration(config.calibration)
    width, height = truth.image_size
    rig = StereoRig(cameras[0], cameras[1], (width, height))
    return replace(believed, rig=rig, tool_from_cyclopean=np.array(truth.tool_from_cyclopean))


@contextlib.asynccontextmanager
async def rig(
    seed: int,
    model: Model | None = None,
    time_scale: float = 20.0,
    settings: Settings | None = None,
    believed: Calibration | None = None,
    truth: Path | None = None,
    log: ListLog | None = None,
    compute: Compute = asyncio.to_thread,
    file: Path = CONFIG,
) -> AsyncIterator[Rig]:
    """Build, open, enable; close at the end, where the motion monitor must have found nothing.

    believed: the daemon's calibration (None: its file); log: one that keeps more than its records; compute: a worker
    process, where one is wanted; file: facetd.yaml.
    """
    config = load_config(file, simulated=True)
    simulated = replace(config.values.simulated, seed=seed, time_scale=time_scale)
    if truth is not None:
        simulated = replace(simulated, truth=str(truth))
    config = replace(config, values=replace(config.values, simulated=simulated))
    believed = believed or load_calibration(config.calibration)
    log = log or ListLog()
    hardware = cells.build(config, log.wire.append, record=log.record)
    assert hardware.operator is not None
    try:
        await hardware.open()
        cell, usual = pick_cell(config, believed, hardware, log, compute)
        start = model or empty_model(load_facets(config.file(config.values.files.facets)))
        cycle = PickCycle(cell, settings or usual, ModelRecogniser(start, believed.rig, config.values.vision))
        tell_the_motion_monitor(hardware.operator.cell, cycle, log)
        await cycle.supervisor.test_stop()
        cycle.supervisor.enable()
        try:
            yield Rig(hardware.operator.cell, cycle, log, hardware.robot)
        finally:
            await cycle.supervisor.close()
        found = hardware.operator.cell.violations()
        assert not found, "\n".join(map(str, found))
    finally:
        await hardware.close()


def tell_the_motion_monitor(cell: SimulatedCell, cycle: PickCycle, log: ListLog) -> None:
    """Report to the motion monitor when the arm may move and how fast, from enable, resume and the log."""

    def leave(act: Callable[..., None]) -> Callable[..., None]:
        def given(*asked: object) -> None:
            cell.motion_monitor.motion_permitted(cell.server.now_s(), True)
            act(*asked)

        return given

    def heard(kind: str, fields: dict[str, Any]) -> None:
        if kind == "fault":
            cell.motion_monitor.motion_permitted(cell.server.now_s(), False)
        if kind == "move":
            cell.motion_monitor.limit_speed(cell.server.now_s(), fields["speed_pct"])

    supervisor = cycle.supervisor
    supervisor.enable, supervisor.resume = leave(supervisor.enable), leave(supervisor.resume)
    log.heard = heard


async def taught(here: Rig) -> Model:
    """Show the six characteristic views of the demo and learn them; the cycle uses the model from then on."""
    sight = here.cycle.recogniser
    assert isinstance(sight, ModelRecogniser)
    model = empty_model(sight.model.library)
    await here.cycle.go("survey")
    for label, view, _ in VIEWS:
        model = await _learnt(here, model, label, view)
    here.cell.clear()
    here.cycle.use(ModelRecogniser(model, sight.rig, sight.settings))
    return model


def taught_once(tmp_path_factory: pytest.TempPathFactory) -> Model:
    """The model that `taught` learns in a separate cell, once for all tests of a run."""

    async def teach() -> Model:
        async with rig(seed=100) as here:
            return await taught(here)

    folder = made_once(tmp_path_factory, "taught", lambda folder: save(asyncio.run(teach()), folder / "model.npz"))
    return load(folder / "model.npz")


async def _learnt(here: Rig, model: Model, label: str, view: int) -> Model:
    """The model with one more view, which is shown again, as a person would, if it was not seen whole."""
    tries = 4
    while True:
        here.cell.place_for_teaching(label, view)
        look = await here.cycle.look(f"teach {label}")
        try:
            return learn_view(model, max(look.scene.view.groups, key=lambda g: len(g.facets)), label)
        except TeachError:
            tries -= 1
            if not tries:
                raise


def lay(here: Rig, label: str, rng: np.random.Generator) -> None:
    """One part alone on the table, on a random stable face."""
    here.cell.scatter([label], rng)
