"""Results of a replay: each look, recorded and replayed, as plain values, and counts over all of them. Pure.

A name counts as right or wrong only where the pick proved it: the gripper then held this part, under a name.
"""

from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict
from statistics import median
from typing import Any

from daemon.events.records import Json
from daemon.fleet.layout import Proof, proofs_of, proven_label
from daemon.review.digest import Digest
from daemon.review.replay import ReplayedLook, apart_mm, paired, without_timing

LIGHTS = ((60.0, "under 60"), (120.0, "60 to 120"), (180.0, "120 to 180"), (float("inf"), "over 180"))
"""99th-percentile brightness of the darker camera image, in grey levels."""
_BRIGHTNESS = {name: number for number, (_, name) in enumerate(LIGHTS)}
UNKNOWN = "unknown"
TIMINGS = ("then_ms", "now_ms")


def result_of(run: Digest, seen: Iterable[ReplayedLook | str]) -> Json:
    """The result of one run, or of some of its looks, as JSON values: {run, looks, skipped}."""
    proofs, looks, skipped = proofs_of(run), [], []
    for one in seen:
        if isinstance(one, str):
            skipped.append(f"{run.name}: {one}")
        else:
            looks.append(_look(one, proofs.get(id(one.record))))
    return {"run": run.name, "looks": looks, "skipped": skipped}


def _look(seen: ReplayedLook, proof: Proof | None) -> Json:
    """One look as JSON values. now: the replayed scene where anything differs, for the page to draw."""
    record = seen.record
    return {
        **{name: record.get(name) for name in ("seq", "cycle", "purpose")},
        "whole": record.get("whole", True),
        "light": light_of(record.get("health") or {}),
        "then_ms": seen.then.get("ms"),
        "now_ms": seen.now.get("ms"),
        "identical": seen.identical,
        "changes": [asdict(change) for change in seen.changes],
        "parts": [_pair(then, now, seen, proof) for then, now in paired(seen.then, seen.now)],
        "now": without_timing(seen.now) if seen.changes else None,
    }


def _pair(then: Json | None, now: Json | None, seen: ReplayedLook, proof: Proof | None) -> Json:
    off = apart_mm(then, now) if then and now and then["label"] == now["label"] else None
    return {
        "then": then and then["label"],
        "now": now and now["label"],
        "proved": proven_label(then or now or {}, seen.record, proof),
        "mm": None if off is None else round(off, 4),
    }


def light_of(health: Mapping[str, Any]) -> str:
    """The class of brightness (LIGHTS) of a look, from its measures."""
    levels = [health.get(f"darkness_{camera}") for camera in ("left", "right")]
    measured = [level for level in levels if isinstance(level, (int, float))]
    return next(name for most, name in LIGHTS if min(measured) < most) if measured else "not measured"


def summed(results: Sequence[tuple[str, Json]]) -> Json:
    """Count the (cell, result) pairs: in total, and by cell, part and light, each in order."""
    groups: dict[str, dict[str, list[tuple[Json, Json]]]] = {k: defaultdict(list) for k in ("cell", "part", "light")}
    looks = [(cell, look) for cell, result in results for look in result["looks"]]
    every: list[tuple[Json, Json]] = []
    for cell, look in looks:
        for pair in look["parts"]:
            every.append((look, pair))
            groups["cell"][cell].append((look, pair))
            groups["part"][_name(pair)].append((look, pair))
            groups["light"][look["light"]].append((look, pair))
    return {
        "looks": len(looks),
        "runs": len({(cell, result["run"]) for cell, result in results}),
        "identical": sum(look["identical"] for _, look in looks),
        "worse": sum(change["regression"] for _, look in looks for change in look["changes"]),
        "all": counted(every) | _times(look for _, look in looks),
        "by": {
            kind: {
                name: counted(of) | _times({id(look): look for look, _ in of}.values())
                for name, of in sorted(found.items(), key=lambda group: (_BRIGHTNESS.get(group[0], 0), group[0]))
            }
            for kind, found in groups.items()
        },
        "skipped": [line for _, result in results for line in result["skipped"]],
    }


def _name(pair: Json) -> str:
    return next((n for n in (pair["proved"], pair["then"], pair["now"]) if n and n != UNKNOWN), UNKNOWN)


def counted(pairs: Sequence[tuple[Json, Json]]) -> Json:
    """Count (look, part) pairs, each figure as [then, now]. named: parts with a name; proved: parts that the gripper
    then held; right, wrong: names of proved parts; mm: distance between then and now.

    Looks that only followed a part had its name given: they count for mm only.
    """
    whole = [pair for look, pair in pairs if look["whole"]]
    proved = [pair for pair in whole if pair["proved"]]
    off = sorted(pair["mm"] for _, pair in pairs if pair["mm"] is not None and pair["then"] != UNKNOWN)

    def of(some: Sequence[Json], holds: Callable[[str | None, Json], bool]) -> list[int]:
        return [sum(holds(pair[when], pair) for pair in some) for when in ("then", "now")]

    return {
        "parts": len(whole),
        "named": of(whole, lambda name, _: name not in (None, UNKNOWN)),
        "proved": len(proved),
        "right": of(proved, lambda name, pair: name == pair["proved"]),
        "wrong": of(proved, lambda name, pair: name not in (None, UNKNOWN, pair["proved"])),
        "mm": round(median(off), 4) if off else None,
        "p95_mm": off[int(0.95 * (len(off) - 1))] if off else None,
    }


def _times(looks: Iterable[Json]) -> Json:
    """Median ms of a look, [then, now], over looks that have both times."""
    both = [(look["then_ms"], look["now_ms"]) for look in looks if look["then_ms"] and look["now_ms"]]
    return {"ms": [round(median(times), 2) for times in zip(*both, strict=True)] if both else [None, None]}


def differences(results: Sequence[tuple[str, Json]]) -> list[Json]:
    """Every look with a difference, worst first: lost or wrong names that a pick had proved, then other regressions."""
    found = [
        {"cell": cell, "run": result["run"], **{k: v for k, v in look.items() if k not in TIMINGS}}
        for cell, result in results
        for look in result["looks"]
        if look["changes"]
    ]

    def weight(one: Json) -> tuple[int, int]:
        lost = sum(p["proved"] is not None and p["then"] == p["proved"] != p["now"] for p in one["parts"])
        return -lost, -sum(change["regression"] for change in one["changes"])

    return sorted(found, key=lambda one: (*weight(one), one["cell"], one["run"], one["seq"]))


def count_by_kind(found: Sequence[Json]) -> dict[str, int]:
    """How often a name became another: `cube -> unknown`."""
    pairs = [(pair["then"], pair["now"]) for one in found if one["whole"] for pair in one["parts"]]
    renamed = Counter(f"{then or 'nothing'} -> {now or 'nothing'}" for then, now in pairs if then != now)
    return dict(renamed.most_common())
