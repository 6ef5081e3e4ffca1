"""Wait until a daemon that was started here is ready: as long as it gets on, by what it reports and computes."""

import contextlib
import os
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from daemon.errors import FacetdError
from daemon.quantities import whole

STALLED_S = 60.0
"""Longest time without a new stage and without use of the processor."""
WORKED_S = 0.05
"""Processor time that counts as getting on."""
PATIENCE_S = 10.0
"""Time after which the stage of the start is reported."""
POLL_S = 0.2


class StartError(FacetdError):
    """The daemon is not ready: it ended, or a time-out after how long, in which stage."""


@contextlib.contextmanager
def listener(folder: Path) -> Iterator[socket.socket]:
    """A socket in a folder, removed afterwards, for NOTIFY_SOCKET, where the daemon reports its start."""
    path = folder / "notify"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) as made:
        made.bind(str(path))
        made.settimeout(POLL_S)
        try:
            yield made
        finally:
            path.unlink(missing_ok=True)


@contextlib.contextmanager
def daemon_in(folder: Path, ends_within_s: float) -> Iterator[tuple[subprocess.Popen[bytes], socket.socket]]:
    """Start a daemon with the facetd.yaml of a folder; yields it and the socket for its reports. Ended afterwards."""
    command = [sys.executable, "-m", "daemon.main", "--config", str(folder / "facetd.yaml")]
    environment = {**os.environ, "NOTIFY_SOCKET": str(folder / "notify")}
    with (folder / "stderr").open("wb") as errors, listener(folder) as reports:
        process = subprocess.Popen(command, stderr=errors, env=environment)
        try:
            yield process, reports
        finally:
            process.terminate()
            process.wait(ends_within_s)


def wait_until_ready(
    process: subprocess.Popen[bytes],
    reports: socket.socket,
    say: Callable[[str], None],
    stalled_s: float = STALLED_S,
    patience_s: float = PATIENCE_S,
) -> None:
    """Wait for READY=1. Raises StartError once the process has ended, or has not got on for stalled_s."""
    began_s = moved_s = time.monotonic()
    stage, reported_stage, used_s = "loading the program", "", 0.0
    while process.poll() is None:
        report = _report(reports)
        if "READY" in report:
            return
        now_s, reached = time.monotonic(), report.get("STATUS", stage).removeprefix("starting: ")
        if (working_s := _processor_s(process.pid)) > used_s + WORKED_S or reached != stage:
            stage, used_s, moved_s = reached, working_s, now_s
        if now_s - began_s > patience_s and reported_stage != stage:
            say(f"the daemon starts: {stage}, after {now_s - began_s:.0f} s")
            reported_stage = stage
        if now_s - moved_s > stalled_s:
            took = f"{now_s - began_s:.0f} s, the last {stalled_s:g} s without getting on"
            raise StartError(f"time-out: the daemon was not ready after {took}; it was at: {stage}")
    raise StartError(f"the daemon ended with status {process.returncode} while it started, at: {stage}")


def _report(reports: socket.socket) -> dict[str, str]:
    """The next report, within POLL_S; empty without one."""
    with contextlib.suppress(TimeoutError):
        lines = reports.recv(4096).decode(errors="replace").splitlines()
        return dict(line.split("=", 1) for line in lines if "=" in line)
    return {}


def _processor_s(pid: int) -> float:
    """Processor time that a process has used, s; 0 where it has ended."""
    try:
        ticks = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[11:13]
    except OSError:
        return 0.0
    return sum(map(whole, ticks)) / os.sysconf("SC_CLK_TCK")
