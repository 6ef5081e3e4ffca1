"""A run's records -> cycles and stops: what was seen, estimated, moved, and how it ended. Pure.

Reads every version of the format since 1; a field that a run does not have is None, never an error.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from statistics import fmean
from typing import Any

from daemon.errors import spelt
from daemon.events.outcomes import GRASPED, UNFINISHED, is_success, is_tried, tally
from daemon.events.records import Record

Kept = Mapping[str, str | None]
"""Files kept with a run, by what they are: model, calibration."""


@dataclass(frozen=True)
class LookStep:
    """One look, the estimate that came of it, and the moves that followed before the next look."""

    number: int | None
    purpose: str
    look: Record
    estimate: Record | None
    moves: tuple[Record, ...]

    @property
    def parts(self) -> list[dict[str, Any]]:
        """What was recognised, as the look has it."""
        return parts_of(self.look)

    @property
    def notes(self) -> str:
        """What the look tells people beside its parts."""
        return " ".join(str(n) for n in (self.look.get("scene") or {}).get("notes") or [])


@dataclass(frozen=True)
class Cycle:
    """One pick: its records from cycle_start to cycle_end. outcome None: the run ended in the middle of it; in_use:
    the files it began with."""

    number: int
    records: tuple[Record, ...]
    stops: tuple[LookStep, ...]
    end: Record | None
    truth: Record | None
    in_use: Kept = field(default_factory=dict)

    @property
    def outcome(self) -> str:
        """picked, missed, ... or `unfinished`."""
        return str(self.end.get("outcome")) if self.end else UNFINISHED

    @property
    def tried(self) -> bool:
        """Whether it counts as tried (daemon/events/outcomes.py)."""
        return is_tried(self.outcome)

    @property
    def grasped(self) -> bool:
        """Whether the gripper closed on the part: an error at the grasp applies only then."""
        return self.outcome in GRASPED or any(r.get("closed") for r in carried_out(self.records) if r["kind"] == "hand")

    @property
    def label(self) -> str | None:
        """The part it went for."""
        if self.end and self.end.get("label"):
            return str(self.end["label"])
        estimates = [s.estimate for s in self.stops if s.estimate]
        return str(estimates[-1].get("label")) if estimates else None

    @property
    def why(self) -> str | None:
        """Why it ended so."""
        return (self.end or {}).get("why")

    @property
    def code(self) -> str | None:
        """The same as a code (daemon/events/codes.py)."""
        return (self.end or {}).get("code")

    @property
    def predicted_mm(self) -> float | None:
        """The error that was expected at the grasp."""
        return _of(self.end, "predicted", "mm")

    @property
    def predicted_deg(self) -> float | None:
        """The same in angle."""
        return _of(self.end, "predicted", "deg")

    @property
    def true_mm(self) -> float | None:
        """The error that the simulated cell's witness saw."""
        return _of(self.truth, "error_mm")

    @property
    def true_deg(self) -> float | None:
        """The same in angle."""
        return _of(self.truth, "error_deg")

    @property
    def started(self) -> str:
        """When it began."""
        return str(self.records[0].get("t") or "")

    @property
    def seconds(self) -> float:
        """From its first record to its last, on the cell's clock."""
        return float(self.records[-1]["mono_s"]) - float(self.records[0]["mono_s"]) if self.records else 0.0

    @property
    def looks(self) -> int:
        """Looks at the part it went for."""
        return sum(s.estimate is not None for s in self.stops)

    @property
    def model(self) -> str | None:
        """The model it was picked with, by the first digits of its hash."""
        return short_hash(self.in_use.get("model"))

    @property
    def calibration(self) -> str | None:
        """The same of the calibration."""
        return short_hash(self.in_use.get("calibration"))

    @cached_property
    def named_looks(self) -> int:
        """Looks in which something has a name."""
        return sum(any(part.get("label") != "unknown" for part in stop.parts) for stop in self.stops)

    @property
    def eyes(self) -> str | None:
        """Which eyes looked: both, left, right, or several in turn; None where nothing was looked at."""
        used = [eyes_of(stop.look) for stop in self.stops]
        return ", ".join(dict.fromkeys(used)) or None

    def of(self, *kinds: str) -> list[Record]:
        """Its records of these kinds, in order."""
        return [r for r in self.records if r["kind"] in kinds]


