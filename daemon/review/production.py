"""Production figures of runs: picked of tried, pace, causes of failures, interventions by people. Pure."""

from collections import Counter
from collections.abc import Iterable, Sequence
from itertools import chain
from typing import Any

import numpy as np

from daemon.events.codes import BY_SUMMARY
from daemon.events.outcomes import UNFINISHED, Outcome, is_success, tally
from daemon.events.records import Json
from daemon.review.digest import Cycle, Digest, repeated_faults
from daemon.review.downtime import use_of_time
from daemon.review.failure_causes import causes, causes_of_record, run_context
from daemon.review.not_counted import picks_not_counted

ROUTINE = frozenset({"pick", "auto", "step", "confirm", "y", "yes"})
"""Commands that do not count as interventions: they begin picks, or answer the questions of step mode."""
ENDING = frozenset({"stop", "abort", "disable", "refuse", "n", "no"})
"""Commands that end a pick."""
WITHOUT_NAME = ("unknown", "ambiguous")
NONE_CHOSEN = "no part chosen"
"""The row of picks that chose none: rows of parts add up to the total."""


def production(runs: Sequence[Digest]) -> Json:
    """Figures of one run, or of several together, as JSON values. Rates are None without data."""
    every = [c for run in runs for c in run.cycles]
    counted = tally(c.outcome for c in every)
    cycles = [c for c in every if c.tried]
    picked = [c for c in cycles if is_success(c.outcome)]
    timed = [run for run in runs if run.times_life == 1]
    seconds = [c.seconds for run in timed for c in run.cycles if is_success(c.outcome)]
    times = use_of_time(timed)
    worked_s = sum(filter(None, map(_worked_s, timed)))
    by_part = {
        label: [sum(is_success(c.outcome) for c in of), len(of)]
        for label in [*sorted({c.label for c in cycles if c.label}), NONE_CHOSEN]
        for of in [[c for c in cycles if (c.label or NONE_CHOSEN) == label]]
        if of
    }
    return {
        "runs": len(runs),
        "tried": counted.tried,
        "picked": counted.picked,
        "released": counted.released,
        "aborted": counted.aborted,
        "interrupted": sum(c.outcome == UNFINISHED for run in runs if not run.going for c in run.cycles),
        "paces": sorted({run.times_life for run in runs if run.cycles}),
        "uncounted": sum(len(picks_not_counted(c)) for c in cycles),
        "parts": by_part,
        "hourly": 3600 * len(seconds) / worked_s if worked_s > 0 and seconds else None,
        "median_s": float(np.median(seconds)) if seconds else None,
        "p95_s": float(np.quantile(seconds, 0.95)) if seconds else None,
        "grasp_mm": median_of(c.predicted_mm for c in picked),
        "true_mm": median_of(c.true_mm for c in picked),
        "looks": median_of(c.looks for c in picked),
        "stops": dict(Counter(chain.from_iterable(map(_stops, runs))).most_common()),
        "nameless": sum(map(_unnamed_parts, cycles)),
        "interventions": sum(map(interventions, runs)),
        "oee": times["oee"],
        "times": times,
    }


def _worked_s(run: Digest) -> float | None:
    """Seconds from the first cycle's start to the last one's end, on the cell's clock, pauses included."""
    if not run.cycles:
        return None
    return float(run.cycles[-1].records[-1]["mono_s"]) - float(run.cycles[0].records[0]["mono_s"])


def remedies(done: Json) -> dict[str, str]:
    """The remedy for each cause in the figures."""
    return {name: BY_SUMMARY[name].remedy for name in done["stops"]}


def _stops(run: Digest) -> Iterable[str]:
    """The first cause of each failed cycle, and of each fault between cycles that repeats none of these."""
    ended, context = set[tuple[Any, str]](), run_context(run.cycles)
    for cycle in run.cycles:
        found = [c.code.summary for c in causes(cycle, context, run.going)[:1]]
        ended |= {(cycle.number, name) for name in found}
        yield from found
    repeated = repeated_faults(run.records)
    for record in run.outside:
        if record["kind"] == "fault" and record["seq"] not in repeated:
            names = [c.code.summary for c in causes_of_record(record)]
            yield from (name for name in names if (record.get("cycle"), name) not in ended)


