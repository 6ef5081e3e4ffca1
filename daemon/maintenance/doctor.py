"""Check an installation: files, devices, disk, clock, service; each finding with its remedy. Reads only."""

import os
import pwd
import shutil
import stat
import subprocess
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal

from daemon.arm import CameraName, Fault
from daemon.calibration.file import Calibration
from daemon.cell import sections
from daemon.cell.hardware import Hardware
from daemon.config import Config
from daemon.errors import FacetdError
from daemon.events.codes import CauseCode, FaultCause
from daemon.maintenance.troubles import Troubles
from daemon.review import failure_causes
from daemon.store.library import load_facets, load_parts
from daemon.store.model_store import ModelStore
from daemon.store.runs import list_runs

CheckLevel = Literal["good", "note", "bad"]
GOOD_REPROJECTION_PX = 0.5
GOOD_EPIPOLAR_PX = 0.5
EARLIEST_YEAR = 2024
SERVICE_USER = "facetd"
"""Of the unit (debian/facetd.service)."""


@dataclass(frozen=True)
class CheckResult:
    """Result of one check: what was found, and the remedy (mend) where it is not good."""

    level: CheckLevel
    what: str
    found: str
    mend: str = ""

    def line(self) -> str:
        sign = {"good": "ok  ", "note": "note", "bad": "BAD "}[self.level]
        return f"{sign} {self.what}: {self.found}" + (f". {self.mend}" if self.mend else "")


def examine(config: Config, running: bool) -> list[CheckResult]:
    """Run every check that needs no daemon. running: a daemon has the devices open, so these are not tried."""
    findings: list[CheckResult] = []
    for check in CHECKS:
        try:
            findings += check(config, running)
        except (FacetdError, OSError, subprocess.SubprocessError) as error:
            findings.append(CheckResult("bad", check.__name__.removeprefix("_").replace("_", " "), str(error)))
    return findings


def from_service(
    hardware: Hardware,
    troubles: Troubles,
    fault: Fault | None,
    not_held: Mapping[CameraName, Sequence[str]] | None = None,
    shutters: Mapping[CameraName, str] | None = None,
) -> list[CheckResult]:
    """Checks that only the running daemon can make. fault: the active one; not_held: by camera, what it did not hold
    when the command `cameras` tested it; shutters: by camera, what `cameras moving` measured."""
    heard_s = hardware.robot.heard_s
    findings = []
    if "cameras" not in troubles.active:
        findings.append(CheckResult("good", "cameras", hardware.cameras.describe()))
    if not_held is None and hardware.kind != "recorded":
        mend = "Type `cameras`, with parts in view and nothing moving"
        findings.append(CheckResult("note", "cameras", "not tested whether they hold exposure and focus", mend))
    if not shutters and hardware.kind == "real":
        mend = "Type `cameras moving`, and move a newspaper in front of them"
        findings.append(CheckResult("note", "cameras", "not tested for a rolling shutter", mend))
    for camera, shutter in (shutters or {}).items():
        findings.append(CheckResult("note" if shutter.startswith("rolling") else "good", f"{camera} camera", shutter))
    for camera, whys in (not_held or {}).items():
        findings += [CheckResult("bad", f"{camera} camera", why) for why in whys]
    if "controller" not in troubles.active and heard_s is not None:
        ago = f"answered {hardware.clock() - heard_s:.0f} s ago at {hardware.where}"
        findings.append(CheckResult("good", "controller", ago))
    if fault is not None:
        mend = remedy_of(fault.cause) or "Remove the cause, then `resume`"
        findings.append(CheckResult("bad", "fault", fault.text, mend))
    for source, text in troubles.active.items():
        mend = remedy_of(troubles.causes.get(source, FaultCause(CauseCode.INTERNAL)))
        findings.append(CheckResult("bad", source, text.removeprefix(f"{source}: "), mend))
    return findings


def remedy_of(cause: FaultCause) -> str:
    """The remedy for a fault or a trouble, from its cause; empty for an unknown cause or an operator's stop."""
    code = next(failure_causes.causes_of_record({"code": cause.code, "findings": cause.findings})).code
    return "" if code.stage == "operator" or code is CauseCode.INTERNAL else code.remedy


