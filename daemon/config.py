"""etc/facetd.yaml -> Config. The service's own keys are typed here; another room's settings stay in that room.

Sections `cameras`, `arm.dialect` and the simulated cell belong to drivers and are typed where drivers are named
(daemon/cell/sections.py), through the same Document, so that their errors name file, line and key as well. Paths in the
file are relative to the file. Nothing is opened here but the file itself, and what says which calibration is in use.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal

from msgspec import Meta

from daemon.pick.settings import Settings
from daemon.quantities import Coordinate, Name
from daemon.store import places
from daemon.store.calibrations import Calibrations, CalibrationsError
from daemon.store.yamlfile import ConfigError, Document, read
from daemon.vision.settings import MemorySettings, VisionSettings

Kind = Literal["real", "recorded", "simulated"]
Row4 = tuple[Coordinate, Coordinate, Coordinate, Coordinate]
Matrix4 = tuple[Row4, Row4, Row4, Row4]
Baud = Annotated[int, Meta(ge=50, le=4_000_000)]
Megabytes = Annotated[int, Meta(ge=1, le=100_000_000)]
Silence = Annotated[float, Meta(gt=0, le=86_400)]
FIXED = "it is fixed now; delete the line"
CALIBRATED = "the calibration says it of itself (`quality` in calibration.yaml); delete the line"
GONE = {
    "health.arm_silence_s": "an idle arm is asked every `arm_check_s`; delete the line",
    **dict.fromkeys((f"pick.doubt.{name}" for name in ("hand_eye_mm", "hand_eye_deg", "pixels")), CALIBRATED),
    **dict.fromkeys((f"pick.{name}" for name in ("gone_mm", "views_of_doubtful", "epipolar_limit_px")), FIXED),
    **dict.fromkeys((f"vision.{name}" for name in (
        "shrinks", "levels", "faintest", "max_corners", "max_regions", "alike", "min_evidence", "min_support",
        "min_seen", "search_epipolar_px")), FIXED),
}  # fmt: skip
"""Keys that files of earlier versions may have, and what became of each. Their values are the fields' defaults."""


@dataclass(frozen=True, kw_only=True)
class Simulated:
    """The simulated cell: its truth, how much faster than life it runs, the seed of its noise (None: a new one), and
    whether its table has a pattern and the parts on it are printed on, and the file to which its judge writes what the
    arm did that it must never do (None: nowhere).
    """

    truth: Name = "simcell.yaml"
    time_scale: Annotated[float, Meta(gt=0, le=1000)] = 1.0
    seed: Annotated[int, Meta(ge=0, le=10**15)] | None = None
    table: Literal["plain", "patterned"] = "plain"
    parts: Literal["plain", "printed"] = "plain"
    verdict: Name | None = None


@dataclass(frozen=True, kw_only=True)
class Recorded:
    """A folder of recorded pairs instead of cameras; nothing moves."""

    pairs: Name = "pairs"


@dataclass(frozen=True, kw_only=True)
class Arm:
    """The arm's serial line. calibrate_answer: to CAL's question; dialect: its controller's ways;

    flange_from_tool: where the tool centre point is, seen from the wrist centre, mm; VAL II's TOOL is set to it.
    file: arm.yaml, as `facetctl arm introduce` writes it: the controller's ways and the arm's geometry (None: a PUMA
    560 and the dialect's defaults); what dialect says here goes before it.
    """

    port: Name = "/dev/facetd-arm"
    file: Name | None = None
    calibrate_answer: Literal["Y", "N"] = "Y"
    dialect: dict[str, Any] = field(default_factory=dict)
    flange_from_tool: Matrix4 = (
        (1.0, 0.0, 0.0, 0.0),
        (0.0, 1.0, 0.0, 0.0),
        (0.0, 0.0, 1.0, 130.0),
        (0.0, 0.0, 0.0, 1.0),
    )


@dataclass(frozen=True, kw_only=True)
class Files:
    """calibration, facets, parts; model: what to start from while no model was accepted here yet (None: nothing)."""

    calibration: Name = "calibration.yaml"
    facets: Name = "facets.yaml"
    parts: Name = "parts.yaml"
    model: Name | None = None


@dataclass(frozen=True, kw_only=True)
class Folders:
    """state: runs, models, taught views; runtime: the socket. None: as daemon/store/places.py says.

    runs: the run folders, where they are to lie elsewhere than in runs/ of the state.
    """

    state: Name | None = None
    runtime: Name | None = None
    runs: Name | None = None


@dataclass(frozen=True, kw_only=True)
class Terminal:
    """A serial console. may: what it is allowed, `look` (nothing moves, no model changes) or `all`."""

    device: Name
    baud: Baud = 9600
    flow_control: bool = False
    may: Literal["look", "all"] = "all"


@dataclass(frozen=True, kw_only=True)
class Console:
    """The operators' doors: the socket's group (None: the daemon's own), a group whose members may only look (None:
    nobody else comes in), and a serial terminal where there is one."""

    group: Name | None = None
    look_group: Name | None = None
    tty: Terminal | None = None


@dataclass(frozen=True, kw_only=True)
class Log:
    """How runs are kept: quota, the disk's free floor, when a run goes on in a new folder (MB), sync interval."""

    quota_mb: Megabytes = 4000
    keep_free_mb: Annotated[int, Meta(ge=0, le=100_000_000)] = 500
    roll_mb: Megabytes = 500
    sync_s: Annotated[float, Meta(ge=0, le=3600)] = 1.0


