"""How long a cell picked, stood still and waited for parts, what each stop cost, and OEE. Pure; a run's records in.

OEE is availability x performance x quality (ISO 22400-2). The time that counts is the time in which somebody wanted
parts: a pick, an auto or a job, from its beginning to its end, stops included. Waiting for parts at an empty table does
not count: the cell could have picked.
"""

from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import Enum, auto
from itertools import chain
from typing import Any

import numpy as np

from daemon.events.codes import CauseCode, cause_code
from daemon.events.outcomes import NOTHING_TO_PICK, Outcome, is_success, tally
from daemon.review.digest import Digest
from daemon.review.failure_causes import causes_of_record

PAUSED = "paused by a person"
NO_FAULT = frozenset({CauseCode.OPERATOR_ABORT, CauseCode.OPERATOR_NO})
"""A single pick that a person ended so is over: nobody has to clear anything."""
IDEAL_QUANTILE = 0.1
"""The ideal cycle time is that of the fastest tenth of the good picks."""
MIN_PICKS = 5
"""Least number of good picks for this measure; with fewer there is no OEE."""


class Doing(Enum):
    """What the cell does while a person wants parts."""

    NOTHING = auto()
    PICKING = auto()
    DOWN = auto()
    WAITING = auto()


@dataclass(frozen=True)
class Span:
    """A stretch of a run: what was done, how long (s), and why, where the cell was down."""

    doing: Doing
    seconds: float
    cause: str = ""


def spans(run: Digest) -> Iterator[Span]:
    """The stretches of a run in order, those of nothing to do left out."""
    doing, cause, since, ordered = Doing.NOTHING, "", 0.0, False
    for record in run.records:
        now, before = float(record["mono_s"]), (doing, cause)
        match record["kind"]:
            case "auto":
                ordered = bool(record.get("on"))
                idle = doing in (Doing.NOTHING, Doing.DOWN)
                doing = (Doing.PICKING if idle else doing) if ordered else Doing.NOTHING
            case "left" if record.get("cycle") is not None or record.get("auto"):
                doing, cause, ordered = Doing.DOWN, CauseCode.RESTARTED.summary, bool(record.get("auto"))
            case "cycle_start":
                doing = Doing.PICKING
            case "fault" if doing in (Doing.PICKING, Doing.WAITING):
                doing, cause = Doing.DOWN, next(c.code.summary for c in causes_of_record(record))
            case "cycle_end" if doing is Doing.PICKING:
                outcome, stopped = record.get("outcome"), record.get("stopped")
                ended = outcome in (Outcome.ABORTED, Outcome.FAULT)
                stop = cause_code(stopped or record.get("code")) if stopped or ended else None
                if stop is not None and (ordered or stop not in NO_FAULT):
                    doing, cause = Doing.DOWN, stop.summary
                elif not ordered:
                    doing = Doing.NOTHING
                elif outcome in NOTHING_TO_PICK:
                    doing = Doing.WAITING
            case "state" if record.get("to") == "paused" and doing is Doing.PICKING:
                doing, cause = Doing.DOWN, PAUSED
            case "state" if record.get("from") == "paused" and cause == PAUSED and doing is Doing.DOWN:
                doing = Doing.PICKING
            case "state" if record.get("from") == "fault" and record.get("to") != "fault" and not ordered:
                doing = Doing.NOTHING
        if (doing, cause) != before:
            yield from _span(*before, now - since)
            since = now
    if run.records:
        yield from _span(doing, cause, float(run.records[-1]["mono_s"]) - since)


def _span(doing: Doing, cause: str, seconds: float) -> Iterator[Span]:
    if doing is not Doing.NOTHING:
        yield Span(doing, max(seconds, 0.0), cause if doing is Doing.DOWN else "")


def use_of_time(runs: Sequence[Digest]) -> dict[str, Any]:
    """Figures of these runs together, JSON values: seconds picking, down and waiting, the stops from the costliest on
    (cause, count, s), and oee with its three factors, each None without data."""
    every = list(chain.from_iterable(map(spans, runs)))
    seconds = {doing: sum(span.seconds for span in every if span.doing is doing) for doing in Doing}
    count, cost = Counter[str](), defaultdict[str, float](float)
    for span in every:
        if span.doing is Doing.DOWN:
            count[span.cause] += 1
            cost[span.cause] += span.seconds
    costly = sorted(((s, name) for name, s in cost.items()), reverse=True)
    cycles = [cycle for run in runs for cycle in run.cycles]
    counted = tally(cycle.outcome for cycle in cycles)
    good_s = [cycle.seconds for cycle in cycles if is_success(cycle.outcome)]
    picking_s, down_s = seconds[Doing.PICKING], seconds[Doing.DOWN]
    factors: dict[str, float | None] = {"availability": None, "performance": None, "quality": None}
    ideal_s = None
    if len(good_s) >= MIN_PICKS and picking_s > 0:
        ideal_s = float(np.quantile(good_s, IDEAL_QUANTILE))
        factors = {
            "availability": picking_s / (picking_s + down_s),
            "performance": min(1.0, ideal_s * counted.tried / picking_s),
            "quality": counted.picked / counted.tried,
        }
    shares = [factor for factor in factors.values() if factor is not None]
    return {
        "picking_s": picking_s,
        "down_s": down_s,
        "waiting_s": seconds[Doing.WAITING],
        "stops": [{"cause": name, "count": count[name], "s": s} for s, name in costly],
        "oee": float(np.prod(shares)) if shares else None,
        **factors,
        "ideal_s": ideal_s,
    }