def _configuration(config: Config, _: bool) -> Iterator[CheckResult]:
    sections.check(config)
    load_facets(config.file(config.values.files.facets))
    load_parts(config.file(config.values.files.parts))
    yield CheckResult("good", "configuration", f"{config.path} ({config.kind} cell)")
    for note in dict.fromkeys((*config.notes, *sections.out_of_reach(config))):
        yield CheckResult("note", "configuration", note)


def _calibration(config: Config, _: bool) -> Iterator[CheckResult]:
    calibration = sections.calibration_in_use(config)
    sections.check_hand_eye(config, calibration)
    for wrong in sections.of_another_size(config, calibration):
        yield CheckResult("bad", "calibration", wrong)
    quality = calibration.quality
    yield _calibration_age(config, calibration)
    for name, value, good in (
        ("reprojection", quality.reprojection_px, GOOD_REPROJECTION_PX),
        ("epipolar", quality.epipolar_px, GOOD_EPIPOLAR_PX),
    ):
        if value is not None and value > good:
            found = f"{name} error {value:.2f} px, more than {good}"
            yield CheckResult("bad", "calibration", found, "Repeat the calibration")
    if calibration.hand_eye is None:
        mend = "Run `facetctl calibrate hand-eye`; until then only `robot` can move the arm"
        yield CheckResult("bad", "calibration", f"{config.calibration} has no hand_eye", mend)


def _calibration_age(config: Config, calibration: Calibration) -> CheckResult:
    made = calibration.quality.made
    if made is None:
        return CheckResult("note", "calibration", f"{config.calibration} does not say when it was made")
    made = made if made.tzinfo else made.replace(tzinfo=UTC)
    days = (datetime.now(UTC) - made).total_seconds() / 86400
    if days > config.values.health.calibration_days:
        return CheckResult("note", "calibration", f"{days:.0f} days old", "Verify it: `facetctl calibrate verify`")
    return CheckResult("good", "calibration", f"{config.calibration}, {max(days, 0):.0f} days old")


def _model(config: Config, _: bool) -> Iterator[CheckResult]:
    model_store = ModelStore(config.state)
    if model_store.current is None:
        yield CheckResult("note", "model", "no model is in use yet", "Make one: `teach LABEL`, `train`, `accept`")
    else:
        labels = ", ".join(model_store.load(model_store.current).model.labels)
        yield CheckResult("good", "model", f"version {model_store.current} with the parts {labels}")
    for view in model_store.views():
        if view.damage:
            yield CheckResult("bad", "views", view.damage)


def _cameras(config: Config, running: bool) -> Iterator[CheckResult]:
    if config.kind != "real":
        return
    settings = sections.camera_settings(config)
    for path in settings.devices.values():
        yield from _device(f"camera {path}", path, "video", running) if path.startswith("/") else ()


def _serial_ports(config: Config, running: bool) -> Iterator[CheckResult]:
    if config.kind == "real":
        yield from _device("controller port", config.values.arm.port, "dialout", running)
    if (tty := config.values.console.tty) is not None:
        yield from _device("console port", tty.device, "dialout", running)


def _device(what: str, path: str, group: str, running: bool) -> Iterator[CheckResult]:
    """Check that a device exists, is a device, may be used, and is free."""
    try:
        mode = os.stat(path).st_mode
    except OSError as error:
        mend = "Plug it in; check that the udev rules (deploy/60-facetd.rules) name it"
        yield CheckResult("bad", what, f"{path}: {error.strerror}", mend)
        return
    if not stat.S_ISCHR(mode):
        yield CheckResult("bad", what, f"{path} is not a device", "Name the device in facetd.yaml")
    elif not os.access(path, os.R_OK | os.W_OK):
        yield CheckResult("bad", what, f"{path}: no permission", f"Put the daemon's user into the group {group}")
    elif not running and (holders := _holders(path)):
        yield CheckResult("bad", what, f"{path} is in use by {', '.join(holders)}", "Stop that program")
    else:
        yield CheckResult("good", what, path)


