"""Picks with one camera beside picks with two, and camera faults in mid-auto.

`python -m tests.bench.long.one_camera [PICKS [FAULTS]]`, in the simulated cell with the hand-eye and arm errors of
etc/simcell.yaml. The same part lies in the same place for two cameras, the left and the right alone, one after the
other. Seconds are the cell's (arm and frames) and, added, the processor's for all else. A fault comes at any moment of
an auto over two parts; then `resume` is said as a person would.
"""

from __future__ import annotations

import asyncio
import sys
import time
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from daemon.arm import CameraName
from daemon.commands.moving import resume
from daemon.events.outcomes import Outcome
from daemon.vision.model.model import Model
from drivers.simcell.parts import TAUGHT
from tests.fakes import simulated_cell
from tests.fakes.fake_context import FakeFrontend
from tests.fakes.in_time import lived
from tests.fakes.simulated_hours import Hours, cell_in_time

PICKS, FAULTS = 40, 40
WAYS: tuple[CameraName | None, ...] = (None, "left", "right")
AILMENTS = ("away", "black", "frozen", "half")
LONGEST_S = 600.0


@dataclass
class Tally:
    """What picks with some cameras came to."""

    outcomes: list[str] = field(default_factory=list)
    errors: list[tuple[float, float]] = field(default_factory=list)
    predicted_mm: list[float] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)
    looks: list[int] = field(default_factory=list)

    def row(self) -> str:
        """One line of the table."""
        picked = self.outcomes.count("picked")
        mm, deg = np.median(self.errors, axis=0)
        worst = np.percentile([e for e, _ in self.errors], 95)
        ratio = np.median([e / p for (e, _), p in zip(self.errors, self.predicted_mm, strict=True)])
        return (
            f"{picked:4d} of {len(self.outcomes):4d}  {mm:6.2f} {worst:6.2f} {deg:6.2f}  {ratio:6.2f}  "
            f"{np.median(self.seconds):6.1f} {np.mean(self.looks):5.1f}"
        )


async def pick(seed: int, label: str, alone: CameraName | None, model: Model, tally: Tally) -> None:
    async with cell_in_time(seed, model, alone) as here:
        simulated_cell.lay(here, label, np.random.default_rng(seed))
        began_s, spent_s = here.now_s, time.thread_time()
        end = await here.cycle.pick()
        tally.seconds.append(here.now_s - began_s + time.thread_time() - spent_s)
        tally.looks.append(len(here.log.said("look")))
        tally.outcomes.append(end.outcome)
        if end.outcome == Outcome.PICKED and end.predicted_mm is not None:
            tally.errors.append(here.grasp_error(end))
            tally.predicted_mm.append(end.predicted_mm)
        else:
            print(f"  seed {seed}, {label}, {alone or 'both'}: {end.outcome}: {end.why}", flush=True)


@dataclass
class Person(FakeFrontend):
    """Answers what `resume` asks: whether a part is in the gripper as it is, all else with yes."""

    here: Hours | None = None

    @property
    def asks(self) -> bool:
        """A person sits there."""
        return True

    async def ask(self, question: str) -> str:
        """See the class."""
        assert self.here is not None
        self.asked.append(question)
        return ("y" if self.here.cell.world.held else "n") if "gripper" in question else "y"


async def broken(seed: int, model: Model) -> dict[str, Any]:
    """An auto over two parts in which one camera fails at some moment; how it went on."""
    rng = np.random.default_rng(seed)
    camera, how = str(rng.choice(["left", "right"])), str(rng.choice(AILMENTS))
    async with cell_in_time(seed, model) as here:
        labels = [str(label) for label in rng.choice(TAUGHT, 2, replace=False)]
        here.cell.scatter(labels, rng)
        await here.context.begin_auto()
        wait_s = float(rng.uniform(0.5, 14.0))
        await asyncio.sleep(wait_s)
        here.cell.camera.cover(camera) if how == "black" else here.cell.camera.set_fault(camera, how)  # type: ignore[arg-type]
        ends = await asyncio.wait_for(here.context.auto_ends(), LONGEST_S)
        fault = here.cycle.supervisor.fault_text
        moves = [r["kind"] for r in here.log.records]
        after = moves[len(moves) - 1 - moves[::-1].index("fault") :] if "fault" in moves else []
        early = sum(kind in ("move", "hand") for kind in after)
        before = here.cell.world_from_tool()
        await asyncio.sleep(5.0)
        still = np.abs(here.cell.world_from_tool() - before).max() < 0.2
        frontend = Person(here=here)
        said = await resume.run(here.context, [], frontend) if fault else None
        if fault:
            ends += await asyncio.wait_for(here.context.auto_ends(), LONGEST_S)
            if here.cycle.supervisor.fault_text is None and here.cycle.pick_order is None:
                ends += await here.cycle.auto()  # what was skipped in passing
        lie = [here.lies(label) for label in labels]
        return {
            "eye": camera, "how": how, "at_s": wait_s, "fault": fault, "moved_before_allowed": early + (not still),
            "went_on_with": here.context.hardware.cameras.alone, "lie": lie,
            "after": here.cycle.supervisor.fault_text, "said": said and said.text,
            "ends": [e.outcome for e in ends],
        }  # fmt: skip


async def teach() -> Model:
    async with cell_in_time(100) as here:
        return await simulated_cell.taught(here)


def table(tallies: dict[CameraName | None, Tally]) -> None:
    """What the picks have come to so far."""
    print("eyes   picked        mm   95 %   deg  of predicted  s  looks   (medians, but for the looks)")
    for alone, tally in tallies.items():
        print(f"{alone or 'both':5s}  {tally.row()}", flush=True)
    both = np.median(tallies[None].seconds)
    for camera, tally in tallies.items():
        if camera is not None:
            print(f"{camera} alone takes {np.median(tally.seconds) / both:.2f} times as long as both", flush=True)


def main(picks: int = PICKS, faults: int = FAULTS) -> None:
    """Measure and print; the table of picks after each twenty."""
    model = lived(teach())
    tallies = {alone: Tally() for alone in WAYS}
    for k in range(picks):
        for alone in WAYS:
            lived(pick(1000 + k, TAUGHT[k % len(TAUGHT)], alone, model, tallies[alone]))
        if (k + 1) % 20 == 0 or k + 1 == picks:
            table(tallies)
    told = []
    for k in range(faults):
        told.append(lived(broken(2000 + k, model)))
        one = told[-1]
        binned = sum(place in ("bin", "nowhere") for place in one["lie"])
        print(f"  {one['eye']} {one['how']} at {one['at_s']:.1f} s: {'fault' if one['fault'] else 'no fault'}, "
              f"went on with {one['went_on_with'] or 'both'}, {binned} of 2 in the bin"
              + (f" {one}" if binned < 2 or one["moved_before_allowed"] else ""), flush=True)  # fmt: skip
    if faults:
        print(f"{faults} camera faults: {sum(bool(t['fault']) for t in told)} stopped the arm, "
              f"{sum(t['moved_before_allowed'] for t in told)} moves before it was allowed, "
              f"{sum(t['after'] is None for t in told)} went on to the end, "
              f"{sum(place in ('floor', 'hand') for t in told for place in t['lie'])} parts lost, "
              f"{sum(place == 'bin' for t in told for place in t['lie'])} of {2 * faults} in the bin")  # fmt: skip


if __name__ == "__main__":
    main(*(int(word) for word in sys.argv[1:]))
