"""Causes planted in the simulated cell, one a run, and which cause the review page names first; a table.

usage: python -m tests.bench.long.causes [--only WORD] [--runs DIR] [--seed N]

DIR: keep the run folders, to be looked at. N: where the plants' own dice begin; a rule that was made looking at some is
not proven by them.

Each run lays a part, harms the cell or its calibration once and picks. The run is written by the run log itself and
read by the review's own reader: what is judged is the first cause of the harmed cycle. Exit 1 where fewer than nine in
ten are right.
"""

from __future__ import annotations

import argparse
import asyncio
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from daemon import frames
from daemon.calibration.file import Calibration, load_calibration
from daemon.config import load_config
from daemon.review.failure_causes import causes, run_context
from daemon.review.page import read_digest, write_page
from daemon.store.runlog import RunLog
from tests.bench.long.faults import FAULTS, on_state
from tests.fakes import simulated_cell
from tests.fakes.simulated_cell import CONFIG, Rig

LONGEST_S = 180.0
"""A pick that has not ended by then never will."""
KNOCK_RAD = 0.03
Act = Callable[[Rig], None]
Truth = dict[str, Any]


@dataclass(frozen=True)
class Plant:
    """What is planted: the name the page should give it; when (a state of the pick; None: before it begins) and what is
    done to the cell; truth: how the cell is made otherwise; knock: the hand-eye as the daemon does not know it."""

    name: str
    moment: str | None = None
    act: Act = lambda here: None
    truth: Callable[[Truth], None] = lambda truth: None
    knock_mm: float = 0.0
    label: str = "cube"
    others: tuple[str, ...] = ()


def _abort(here: Rig) -> None:
    here.later = asyncio.get_running_loop().create_task(here.cycle.supervisor.abort())  # type: ignore[attr-defined]


def _refuse(here: Rig) -> None:
    supervisor = here.cycle.supervisor
    supervisor.hold.step(True)

    async def no() -> None:
        while supervisor.status()["pending"] is None:
            await asyncio.sleep(0.01)
        supervisor.hold.refuse()

    here.later = asyncio.get_running_loop().create_task(no())  # type: ignore[attr-defined]


def _knock_hard(here: Rig) -> None:
    here.cell.camera.displace("right", (3.0, 1.0, 0.0))


def _far(here: Rig) -> None:
    for part in here.cell.world.parts:
        here.cell.world.nudge(part.name, 230.0, 0.0)


def _knock_left(here: Rig) -> None:
    here.cell.camera.displace("left", (0.5, 0.3, 0.0))


def _cover_right(here: Rig) -> None:
    here.cell.camera.cover("right")


def _noise(here: Rig) -> None:
    here.cell.controller.faults.seed_noise(1, 0.5)


def _mute(here: Rig) -> None:
    here.cell.controller.faults.mute_answers = 1000


def _disable(here: Rig) -> None:
    here.later = asyncio.get_running_loop().create_task(here.cycle.supervisor.disable())  # type: ignore[attr-defined]


def _dark(factor: float) -> Callable[[Truth], None]:
    def change(truth: Truth) -> None:
        light = truth["lighting"]
        light["ambient"] *= factor
        for lamp in light["lamps"]:
            lamp["level"] *= factor

    return change


def _sensor(**values: float) -> Callable[[Truth], None]:
    return lambda truth: truth["sensor"].update(values)


def _gripper(**values: float) -> Callable[[Truth], None]:
    return lambda truth: truth["gripper"].update(values)


def _arm(joint: int, degrees: float) -> Callable[[Truth], None]:
    def change(truth: Truth) -> None:
        truth["arm"]["joint_offset_deg"][joint] += degrees

    return change


PLANTS: dict[str, Plant] = {
    "operator's stop": Plant("operator's stop", "stop_n", FAULTS["operator's stop"]),
    "operator's stop at the grasp": Plant("operator's stop", "closing", FAULTS["operator's stop"]),
    "operator's abort": Plant("operator's abort", "stop_n", _abort),
    "a no in step mode": Plant("operator refused a move", "stop_n", _refuse),
    "emergency stop": Plant("emergency stop", "stop_n", FAULTS["emergency stop"]),
    "arm power lost": Plant("arm power", "final", FAULTS["arm power lost"]),
    "envelope error": Plant("envelope error", "stop_n", FAULTS["envelope error"]),
    "controller power cycled": Plant("controller restarted", "stop_n", FAULTS["controller power cycled"]),
    "controller dead": Plant("controller silent", "stop_n", FAULTS["controller dead"]),
    "location refused": Plant("out of the arm's reach", "stop_n", FAULTS["location refused"]),
    "camera cable torn": Plant("camera not connected", "looking", FAULTS["cameras unplugged"]),
    "left lens covered": Plant("lens covered", "looking", FAULTS["left lens covered"]),
    "part carried off": Plant("part moved", "choose", _far),
    "right camera knocked": Plant("camera knocked", "looking", FAULTS["right camera knocked"]),
    "right camera knocked hard": Plant("camera knocked", "looking", _knock_hard),
    "hand-eye knocked": Plant("hand-eye calibration off", knock_mm=12.0, others=("pyramid", "triangular_prism")),
    "hand-eye knocked a little": Plant(
        "hand-eye calibration off", knock_mm=6.0, others=("pyramid", "triangular_prism")
    ),
    "arm drifted": Plant("hand-eye calibration off", truth=_arm(4, 3.0), others=("pyramid", "triangular_prism")),
    "part taken away": Plant("part moved", "looking", FAULTS["part taken away"]),
    "part slippery": Plant("part slipped", truth=_gripper(friction=0.02), label="pyramid"),
    "gripper opens too little": Plant("gripper does not open or close", truth=_gripper(opening_mm=40.0)),
    "out of focus": Plant("lens out of focus or dirty", truth=_sensor(blur_px=4.5)),
    "light off": Plant("light off", truth=_dark(0.02)),
    "wrong part": Plant("not taught", label="l_block"),
    "noise, more than it can be typed through": Plant("noise on the line", "stop_n", _noise),
    "controller heard and never answering": Plant("controller silent", "final", _mute),
    "disabled in mid-approach": Plant("operator's abort", "stop_n", _disable),
    "right lens covered": Plant("lens covered", "stop_n", _cover_right),
    "left camera knocked": Plant("camera knocked", "looking", _knock_left),
    "left camera frozen": Plant("camera frozen", "looking", lambda here: here.cell.camera.set_fault("left", "frozen")),
    "half frames on the right": Plant("half a frame", "looking", lambda it: it.cell.camera.set_fault("right", "half")),
}  # fmt: skip