def _holders(path: str) -> list[str]:
    """Programs that have a device open, as far as this user may know."""
    target, found = os.path.realpath(path), []
    for process in Path("/proc").glob("[0-9]*"):
        try:
            if any(os.readlink(handle) == target for handle in (process / "fd").iterdir()):
                found.append(f"{(process / 'comm').read_text().strip()} ({process.name})")
        except OSError:
            continue
    return found


def _daemon_may_write(folder: Path) -> bool:
    """Whether the present user may write there, or it is the service's folder, which an operator only reads."""
    if os.access(folder, os.W_OK):
        return True
    try:
        return pwd.getpwuid(folder.stat().st_uid).pw_name == SERVICE_USER
    except KeyError:
        return False


def _disk(config: Config, _: bool) -> Iterator[CheckResult]:
    """Check the disk of the runs, and that of the state where it is another."""
    folders = [next(p for p in (one, *one.parents) if p.exists()) for one in (config.runs, config.state)]
    disks = {os.stat(folder).st_dev: folder for folder in folders}
    free_mb = {disk: shutil.disk_usage(folder).free / 1e6 for disk, folder in disks.items()}
    good = True
    for disk, folder in disks.items():
        if not _daemon_may_write(folder):
            good = False
            yield CheckResult("bad", "disk", f"{folder} cannot be written", "The daemon's user must own it")
        elif free_mb[disk] < config.values.log.keep_free_mb:
            good = False
            mend = "Free disk space; facetd removes only old runs (log.quota_mb)"
            yield CheckResult("bad", "disk", f"{free_mb[disk]:.0f} MB free in {folder}", mend)
    if good:
        runs = len(list_runs(config.runs))
        count = "1 run" if runs == 1 else f"{runs} runs"
        free = next(iter(free_mb.values()))
        yield CheckResult("good", "disk", f"{free:.0f} MB free, {count} in {config.runs}")


def _clock(config: Config, _: bool) -> Iterator[CheckResult]:
    year = datetime.now(UTC).year
    newest = max((run.stat().st_mtime for run in list_runs(config.runs)), default=0.0)
    if year < EARLIEST_YEAR or newest > time.time() + 60:
        found = f"the clock shows {datetime.now(UTC):%Y-%m-%d %H:%M} UTC, which is wrong"
        mend = "Set it, or enable systemd-timesyncd; the times in the run log depend on it"
        yield CheckResult("bad", "clock", found, mend)
    else:
        yield CheckResult("good", "clock", f"{datetime.now(UTC):%Y-%m-%d %H:%M} UTC")


def _unit(_: Config, __: bool) -> Iterator[CheckResult]:
    if not Path("/run/systemd/system").is_dir() or shutil.which("systemctl") is None:
        yield CheckResult("note", "unit", "this machine does not run systemd; the daemon is started by hand")
        return
    shown = subprocess.run(
        ["systemctl", "show", "facetd.service", "-p", "LoadState,ActiveState,UnitFileState,NRestarts"],
        capture_output=True, text=True, timeout=5, check=False,
    )  # fmt: skip
    unit = dict(line.split("=", 1) for line in shown.stdout.splitlines() if "=" in line)
    if unit.get("LoadState") != "loaded":
        mend = "Install the package: sudo apt install ./facetd_*.deb"
        yield CheckResult("note", "unit", "facetd.service is not installed", mend)
    else:
        restarts = unit.get("NRestarts", "0")
        level: CheckLevel = "bad" if unit.get("ActiveState") == "failed" or restarts not in ("", "0") else "good"
        found = f"{unit.get('ActiveState')}, {unit.get('UnitFileState')}, restarted {restarts} times"
        yield CheckResult(level, "unit", found, "" if level == "good" else "See `journalctl -u facetd -b`")


CHECKS: tuple[Callable[[Config, bool], Iterator[CheckResult]], ...] = (
    _configuration, _calibration, _model, _cameras, _serial_ports, _disk, _clock, _unit,
)  # fmt: skip
