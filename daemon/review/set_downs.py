"""Parts set down at their places: looks, deviation seen, last status of each place, figures. Pure."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass

import numpy as np

from daemon.events.records import Json, Record
from daemon.review.digest import Cycle, Digest
from daemon.store.place_file import pattern_of
from daemon.store.place_status import PlaceStatus

LOOKED_AT = frozenset({PlaceStatus.RIGHT, PlaceStatus.OFF, PlaceStatus.MISSING})
"""The results of a look after a set-down."""


@dataclass(frozen=True)
class PartSetDown:
    """One part set down at one place. status: the result of the look there, `set` where a pick ended before it; before,
    after: numbers of the look records with the part in the gripper and at the place."""

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
    """All set-downs of a run, in order."""
    return [made for cycle in run.cycles for made in set_downs_of(cycle)]


def set_downs_of(cycle: Cycle) -> Iterator[PartSetDown]:
    """The set-downs of one pick, in order."""
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
                yield _set_down(cycle, record, before, last)
                set_at = None
    if set_at is not None:
        yield _set_down(cycle, set_at, before, None)


def _set_down(cycle: Cycle, record: Record, before: int | None, after: int | None) -> PartSetDown:
    name, label, status, why = (str(record.get(key) or "") for key in ("place", "label", "status", "why"))
    off_mm, off_deg, most_mm, most_deg = map(record.get, ("off_mm", "off_deg", "tolerance_mm", "tolerance_deg"))
    return PartSetDown(
        cycle.number, record.get("t"), name, label, status, off_mm, off_deg, most_mm, most_deg, why, before, after
    )


def last_of_each(run: Digest) -> list[Json]:
    """Every place with a status in the run: name, part, status, deviation, outline from above (mm)."""
    last = {str(record.get("place")): record for record in run.of("place")}
    return [
        {"name": name, "part": record.get("label"), "outline": record.get("outline") or []}
        | {key: record.get(key) for key in ("status", "off_mm", "off_deg")}
        for name, record in last.items()
    ]


def placing_figures(made: Iterable[PartSetDown]) -> list[Json]:
    """Return for each part and place, a pattern before its places: number of set-downs looked at, number seen right,
    median and 95th percentile of the deviation, mm and degrees (None without any)."""
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
    """Places on the page of a run: figures over all of it, each set-down of the part shown."""
    return {
        "last": last_of_each(shown),
        "made": [asdict(each) for each in set_downs(shown)],
        "figures": placing_figures(set_downs(run)),
    }
