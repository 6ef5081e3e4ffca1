"""The doctor's findings: what is well, what is not, and that each that is not says how to mend it."""

from __future__ import annotations

import os
import pty
import pwd
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from daemon.arm import Fault
from daemon.config import Config, load_config
from daemon.events.codes import BY_OPERATOR, CauseCode, FaultCause, cause_of
from daemon.maintenance.doctor import CheckResult, examine, from_service, remedy_of
from daemon.maintenance.troubles import Troubles
from drivers.val2.errors import ControllerError
from tests.fakes.daemon_process import write_own_calibration

ETC = Path(__file__).resolve().parents[3] / "etc"


def configured(folder: Path, more: str = "", calibration: str | None = None) -> Config:
    """A configuration with all its files in one folder."""
    for name in ("calibration.yaml", "facets.yaml", "parts.yaml", "simcell.yaml"):
        shutil.copy(ETC / name, folder)
    if calibration is not None:
        (folder / "calibration.yaml").write_text(calibration)
    (folder / "facetd.yaml").write_text(f"version: 1\nfolders: {{state: state, runtime: .}}\n{more}")
    return load_config(folder / "facetd.yaml")


def of(findings: list[CheckResult], what: str) -> list[CheckResult]:
    return [finding for finding in findings if finding.what == what]


def changed(old: str, new: str) -> str:
    """The calibration of etc/ with one thing changed."""
    text = (ETC / "calibration.yaml").read_text()
    assert old in text
    return text.replace(old, new)


@pytest.fixture
def terminal() -> Iterator[str]:
    ours, theirs = pty.openpty()
    yield os.ttyname(theirs)
    os.close(ours)
    os.close(theirs)


def test_a_simulated_cell_as_installed_has_nothing_bad(tmp_path: Path) -> None:
    findings = examine(configured(tmp_path, "cell: simulated\n"), running=False)
    assert [finding for finding in findings if finding.level == "bad"] == []
    (found,) = of(findings, "configuration")
    assert found.line() == f"ok   configuration: {tmp_path / 'facetd.yaml'} (simulated cell)"
    (model,) = of(findings, "model")
    assert model.line() == "note model: no model is in use yet. Make one: `teach LABEL`, `train`, `accept`"


def test_what_is_bad_says_how_to_mend_it(tmp_path: Path) -> None:
    devices = "cameras: {left: /dev/none0, right: /dev/none1}\narm: {port: /dev/none-arm}\n"
    config = configured(tmp_path, devices)
    write_own_calibration(tmp_path)
    bad = [finding for finding in examine(config, running=False) if finding.level == "bad"]
    assert {finding.what for finding in bad} == {"camera /dev/none0", "camera /dev/none1", "controller port"}
    assert all(finding.mend for finding in bad)
    assert bad[-1].line().startswith("BAD  controller port: /dev/none-arm: No such file or directory. Plug it in")


def test_the_simulated_cell_s_hand_eye_is_none_of_a_real_cell(tmp_path: Path) -> None:
    (found,) = of(examine(configured(tmp_path, "arm: {port: /dev/none-arm}\n"), running=False), "calibration")
    assert found.level == "bad"
    assert "calibration.yaml: hand_eye is the simulated cell's: enter where your cameras are" in found.found


def test_a_file_is_no_device_and_a_device_that_somebody_holds_is_named_with_them(tmp_path: Path, terminal: str) -> None:
    config = configured(tmp_path, f"cell: simulated\nconsole: {{tty: {{device: {tmp_path / 'facetd.yaml'}}}}}\n")
    (found,) = of(examine(config, running=False), "console port")
    assert (found.level, "is not a device" in found.found) == ("bad", True)
    config = configured(tmp_path, f"cell: simulated\nconsole: {{tty: {{device: {terminal}}}}}\n")
    with open(terminal) as held:
        holder = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"], stdin=held)
    try:
        (found,) = of(examine(config, running=False), "console port")
        assert (found.level, f"({holder.pid})" in found.found) == ("bad", True)
        (found,) = of(examine(config, running=True), "console port")
        assert found.level == "good", "the daemon itself holds it"
    finally:
        holder.kill()
        holder.wait()