@dataclass(frozen=True)
class Digest:
    """A whole run. outside: looks, moves, faults that belong to no cycle (teaching, console); going: it is still
    being written."""

    name: str
    start: Record | None
    end: Record | None
    cycles: tuple[Cycle, ...]
    outside: tuple[Record, ...]
    records: tuple[Record, ...]
    skipped: tuple[str, ...]
    going: bool

    def of(self, *kinds: str) -> list[Record]:
        """All records of these kinds, in order."""
        return [r for r in self.records if r["kind"] in kinds]

    @property
    def times_life(self) -> float:
        """How many times as fast as life the cell ran: 1 but for a simulated one. Times of a run at another pace are no
        times of the cell: motion is faster, the computer is not."""
        return float((self.start or {}).get("times_life") or 1)

    @property
    def stops(self) -> list[LookStep]:
        """Every look of every cycle."""
        return [s for c in self.cycles for s in c.stops]

    def models(self) -> list[str]:
        """The kept model files in the order they came into use."""
        first = [self.start["model"]] if self.start and self.start.get("model") else []
        return first + [r["file"] for r in self.of("model") if r.get("file")]

    def models_used(self) -> list[str]:
        """The models that were in use: `version 3 (1f2e3d4c)`; where a file's version was not told, its hash."""
        versions = self._versions()
        told = (
            f"version {versions[file]} ({short_hash(file)})" if versions.get(file) else str(short_hash(file))
            for file in self.models()
        )
        return list(dict.fromkeys(told))

    @property
    def model(self) -> str | None:
        """The last model in use, by the first digits of its hash."""
        return short_hash(self.models()[-1]) if self.models() else None

    @property
    def model_version(self) -> int | None:
        """The last model in use, by its number in the cell; None where that was not told."""
        return self._versions().get(self.models()[-1]) if self.models() else None

    def _versions(self) -> dict[str, int | None]:
        """Each kept model file's number."""
        return {r["file"]: r.get("version") for r in self.of("model") if r.get("file")}

    def kept(self, name: str) -> str | None:
        """A file the run began with (config, calibration, model), by the first digits of its hash."""
        return short_hash((self.start or {}).get(name))

    def statistics(self) -> dict[str, Any]:
        """What a table of runs shows: counts, means over picked cycles (None where there are none)."""
        by_outcome = Counter(cycle.outcome for cycle in self.cycles)
        picked = [c for c in self.cycles if is_success(c.outcome)]
        counted = tally(by_outcome)
        return {
            "run": self.name,
            "started": self.records[0].get("t") if self.records else None,
            "seconds": round(duration_s(self.records), 1),
            "cycles": len(self.cycles),
            "tried": counted.tried,
            "picked": counted.picked,
            "aborted": counted.aborted,
            "missed": by_outcome["missed"],
            "outcomes": dict(by_outcome),
            "looks": len(self.of("look")),
            "refusals": len(self.of("refusal")),
            "faults": len(self.of("fault")),
            "mean_looks": _mean(c.looks for c in picked),
            "mean_cycle_s": _mean(c.seconds for c in picked),
            "predicted_mm": _mean(c.predicted_mm for c in picked),
            "true_mm": _mean(c.true_mm for c in picked),
            "model": self.model,
            "model_version": self.model_version,
            "calibration": self.kept("calibration"),
            "config": self.kept("config"),
            "ended": self.end is not None,
            "going": self.going,
        }


def repeated_faults(records: Sequence[Record]) -> frozenset[int]:
    """The faults, by seq, that only say once more what stands already: nobody has resumed since, and the cycle and the
    text are the same. A second `stop` while the first one's fault stands is one."""
    standing: tuple[Any, Any] | None = None
    again = set[int]()
    for record in records:
        if record["kind"] == "fault":
            told = record.get("cycle"), record.get("text")
            if told == standing:
                again.add(int(record["seq"]))
            standing = told
        elif record["kind"] == "state" and record.get("from") == "fault" and record.get("to") != "fault":
            standing = None
    return frozenset(again)


