"""The daemon as a process: ready, watched, reloaded, stopped, killed; every bad start is one line and a status."""

from __future__ import annotations

import asyncio
import json
import os
import pty
import shutil
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

import pytest
import yaml

from daemon.arm.stopping import ABORT_S
from daemon.cell import build as build_room
from daemon.cell.no_arm import CellError
from daemon.config import load_config
from daemon.frontends.client import DaemonLink, DaemonUnreachableError
from daemon.service import HALT_S, RELOAD_S, Service, make_room
from daemon.store.runs import check_wire, list_runs, read_run
from daemon.store.yamlfile import ConfigError
from drivers.val2.dialect import Dialect
from tests.fakes.daemon_process import ETC, SIMULATED, Daemon, write_own_calibration
from tests.fakes.in_time import lived
from tests.fakes.waiting import until


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    short = Path(f"/tmp/facetd-test-{os.getpid()}-{tmp_path.name[-12:]}")
    shutil.rmtree(short, ignore_errors=True)
    short.mkdir()
    return short


@pytest.fixture
def daemons(folder: Path) -> Iterator[list[Daemon]]:
    started: list[Daemon] = []
    yield started
    for daemon in started:
        daemon.close()
    shutil.rmtree(folder, ignore_errors=True)


@pytest.fixture
def daemon(folder: Path, daemons: list[Daemon]) -> Daemon:
    daemons.append(Daemon(folder))
    daemons[-1].hears("READY=1")
    return daemons[-1]


def test_it_is_ready_answers_says_its_state_and_ends_cleanly(daemon: Daemon) -> None:
    status = daemon.do("status")
    assert status["data"]["cell"] == "simulated"
    assert status["data"]["troubles"] == {}
    assert "idle" in daemon.hears("STATUS=")
    daemon.process.send_signal(signal.SIGTERM)
    assert daemon.ends() == 0
    (run,) = list_runs(daemon.folder / "state" / "runs")
    records = read_run(run)
    assert records.skipped == ()
    assert records.records[0]["kind"] == "run_start"
    assert (run / records.records[0]["config"]).read_bytes() == daemon.config.read_bytes()
    assert records.records[-1] | {"why": "signal SIGTERM"} == records.records[-1]
    assert check_wire(run) == []
    assert not (daemon.folder / "facetd.sock").exists()


def test_a_look_is_waited_for_as_long_as_its_configured_budget_needs_on_a_shared_processor(folder: Path) -> None:
    """A look with a budget of 60 s was ended after 60 s by the clock, where others used the processor as well."""
    for name in ("calibration.yaml", "facets.yaml", "parts.yaml", "simcell.yaml"):
        shutil.copy(ETC / name, folder)
    file = folder / "facetd.yaml"

    def configure(budget_s: float) -> None:
        file.write_text(
            f"version: 1\nfolders: {{state: state, runtime: .}}\n{SIMULATED}vision: {{budget_s: {budget_s}}}\n"
        )

    async def waited_for() -> list[float]:
        service, limits_s = Service(file, simulated=True), list[float]()
        life = asyncio.create_task(service.run())
        while service.context is None or not service._ready:
            await asyncio.sleep(0)
        limits_s.append(service.context.worker.within_s)
        configure(10.0)
        await service.reload()
        limits_s.append(service.context.worker.within_s)
        service.end("tried")
        assert await life == 0
        return limits_s

    configure(60.0)
    assert asyncio.run(waited_for()) == [300.0, 100.0]


@pytest.mark.parametrize("name", ["TERM", "INT", "QUIT", "USR1", "USR2", "ALRM", "VTALRM", "PROF", "IO", "PWR", "XCPU"])
def test_no_signal_that_ends_a_process_ends_the_daemon_before_the_arm_is_stopped(name: str) -> None:
    """A `kill -USR1`, which many programs take for something harmless, ended it with the arm on its way."""

    async def lives() -> str:
        service, ended = Service(Path("unread.yaml"), simulated=True), asyncio.get_running_loop().create_future()
        with patch.object(service, "end", ended.set_result):
            service._listen_to_signals()
            os.kill(os.getpid(), signal.Signals[f"SIG{name}"])
            return await asyncio.wait_for(ended, 10.0)

    assert asyncio.run(lives()) == f"signal SIG{name}"


def test_a_signal_while_the_arm_moves_stops_the_arm_first(daemon: Daemon) -> None:
    daemon.config.write_text(daemon.config.read_text())
    daemon.do("enable")
    with socket.socket(socket.AF_UNIX) as raw:
        raw.connect(str(daemon.folder / "facetd.sock"))
        daemon.do("step on")
        raw.sendall(b'{"do": "go survey"}\n')
        until(lambda: daemon.do("status")["data"]["doing"] == "survey")
        daemon.process.send_signal(signal.SIGINT)
        assert daemon.ends() == 0
    (run,) = list_runs(daemon.folder / "state" / "runs")
    assert read_run(run).records[-1]["kind"] == "run_end"
    sent = (run / "wire.jsonl").read_text().upper()
    assert "ABORT" in sent