def test_a_file_that_cannot_be_read_spoils_its_own_check_only(tmp_path: Path) -> None:
    config = configured(tmp_path, "cell: simulated\n", calibration="version: 1\n")
    findings = examine(config, running=False)
    (found,) = of(findings, "calibration")
    assert found.level == "bad"
    assert "calibration.yaml" in found.found
    assert of(findings, "configuration")[0].level == "good"


def test_a_calibration_that_is_coarse_old_or_without_a_hand_eye_is_told(tmp_path: Path) -> None:
    text = (ETC / "calibration.yaml").read_text()
    body, _, _ = text.partition("hand_eye:")
    coarse = body + "quality: {reprojection_px: 0.9, epipolar_px: 0.7, made: 2020-01-01T00:00:00Z}\n"
    found = of(examine(configured(tmp_path, "cell: simulated\n", coarse), running=False), "calibration")
    told = [finding.line() for finding in found]
    assert any("days old. Verify it: `facetctl calibrate verify`" in line for line in told)
    assert any("reprojection error 0.90 px, more than 0.5. Repeat the calibration" in line for line in told)
    assert any("epipolar error 0.70 px, more than 0.5" in line for line in told)
    assert any(
        "has no hand_eye. Run `facetctl calibrate hand-eye`; until then only `robot` can move the arm" in line
        for line in told
    )


def test_a_clock_that_stands_before_the_newest_run_cannot_be_right(tmp_path: Path) -> None:
    config = configured(tmp_path, "cell: simulated\n")
    run = config.runs / "20260101T000000Z"
    run.mkdir(parents=True)
    (run / "run.jsonl").write_text("")
    os.utime(run, (time.time() + 3600,) * 2)
    (found,) = of(examine(config, running=False), "clock")
    assert (found.level, "which is wrong" in found.found) == ("bad", True)


def test_a_full_disk_is_told_with_what_goes_by_itself(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    config = configured(tmp_path, "cell: simulated\n")
    monkeypatch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=1_000_000))
    (found,) = of(examine(config, running=False), "disk")
    assert (found.level, found.found.startswith("1 MB free in")) == ("bad", True)
    assert "removes only old runs" in found.mend


@pytest.mark.parametrize(("owner", "level"), [("facetd", "good"), ("root", "bad")])
def test_a_folder_of_the_daemons_is_in_order_also_where_an_operator_asks_who_may_not_write_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, owner: str, level: str
) -> None:
    config = configured(tmp_path, "cell: simulated\n")
    monkeypatch.setattr(os, "access", lambda *_: False)
    monkeypatch.setattr(pwd, "getpwuid", lambda _: SimpleNamespace(pw_name=owner))
    (found,) = of(examine(config, running=False), "disk")
    assert found.level == level


def test_what_a_camera_did_not_hold_is_to_correct_and_an_untested_camera_is_noted() -> None:
    cameras = SimpleNamespace(describe=lambda: "two")
    hardware: Any = SimpleNamespace(kind="real", cameras=cameras, robot=SimpleNamespace(heard_s=None))
    assert "note cameras: not tested whether" in from_service(hardware, Troubles(), None)[1].line()
    found = from_service(hardware, Troubles(), None, {"left": ["autofocus"]})
    assert ("bad", "BAD  left camera: autofocus") in [(one.level, one.line()) for one in found]
    hardware.kind = "recorded"
    assert len(from_service(hardware, Troubles(), None)) == 1


def test_a_rolling_shutter_is_noted_and_so_is_a_camera_that_was_never_tested_for_one() -> None:
    cameras = SimpleNamespace(describe=lambda: "two")
    hardware: Any = SimpleNamespace(kind="real", cameras=cameras, robot=SimpleNamespace(heard_s=None))
    (_, found) = from_service(hardware, Troubles(), None, {})
    assert found.line().startswith("note cameras: not tested for a rolling shutter. Type `cameras moving`")
    measured: Any = {"left": "rolling shutter: 20 ms", "right": "global shutter: 0 ms"}
    levels = [(one.what, one.level) for one in from_service(hardware, Troubles(), None, {}, measured)[1:]]
    assert levels == [("left camera", "note"), ("right camera", "good")]


