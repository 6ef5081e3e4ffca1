"""`make bench-faults`: faults injected at every moment of a pick on the simulated cell; what happened, as one table.

usage: python -m tests.bench.long.faults [--each N] [--only WORD] [--jobs N]   N picks for each fault and moment (2)

Each run lays one part, starts a pick and harms it once when the cycle enters the moment's state. Then it is judged by
the cell's ground truth and the wire ledger: was the arm at rest after the fault, did any motion leave afterwards, is
what was said of the part true, and does the cell pick on after `resume`. Prints the table and the counts; exit 1 where
a part was lost silently or the arm moved after a fault.
"""

from __future__ import annotations

import argparse
import asyncio
import os
import re
import sys
import time
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from itertools import product
from typing import Any

import numpy as np

from daemon.cli.demo import PARTS
from drivers.simcell.controller import LineFault, Mishap
from tests.fakes import simulated_cell
from tests.fakes.simulated_cell import Rig

MOMENTS = ("survey", "stop_n", "looking", "final", "closing", "retreat", "verify", "bin")
STILL_MM = 0.3
MOTION = re.compile(r"DO (?:MOVE|MOVES|DRAW|READY|OPENI|CLOSEI)\b[^\r\x15]*\r")
"""A line that moves arm or hand, ended: what was typed and cancelled moves nothing."""


@dataclass(frozen=True)
class Judged:
    """One harmed pick: what the cycle said, whether the arm stood still after a fault, whether what was said is true,
    and whether the next pick went well."""

    outcome: str
    at_rest: bool
    sent_after: int
    honest: bool
    recovered: bool
    why: str


def _in_move(mishap: Mishap) -> Callable[[Rig], None]:
    return lambda here: here.cell.controller.faults.in_move.append((0.4, mishap))


def _line(way: str, harm: str, count: int = 1) -> Callable[[Rig], None]:
    return lambda here: here.cell.controller.faults.line.append(LineFault(way, harm, after=7, count=count))  # type: ignore[arg-type]


def _refused(here: Rig) -> None:
    here.cell.controller.faults.refusals.append("*Location out of range*")


def _mute(here: Rig) -> None:
    here.cell.controller.faults.mute_answers += 1


def _slow_prompt(here: Rig) -> None:
    here.cell.controller.faults.split_prompt_s = 0.3


def _unplug(here: Rig) -> None:
    here.cell.camera.unplug()


def _cover(here: Rig) -> None:
    here.cell.camera.cover("left")


def _knock(here: Rig) -> None:
    here.cell.camera.displace("right", (0.5, 0.3, 0.0))


def _push(here: Rig) -> None:
    for part in here.cell.world.parts:
        if part.where.value == "table":
            here.cell.world.nudge(part.name, 12.0, -9.0, 0.1)


def _take_away(here: Rig) -> None:
    for part in here.cell.world.parts:
        if part.where.value == "table":
            here.cell.world.remove(part.name)


def _stop(here: Rig) -> None:
    here.later = asyncio.get_running_loop().create_task(here.cycle.supervisor.stop("by the bench"))  # type: ignore[attr-defined]


FAULTS: dict[str, Callable[[Rig], None]] = {
    "arm power lost": _in_move(Mishap.POWER_LOST),
    "emergency stop": _in_move(Mishap.EMERGENCY_STOP),
    "envelope error": _in_move(Mishap.ENVELOPE_ERROR),
    "controller power cycled": _in_move(Mishap.POWER_CYCLED),
    "controller dead": _in_move(Mishap.DEAD),
    "byte to arm flipped": _line("to_controller", "flip"),
    "byte to arm dropped": _line("to_controller", "drop"),
    "byte from arm doubled": _line("to_host", "double"),
    "bytes from arm flipped": _line("to_host", "flip", 4),
    "location refused": _refused,
    "an answer swallowed": _mute,
    "prompt in two halves": _slow_prompt,
    "cameras unplugged": _unplug,
    "left lens covered": _cover,
    "right camera knocked": _knock,
    "part pushed": _push,
    "part taken away": _take_away,
    "operator's stop": _stop,
}


async def mend(here: Rig) -> None:
    """What a technician does before `resume`: cables, lens caps, arm power, the controller's questions, CAL."""
    faults = here.cell.controller.faults
    faults.in_move.clear()
    faults.line.clear()
    faults.refusals.clear()
    faults.mute_answers, faults.split_prompt_s = 0, 0.0
    here.cell.camera.unplug(False)
    here.cell.camera.cover("left", False)
    here.cell.controller.machine.arm_power = True
    await _stopped(here)
    if here.robot.question:
        await here.robot.power_up(("Y", "Y"))
    if not here.cell.controller.machine.calibrated:
        here.cell.motion_monitor.motion_permitted(here.cell.server.now_s(), True)
        await here.robot.calibrate("Y")


async def _stopped(here: Rig) -> None:
    """A stop that was not confirmed goes on until it is; a dead controller never confirms it."""
    for _ in range(200):
        if not here.cycle.supervisor.permission.stopping:
            return
        await asyncio.sleep(0.05)


def on_state(here: Rig, state: str, act: Callable[[], None]) -> None:
    """Call act once, when the cycle enters the state."""
    record = here.log.record
    done = False

    def listening(kind: str, /, **fields: Any) -> None:
        nonlocal done
        record(kind, **fields)
        if kind == "state" and fields["to"] == state and not done:
            done = True
            act()

    here.cycle.cell.log.record = listening


