"""Read facetd.yaml into Config: the service's own keys with type, bounds and meaning; other packages add theirs.

daemon/cell/sections.py types the sections `cameras`, `arm.dialect` and the simulated cell, which belong to drivers,
from the same Document, so that their errors name file, line and key too. Paths in the file are relative to the file.
"""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal

from msgspec import Meta

from daemon.arm import ARM, BODY_MM
from daemon.pick.grippers import SuctionCup, TwoFingers
from daemon.pick.settings import Settings
from daemon.quantities import Coordinate, Name
from daemon.signals.settings import VALVES, ModbusSettings, SignalSettings, check_signals
from daemon.store import folders
from daemon.store.calibrations import Calibrations
from daemon.store.job_file import FOLDER as JOBS
from daemon.store.mounted_gripper import MountedGripper, load_mounted
from daemon.store.place_file import FILE as PLACES
from daemon.store.place_file import CellPlaces, load_places
from daemon.store.yamlfile import Document, read
from daemon.vision.settings import MemorySettings, VisionSettings

Row4 = tuple[Coordinate, Coordinate, Coordinate, Coordinate]
Matrix4 = tuple[Row4, Row4, Row4, Row4]
TOOL: Matrix4 = ((1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 130.0), (0.0, 0.0, 0.0, 1.0))
Baud = Annotated[int, Meta(ge=50, le=4_000_000)]
GripperName = Annotated[str, Meta(pattern="^[a-z][a-z0-9_]{0,39}$")]
Megabytes = Annotated[int, Meta(ge=1, le=100_000_000)]
Silence = Annotated[float, Meta(gt=0, le=86_400)]
FIXED = "it is fixed now; delete the line"
CALIBRATED = "the calibration says it of itself (`quality` in calibration.yaml); delete the line"
OBSOLETE = {
    "health.arm_silence_s": "an idle arm is asked every `arm_check_s`; delete the line",
    **dict.fromkeys((f"pick.doubt.{name}" for name in ("hand_eye_mm", "hand_eye_deg", "pixels")), CALIBRATED),
    **dict.fromkeys((f"pick.{name}" for name in ("gone_mm", "views_of_doubtful", "epipolar_limit_px")), FIXED),
    **dict.fromkeys((f"vision.{name}" for name in (
        "shrinks", "levels", "faintest", "max_corners", "max_regions", "alike", "min_evidence", "min_support",
        "min_seen", "search_epipolar_px")), FIXED),
}  # fmt: skip
"""Keys of earlier versions, with what became of each."""


@dataclass(frozen=True, kw_only=True)
class SimulatedSettings:
    """The simulated cell: what it is like, how fast it runs, what its table and parts look like."""

    truth: Name = "simcell.yaml"
    """File that says what the simulated cell is really like: kinematics, lenses, noise, light."""
    time_scale: Annotated[float, Meta(gt=0, le=1000)] = 1.0
    """How many seconds pass in the cell for each real second."""
    seed: Annotated[int, Meta(ge=0, le=10**15)] | None = None
    """Seed of the noise and of how parts fall. Unset: a new seed at each start; `status` shows it."""
    table: Literal["plain", "patterned"] = "plain"
    """What the parts lie on: a plain surface, or wood, a belt, bands and concrete."""
    parts: Literal["plain", "printed"] = "plain"
    """What the parts look like: plain faces, or text, labels, stripes, dots and scratches."""
    verdict: Name | None = None
    """File in which the independent motion monitor records when the arm set out and each forbidden motion. Unset:
    none."""


@dataclass(frozen=True, kw_only=True)
class RecordedSettings:
    """Recorded stereo pairs instead of cameras; nothing moves."""

    pairs: Name = "pairs"
    """Folder of recorded pairs, each a folder with left.png and right.png."""


@dataclass(frozen=True, kw_only=True)
class ArmSettings:
    """The arm: its serial line, its controller's dialect, its tool."""

    port: Name = "/dev/facetd-arm"
    """Serial port of the VAL II controller."""
    file: Name | None = None
    """arm.yaml, as the first contact with the controller writes it: dialect and arm geometry. `arm.dialect` overrides
    it. Unset: a PUMA 560 and the defaults of `arm.dialect`."""
    calibrate_answer: Literal["Y", "N"] = "Y"
    """Answer to the question that the controller asks after CAL."""
    dialect: dict[str, Any] = field(default_factory=dict)
    """How this controller speaks on the line."""
    flange_from_tool: Matrix4 = TOOL
    """Pose of the tool centre point in the frame of the wrist centre, 4x4, mm. facetd sets VAL II's TOOL to it."""


