"""Picks not counted: the look after the lift reported a miss, but the part is likely in the bin. Pure.

After a reported miss the gripper still opens over the bin, because a look may err. Later looks at the table show
whether it did: where they no longer find the part, it is likely in the bin, and the pick did not count.
"""

import numpy as np

from daemon.events.codes import DecisionCode
from daemon.events.records import Record
from daemon.review.digest import Cycle, carried_out, place_mm, seq_of

NEAR_MM = 50.0
"""A part within this distance of the old place may be the same part, pushed."""


def picks_not_counted(cycle: Cycle) -> list[Record]:
    """The reported misses (part still on the table) after which the same survey, repeated once the gripper had opened
    over the bin, finds nothing at that place and one part fewer in all."""
    misses = [r for r in cycle.of("decision") if r.get("code") == DecisionCode.STILL_THERE]
    return [miss for miss in misses if _absent_after(cycle, seq_of(miss))]


def not_counted_text(miss: Record) -> str:
    """Describe one pick not counted."""
    return f"`{miss.get('why')}`, but a later look at the table did not find it: likely in the bin, and not counted"


def _absent_after(cycle: Cycle, at: int) -> bool:
    poses = [s.estimate.get("world_from_part") for s in cycle.stops if s.estimate and s.seq < at]
    last = [pose for pose in poses if pose][-1:]
    surveys = [s for s in cycle.stops if s.purpose.startswith("survey")]
    before = {s.purpose: s for s in surveys if s.seq < at}
    after = {s.purpose: s for s in reversed(surveys) if s.seq > at}
    again = [(before[purpose], after[purpose]) for purpose in before.keys() & after.keys()]
    if not (last and again and _opened_over_the_bin(cycle, at)):
        return False
    place = np.array(last[0], float)[:3, 3]
    fewer = sum(len(now.parts) for _, now in again) < sum(len(then.parts) for then, _ in again)
    seen = (place_mm(part, now.look) for _, now in again for part in now.parts)
    return fewer and not any(p is not None and np.linalg.norm(p - place) < NEAR_MM for p in seen)


def _opened_over_the_bin(cycle: Cycle, at: int) -> bool:
    after = carried_out(r for r in cycle.records if seq_of(r) > at)
    opened = next((n for n, r in enumerate(after) if r["kind"] == "hand" and not r.get("closed")), 0)
    return any(r.get("purpose") == "bin" for r in after[:opened])