def _unnamed_parts(cycle: Cycle) -> int:
    skipped = (cycle.end or {}).get("skipped") or []
    return sum(s.get("outcome") in WITHOUT_NAME for s in skipped) or int(cycle.outcome in WITHOUT_NAME)


def interventions(run: Digest) -> int:
    """Number of times a person had to act: commands during a pick or an auto, picks that a person ended, and faults
    until `resume`. A person's own stop and the `resume` after it are one intervention, in whatever order the end of the
    pick, the fault and the command were written."""
    count, picking, auto, fault, ended = 0, False, False, False, False
    for record in run.records:
        match record["kind"]:
            case "cycle_start":
                picking, ended = True, False
            case "cycle_end":
                picking = False
                stopped = record.get("outcome") == Outcome.ABORTED or record.get("stopped")
                if stopped and not (fault or ended):
                    ended = True
                    count += 1
            case "auto":
                auto = bool(record.get("on"))
            case "command" if (picking or auto) and not (fault or ended):
                words = str(record.get("text")).split()
                count += bool(words) and words[0] not in ROUTINE
                ended = bool(words) and words[0] in ENDING
            case "fault" if (picking or auto or ended) and not fault:
                fault = True
                count += not ended
            case "left" if record.get("cycle") is not None or record.get("auto"):
                fault = True
                count += 1
            case "state" if record.get("from") == "fault" and record.get("to") != "fault":
                fault = auto = ended = False
            case "run_start" if not record.get("reloaded"):
                picking = fault = ended = False
    return count


def median_of(values: Iterable[Any]) -> float | None:
    """Median of the values that are numbers; None without one."""
    numbers = [float(v) for v in values if isinstance(v, (int, float))]
    return float(np.median(numbers)) if numbers else None


def compared(before: Json, now: Json) -> list[Json]:
    """Compare two productions in rows: name, before, now, delta, matters.

    matters: `better` or `worse` where a share differs by more than two standard errors, or a time or an error by more
    than a tenth; else None.
    """
    picked, picked_now = ([each["picked"], each["tried"]] for each in (before, now))
    labels = sorted({*before["parts"], *now["parts"]})
    return [
        _share_row("picked of tried", picked, picked_now),
        *(_row(name, before[key], now[key], unit, lower) for name, key, unit, lower in PLAIN),
        *(_share_row(label, *(each["parts"].get(label, [0, 0]) for each in (before, now))) for label in labels),
    ]


PLAIN = (
    ("picks per hour", "hourly", "", False),
    ("cycle time, median", "median_s", "s", True),
    ("cycle time, 95th percentile", "p95_s", "s", True),
    ("OEE", "oee", "", False),
    ("looks per pick", "looks", "", True),
    ("predicted error at the grasp", "grasp_mm", "mm", True),
    ("true error at the grasp", "true_mm", "mm", True),
    ("unidentified parts", "nameless", "", True),
    ("interventions", "interventions", "", True),
)
"""Name, key, unit, whether less is better."""
TENTH = 0.1
"""A figure that differs by more than this share of it matters."""


def _row(name: str, before: Any, now: Any, unit: str, lower: bool) -> Json:
    row: Json = {"name": name, "before": before, "now": now, "unit": unit, "delta": None, "matters": None}
    if before is None or now is None:
        return row
    row["delta"] = now - before
    if abs(now - before) > TENTH * max(abs(before), 1e-9) and now != before:
        row["matters"] = "better" if (now < before) == lower else "worse"
    return row


def _share_row(name: str, before: list[int], now: list[int]) -> Json:
    """A row of two shares [part, of]; the difference in percent."""
    row: Json = {"name": name, "before": before, "now": now, "unit": "%", "delta": None, "matters": None}
    if not before[1] or not now[1]:
        return row
    gap, sigma = shares_apart(before, now)
    row["delta"] = 100 * gap
    if abs(gap) > 2 * sigma > 0:
        row["matters"] = "better" if gap > 0 else "worse"
    return row


def shares_apart(one: Sequence[int], other: Sequence[int]) -> tuple[float, float]:
    """Return how much larger the second of two shares [part, of] is, and the standard error of that difference."""
    pooled = (one[0] + other[0]) / (one[1] + other[1])
    sigma = float(np.sqrt(pooled * (1 - pooled) * (1 / one[1] + 1 / other[1])))
    return other[0] / other[1] - one[0] / one[1], sigma