def _truth_file(folder: Path, change: Callable[[Truth], None]) -> Path:
    config = load_config(CONFIG, simulated=True)
    content = yaml.safe_load(config.file(config.values.simulated.truth).read_text())
    change(content)
    path = folder / "simcell.yaml"
    path.write_text(yaml.safe_dump(content))
    return path


def _knocked(mm: float) -> Calibration | None:
    if not mm:
        return None
    believed = load_calibration(load_config(CONFIG, simulated=True).calibration)
    assert believed.tool_from_cyclopean is not None
    sine, cosine = np.sin(KNOCK_RAD), np.cos(KNOCK_RAD)
    turn = np.array([[1.0, 0.0, 0.0], [0.0, cosine, -sine], [0.0, sine, cosine]])
    knock = frames.rigid(turn, np.array([mm, 0.0, 0.0]))
    return replace(believed, tool_from_cyclopean=believed.tool_from_cyclopean @ knock)


def _kept(here: Rig, run: RunLog) -> None:
    """What the cycle logs goes into a run folder as well."""
    record = here.log.record

    def both(kind: str, /, **fields: Any) -> None:
        run.record(kind, **fields)
        record(kind, **fields)

    here.cycle.cell.log.record = both


async def planted(model: Any, plant: Plant, seed: int, folder: Path) -> None:
    """One run with one cause in it."""
    truth = _truth_file(folder.parent, plant.truth)
    rng = np.random.default_rng(seed)
    async with simulated_cell.rig(seed, model, time_scale=40.0, believed=_knocked(plant.knock_mm), truth=truth) as here:
        here.cell.scatter([plant.label, *plant.others], rng)
        run = RunLog(folder, clock=here.cycle.cell.clock)
        run.record("run_start", version="bench", cell="simulated", seed=seed)
        _kept(here, run)
        if plant.moment is None:
            plant.act(here)
        else:
            on_state(here, plant.moment, lambda: plant.act(here))
        try:
            await asyncio.wait_for(here.cycle.pick(), LONGEST_S)
        finally:
            if hasattr(here, "later"):
                await asyncio.gather(here.later, return_exceptions=True)
            run.close()


async def _taught() -> Any:
    async with simulated_cell.rig(seed=100) as here:
        return await simulated_cell.taught(here)


def main() -> int:
    """Plant, pick, ask the page, print."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--only", default="", help="plants with this word in their name")
    parser.add_argument("--runs", type=Path, help="keep the runs here")
    parser.add_argument("--seed", type=int, default=500, help="the first plant's dice; each further plant has the next")
    args = parser.parse_args()
    chosen = [(k, name, plant) for k, (name, plant) in enumerate(PLANTS.items()) if args.only in name]
    model = asyncio.run(_taught())
    right = 0
    with tempfile.TemporaryDirectory() as scratch:
        for k, name, plant in chosen:
            folder = (args.runs or Path(scratch)) / f"20260101T{k:06d}Z"
            folder.parent.mkdir(parents=True, exist_ok=True)
            try:
                asyncio.run(planted(model, plant, args.seed + k, folder))
            except Exception as error:  # such as the motion monitor's word on an arm that is not where its joints say
                print(f"    {name}: {type(error).__name__} {str(error)[:100]}", flush=True)
            cycles = read_digest(folder).cycles
            cycle, found = cycles[0], causes(cycles[0], run_context(cycles))
            first = found[0] if found else None
            good = first is not None and first.code.summary == plant.name
            right += good
            said = "-" if first is None else first.code.summary
            print(f"{'ok  ' if good else 'BAD '} {name:30} {cycle.outcome:11} {said}", flush=True)
            if args.runs:
                write_page(folder, folder / "report.html")
    print(f"{right} of {len(chosen)} right")
    return 0 if right >= 0.9 * len(chosen) else 1


if __name__ == "__main__":
    sys.exit(main())