def in_use(records: Iterable[Record]) -> Iterator[tuple[Record, Kept]]:
    """Each record with what is in use from it on: a reload and another calibration begin no new run, they tell
    run_start again."""
    kept: Kept = {}
    for record in records:
        if record["kind"] == "run_start":
            kept = {name: record.get(name) or kept.get(name) for name in ("model", "calibration")}
        elif record["kind"] == "model":
            kept = {**kept, "model": record.get("file") or kept.get("model")}
        yield record, kept


def digest(name: str, records: Sequence[Record], skipped: Sequence[str] = (), going: bool = False) -> Digest:
    """Sort a run's records (read by daemon/store/runs.py) into cycles and stops. going: it is being written still."""
    cycles: list[Cycle] = []
    outside: list[Record] = []
    current: list[Record] | None = None
    began: Kept = {}
    truths = {r.get("cycle"): r for r in records if r["kind"] == "truth"}
    for record, kept in in_use(records):
        kind = record["kind"]
        if kind == "cycle_start":
            if current is not None:
                cycles.append(_cycle(current, truths, began))
            current, began = [record], kept
        elif current is None or kind in ("run_start", "run_end", "truth"):
            outside.append(record)
        else:
            current.append(record)
            if kind == "cycle_end":
                cycles.append(_cycle(current, truths, began))
                current = None
    if current is not None:
        cycles.append(_cycle(current, truths, began))
    start = next((r for r in records if r["kind"] == "run_start"), None)
    end = next((r for r in reversed(records) if r["kind"] == "run_end"), None)
    going = going and end is None
    return Digest(spelt(name), start, end, tuple(cycles), tuple(outside), tuple(records), tuple(skipped), going)


def _cycle(records: list[Record], truths: dict[Any, Record], began: Kept) -> Cycle:
    number = int(records[0].get("cycle") or 0)
    last = records[-1]
    end = last if last["kind"] == "cycle_end" else None
    return Cycle(number, tuple(records), tuple(stops_of(records)), end, truths.get(records[0].get("cycle")), began)


def stops_of(records: Sequence[Record]) -> list[LookStep]:
    """Each look with the estimate and the moves up to the next look."""
    found: list[LookStep] = []
    at = [k for k, r in enumerate(records) if r["kind"] == "look"]
    for begin, end in pairwise([*at, len(records)]):
        after = records[begin + 1 : end]
        estimate = next((r for r in after if r["kind"] == "estimate"), None)
        moves = tuple(r for r in after if r["kind"] in ("move", "moved", "held_back", "refusal", "hand"))
        look = records[begin]
        found.append(LookStep(look.get("stop"), str(look.get("purpose") or "look"), look, estimate, moves))
    return found


def carried_out(records: Iterable[Record]) -> list[Record]:
    """The moves, and the motions of the hand, but for those that were taken back as they were typed."""
    told: list[Record] = []
    for record in records:
        if record["kind"] in ("move", "hand"):
            told.append(record)
        elif record["kind"] == "held_back" and told and told[-1]["kind"] == record.get("what"):
            told.pop()
    return told


def duration_s(records: Sequence[Record]) -> float:
    """From first record to last on the cell clock, which starts anew with the daemon: jumps back count nothing."""
    times = [float(r["mono_s"]) for r in records if "mono_s" in r]
    return sum(max(b - a, 0.0) for a, b in pairwise(times))


def short_hash(kept: str | None) -> str | None:
    """`kept/<sha256>.yaml` -> its first 8 digits."""
    return None if not kept else kept.rsplit("/", 1)[-1].split(".")[0][:8]


def eyes_of(look: Record) -> str:
    """Which eyes took a look's pictures: both, or the one that was moved."""
    return (look.get("moved") or {}).get("eye") or "both"


def parts_of(look: Record) -> list[dict[str, Any]]:
    """What was recognised, as the look's record has it."""
    found: list[dict[str, Any]] = (look.get("scene") or {}).get("parts") or []
    return found


def residual_mm(parts: Iterable[dict[str, Any]]) -> float | None:
    """The worst distance of corners to the taught part; None where none was named."""
    return max((p["residual_mm"] for p in parts if p.get("residual_mm") is not None), default=None)


def _of(record: Any, *keys: str) -> float | None:
    for key in keys:
        record = (record or {}).get(key)
    number: float | None = record
    return number


def _mean(values: Iterable[float | None]) -> float | None:
    known = [v for v in values if v is not None]
    return round(fmean(known), 3) if known else None
