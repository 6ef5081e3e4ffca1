"""Sort a run's records into cycles and looks, with what was seen, estimated and moved, and how each cycle ended. Pure.

Accepts every version of the format; a field that a run does not have is None, never an error.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from statistics import fmean
from typing import Any

import numpy as np

from daemon.arrays import Array
from daemon.errors import spelt
from daemon.events.outcomes import GRASPED, UNFINISHED, is_success, is_tried, tally
from daemon.events.records import Record

Kept = Mapping[str, str | None]
"""Files in a run's kept/, by kind: model, calibration."""


@dataclass(frozen=True)
class LookStep:
    """One look, its estimate, and the moves before the next look."""

    number: int | None
    purpose: str
    look: Record
    estimate: Record | None
    moves: tuple[Record, ...]

    @property
    def seq(self) -> int:
        """Number of the look's record in its run."""
        return seq_of(self.look)

    @property
    def scene(self) -> dict[str, Any]:
        """The recorded scene; empty where no part was sought."""
        return self.look.get("scene") or {}

    @property
    def parts(self) -> list[dict[str, Any]]:
        return parts_of(self.look)


@dataclass(frozen=True)
class Cycle:
    """One pick, cycle_start to cycle_end. end None: the run ended before; in_use: the files in use at its start."""

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
        return is_tried(self.outcome)

    @property
    def grasped(self) -> bool:
        """Whether the gripper closed on the part: only then has the cycle an error at the grasp."""
        return self.outcome in GRASPED or any(r.get("closed") for r in carried_out(self.records) if r["kind"] == "hand")

    @property
    def label(self) -> str | None:
        """The chosen part."""
        if self.end and self.end.get("label"):
            return str(self.end["label"])
        estimates = [s.estimate for s in self.stops if s.estimate]
        return str(estimates[-1].get("label")) if estimates else None

    @property
    def why(self) -> str | None:
        return (self.end or {}).get("why")

    @property
    def code(self) -> str | None:
        """Why it ended, as a code (daemon/events/codes.py)."""
        return (self.end or {}).get("code")

    @property
    def stopped(self) -> str | None:
        """The code of what stopped the arm after the cycle's outcome was certain."""
        return (self.end or {}).get("stopped")

    @property
    def predicted_mm(self) -> float | None:
        """The expected error at the grasp."""
        return _of(self.end, "predicted", "mm")

    @property
    def predicted_deg(self) -> float | None:
        """The expected error at the grasp, in angle."""
        return _of(self.end, "predicted", "deg")

    @property
    def true_mm(self) -> float | None:
        """The true error at the grasp, from a simulated cell."""
        return _of(self.truth, "error_mm")

    @property
    def true_deg(self) -> float | None:
        """The true error at the grasp, in angle."""
        return _of(self.truth, "error_deg")

    @property
    def started(self) -> str:
        """The time when it began, ISO UTC."""
        return str(self.records[0].get("t") or "")

    @property
    def seconds(self) -> float:
        """Seconds from its first record to its last, on the cell's clock."""
        return float(self.records[-1]["mono_s"]) - float(self.records[0]["mono_s"]) if self.records else 0.0

    @property
    def looks(self) -> int:
        """Number of looks at the chosen part."""
        return sum(s.estimate is not None for s in self.stops)

    @property
    def model(self) -> str | None:
        """The model in use, as the first digits of its hash."""
        return short_hash(self.in_use.get("model"))

    @property
    def calibration(self) -> str | None:
        """The calibration in use, as the first digits of its hash."""
        return short_hash(self.in_use.get("calibration"))

    @cached_property
    def named_looks(self) -> int:
        return sum(any(part.get("label") != "unknown" for part in stop.parts) for stop in self.stops)

    @property
    def cameras(self) -> str | None:
        """The cameras used: both, left, right, or several in turn; None without a look."""
        used = [cameras_of(stop.look) for stop in self.stops]
        return ", ".join(dict.fromkeys(used)) or None

    def of(self, *kinds: str) -> list[Record]:
        return [r for r in self.records if r["kind"] in kinds]