@dataclass(frozen=True, kw_only=True)
class KnownGripper:
    """A gripper that may be mounted, by its name. The first of several is the one with which the hand-eye pose was
    calibrated, where calibration.yaml does not say with which. Cameras on the hand stay there as grippers change."""

    gripper: TwoFingers | SuctionCup = field(default_factory=TwoFingers)
    """Its kind and dimensions."""
    flange_from_tool: Matrix4 = TOOL
    """Pose of its tool centre point in the frame of the wrist centre, 4x4, mm. facetd sets VAL II's TOOL to it."""


@dataclass(frozen=True, kw_only=True)
class FilesSettings:
    """The files that the daemon reads at start, relative to facetd.yaml."""

    calibration: Name = "calibration.yaml"
    """Calibration of the cameras and of the hand-eye pose, until a calibration made on this cell replaces it."""
    facets: Name = "facets.yaml"
    """Library of 2-D facet types."""
    parts: Name = "parts.yaml"
    """Names of the parts, their ART-b codes and how to grasp them."""
    model: Name | None = None
    """Model to start from until one is accepted on this cell. Unset: none; begin by teaching."""


@dataclass(frozen=True, kw_only=True)
class FolderSettings:
    """Where the daemon keeps its own files. Unset: the defaults of daemon/store/folders.py."""

    state: Name | None = None
    """Folder of runs, models, taught views and calibrations. Unset: systemd's state directory, else var/ of the
    checkout. `facetd --sim` where facetd is installed: ~/.local/state/facetd."""
    runtime: Name | None = None
    """Folder of the operators' socket. Unset: systemd's runtime directory, else var/ of the checkout."""
    runs: Name | None = None
    """Folder of the run folders. Unset: runs/ of the state folder."""


@dataclass(frozen=True, kw_only=True)
class SerialTerminalSettings:
    """A serial terminal for operators."""

    device: Name
    """Serial port of the terminal."""
    baud: Baud = 9600
    """Speed of the line, bits per second."""
    flow_control: bool = False
    """Whether the terminal uses XON and XOFF."""
    may: Literal["look", "all"] = "all"
    """What is allowed there: everything, or only commands that move nothing and change nothing (and those that
    stop)."""


@dataclass(frozen=True, kw_only=True)
class ConsoleSettings:
    """Who may give commands, and from where."""

    group: Name | None = None
    """Group whose members may give every command at the socket. Unset: the daemon's own group."""
    look_group: Name | None = None
    """Group whose members may only look, and stop the arm. Unset: nobody else is let in."""
    tty: SerialTerminalSettings | None = None
    """Serial terminal for operators. Unset: none."""


@dataclass(frozen=True, kw_only=True)
class LogSettings:
    """How runs are kept."""

    quota_mb: Megabytes = 4000
    """Most that all runs together may take, MB. The oldest runs are removed first, runs with failures last."""
    keep_free_mb: Annotated[int, Meta(ge=0, le=100_000_000)] = 500
    """Least free space on the disk, MB. Below it the oldest runs are removed."""
    roll_mb: Megabytes = 500
    """Size at which a run continues in a new folder, MB."""
    sync_s: Annotated[float, Meta(ge=0, le=3600)] = 1.0
    """Longest time that records may wait to be synced to the disk, s. Faults and grasps are synced at once."""


@dataclass(frozen=True, kw_only=True)
class HealthSettings:
    """When the daemon reports that a device or a calibration needs attention."""

    camera_silence_s: Silence = 10.0
    """Time without a frame after which a camera counts as lost, s."""
    arm_check_s: Silence = 10.0
    """How often an idle arm is asked where it is, s."""
    calibration_days: Annotated[float, Meta(gt=0, le=36_500)] = 90.0
    """Age of a calibration from which `doctor` asks to verify it, days."""


@dataclass(frozen=True, kw_only=True)
class MetricsSettings:
    """Prometheus metrics on the loopback interface."""

    port: Annotated[int, Meta(ge=1024, le=65535)] | None = None
    """Port on 127.0.0.1. Unset: no metrics. Needs the extra `metrics`."""