def test_the_end_has_the_units_whole_time_for_a_stop_that_is_not_heard_at_once(folder: Path) -> None:
    """ABORT's first attempt may be lost in noise; the second comes after the time in which the line is found again."""
    confirmed: list[bool] = []

    async def close() -> None:
        """The alarm has sounded."""

    async def wait_for_stop_end() -> None:
        await asyncio.sleep(2.5 * Dialect().resync_s)
        confirmed.append(True)

    service = Service(folder / "facetd.yaml")
    service.context = SimpleNamespace(
        cycle=SimpleNamespace(supervisor=SimpleNamespace(close=close, wait_for_stop_end=wait_for_stop_end))
    )  # type: ignore[assignment]
    lived(service._end())
    assert confirmed
    unit = (ETC.parent / "deploy" / "facetd.service").read_text()
    given_s = float(unit.partition("TimeoutStopSec=")[2].split()[0])
    assert ABORT_S < HALT_S < given_s - 1.5


def test_a_second_daemon_on_the_same_state_is_refused_and_the_first_goes_on(
    daemon: Daemon, folder: Path, daemons: list[Daemon]
) -> None:
    second = subprocess.run(
        [sys.executable, "-m", "daemon.main", "--config", str(daemon.config), "--sim"],
        capture_output=True, text=True, timeout=30, check=False,
    )  # fmt: skip
    assert second.returncode == 2
    assert second.stderr.count("\n") == 1
    assert f"another facetd (process {daemon.process.pid}) uses it; stop that one first" in second.stderr
    assert daemon.do("status")["status"] == 0
    assert len(list_runs(folder / "state" / "runs")) == 1


def test_reload_takes_a_good_configuration_over_and_refuses_a_bad_one(daemon: Daemon) -> None:
    good = daemon.config.read_text()
    daemon.config.write_text(good + "pick: {order: nearest}\n")
    assert daemon.do("reload")["status"] == 0
    daemon.config.write_text(good + "pick: {order: biggest}\n")
    refused = daemon.do("reload")
    assert refused["status"] == 1
    assert "pick.order: expected one of nearest, surest, found 'biggest'" in refused["text"]
    daemon.process.send_signal(signal.SIGHUP)
    until(lambda: daemon.stderr().count("refused, the configuration is unchanged") >= 2, "the signal's answer")
    daemon.hears("RELOADING=1")
    daemon.hears("READY=1")
    daemon.config.write_text(good + "arm: {port: /dev/other}\n")
    assert "Takes effect after a restart: arm" in daemon.do("reload")["text"]
    seen = daemon.do("look")["data"]["parts"]
    daemon.config.write_text(good + "vision: {depth_range_mm: [1500, 2500]}\n")
    assert daemon.do("reload")["text"] == "The configuration is reloaded. Takes effect after a restart: arm."
    assert seen
    assert daemon.do("look")["data"]["parts"] == []
    assert daemon.do("status")["status"] == 0


@pytest.mark.parametrize("what", ["nothing", "hand_eye gone", "hand_eye moved", "limits"])
def test_a_reload_that_changes_the_cells_geometry_disables_the_arm_first_and_says_so(daemon: Daemon, what: str) -> None:
    daemon.do("enable")
    calibration, moved = daemon.folder / "calibration.yaml", what != "nothing"
    content = yaml.safe_load(calibration.read_text())
    if what == "hand_eye gone":
        del content["hand_eye"]
    elif what == "hand_eye moved":
        content["hand_eye"]["tool_from_cyclopean"][0][3] += 1.0
    elif what == "limits":
        daemon.config.write_text(daemon.config.read_text() + "pick: {limits: {table_z_mm: -290.0}}\n")
    calibration.write_text(yaml.safe_dump(content))
    reloaded = daemon.do("reload")
    assert reloaded["status"] == 0, reloaded["text"]
    assert ("The arm is disabled: " in reloaded["text"]) is moved
    assert daemon.do("status")["data"]["enabled"] is not moved
    if moved:
        assert "not_enabled" in daemon.do("go home")["text"]
        assert daemon.do("enable")["status"] == (what == "hand_eye gone")


