"""Replay the looks of a recorded run through today's recogniser, and report the differences.

Model and calibration are those in use at each look, from the run's kept/, or others given instead.
"""

from collections.abc import Container, Iterator
from dataclasses import dataclass
from pathlib import Path
from time import thread_time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daemon import frames
from daemon.arrays import Array
from daemon.calibration.file import load_calibration
from daemon.events.records import Json, Record
from daemon.pick.moved_pair import places_of, with_arm_errors
from daemon.review.digest import Digest, in_use
from daemon.store.model import load
from daemon.store.outside import FileError
from daemon.store.pictures import read_as_stored
from daemon.store.runs import RunError, kept_file
from daemon.vision.facets import table_of
from daemon.vision.geometry import StereoRig
from daemon.vision.look import look
from daemon.vision.model import FacetLibrary, Model, empty_model
from daemon.vision.report import scene_json
from daemon.vision.settings import VisionSettings
from daemon.vision.values import UNKNOWN

NEAR_MM = 25.0
"""Two parts count as the same one when the centroids of their facets are this close."""
SIGMAS = 3.0
OF_ONE_TIME = ("ms", "stages_ms", "unmatched", "nothing")
"""Fields of a recorded scene that a replay does not compare: times, and what the pick added where it saw no part."""
NO_LONGER, NOT_BEFORE = "no longer found", "was not found before"
"""Neither applies to a look that sought only the expected part, by its edges."""


@dataclass(frozen=True)
class ReplayChange:
    """One difference in one look. regression: a named part lost its name, has another one, or has moved."""

    seq: int
    cycle: int | None
    part: str
    what: str
    regression: bool


@dataclass(frozen=True)
class ReplayInputs:
    """Model, calibration and settings of a replay; None: the run's own, and default settings."""

    model: Model | None = None
    rig: StereoRig | None = None
    settings: VisionSettings | None = None


@dataclass(frozen=True, eq=False)
class ReplayedLook:
    """A replayed look. now: today's scene; identical: to the last digit, or, where it followed a part, no change."""

    record: Record
    now: Json
    changes: tuple[ReplayChange, ...]
    identical: bool

    @property
    def then(self) -> Json:
        """The recorded scene."""
        return self.record.get("scene") or {}


def replayed_looks(
    folder: Path, run: Digest, library: FacetLibrary, using: ReplayInputs, chosen: Container[int] | None = None
) -> Iterator[ReplayedLook | str]:
    """Replay the looks of a run; yields each look, or a line of text that says why it cannot be replayed.

    library: facet types for looks before the first model; chosen: looks by seq (None: all). Looks at a calibration
    board are left out. Raises RunError without a kept calibration, ConfigError or ModelError for an unusable kept file.
    """
    rigs: dict[str, StereoRig] = {}
    models: dict[str, Model] = {}
    untaught = empty_model(library)
    settings = (using.settings or VisionSettings()).without_time_limit()
    for record, kept in in_use(run.records):
        if record["kind"] != "look" or record.get("scene") is None:
            continue
        if chosen is not None and record["seq"] not in chosen:
            continue
        rig = using.rig or _rig(folder, kept.get("calibration"), rigs)
        model = using.model or _model(folder, kept.get("model"), models) or untaught
        pair = _pictures(folder, record)
        if pair is None:
            yield f"look {record['seq']}: its pictures are not in the run folder"
            continue
        moved = places_of(record.get("moved"))
        taken_by = rig if moved is None else moved.rig(rig)
        scene = look(*pair, taken_by, model, settings, thread_time, table_of(record.get("table")))
        if moved is not None:
            scene = with_arm_errors(scene, taken_by, moved.arm)
        now, then = scene_json(scene), record.get("scene") or {}
        whole = record.get("whole", True)
        found = compare(then, now, whole, using.model is None)
        changes = tuple(ReplayChange(int(record["seq"]), record.get("cycle"), *change) for change in found)
        yield ReplayedLook(record, now, changes, without_timing(then) == without_timing(now) if whole else not found)


def _rig(folder: Path, kept: str | None, loaded: dict[str, StereoRig]) -> StereoRig:
    """The rig of a kept calibration, read once. Raises RunError without one."""
    if not kept:
        raise RunError(f"{folder}: no calibration was kept with this run; it cannot be replayed")
    if kept not in loaded:
        loaded[kept] = load_calibration(kept_file(folder, kept)).rig
    return loaded[kept]


def _model(folder: Path, kept: str | None, loaded: dict[str, Model]) -> Model | None:
    """A kept model, read once; None before the first model."""
    if kept and kept not in loaded:
        loaded[kept] = load(kept_file(folder, kept))
    return loaded.get(kept or "")