def test_the_running_daemon_adds_its_devices_and_its_troubles() -> None:
    hardware: Any = SimpleNamespace(
        kind="simulated",
        clock=lambda: 50.0,
        cameras=SimpleNamespace(describe=lambda: "two cameras at 30 Hz"),
        robot=SimpleNamespace(heard_s=47.0),
        where="/dev/facetd-arm",
    )
    lines = [
        finding.line() for finding in from_service(hardware, Troubles(active={"disk": "disk: 12 MB free"}), None, {})
    ]
    assert lines == [
        "ok   cameras: two cameras at 30 Hz",
        "ok   controller: answered 3 s ago at /dev/facetd-arm",
        "BAD  disk: 12 MB free",
    ]
    lost, cut = Troubles(), Fault("*Arm power off*", (FaultCause(CauseCode.ARM_POWER),))
    lost.report("cameras", "cameras: unplugged", FaultCause(CauseCode.CAMERA_LOST))
    lines = [f.line() for f in from_service(hardware, lost, cut, {})]
    assert [line[:20] for line in lines] == ["ok   controller: ans", "BAD  fault: *Arm pow", "BAD  cameras: unplug"]
    assert "switch arm power on" in lines[1], "`All is well` was said under a fault"
    assert "plug it in" in lines[2]
    hardware.robot.heard_s = None
    assert [finding.what for finding in from_service(hardware, Troubles(), None, {})] == ["cameras"]


@pytest.mark.parametrize(
    ("fault", "mend"),
    [
        (cause_of(ControllerError("*Emergency stop*")), "unlatch"),
        (cause_of(ControllerError("*Not calibrated*")), "`robot cal`"),
        (FaultCause(CauseCode.CAMERA_LOST), "plug it in"),
        (FaultCause(CauseCode.INTERNAL, ("focus left",)), "focus"),
        (BY_OPERATOR, ""),
        (cause_of(KeyError("x")), ""),
    ],
)
def test_what_a_fault_asks_for_follows_from_its_cause(fault: FaultCause, mend: str) -> None:
    told = remedy_of(fault)
    assert mend in told
    assert bool(told) is bool(mend)


def test_a_systemd_that_does_not_answer_spoils_its_own_check_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Doctor, and the bundle that it is a part of, ended in a traceback."""

    def hanging(command: list[str], timeout: float, **_: object) -> None:
        raise subprocess.TimeoutExpired(command, timeout)

    usual = Path.is_dir
    monkeypatch.setattr(Path, "is_dir", lambda path: str(path) == "/run/systemd/system" or usual(path))
    monkeypatch.setattr(shutil, "which", lambda name: f"/bin/{name}")
    monkeypatch.setattr(subprocess, "run", hanging)
    findings = examine(configured(tmp_path, "cell: simulated\n"), running=False)
    (found,) = of(findings, "unit")
    assert (found.level, "timed out after 5 seconds" in found.found) == ("bad", True)
    assert of(findings, "clock")


def test_runs_on_a_disk_of_their_own_are_told_by_that_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The state's disk had room; the one that the runs were to go to was full, and it was well."""
    other = Path("/dev/shm")
    config = configured(tmp_path, "cell: simulated\n")
    values = replace(config.values, folders=replace(config.values.folders, runs=str(other)))
    config = replace(config, values=values)
    free = {tmp_path: 9_000_000_000, other: 3_000_000_000}
    monkeypatch.setattr(shutil, "disk_usage", lambda folder: SimpleNamespace(free=free[folder]))
    (found,) = of(examine(config, running=False), "disk")
    assert (found.level, found.found.split(",")[0]) == ("good", "3000 MB free")
    free[other] = 1_000_000
    (found,) = of(examine(config, running=False), "disk")
    assert (found.level, found.found) == ("bad", "1 MB free in /dev/shm")