@pytest.mark.slow
def test_taught_and_trained_by_command_it_names_the_part_and_keeps_it_over_a_restart(
    daemon: Daemon, folder: Path, daemons: list[Daemon]
) -> None:
    assert daemon.do("teach triangular_prism")["status"] == 0
    assert daemon.do("train")["data"]["accepted"] is True
    assert daemon.do("show triangular_prism 1")["status"] == 0
    seen = daemon.do("look")["data"]
    assert [part["label"] for part in seen["parts"]] == ["triangular_prism"]
    json.dumps(seen)
    assert daemon.do("teach cube")["status"] == 0
    assert daemon.do("untaught")["data"]["waiting"] == ["cube/1"]
    assert daemon.do("train")["data"]["version"] == 2
    assert daemon.do("status")["data"]["model"]["version"] == 1, "a candidate does not disturb the model in use"
    assert daemon.do("accept")["data"]["version"] == 2
    assert daemon.do("rollback")["data"]["version"] == 1
    assert daemon.do("rollback")["status"] == 1
    daemon.process.send_signal(signal.SIGTERM)
    daemon.ends()
    daemon.close()
    daemons.append(Daemon(folder))
    daemons[-1].hears("READY=1")
    model = daemons[-1].do("status")["data"]["model"]
    assert (model["version"], model["labels"], model["candidate"]) == (1, ["triangular_prism"], 2)


@pytest.mark.slow
def test_killed_in_mid_cycle_it_comes_back_with_nothing_moving_and_asks(
    daemon: Daemon, folder: Path, daemons: list[Daemon]
) -> None:
    daemon.do("teach cube")
    daemon.do("train")
    daemon.do("scatter cube")
    daemon.do("enable")
    daemon.do("step on")
    daemon.do("auto on")
    until(lambda: daemon.do("status")["data"]["pending"])
    daemon.process.kill()
    daemon.ends()
    daemon.close()
    run = list_runs(folder / "state" / "runs")[-1]
    assert len(read_run(run).skipped) <= 1
    daemons.append(Daemon(folder))
    again = daemons[-1]
    again.hears("READY=1")
    state = again.do("status")["data"]
    assert "restarted" in state["fault"]
    assert state["enabled"] is False
    assert "was interrupted in state" in state["troubles"]["restart"]
    again.do("enable")
    assert again.do("pick cube")["status"] == 1, "nothing moves until resume"
    assert again.do("resume")["status"] == 0


def bad_start(folder: Path, config: str, *arguments: str) -> tuple[int, str]:
    daemon = Daemon(folder, config, arguments)
    try:
        return daemon.ends(30), daemon.stderr()
    finally:
        daemon.close()
        shutil.rmtree(folder, ignore_errors=True)


@pytest.mark.parametrize(
    ("config", "arguments", "status", "want"),
    [
        ("log: {quota: 1}\n", ("--sim",), 78, "facetd.yaml:4: log.quota: unknown key"),
        ("files: {calibration: none.yaml}\n", ("--sim",), 78, "files.calibration: expected a file"),
        ("files: {model: parts.yaml}\n", ("--sim",), 78, "parts.yaml"),
        ("cell: recorded\n", (), 2, "recorded pairs: "),
        (
            "cameras: {left: a, right: b}\n",
            (),
            78,
            "calibration.yaml: hand_eye is the simulated cell's: enter where your cameras are",
        ),
    ],
)
def test_a_bad_start_is_one_line_and_nothing_is_left_behind(
    folder: Path, config: str, arguments: tuple[str, ...], status: int, want: str
) -> None:
    got, told = bad_start(folder, config, *arguments)
    assert got == status, told
    assert told.count("\n") == 1
    assert told.startswith("facetd: ")
    assert want in told


def test_a_device_that_is_not_there_ends_the_start(folder: Path) -> None:
    write_own_calibration(folder)
    got, told = bad_start(folder, "cameras: {left: /dev/none0, right: /dev/none1}\narm: {port: /dev/none}\n")
    assert (got, told.count("\n"), "/dev/none" in told) == (2, 1, True), told


def test_a_state_folder_that_cannot_be_is_told_with_the_key_that_names_it(folder: Path) -> None:
    (folder / "state").write_text("")
    got, told = bad_start(folder, "", "--sim")
    assert (got, told.count("\n")) == (2, 1), told
    assert f"{folder}/state: File exists; see folders.state in {folder}/facetd.yaml" in told


def test_a_controller_that_does_not_answer_ends_the_start_with_what_to_check(folder: Path) -> None:
    ours, theirs = pty.openpty()
    try:
        pairs = folder / "pairs" / "1"
        pairs.mkdir(parents=True)
        write_own_calibration(folder)
        config = f"cell: real\ncameras: {{left: /dev/none0, right: /dev/none1}}\narm: {{port: {os.ttyname(theirs)}}}\n"
        got, told = bad_start(folder, config)
        assert got == 2
        assert told.count("\n") == 1
    finally:
        os.close(ours)
        os.close(theirs)


