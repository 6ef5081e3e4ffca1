"""`facetctl demo`: teach, train and clear a table on the simulated cell, with the service's own parts throughout.

Only what a demo adds is here: setting the scene, telling what happens, and asking the simulated cell afterwards how far
each grasp truly was from what was estimated. The daemon's parts are never told.
"""

from __future__ import annotations

import argparse
import asyncio
import random
import sys
import time
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from daemon import frames
from daemon.store import places

TRIANGLE = "isosceles_triangle"
VIEWS = (
    ("cube", 0, ("square", "square", "square")),
    ("pyramid", 0, (TRIANGLE, TRIANGLE, TRIANGLE, TRIANGLE)),
    ("pyramid", 1, (TRIANGLE, TRIANGLE, "square")),
    ("triangular_prism", 0, ("equilateral_triangle", "rectangle", "rectangle")),
    ("pentagonal_prism", 0, ("pentagon", "rectangle", "rectangle")),
    ("pentagonal_prism", 1, ("rectangle", "rectangle", "rectangle")),
)
"""The six characteristic views (D'Souza, chapter 5), and what a person sees in each: the answer to `is this right?`."""
TEACHING_TRIES = 6
"""How often a person holds the part up again before giving up on a view."""
PARTS = tuple(dict.fromkeys(label for label, _, _ in VIEWS))
ROUNDS = 3
"""How often the table is gone over before what is left is given up."""


@dataclass(frozen=True)
class Taken:
    """One pick as the demo tells it; errors are what the grasp truly was off, nan where it is not known."""

    label: str
    outcome: str
    looks: int
    predicted_mm: float
    predicted_deg: float
    error_mm: float
    error_deg: float
    held: bool
    seconds: float
    why: str


def register(subparsers: Any) -> None:
    """Add `demo` to facetctl."""
    parser = subparsers.add_parser("demo", help="simulated cell: teach, train, pick every part, write the report")
    parser.add_argument("--seed", type=int, help="repeat an earlier demo (each prints its seed)")
    parser.add_argument("--time-scale", type=float, default=20.0, help="how much faster than life the cell runs (20)")
    parser.add_argument("--runs", type=Path, help="where the run is written (as the daemon does)")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Run it; 0 only when every part was picked, 2 where the installation cannot be used."""
    from daemon.cell.build import EXPECTED_ERRORS
    from daemon.config import ConfigError
    from daemon.store.files import plain

    seed = args.seed if args.seed is not None else random.SystemRandom().randrange(1_000_000)
    try:
        return asyncio.run(_demo(seed, args.time_scale, args.runs or places.runs_folder(simulated=True)))
    except (ConfigError, OSError, *EXPECTED_ERRORS) as error:  # type: ignore[misc]
        print(f"facetctl demo: {plain(error)}", file=sys.stderr)
        return 2


class Teller:
    """The run log, told on the screen as it is written. After each closing of the hand it asks the cell's witness."""

    def __init__(self, log: Any, simulated: Any) -> None:
        self.log, self.simulated = log, simulated
        self.cycle: Any = None
        self.taken: list[Taken] = []

    def record(self, kind: str, /, **fields: Any) -> None:
        """Write the record; say what a bystander wants to know of it."""
        self.log.record(kind, **fields)
        if kind == "decision":
            say(f"  {fields['text']}: {fields['why']}")
        elif kind == "estimate":
            error = f"{fields['predicted_mm']:.2f} mm, {fields['predicted_deg']:.2f} degrees"
            say(f"  look {fields['stop']}: {fields['label']}, predicted error at the grasp {error}")
        elif kind in ("refusal", "fault"):
            say(f"  {kind}: {fields['text']}")
        elif kind == "cycle_end":
            self._ended()

    def _ended(self) -> None:
        end = self.cycle.ends[-1]
        truth = self._truth(end)
        if truth is not None:
            error_mm, error_deg, held = truth
            self.log.record("truth", cycle=end.cycle, error_mm=error_mm, error_deg=error_deg, held=held)
            predicted = end.predicted_mm or float("nan"), end.predicted_deg or float("nan")
            self.taken.append(
                Taken(end.label, end.outcome, end.stops, *predicted, error_mm, error_deg, held, end.seconds, end.why)
            )
        say(f"  {end.outcome}: {end.why} ({end.seconds:.1f} s)")

    def _truth(self, end: Any) -> tuple[float, float, bool] | None:
        """(mm, degrees, held): where the part truly was in the closing hand against where it was expected."""
        if end.outcome not in ("picked", "missed", "fault") or end.grasp is None or end.corners is None:
            return None
        try:
            expected = frames.apply(frames.inverse(end.grasp), end.corners)
            error_mm, error_deg = self.simulated.truth.grasp_pose_error(expected)
        except ValueError:
            return float("nan"), float("nan"), False
        return error_mm, error_deg, self.simulated.truth.grasps[-1].held


def say(text: str) -> None:
    """A line on the screen, at once."""
    print(text, flush=True)


