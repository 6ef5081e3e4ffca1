"""Run facetd as a separate process with a simulated cell in its own folder."""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from daemon.frontends.client import DaemonLink
from tests.fakes.waiting import PATIENCE_S

ETC = Path(__file__).resolve().parents[2] / "etc"
SIMULATED = "simulated: {truth: simcell.yaml, time_scale: 20.0, seed: 7}\n"
HAND_IN = """import os, sys
os.dup2(int(sys.argv[1]), 3)
os.environ.update(LISTEN_PID=str(os.getpid()), LISTEN_FDS="1", LISTEN_FDNAMES="modbus")
os.execv(sys.executable, [sys.executable, *sys.argv[2:]])"""
"""Replaces itself by facetd, with the socket of that number handed in."""


def write_own_calibration(folder: Path) -> None:
    """The calibration of etc/ as that of a real cell, which the simulated one's hand-eye is not."""
    text = (ETC / "calibration.yaml").read_text(encoding="utf-8")
    (folder / "calibration.yaml").write_text(text.replace("method: simulated, ", ""), encoding="utf-8")


class Daemon:
    """A facetd process in its own folder, with a receiver of its sd_notify messages."""

    def __init__(
        self,
        folder: Path,
        config: str | None = "",
        arguments: tuple[str, ...] = ("--sim",),
        listener: socket.socket | None = None,
    ) -> None:
        """config: the end of facetd.yaml; None: the folder has all files already; listener: handed in for Modbus, as
        systemd does."""
        self.folder = folder
        for name in ("calibration.yaml", "facets.yaml", "parts.yaml", "simcell.yaml"):
            if config is not None and not (folder / name).exists():
                shutil.copy(ETC / name, folder)
        self.config = folder / "facetd.yaml"
        if config is not None:
            self.config.write_text(f"version: 1\nfolders: {{state: state, runtime: .}}\n{SIMULATED}{config}")
        self.notes = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        (folder / "notify").unlink(missing_ok=True)
        self.notes.bind(str(folder / "notify"))
        self.notes.settimeout(20)
        environment = {**os.environ, "NOTIFY_SOCKET": str(folder / "notify"), "OMP_NUM_THREADS": "1"}
        self.errors = (folder / "stderr").open("w+")
        command = ["-m", "daemon.main", "--config", str(self.config), *arguments]
        handed: tuple[int, ...] = () if listener is None else (listener.fileno(),)
        if listener is not None:
            command = ["-c", HAND_IN, str(listener.fileno()), *command]
        self.began_s = time.monotonic()
        self.process = subprocess.Popen(
            [sys.executable, *command], stderr=self.errors, env=environment, pass_fds=handed
        )

    def hears(self, text: str) -> str:
        """Wait for a notification that contains a text."""
        while True:
            note = self.notes.recv(4096).decode()
            if text in note:
                return note

    def do(self, text: str) -> dict[str, Any]:
        with DaemonLink(self.folder / "facetd.sock") as link:
            return link.do(text, "test", lambda _: None)

    def stderr(self) -> str:
        return (self.folder / "stderr").read_text()

    def ends(self, seconds: float = PATIENCE_S) -> int:
        return self.process.wait(seconds)

    def close(self) -> None:
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()
        self.notes.close()
        self.errors.close()
