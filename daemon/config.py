"""etc/facetd.yaml -> Config. The service's own keys are typed here; another room's settings stay in that room.

Sections `cameras`, `arm.dialect` and the simulated cell belong to drivers and are typed where drivers are named
(daemon/cell/sections.py), through the same Document, so that their errors name file, line and key as well. Paths in the
file are relative to the file. Nothing is opened here but the file itself.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

from msgspec import Meta

from daemon.pick.settings import Settings
from daemon.store import places
from daemon.store.bounds import check_bounds, check_finite
from daemon.store.yamlfile import ConfigError, Document, Key, read
from daemon.vision.settings import VisionSettings

Positive = Annotated[float, Meta(gt=0)]
NotNegative = Annotated[float, Meta(ge=0)]
Count = Annotated[int, Meta(ge=1)]
Kind = Literal["real", "recorded", "simulated"]
Row4 = tuple[float, float, float, float]
Matrix4 = tuple[Row4, Row4, Row4, Row4]
Baud = Annotated[int, Meta(ge=50, le=4_000_000)]


@dataclass(frozen=True, kw_only=True)
class Simulated:
    """The simulated cell: its truth, how much faster than life it runs, the seed of its noise (None: a new one)."""

    truth: str = "simcell.yaml"
    time_scale: Positive = 1.0
    seed: int | None = None


@dataclass(frozen=True, kw_only=True)
class Recorded:
    """A folder of recorded pairs instead of cameras; nothing moves."""

    pairs: str = "pairs"


@dataclass(frozen=True, kw_only=True)
class Arm:
    """The arm's serial line. calibrate_answer: to CAL's question; dialect: its controller's ways;

    flange_from_tool: where the tool centre point is, seen from the wrist centre, mm; VAL II's TOOL is set to it.
    """

    port: str = "/dev/facetd-arm"
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

    calibration: str = "calibration.yaml"
    facets: str = "facets.yaml"
    parts: str = "parts.yaml"
    model: str | None = None


@dataclass(frozen=True, kw_only=True)
class Folders:
    """state: runs, models, taught views; runtime: the socket. None: where systemd says, else var/ of the checkout.

    runs: the run folders, where they are to lie elsewhere than in runs/ of the state.
    """

    state: str | None = None
    runtime: str | None = None
    runs: str | None = None


@dataclass(frozen=True, kw_only=True)
class Terminal:
    """A serial console. may: what it is allowed, `look` (nothing moves, no model changes) or `all`."""

    device: str
    baud: Baud = 9600
    flow_control: bool = False
    may: Literal["look", "all"] = "all"


@dataclass(frozen=True, kw_only=True)
class Console:
    """The operators' doors: the socket's group (None: the daemon's own), and a serial terminal where there is one."""

    group: str | None = None
    tty: Terminal | None = None


@dataclass(frozen=True, kw_only=True)
class Log:
    """How runs are kept: quota, the disk's free floor, when a run goes on in a new folder (MB), sync interval."""

    quota_mb: Count = 4000
    keep_free_mb: Annotated[int, Meta(ge=0)] = 500
    roll_mb: Count = 500
    sync_s: NotNegative = 1.0


@dataclass(frozen=True, kw_only=True)
class Health:
    """When to worry: seconds without a frame or a word from the idle arm, days since the calibration."""

    camera_silence_s: Positive = 10.0
    arm_silence_s: Positive = 30.0
    arm_check_s: Positive = 10.0
    calibration_days: Positive = 90.0


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
    console: Console = field(default_factory=Console)
    log: Log = field(default_factory=Log)
    health: Health = field(default_factory=Health)
    metrics: Metrics = field(default_factory=Metrics)


@dataclass(frozen=True)
class Config:
    """The whole configuration: `values` as the file has it, `document` to name lines in, paths made absolute."""

    values: _File
    document: Document
    kind: Kind

    @property
    def path(self) -> Path:
        """The file it was read from."""
        return self.document.path

    def file(self, name: str) -> Path:
        """A path as the file means it."""
        return (self.path.resolve().parent / Path(name).expanduser()).resolve()

    @property
    def calibration(self) -> Path:
        """calibration.yaml."""
        return self.file(self.values.files.calibration)

    @property
    def state(self) -> Path:
        """The folder of runs, models and taught views."""
        said = self.values.folders.state
        return self.file(said) if said else places.state_folder(self.kind == "simulated")

    @property
    def runs(self) -> Path:
        """The folder of run folders."""
        runs = self.values.folders.runs
        return self.file(runs) if runs else self.state / "runs"

    @property
    def socket(self) -> Path:
        """The operators' socket."""
        said = self.values.folders.runtime
        return (self.file(said) if said else places.runtime_folder(self.kind == "simulated")) / places.SOCKET_NAME


def load_config(path: Path, simulated: bool = False) -> Config:
    """Read and check facetd.yaml; simulated overrides `cell`. Raises ConfigError."""
    document = read(path)
    check_finite(document)
    said = document.convert(_File)
    for check in (check_bounds, _check_guard, _check_files):
        check(document, said)
    return Config(said, document, "simulated" if simulated else said.cell)


def _check_guard(document: Document, values: _File) -> None:
    guard = values.pick.limits
    for axis, low, high in zip("xyz", guard.box_low_mm, guard.box_high_mm, strict=True):
        if low >= high:
            keys: tuple[Key, ...] = ("pick", "limits", "box_low_mm")
            raise document.error(keys, f"expected {axis} below box_high_mm's {high:g}, found {low:g}")


def _check_files(document: Document, values: _File) -> None:
    folder = document.path.resolve().parent
    for name in ("calibration", "facets", "parts", "model"):
        value = getattr(values.files, name)
        if value is not None and not (folder / Path(value).expanduser()).is_file():
            raise document.error(("files", name), f"expected a file, found none at {folder / value}")


__all__ = ["Config", "ConfigError", "load_config"]