def test_without_a_daemon_facetctl_says_so_in_one_line_and_ends_with_two(tmp_path: Path) -> None:
    environment = {**os.environ, "FACETD_SOCKET": str(tmp_path / "none")}
    command = [sys.executable, "-m", "daemon.ctl"]
    for words in (["status"], ["console"], ["pick", "cube"], ["--json", "look"]):
        done = subprocess.run([*command, *words], capture_output=True, text=True, env=environment, check=False)
        assert done.returncode == 2
        assert done.stderr.count("\n") == 1
        assert "no daemon answers at" in done.stderr
        assert done.stdout == ""
    with pytest.raises(DaemonUnreachableError):
        DaemonLink(tmp_path / "none")


def test_facetctl_gives_text_json_and_exit_status(daemon: Daemon) -> None:
    environment = {**os.environ, "FACETD_SOCKET": str(daemon.folder / "facetd.sock")}

    def ctl(*words: str, said: str = "") -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-m", "daemon.ctl", *words]
        return subprocess.run(command, capture_output=True, text=True, env=environment, input=said, check=False)

    assert ctl("status").stdout.startswith("cell      simulated")
    assert json.loads(ctl("--json", "status").stdout)["cell"] == "simulated"
    assert json.loads(ctl("where", "--json").stdout)["status"] == 0
    refused = ctl("pick")
    assert (refused.returncode, refused.stdout) == (1, "")
    assert "the arm is not enabled" in refused.stderr
    assert ctl("flurb").returncode == 2
    script = ctl("script", "-", said="# a script\nstatus\n\nflurb\nlook\n")
    assert script.returncode == 2
    assert "-:4: not done; the rest was not run" in script.stderr
    console = ctl("console", said="status\nparts\n")
    assert "cell      simulated" in console.stdout
    assert "pentagonal_prism" in console.stdout


def test_old_runs_make_room_before_a_start_needs_it(folder: Path) -> None:
    for name in ("calibration.yaml", "facets.yaml", "parts.yaml"):
        shutil.copy(ETC / name, folder)
    (folder / "facetd.yaml").write_text("version: 1\nfolders: {state: state, runtime: .}\nlog: {quota_mb: 1}\n")
    config = load_config(folder / "facetd.yaml", simulated=True)
    make_room(config)  # where there is nothing yet
    runs = [config.runs / f"2026010{day}T000000Z" for day in (1, 2)]
    for run in runs:
        run.mkdir(parents=True)
        (run / "run.jsonl").write_bytes(bytes(600_000))
    make_room(config)
    assert list_runs(config.runs) == runs[1:]


def test_what_was_asked_by_a_signal_is_forgotten_once_it_is_done(folder: Path) -> None:
    async def reloads() -> int:
        service = Service(folder / "facetd.yaml")
        for _ in range(100):
            service.in_background(asyncio.sleep(0), "reload")
        await asyncio.gather(*service._tasks)
        return len(service._tasks)

    assert asyncio.run(reloads()) == 0


def test_a_burst_of_hang_ups_reads_the_files_once_and_once_more_for_those_that_came_meanwhile() -> None:
    """Each read them for itself, and a stop waited for seconds until three hundred had."""
    read: list[float] = []

    async def burst() -> None:
        service: Any = Service(Path("facetd.yaml"))
        service.context = SimpleNamespace()

        async def reload() -> None:
            read.append(asyncio.get_running_loop().time())
            raise ConfigError("facetd.yaml: not taken over while busy")

        service.reload = reload
        for seconds in (0.0, 0.5, 10.0):
            for _ in range(300):
                service._hang_up()
            await asyncio.sleep(seconds)
        service._hang_up()
        await asyncio.sleep(5.0)

    lived(burst())
    assert read == pytest.approx([0.0, RELOAD_S, 10.5], abs=0.1)


@pytest.mark.parametrize("fails", [False, True])
def test_a_daemon_told_to_end_while_it_opens_its_devices_lets_it_bring_an_arm_at_work_to_rest(
    folder: Path, monkeypatch: pytest.MonkeyPatch, fails: bool
) -> None:
    """The one before was killed in a move: its successor let go of the line in the middle of the stop."""
    for name in ("calibration.yaml", "facets.yaml", "parts.yaml", "simcell.yaml"):
        shutil.copy(ETC / name, folder)
    (folder / "facetd.yaml").write_text(f"version: 1\nfolders: {{state: state, runtime: .}}\n{SIMULATED}")
    service, done = Service(folder / "facetd.yaml", simulated=True), list[str]()

    async def opened() -> None:
        service.end("signal SIGTERM")
        await asyncio.sleep(0.2)
        done.append("at rest")
        if fails:
            raise CellError("the camera is gone")

    async def closed() -> None:
        done.append("closed")

    hardware = SimpleNamespace(open=opened, close=closed)
    monkeypatch.setattr(build_room, "build", lambda *_, **__: hardware)
    assert asyncio.run(service.run()) == 0
    assert done == ["at rest", "closed"]