async def _demo(seed: int, time_scale: float, runs: Path) -> int:
    from daemon.calibration.file import load_calibration
    from daemon.cell import build as cells
    from daemon.cell.no_arm import CellError
    from daemon.cell.pick_cell import pick_cell
    from daemon.config import load_config
    from daemon.pick.cycle import Cycle
    from daemon.store.library import load_facets, load_parts
    from daemon.store.model_store import ModelStore
    from daemon.store.runlog import RunLog
    from daemon.store.runs import new_folder
    from daemon.teaching.trainer import Trainer

    began = time.monotonic()
    own = places.HOUSE / "etc" / "facetd.yaml"
    config = load_config(own if own.exists() else places.config_file(), simulated=True)
    simulated = replace(config.values.simulated, seed=seed, time_scale=time_scale)
    config = replace(config, values=replace(config.values, simulated=simulated))
    calibration = load_calibration(config.calibration)
    if calibration.tool_from_cyclopean is None:
        raise CellError(f"{config.calibration}: no hand_eye in it; `facetctl calibrate hand-eye` first")
    folder = new_folder(runs, datetime.now(UTC))
    log = RunLog(folder)
    say(f"facetctl demo: seed {seed} (repeat it with --seed {seed}), cell time x{time_scale:g}, run {folder}")
    hardware = cells.build(config, log.wire)
    try:
        await hardware.open()
        assert hardware.hand is not None
        in_cell = hardware.hand.cell
        teller = Teller(log, in_cell)
        kept = {"config": log.keep(config.path), "calibration": log.keep(config.calibration)}
        log.record("run_start", seed=seed, **kept)
        rig = calibration.rig
        cell, settings = pick_cell(config, calibration, hardware, teller)
        settings = replace(settings, stops=replace(settings.stops, least_looks=3))
        library = load_facets(config.file(config.values.files.facets))
        parts = load_parts(config.file(config.values.files.parts))
        trainer = Trainer(ModelStore(folder / "taught"), rig, library, parts, config.values.vision)
        cycle = teller.cycle = Cycle(cell, settings, trainer.in_use)
        try:
            await _teach(cycle, trainer, in_cell, log)
            await _clear(cycle, in_cell, teller)
        finally:
            await cycle.close()
    finally:
        await hardware.close()
        log.close("the demo ended")
    picked = _table(teller.taken, time.monotonic() - began)
    _report(folder)
    return 0 if picked == len(PARTS) else 1


async def _teach(cycle: Any, trainer: Any, simulated: Any, log: Any) -> None:
    """Show the six views, store each, train, and take the model into use."""
    say("teaching")
    cycle.enable()
    await cycle.go("survey")
    for label, view, shown in VIEWS:
        await _teach_view(cycle, trainer, simulated, (label, view, shown))
    trained = trainer.train()
    trainer.accept()
    cycle.use(trainer.in_use)
    kept = log.keep(trainer.model_store.path(trained.version))
    log.record("model", action="accepted", version=trained.version, labels=list(trainer.model.labels), file=kept)
    right_ones = sum(verdict.right for verdict in trained.verdicts)
    say(f"trained on {len(trained.verdicts)} views in {trained.seconds:.1f} s, {right_ones} of them named right")


async def _teach_view(cycle: Any, trainer: Any, simulated: Any, shown: tuple[str, int, tuple[str, ...]]) -> None:
    """One view, looked at again until what was seen is what a person sees, as `teach` asks it of an operator.

    Raises CellError when it never is.
    """
    from daemon.cell.no_arm import CellError
    from daemon.teaching.trainer import teaching_note
    from daemon.vision.model.model import TeachError

    label, view, facets = shown
    for _ in range(TEACHING_TRIES):
        simulated.place_for_teaching(label, view)
        look = await cycle.look(f"teach {label}")
        seen = tuple(sorted(f.type for f in max((p.facets for p in look.scene.parts), key=len, default=())))
        if seen != tuple(sorted(facets)):
            say(f"  {label}, view {view + 1}: not all of it was seen ({', '.join(seen) or 'nothing'}); again")
            continue
        left, right = look.pictures.left.pixels, look.pictures.right.pixels
        try:
            trainer.store(label, left, right, teaching_note("demo", "", look.table, look.scene))
        except TeachError as error:
            say(f"  {label}, view {view + 1}: {error}; again")
            continue
        say(f"  {label}, view {view + 1}: {', '.join(seen)}")
        return
    raise CellError(f"the {label} was not seen whole in {TEACHING_TRIES} looks; light, focus and calibration?")


async def _clear(cycle: Any, simulated: Any, teller: Teller) -> None:
    """Scatter the parts and pick until all are in the bin or several rounds left some."""
    simulated.scatter(PARTS)
    say(f"the table: {', '.join(PARTS)}, in random poses")
    for _ in range(ROUNDS):
        left = len(PARTS) - sum(taken.outcome == "picked" for taken in teller.taken)
        if left == 0 or cycle.mover.fault is not None:
            return
        await cycle.auto(count=left)


def _table(taken: list[Taken], seconds: float) -> int:
    """Print part by part; returns how many were picked (and truly held)."""
    say(f"\n{'part':18}{'outcome':9}{'looks':>6}{'predicted':>20}{'true error at grasp':>23}{'time':>8}")
    for one in taken:
        predicted = f"{one.predicted_mm:.2f} mm {one.predicted_deg:.2f} deg"
        error = f"{one.error_mm:.2f} mm {one.error_deg:.2f} deg"
        outcome = one.outcome if one.held or one.outcome != "picked" else "WRONG"
        say(f"{one.label:18}{outcome:9}{one.looks:6}{predicted:>20}{error:>23}{one.seconds:6.1f} s")
    picked = sum(one.outcome == "picked" and one.held for one in taken)
    say(f"{picked} of {len(PARTS)} parts picked, {seconds:.0f} s in all")
    return picked


def _report(folder: Path) -> None:
    try:
        from daemon.review.page import write_page
    except ImportError:
        say(f"run: {folder}")
        return
    say(f"report: {write_page(folder, folder / 'report.html')}")