@dataclass(frozen=True, kw_only=True)
class Health:
    """When to worry: seconds without a frame, how often an idle arm is asked, days since the calibration."""

    camera_silence_s: Silence = 10.0
    arm_check_s: Silence = 10.0
    calibration_days: Annotated[float, Meta(gt=0, le=36_500)] = 90.0


@dataclass(frozen=True, kw_only=True)
class Metrics:
    """Prometheus text on the loopback interface; off without a port."""

    port: Annotated[int, Meta(ge=1024, le=65535)] | None = None


@dataclass(frozen=True, kw_only=True)
class _File:
    version: Literal[1]
    cell: Kind = "real"
    simulated: Simulated = field(default_factory=Simulated)
    recorded: Recorded = field(default_factory=Recorded)
    cameras: dict[str, Any] = field(default_factory=dict)
    arm: Arm = field(default_factory=Arm)
    files: Files = field(default_factory=Files)
    folders: Folders = field(default_factory=Folders)
    pick: Settings = field(default_factory=Settings)
    vision: VisionSettings = field(default_factory=VisionSettings)
    memory: MemorySettings = field(default_factory=MemorySettings)
    console: Console = field(default_factory=Console)
    log: Log = field(default_factory=Log)
    health: Health = field(default_factory=Health)
    metrics: Metrics = field(default_factory=Metrics)


@dataclass(frozen=True)
class Config:
    """The whole configuration: `values` as the file has it, `document` to name lines in, paths made absolute.

    calibration: the file in use, the configuration's or one made here; notes: a line for each key in the file that is
    no longer one, and for what else is not as it may seem.
    """

    values: _File
    document: Document
    kind: Kind
    calibration: Path = field(default_factory=Path)
    notes: tuple[str, ...] = ()

    @property
    def path(self) -> Path:
        """The file it was read from."""
        return self.document.path

    def file(self, name: str) -> Path:
        """A path as the file means it."""
        return (self.path.resolve().parent / Path(name).expanduser()).resolve()

    @property
    def calibrations(self) -> Calibrations:
        """Those made here, and the one that the file names."""
        return Calibrations(self.state, self.kind, self.file(self.values.files.calibration))

    @property
    def state(self) -> Path:
        """The folder of runs, models and taught views."""
        state = self.values.folders.state
        return self.file(state) if state else places.state_folder(self.kind == "simulated")

    @property
    def runs(self) -> Path:
        """The folder of run folders."""
        runs = self.values.folders.runs
        return self.file(runs) if runs else self.state / "runs"

    @property
    def socket(self) -> Path:
        """The operators' socket."""
        runtime = self.values.folders.runtime
        folder = self.file(runtime) if runtime else places.runtime_folder(self.kind == "simulated")
        return folder / places.SOCKET_NAME


def load_config(path: Path, simulated: bool = False) -> Config:
    """Read and check facetd.yaml; simulated overrides `cell`. Raises ConfigError."""
    document, notes = read(path).without(GONE)
    values = document.convert(_File)
    for check in (_check_limits, _check_stops, _check_depth, _check_files):
        check(document, values)
    config = Config(values, document, "simulated" if simulated else values.cell)
    try:
        made, old = config.calibrations.in_use, config.calibrations.passed_over
    except CalibrationsError as error:
        raise ConfigError(str(error)) from None
    if old is not None:
        notes.append(f"{made} is another than it was: it is used, not calibration {old} (`calibrate use {old}`)")
    return replace(config, calibration=made, notes=tuple(notes))


def _check_limits(document: Document, values: _File) -> None:
    limits = values.pick.limits
    boxes = {"box": (limits.box_low_mm, limits.box_high_mm), "room": (limits.room_low_mm, limits.room_high_mm)}
    for name, (lows, highs) in boxes.items():
        for axis, low, high in zip("xyz", lows, highs, strict=True):
            if low >= high:
                keys = ("pick", "limits", f"{name}_low_mm")
                raise document.error(keys, f"expected {axis} below {name}_high_mm's {high:g}, found {low:g}")


def _check_stops(document: Document, values: _File) -> None:
    stops = values.pick.stops
    if list(stops.stand_offs_mm) != sorted(stops.stand_offs_mm, reverse=True):
        problem = f"expected distances, far to near, found {list(stops.stand_offs_mm)}"
        raise document.error(("pick", "stops", "stand_offs_mm"), problem)
    if stops.most_looks < stops.least_looks:
        found = f"{stops.most_looks}, less than least_looks' {stops.least_looks}"
        raise document.error(("pick", "stops", "most_looks"), f"expected at least as many looks, found {found}")


def _check_depth(document: Document, values: _File) -> None:
    near, far = values.vision.depth_range_mm
    if near >= far:
        problem = f"expected the near end first, found {near:g} and {far:g}"
        raise document.error(("vision", "depth_range_mm"), problem)


def _check_files(document: Document, values: _File) -> None:
    folder = document.path.resolve().parent
    for name in ("calibration", "facets", "parts", "model"):
        value = getattr(values.files, name)
        if value is not None and not (folder / Path(value).expanduser()).is_file():
            raise document.error(("files", name), f"expected a file, found none at {folder / value}")


__all__ = ["Config", "ConfigError", "load_config"]
