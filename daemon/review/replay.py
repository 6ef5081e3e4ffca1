"""A recorded run as a test: every look through today's recogniser, and what came out differently.

The model is the one that was in use at that look (kept in the run), or another one, to ask what it would have done.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from time import thread_time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daemon import frames
from daemon.arrays import Array
from daemon.calibration.file import load_calibration
from daemon.pick.moved_pair import places_of, with_arm
from daemon.review.digest import Digest
from daemon.store.model import load
from daemon.store.outside import FileError
from daemon.store.pictures import read_as_stored
from daemon.store.records import Record
from daemon.store.runs import RunError, kept_file
from daemon.vision.facets import Table
from daemon.vision.look import look
from daemon.vision.model import FacetLibrary, Model, empty_model
from daemon.vision.report import scene_json
from daemon.vision.settings import VisionSettings
from daemon.vision.values import UNKNOWN

Json = dict[str, Any]

NEAR_MM = 25.0
"""A part now and a part then are the same one when their facets' centroids are this close."""
SIGMAS = 3.0
TIMINGS = ("ms", "stages_ms")
NO_LONGER, NOT_BEFORE = "no longer found", "was not found before"
"""Neither says anything of a look in which only the expected part was looked for, by its edges."""


@dataclass(frozen=True)
class Change:
    """One difference of one look. regression: a part that was named is not, is named otherwise, or has moved."""

    seq: int
    cycle: int | None
    part: str
    what: str
    regression: bool


@dataclass(frozen=True)
class Replayed:
    """looks replayed, how many came out identical to the last digit, all changes, median ms of a look then and now,
    and one line for each look that could not be replayed."""

    looks: int
    identical: int
    changes: tuple[Change, ...]
    then_ms: float | None
    now_ms: float | None
    skipped: tuple[str, ...]

    @property
    def regressions(self) -> int:
        """How many of the changes are for the worse."""
        return sum(c.regression for c in self.changes)


def replay(
    folder: Path, run: Digest, library: FacetLibrary, settings: VisionSettings | None = None, model: Model | None = None
) -> Replayed:
    """Replay every look of a run. library: facet types for looks before there was a model; model: not the run's own.

    Raises RunError where the run keeps no calibration, ConfigError or ModelError where a kept file is not usable.
    """
    kept = (run.start or {}).get("calibration")
    if not kept:
        raise RunError(f"{folder}: no calibration was kept with this run; it cannot be replayed")
    rig = load_calibration(kept_file(folder, kept)).rig
    changes: list[Change] = []
    skipped: list[str] = []
    then_ms: list[float] = []
    now_ms: list[float] = []
    looks = identical = 0
    untaught = empty_model(library)
    unhurried = (settings or VisionSettings()).unhurried()
    for record, in_use in looks_with_models(folder, run):
        pair = _pictures(folder, record)
        if pair is None:
            skipped.append(f"look {record['seq']}: its pictures are not in the run folder")
            continue
        moved = places_of(record.get("moved"))
        taken_by = rig if moved is None else moved.rig(rig)
        scene = look(*pair, taken_by, model or in_use or untaught, unhurried, thread_time, _table(record))
        if moved is not None:
            scene = with_arm(scene, taken_by, moved.arm)
        now, then = scene_json(scene), record.get("scene") or {}
        whole = record.get("whole", True)
        found = compare(then, now, whole)
        looks += 1
        identical += _same(then, now) if whole else not found
        changes += [Change(int(record["seq"]), record.get("cycle"), part, what, worse) for part, what, worse in found]
        then_ms += [then["ms"]] if then.get("ms") else []
        now_ms += [now["ms"]] if now.get("ms") else []
    return Replayed(
        looks,
        identical,
        tuple(changes),
        median(then_ms) if then_ms else None,
        median(now_ms) if now_ms else None,
        tuple(skipped),
    )


def looks_with_models(folder: Path, run: Digest) -> Iterator[tuple[Record, Model | None]]:
    """Each look with the model that was in use then (None before there was one). Raises ModelError, RunError."""
    loaded: dict[str, Model] = {}
    current = (run.start or {}).get("model")
    for record in run.records:
        if record["kind"] == "model":
            current = record.get("file") or current
        elif record["kind"] == "look":
            if current and current not in loaded:
                loaded[current] = load(kept_file(folder, current))
            yield record, loaded.get(current) if current else None


def compare(then: Json, now: Json, whole: bool = True) -> list[tuple[str, str, bool]]:
    """(part, what changed, whether for the worse) between two looks as scene_json has them. whole: both looked for
    everything in view; a look that only followed a part knew its name and measured it by its edges, where a replay has
    nothing but its facets: it need not be named by those, and both measurements have an error of their own.
    """
    found: list[tuple[str, str, bool]] = []
    left = list(now.get("parts") or [])
    for part in then.get("parts") or []:
        match = min(left, key=lambda p: _gap_mm(part, p), default=None)
        named = part["label"] != UNKNOWN
        if match is None or _gap_mm(part, match) > NEAR_MM:
            if named and whole:
                found.append((part["label"], NO_LONGER, True))
            continue
        left.remove(match)
        if not whole and match["label"] == UNKNOWN:
            continue
        if match["label"] != part["label"]:
            found.append((part["label"], f"now {match['label']}: {match.get('reason')}", named))
        elif named and (moved := _moved(part, match, whole)) is not None:
            found.append((part["label"], moved, True))
    found += [(p["label"], NOT_BEFORE, False) for p in left if whole and p["label"] != UNKNOWN]
    return found


def _same(then: Json, now: Json) -> bool:
    def bare(scene: Json) -> Json:
        return {k: v for k, v in scene.items() if k not in TIMINGS}

    return bare(then) == bare(now)


def _centre(part: Json) -> Array:
    corners = [c for f in part.get("facets") or [] for c in f["corners_mm"]]
    return np.mean(corners, axis=0) if corners else np.full(3, np.inf)


def _gap_mm(a: Json, b: Json) -> float:
    gap = float(np.linalg.norm(_centre(a) - _centre(b)))
    return gap if np.isfinite(gap) else np.inf


def _moved(then: Json, now: Json, whole: bool) -> str | None:
    """In words, where the pose differs by more than SIGMAS of what was predicted, over all equal poses of the part."""
    if any(one.get("cyclopean_from_part") is None or one.get("covariance") is None for one in (then, now)):
        return None
    reference = np.array(then["cyclopean_from_part"], float)
    spread = [np.diag(np.array(one["covariance"], float)) for one in ((then,) if whole else (then, now))]
    sigma = np.sqrt(np.maximum(np.sum(spread, axis=0), 1e-12))
    poses = [now["cyclopean_from_part"], *(now.get("equivalents") or [])]
    motions = [frames.difference(np.array(p, float), reference) for p in poses]
    motion = min(motions, key=lambda m: float(np.max(np.abs(m) / sigma)))
    worst = float(np.max(np.abs(motion) / sigma))
    if worst <= SIGMAS:
        return None
    mm, deg = np.linalg.norm(motion[:3]), np.degrees(np.linalg.norm(motion[3:]))
    return f"moved by {mm:.2f} mm and {deg:.2f} degrees, {worst:.1f} sigma"


def _table(record: Record) -> Table | None:
    table = record.get("table")
    return None if not table else Table(np.array(table["up"], float), float(table["level_mm"]))


def _pictures(folder: Path, record: Record) -> tuple[NDArray[Any], NDArray[Any]] | None:
    names = record.get("images") or {}
    try:
        left, right = (read_as_stored(Path(names[eye]), folder) for eye in ("left", "right"))
    except (FileError, KeyError):
        return None
    return left, right