def mark_faults(here: Rig) -> list[int]:
    """How long the wire ledger was at each fault from now on."""
    record, at = here.cycle.cell.log.record, list[int]()

    def listening(kind: str, /, **fields: Any) -> None:
        record(kind, **fields)
        if kind == "fault":
            at.append(len(here.log.wire))

    here.cycle.cell.log.record = listening
    return at


def motions(here: Rig, since: int) -> int:
    """How many lines that move something went out since that record of the ledger."""
    return len(MOTION.findall("".join(r["bytes"] for r in here.log.wire[since:] if r["way"] == "out")))


async def judged(model: Any, seed: int, fault: str, moment: str) -> Judged:
    """One pick with one fault."""
    rng = np.random.default_rng(seed)
    label = PARTS[seed % len(PARTS)]
    async with simulated_cell.rig(seed, model, time_scale=40.0) as here:
        simulated_cell.lay(here, label, rng)
        on_state(here, moment, lambda: FAULTS[fault](here))
        faults_at = mark_faults(here)
        end = await here.cycle.pick()
        if hasattr(here, "later"):
            await asyncio.gather(here.later, return_exceptions=True)
        before = here.cell.world_from_tool()
        await asyncio.sleep(0.15)
        moved_mm = float(np.linalg.norm((here.cell.world_from_tool() - before)[:3, 3]))
        honest = _honest(end.outcome, here.lies(label), here.cycle.belief.holds_part)
        after = motions(here, faults_at[0]) if faults_at else 0
        recovered = await _goes_on(here, label, rng) if fault not in BROKEN_FOR_GOOD else True
        return Judged(end.outcome, moved_mm < STILL_MM, after, honest, recovered, end.why)


BROKEN_FOR_GOOD = ("controller dead", "right camera knocked")
"""What needs another controller or another calibration; going on is not expected."""


def _honest(outcome: str, lies: str, hand_full: bool | None) -> bool:
    """Whether what was said of the part is so: `picked` only for one in the bin, `empty` only where none lies on the
    table, and never `nothing in the hand` where something is."""
    said = {"picked": lies == "bin", "empty": lies != "table"}.get(outcome, True)
    return said and not (lies == "hand" and hand_full is False)


async def _goes_on(here: Rig, label: str, rng: np.random.Generator) -> bool:
    """Mend, resume, answer for the gripper, pick a fresh part."""
    try:
        await mend(here)
        if here.cycle.supervisor.fault_text is not None:
            here.cycle.supervisor.resume()
        if here.cycle.belief.holds_part is None:
            here.cycle.holding(here.lies(label) == "hand")
        if here.cycle.belief.holds_part:
            await here.cycle.pick()
        simulated_cell.lay(here, "cube", rng)
        return (await here.cycle.pick()).outcome == "picked"
    except Exception as error:
        print(f"    not recovered: {type(error).__name__}: {error}", flush=True)
        return False


async def _taught() -> Any:
    async with simulated_cell.rig(seed=100) as here:
        return await simulated_cell.taught(here)


def _one(model: Any, task: tuple[int, str, str]) -> Judged:
    return asyncio.run(judged(model, *task))


def _all(each: int, only: str, jobs: int) -> dict[tuple[str, str], list[Judged]]:
    model = asyncio.run(_taught())
    tasks = [
        (1000 + 10 * number + k, fault, moment)
        for number, (fault, moment) in enumerate(product(FAULTS, MOMENTS))
        for k in range(each if only in fault else 0)
    ]
    found: dict[tuple[str, str], list[Judged]] = {}
    with ProcessPoolExecutor(jobs) as pool:
        for (seed, fault, moment), one in zip(tasks, pool.map(partial(_one, model), tasks), strict=True):
            found.setdefault((fault, moment), []).append(one)
            bad = "" if one.honest and one.at_rest and not one.sent_after else "  <-- WRONG"
            stuck = "" if one.recovered else "  (did not go on)"
            print(f"  {seed} {fault:24} {moment:8} {one.outcome:11} {one.why[:90]}{bad}{stuck}", flush=True)
    return found


def main() -> int:
    """Inject, judge, print."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--each", type=int, default=2)
    parser.add_argument("--only", default="", help="faults with this word in their name")
    parser.add_argument("--jobs", type=int, default=len(os.sched_getaffinity(0)))
    args = parser.parse_args()
    began = time.monotonic()
    found = _all(args.each, args.only, args.jobs)
    every = [one for ones in found.values() for one in ones]
    print(f"\n{'fault':26}{'moment':10}{'outcomes':34}{'at rest':>8}{'moves after':>12}{'true':>6}{'goes on':>9}")
    for (fault, moment), ones in found.items():
        outcomes = ", ".join(f"{n} {what}" for what, n in Counter(o.outcome for o in ones).items())
        rest, true = sum(o.at_rest for o in ones), sum(o.honest for o in ones)
        after, on = sum(o.sent_after for o in ones), sum(o.recovered for o in ones)
        print(
            f"{fault:26}{moment:10}{outcomes:34}{rest:>5}/{len(ones)}{after:>12}{true:>4}/{len(ones)}{on:>7}/{len(ones)}"
        )
    silent, moved = sum(not o.honest for o in every), sum(not o.at_rest or o.sent_after > 0 for o in every)
    on = sum(o.recovered for o in every)
    print(
        f"\n{len(every)} faults injected in {time.monotonic() - began:.0f} s: {silent} parts lost silently, "
        f"{moved} moves after a fault, {on} cells went on once mended (or need new parts)"
    )
    return 1 if silent or moved else 0


if __name__ == "__main__":
    sys.exit(main())
