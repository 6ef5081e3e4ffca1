"""Parts that were set down at their places: each with the looks before and after it and how far off it was seen; the
last status of every place; figures by place over one run or many. Pure.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from daemon.events.records import Record
from daemon.review.digest import Cycle, Digest
from daemon.store.place_file import pattern_of
from daemon.store.place_status import PlaceStatus

Json = dict[str, Any]

LOOKED_AT = frozenset({PlaceStatus.RIGHT, PlaceStatus.OFF, PlaceStatus.MISSING})
"""What a look after a set-down finds."""


@dataclass(frozen=True)
class PartSetDown:
    """One part set down at one place. status: what the look found, `set` where a pick was cut off before it; before,
    after: records of the last look with the part in the gripper and of the last one at the place, by their number."""

    cycle: int
    t: str | None
    place: str
    label: str
    status: str
    off_mm: float | None
    off_deg: float | None
    tolerance_mm: float | None
    tolerance_deg: float | None
    why: str
    before: int | None
    after: int | None


def set_downs(run: Digest) -> list[PartSetDown]:
    """All of a run, in order."""
    return [made for cycle in run.cycles for made in set_downs_of(cycle)]


def set_downs_of(cycle: Cycle) -> Iterator[PartSetDown]:
    """Those of one pick, in order."""
    last = before = set_at = None
    for record in cycle.records:
        if record["kind"] == "look":
            last = int(record["seq"])
        elif record["kind"] == "place":
            status = record.get("status")
            if status == PlaceStatus.CLAIMED:
                before = last
            elif status == PlaceStatus.SET:
                set_at = record
            elif set_at is not None and record.get("place") == set_at.get("place") and status in LOOKED_AT:
                yield _made(cycle, record, before, last)
                set_at = None
    if set_at is not None:
        yield _made(cycle, set_at, before, None)


def _made(cycle: Cycle, record: Record, before: int | None, after: int | None) -> PartSetDown:
    name, label, status, why = (str(record.get(key) or "") for key in ("place", "label", "status", "why"))
    off_mm, off_deg, most_mm, most_deg = map(record.get, ("off_mm", "off_deg", "tolerance_mm", "tolerance_deg"))
    return PartSetDown(
        cycle.number, record.get("t"), name, label, status, off_mm, off_deg, most_mm, most_deg, why, before, after
    )


def last_of_each(run: Digest) -> list[Json]:
    """Every place that the run has a status of: name, part, status, how far off, and its outline from above (mm)."""
    last = {str(record.get("place")): record for record in run.of("place")}
    return [
        {
            "name": name,
            "part": record.get("label"),
            "status": record.get("status"),
            "off_mm": record.get("off_mm"),
            "off_deg": record.get("off_deg"),
            "outline": record.get("outline") or [],
        }
        for name, record in last.items()
    ]


def placing_figures(made: Iterable[PartSetDown]) -> list[Json]:
    """By part and place, a pattern before its places: how many were looked at, how many of them seen right, median and
    95th percentile of how far off they were seen, mm and degrees (None: none was seen)."""
    by_place: dict[tuple[str, str], list[PartSetDown]] = {}
    for each in made:
        if each.status in LOOKED_AT:
            for name in dict.fromkeys((pattern_of(each.place), each.place)):
                by_place.setdefault((each.label, name), []).append(each)
    return [_figures(label, name, some) for (label, name), some in sorted(by_place.items(), key=_in_order)]


def _in_order(entry: tuple[tuple[str, str], Sequence[PartSetDown]]) -> tuple[str, str, int]:
    (label, name), _ = entry
    pattern, _, number = name.partition(".")
    return label, pattern, int(number) if number.isdigit() else 0


def _figures(label: str, name: str, some: Sequence[PartSetDown]) -> Json:
    seen = [(each.off_mm, each.off_deg) for each in some if each.off_mm is not None and each.off_deg is not None]
    half, most = (np.percentile(seen, q, axis=0).tolist() if seen else (None, None) for q in (50, 95))
    right = sum(each.status == PlaceStatus.RIGHT for each in some)
    errors = {"median_mm": half[0], "p95_mm": most[0], "median_deg": half[1], "p95_deg": most[1]}
    return {"part": label, "place": name, "looked_at": len(some), "right": right, **errors}


def places_json(run: Digest, shown: Digest) -> Json:
    """What the page of a run shows of places: figures of all of it, each set-down of what is shown."""
    return {
        "last": last_of_each(shown),
        "made": [asdict(each) for each in set_downs(shown)],
        "figures": placing_figures(set_downs(run)),
    }