def compare(then: Json, now: Json, whole: bool = True, one_model: bool = True) -> list[tuple[str, str, bool]]:
    """Compare two scenes (scene_json): (part, what changed, whether it is a regression).

    whole: the look sought everything in view. A look that only followed a part had its name and rough pose given, which
    a replay has not: the replay need not name it, nor decide between poses that look the same. one_model: the part's
    origin is the same in both; else corners are compared instead of poses.
    """
    moved_by = part_moved if one_model and whole else corners_moved
    found: list[tuple[str, str, bool]] = []
    for part, match in paired(then, now):
        if part is None or match is None:
            one = part or match or {}
            if whole and one["label"] != UNKNOWN:
                found.append((one["label"], NO_LONGER if match is None else NOT_BEFORE, match is None))
        elif match["label"] != part["label"]:
            if whole or match["label"] != UNKNOWN:
                found.append((part["label"], f"now {match['label']}: {match.get('reason')}", part["label"] != UNKNOWN))
        elif part["label"] != UNKNOWN and (moved := moved_by(part, match)) is not None:
            found.append((part["label"], moved, True))
    return found


def paired(then: Json, now: Json) -> list[tuple[Json | None, Json | None]]:
    """Pair the parts of two scenes by position; None for a part without a partner."""
    pairs: list[tuple[Json | None, Json | None]] = []
    left = list(now.get("parts") or [])
    for part in then.get("parts") or []:
        match = min(left, key=lambda p: centre_distance_mm(part, p), default=None)
        if match is None or centre_distance_mm(part, match) > NEAR_MM:
            match = None
        else:
            left.remove(match)
        pairs.append((part, match))
    return [*pairs, *((None, part) for part in left)]


def apart_mm(then: Json, now: Json) -> float | None:
    """Median distance of the corners of two parts, which need no common origin; None without corners."""
    fewer, more = sorted((_corners(then), _corners(now)), key=len)
    if not len(fewer):
        return None
    return float(np.median(np.linalg.norm(fewer[:, None] - more[None], axis=2).min(axis=1)))


def _corners(part: Json) -> Array:
    corners = [c for f in part.get("facets") or [] for c in f["corners_mm"]]
    return np.array(corners, float).reshape(-1, 3)


def without_timing(scene: Json) -> Json:
    """A scene without its times."""
    return {name: value for name, value in scene.items() if name not in OF_ONE_TIME}


def centre_distance_mm(a: Json, b: Json) -> float:
    """Distance between the middles of two recorded parts, mm; inf where one has no corners."""
    one, other = _corners(a), _corners(b)
    return float(np.linalg.norm(one.mean(axis=0) - other.mean(axis=0))) if len(one) and len(other) else np.inf


def part_moved(then: Json, now: Json) -> str | None:
    """The motion in words where the pose, over all equivalent poses, differs by more than SIGMAS predicted sigmas."""
    if any(one.get("cyclopean_from_part") is None or one.get("covariance") is None for one in (then, now)):
        return None
    reference = np.array(then["cyclopean_from_part"], float)
    sigma = np.sqrt(np.maximum(np.diag(np.array(then["covariance"], float)), 1e-12))
    poses = [now["cyclopean_from_part"], *(now.get("equivalents") or [])]
    motions = [frames.difference(np.array(p, float), reference) for p in poses]
    motion = min(motions, key=lambda m: float(np.max(np.abs(m) / sigma)))
    worst = float(np.max(np.abs(motion) / sigma))
    if worst <= SIGMAS:
        return None
    mm, turn = frames.size(motion)
    return f"moved by {mm:.2f} mm and {np.degrees(turn):.2f} degrees, {worst:.1f} sigma"


def corners_moved(then: Json, now: Json) -> str | None:
    """The motion of the corners in words, where it exceeds SIGMAS of both measurements' errors."""
    mm = apart_mm(then, now)
    if mm is None or any(one.get("covariance") is None for one in (then, now)):
        return None
    spread = sum(np.array(one["covariance"], float)[:3, :3] for one in (then, now))
    sigma = float(np.sqrt(max(np.linalg.eigvalsh(spread)[-1], 1e-12)))
    return None if mm <= SIGMAS * sigma else f"moved by {mm:.2f} mm at its corners, {mm / sigma:.1f} sigma"


def _pictures(folder: Path, record: Record) -> tuple[NDArray[Any], NDArray[Any]] | None:
    names = record.get("images") or {}
    try:
        left, right = (read_as_stored(Path(names[camera]), folder) for camera in ("left", "right"))
    except (FileError, KeyError):
        return None
    return left, right