@dataclass(frozen=True, kw_only=True)
class ConfigFile:
    """The file's version, the kind of cell, and the sections."""

    version: Literal[1]
    """Version of the file's format."""
    cell: Name = "real"
    """`real`: V4L2 cameras and a VAL II controller. `linuxcnc`: the same cameras and LinuxCNC. `recorded`: pairs from a
    folder, nothing moves. `simulated`: all of it simulated; `facetd --sim` does the same for one start. Or the name of
    a back-end that is installed beside facetd."""
    backend: dict[str, Any] = field(default_factory=dict)
    """Settings of LinuxCNC, below; those of a back-end that is installed beside facetd are in its own documentation."""
    simulated: SimulatedSettings = field(default_factory=SimulatedSettings)
    recorded: RecordedSettings = field(default_factory=RecordedSettings)
    cameras: dict[str, Any] = field(default_factory=dict)
    arm: ArmSettings = field(default_factory=ArmSettings)
    files: FilesSettings = field(default_factory=FilesSettings)
    folders: FolderSettings = field(default_factory=FolderSettings)
    pick: Settings = field(default_factory=Settings)
    vision: VisionSettings = field(default_factory=VisionSettings)
    memory: MemorySettings = field(default_factory=MemorySettings)
    console: ConsoleSettings = field(default_factory=ConsoleSettings)
    log: LogSettings = field(default_factory=LogSettings)
    health: HealthSettings = field(default_factory=HealthSettings)
    metrics: MetricsSettings = field(default_factory=MetricsSettings)
    signals: dict[str, SignalSettings] = field(default_factory=dict)
    modbus: ModbusSettings | None = None
    grippers: dict[GripperName, KnownGripper] = field(default_factory=dict)


@dataclass(frozen=True)
class Config:
    """The configuration: `values` of the file, `document` for errors with line numbers, absolute paths.

    `values` has the mounted gripper, of the section `grippers` where there is one, in arm.flange_from_tool and
    pick.gripper. calibration: the file in use, the configured one or one made on this cell; places: those of
    places.yaml in the state folder; mounted: what a person said of that section; notes: a line for each obsolete key,
    and for other surprises.
    """

    values: ConfigFile
    document: Document
    kind: str
    calibration: Path = field(default_factory=Path)
    places: CellPlaces = field(default_factory=CellPlaces)
    mounted: MountedGripper | None = None
    notes: tuple[str, ...] = ()

    @property
    def path(self) -> Path:
        """The configuration file."""
        return self.document.path

    @property
    def gripper(self) -> str | None:
        """Name of the mounted gripper; None: it is unknown which of several it is, and the first is assumed."""
        names, mounted = self.values.grippers, self.mounted
        if len(names) <= 1:
            return next(iter(names), kind_of(self.values.pick.gripper))
        return mounted.name if mounted is not None and mounted.name in names else None

    def each_gripper(self) -> dict[str, "Config"]:
        """The configuration with each gripper of the section `grippers` mounted, by name; itself without that
        section."""
        names = self.values.grippers
        return {name: with_mounted(self, MountedGripper(name, "", "")) for name in names} or {"": self}

    @property
    def calibrated_tool(self) -> Matrix4:
        """flange_from_tool of the hand-eye pose, where calibration.yaml does not say it: the first gripper's."""
        first = next(iter(self.values.grippers.values()), None)
        return self.values.arm.flange_from_tool if first is None else first.flange_from_tool

    def file(self, name: str) -> Path:
        """The absolute path of a path in the file."""
        return (self.path.resolve().parent / Path(name).expanduser()).resolve()

    @property
    def calibrations(self) -> Calibrations:
        """The calibrations made on this cell, and the configured one."""
        return Calibrations(self.state, self.kind, self.file(self.values.files.calibration))

    @property
    def state(self) -> Path:
        """The folder of runs, models and taught views."""
        state = self.values.folders.state
        return self.file(state) if state else folders.state_folder(self.kind == "simulated")

    @property
    def places_file(self) -> Path:
        """Where each part belongs."""
        return self.state / PLACES

    @property
    def jobs(self) -> Path:
        """The folder of job files."""
        return self.path.resolve().parent / JOBS

    @property
    def runs(self) -> Path:
        runs = self.values.folders.runs
        return self.file(runs) if runs else self.state / "runs"

    @property
    def socket(self) -> Path:
        runtime = self.values.folders.runtime
        folder = self.file(runtime) if runtime else folders.runtime_folder(self.kind == "simulated")
        return folder / folders.SOCKET_NAME


