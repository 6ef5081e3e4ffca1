"""Picks not counted: a look after the lift denied the part, later looks no longer find it, and the gripper let it go
over the bin.

Pure: one cycle in. A pick that is told that it missed opens the hand over the bin all the same, because a look may err;
whether this one did is seen only when the table is looked at again. Such a part is likely in the bin, and not counted.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from daemon.arrays import Array
from daemon.events.codes import DecisionCode
from daemon.events.records import Record
from daemon.review.digest import Cycle, LookStep, carried_out

NEAR_MM = 50.0
"""What lies within this of where the part lay may be the part, pushed."""


def picks_not_counted(cycle: Cycle) -> list[Record]:
    """The misses of a cycle by which a part lies where it lay, while the same survey, looking again after the hand had
    opened over the bin, has nothing there and a part fewer altogether."""
    return [miss for miss in cycle.of("decision") if _says_it_lies_there(miss) and _is_gone_after(cycle, _seq(miss))]


def not_counted_text(miss: Record) -> str:
    """One of them in words."""
    return (
        f"`{miss.get('why')}`, but nothing did when the table was looked at again: likely in the bin, and not counted"
    )


def _says_it_lies_there(record: Record) -> bool:
    return record.get("code") == DecisionCode.STILL_THERE


def _is_gone_after(cycle: Cycle, at: int) -> bool:
    told = [s.estimate.get("world_from_part") for s in cycle.stops if s.estimate and _seq(s.look) < at]
    lay = [place for place in told if place][-1:]
    surveys = [s for s in cycle.stops if s.purpose.startswith("survey")]
    before = {s.purpose: s for s in surveys if _seq(s.look) < at}
    after = {s.purpose: s for s in reversed(surveys) if _seq(s.look) > at}
    again = [(before[purpose], after[purpose]) for purpose in before.keys() & after.keys()]
    if not (lay and again and _opened_over_the_bin(cycle, at)):
        return False
    place = np.array(lay[0], float)[:3, 3]
    fewer = sum(len(now.parts) for _, now in again) < sum(len(then.parts) for then, _ in again)
    return fewer and not any(np.linalg.norm(p - place) < NEAR_MM for _, now in again for p in _places(now))


def _opened_over_the_bin(cycle: Cycle, at: int) -> bool:
    after = carried_out(r for r in cycle.records if _seq(r) > at)
    opened = next((n for n, r in enumerate(after) if r["kind"] == "hand" and not r.get("closed")), 0)
    return any(r.get("purpose") == "bin" for r in after[:opened])


def _places(stop: LookStep) -> Iterator[Array]:
    """(3,) world mm of each part of a look that says where it is."""
    if world_from_cyclopean := stop.look.get("world_from_cyclopean"):
        for part in stop.parts:
            if part.get("cyclopean_from_part"):
                yield (np.array(world_from_cyclopean) @ np.array(part["cyclopean_from_part"]))[:3, 3]


def _seq(record: Record) -> int:
    return int(record.get("seq") or 0)