@dataclass(frozen=True)
class Digest:
    """A run. outside: records that belong to no cycle (teaching, console); going: the run is still being written."""

    name: str
    start: Record | None
    end: Record | None
    cycles: tuple[Cycle, ...]
    outside: tuple[Record, ...]
    records: tuple[Record, ...]
    skipped: tuple[str, ...]
    going: bool

    def of(self, *kinds: str) -> list[Record]:
        return [r for r in self.records if r["kind"] in kinds]

    @property
    def times_life(self) -> float:
        """Speed of a simulated cell as a multiple of real time: times at different speeds are not comparable."""
        return float((self.start or {}).get("times_life") or 1)

    @property
    def stops(self) -> list[LookStep]:
        return [s for c in self.cycles for s in c.stops]

    def models(self) -> list[str]:
        """The kept model files, in order of use."""
        first = [self.start["model"]] if self.start and self.start.get("model") else []
        return first + [r["file"] for r in self.of("model") if r.get("file")]

    def models_used(self) -> list[str]:
        """The models used, as `version 3 (1f2e3d4c)`, or only the hash where the version was not recorded."""
        versions = self._versions()
        names = (
            f"version {versions[file]} ({short_hash(file)})" if versions.get(file) else str(short_hash(file))
            for file in self.models()
        )
        return list(dict.fromkeys(names))

    @property
    def model(self) -> str | None:
        """The last model used, as the first digits of its hash."""
        return short_hash(self.models()[-1]) if self.models() else None

    @property
    def model_version(self) -> int | None:
        """The version of the last model used; None where it was not recorded."""
        return self._versions().get(self.models()[-1]) if self.models() else None

    def _versions(self) -> dict[str, int | None]:
        return {r["file"]: r.get("version") for r in self.of("model") if r.get("file")}

    def kept(self, name: str) -> str | None:
        """A file that the run began with (config, calibration, model), as the first digits of its hash."""
        return short_hash((self.start or {}).get(name))

    def statistics(self) -> dict[str, Any]:
        """Figures for a table of runs: counts, and means over picked cycles (None without one)."""
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
    """The faults, by seq, that repeat the active one, as after a second `stop`: same cycle and text, no `resume`."""
    active: tuple[Any, Any] | None = None
    repeated = set[int]()
    for record in records:
        if record["kind"] == "fault":
            fault = record.get("cycle"), record.get("text")
            if fault == active:
                repeated.add(int(record["seq"]))
            active = fault
        elif record["kind"] == "state" and record.get("from") == "fault" and record.get("to") != "fault":
            active = None
    return frozenset(repeated)


def in_use(records: Iterable[Record]) -> Iterator[tuple[Record, Kept]]:
    """Yield each record with the files in use from it on: a reload writes run_start again, in the same run."""
    kept: Kept = {}
    for record in records:
        if record["kind"] == "run_start":
            kept = {name: record.get(name) or kept.get(name) for name in ("model", "calibration")}
        elif record["kind"] == "model":
            kept = {**kept, "model": record.get("file") or kept.get("model")}
        yield record, kept


def digest(name: str, records: Sequence[Record], skipped: Sequence[str] = (), going: bool = False) -> Digest:
    """Sort a run's records into cycles and looks. going: the run is still being written."""
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
    """Each look with its estimate and the moves up to the next look."""
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
    """The moves and gripper commands that were sent, without those withdrawn while typed."""
    sent: list[Record] = []
    for record in records:
        if record["kind"] in ("move", "hand"):
            sent.append(record)
        elif record["kind"] == "held_back" and sent and sent[-1]["kind"] == record.get("what"):
            sent.pop()
    return sent


def duration_s(records: Sequence[Record]) -> float:
    """Seconds from first record to last on the cell's clock, which restarts with the daemon: jumps back count 0."""
    times = [float(r["mono_s"]) for r in records if "mono_s" in r]
    return sum(max(b - a, 0.0) for a, b in pairwise(times))


def short_hash(kept: str | None) -> str | None:
    """The first 8 digits of the hash in `kept/<sha256>.yaml`."""
    return None if not kept else kept.rsplit("/", 1)[-1].split(".")[0][:8]


def seq_of(record: Record) -> int:
    """Number of a record in its run."""
    return int(record.get("seq") or 0)


def place_mm(part: dict[str, Any], look: Record) -> Array | None:
    """(3,) world mm of a part's origin; None where the look or the part has no pose."""
    outer, inner = look.get("world_from_cyclopean"), part.get("cyclopean_from_part")
    return None if outer is None or inner is None else (np.array(outer, float) @ np.array(inner, float))[:3, 3]


def cameras_of(look: Record) -> str:
    """The cameras that took a look's images: both, or the one that was moved."""
    return (look.get("moved") or {}).get("eye") or "both"


def parts_of(look: Record) -> list[dict[str, Any]]:
    """The recognised parts, as recorded."""
    return list((look.get("scene") or {}).get("parts") or [])


def residual_mm(parts: Iterable[dict[str, Any]]) -> float | None:
    """The largest distance of a corner to the taught part; None without a named part."""
    return max((p["residual_mm"] for p in parts if p.get("residual_mm") is not None), default=None)


def _of(record: Any, *keys: str) -> float | None:
    for key in keys:
        record = (record or {}).get(key)
    number: float | None = record
    return number


def _mean(values: Iterable[float | None]) -> float | None:
    present = [v for v in values if v is not None]
    return round(fmean(present), 3) if present else None