def load_config(path: Path, simulated: bool = False) -> Config:
    """Read and check facetd.yaml; simulated overrides `cell`. Raises ConfigError."""
    document, notes = read(path).without(OBSOLETE)
    values = document.convert(ConfigFile)
    for check in (_check_limits, _check_stops, _check_depth, _check_files):
        check(document, values)
    check_signals(document, values.signals, values.modbus)
    config = Config(values, document, "simulated" if simulated else values.cell)
    if values.grippers:
        config = with_mounted(config, load_mounted(config.state))
        notes += [] if config.gripper else [gripper_unknown(config)]
    _check_valves(config)
    made, old = config.calibrations.in_use, config.calibrations.passed_over
    if old is not None:
        notes.append(
            f"{made} has changed: it is in use instead of calibration {old}; go back with `calibrate use {old}`"
        )
    return replace(config, calibration=made, places=load_places(config.places_file), notes=tuple(notes))


def with_mounted(config: Config, mounted: MountedGripper | None) -> Config:
    """The configuration with that gripper of the section `grippers`, which must exist; with the first one while it is
    unknown. Raises ConfigError."""
    values, document = config.values, config.document
    for keys in (("pick", "gripper"), ("arm", "flange_from_tool")):
        if document.has(keys):
            raise document.error(
                keys, "expected this key for each gripper of the section grippers, and not here: delete it here"
            )
    limits = values.pick.limits
    if limits.capsules != ARM and any(piece.link == "tool" for piece in limits.capsules):
        problem = "expected no piece with the link tool beside the section grippers: give what stays the link wrist"
        raise document.error(("pick", "limits", "capsules"), problem)
    if limits.body_mm != BODY_MM:
        problem = "expected none beside the section grippers: give what stays as capsules with the link wrist"
        raise document.error(("pick", "limits", "body_mm"), problem)
    config = replace(config, mounted=mounted)
    one = values.grippers[config.gripper or next(iter(values.grippers))]
    arm, pick = replace(values.arm, flange_from_tool=one.flange_from_tool), replace(values.pick, gripper=one.gripper)
    return replace(config, values=replace(values, arm=arm, pick=pick))


def _check_valves(config: Config) -> None:
    valves = [name for name, signal in config.values.signals.items() if signal.role in VALVES]
    if valves and not any(each.values.pick.gripper.by_vacuum for each in config.each_gripper().values()):
        problem = "expected a gripper with `kind: suction`, whose valve this is; found none"
        raise config.document.error(("signals", valves[0], "role"), problem)


def gripper_unknown(config: Config) -> str:
    """The message that it is unknown which gripper is mounted, and what to do."""
    before = "" if config.mounted is None else f"{config.mounted.name} is no longer in the section grippers; "
    names = ", ".join(config.values.grippers)
    return f"the mounted gripper is unknown: {before}type `gripper use NAME` ({names})"


def kind_of(gripper: TwoFingers | SuctionCup) -> str:
    """The word of its kind, as in facetd.yaml."""
    return str(type(gripper).__struct_config__.tag)


def _check_limits(document: Document, values: ConfigFile) -> None:
    limits = values.pick.limits
    boxes = {"box": (limits.box_low_mm, limits.box_high_mm), "room": (limits.room_low_mm, limits.room_high_mm)}
    for name, (lows, highs) in boxes.items():
        for axis, low, high in zip("xyz", lows, highs, strict=True):
            if low >= high:
                keys = ("pick", "limits", f"{name}_low_mm")
                raise document.error(keys, f"expected {axis} below {name}_high_mm's {high:g}, found {low:g}")


def _check_stops(document: Document, values: ConfigFile) -> None:
    stops = values.pick.stops
    if list(stops.stand_offs_mm) != sorted(stops.stand_offs_mm, reverse=True):
        problem = f"expected distances, far to near, found {list(stops.stand_offs_mm)}"
        raise document.error(("pick", "stops", "stand_offs_mm"), problem)
    if stops.most_looks < stops.least_looks:
        found = f"{stops.most_looks}, less than least_looks' {stops.least_looks}"
        raise document.error(("pick", "stops", "most_looks"), f"expected at least as many looks, found {found}")


def _check_depth(document: Document, values: ConfigFile) -> None:
    near, far = values.vision.depth_range_mm
    if near >= far:
        problem = f"expected the near end first, found {near:g} and {far:g}"
        raise document.error(("vision", "depth_range_mm"), problem)


def _check_files(document: Document, values: ConfigFile) -> None:
    folder = document.path.resolve().parent
    for name in ("calibration", "facets", "parts", "model"):
        value = getattr(values.files, name)
        if value is not None and not (folder / Path(value).expanduser()).is_file():
            raise document.error(("files", name), f"expected a file, found none at {folder / value}")
