"""Picks by suction in the simulated cell against its own truth: blocks with bores and slots, laid at random, and the
vacuum switch at its word or lying.

usage: python -m tests.bench.long.suction [COUNT [LIES [FIRST]]]
COUNT: picks of parts for which there is a grasp as they lie (20); LIES: picks of such with the switch stuck on, and as
many with it stuck off (4); FIRST: the first seed (2; even seeds are for tuning, and every second one is taken).
"""

from __future__ import annotations

import sys
from collections import Counter

from drivers.simcell.truth import Works
from tests.fakes.holed import holed_pair
from tests.fakes.suction_cell import Drawn, picked

KINDS = ("place", "slot", "radius_20")


def block(seed: int) -> Drawn:
    """One with a hole."""
    made = holed_pair(KINDS[seed // 2 % len(KINDS)], seed)[1]
    return Drawn(made.label, made.drawing, made.shape)


def pick(seed: int, switch: Works = "works") -> tuple[str, str, str]:
    """How a pick ended, where the part is, and why it ended so."""
    try:
        end, lies, here = picked(seed, block(seed), switch)
    except AssertionError as found:  # what the motion monitor says of the run
        return "violation", "", str(found)
    loss = next((c.grip.why for c in here.cell.world.closings if c.grip and not c.grip.held), "")
    return str(end.outcome), lies, f"{end.why}; {loss}" if loss else end.why


def main(count: int, lies: int, first: int) -> None:
    """Print the table."""
    ends: Counter[str] = Counter()
    held: list[int] = []
    seed = first
    while len(held) < count:
        outcome, where, why = pick(seed)
        ends[f"{outcome}, in the {where}" if where else outcome] += 1
        held += [] if outcome == "unreachable" else [seed]
        if (outcome, where) != ("picked", "bin"):
            print(f"seed {seed}: {outcome}, in the {where}: {why}", flush=True)
        seed += 2
    print(f"{ends.total()} parts: {'; '.join(f'{n} {what}' for what, n in ends.most_common())}")
    print(f"picked {ends['picked, in the bin']} of {len(held)} for which there was a grasp")
    for switch in ("stuck on", "stuck off"):
        some = [pick(seed, switch) for seed in held[:lies]]
        asked = sum(outcome == "fault" and "sensor" in why for outcome, _, why in some)
        print(f"switch {switch}: asked about in {asked} of {len(some)}", flush=True)


if __name__ == "__main__":
    told = [int(word) for word in sys.argv[1:]]
    main(*(told + [20, 4, 2][len(told) :]))
