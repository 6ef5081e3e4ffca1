"""A facetd process with a simulated cell in its own folder, for benches and tests that disturb or measure it.

Starts it, sends commands, and reads the kernel's figures of the process.
"""

from __future__ import annotations

import json
import os
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from daemon.frontends.client import DaemonLink

ETC = Path(__file__).resolve().parents[2] / "etc"
SHOWN = (("cube", 3), ("pyramid", 4), ("pyramid", 3), ("triangular_prism", 3), ("pentagonal_prism", 3),
         ("pentagonal_prism", 3))  # fmt: skip
"""The six views in the order in which the simulated operator shows them, and the number of facets in each."""
TRIES = 8


@dataclass(frozen=True)
class Footprint:
    """What a process holds: resident MiB, of them anonymous, open file handles, threads, CPU seconds used."""

    resident_mib: float
    anonymous_mib: float
    handles: int
    threads: int
    cpu_s: float


class Running:
    """One facetd. `folder` must have a short path (a socket lies in it); it is kept when the process ends."""

    def __init__(self, folder: Path, config: str, seed: int = 7, time_scale: float = 40.0) -> None:
        """config: lines to add to facetd.yaml."""
        self.folder, self.ready_s = folder, float("nan")
        folder.mkdir(parents=True, exist_ok=True)
        for name in ("calibration.yaml", "facets.yaml", "parts.yaml", "simcell.yaml"):
            shutil.copy(ETC / name, folder)
        simulated = (
            f"simulated: {{truth: simcell.yaml, time_scale: {time_scale}, seed: {seed}, verdict: verdict.jsonl}}\n"
        )
        (folder / "facetd.yaml").write_text(
            f"version: 1\nfolders: {{state: state, runtime: .}}\n{simulated}{config}", encoding="utf-8"
        )
        self.process: subprocess.Popen[bytes] | None = None
        self.program = "daemon.main"
        self.launcher: tuple[str, ...] = ()
        """A command that starts facetd, in front of its own; empty: none."""
        self.environment: dict[str, str] = {}
        self._allowed: list[tuple[float, bool]] = []
        """Whether the commands permitted motion, with the time from which."""

    @property
    def runs(self) -> Path:
        """The folder of its runs."""
        return self.folder / "state" / "runs"

    def start(self, arguments: Iterable[str] = ("--sim",), timeout_s: float = 60.0) -> None:
        """Start it and wait until it is ready. Raises RuntimeError where it ends before, or is never ready."""
        self._allowed.append((time.monotonic(), False))
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as notes:
            place = self.folder / "notify"
            place.unlink(missing_ok=True)
            notes.bind(str(place))
            notes.settimeout(0.2)
            environment = {**os.environ, "NOTIFY_SOCKET": str(place), "OMP_NUM_THREADS": "1", **self.environment}
            config = str(self.folder / "facetd.yaml")
            command = [*self.launcher, sys.executable, "-m", self.program, "--config", config, *arguments]
            began = time.monotonic()
            with (self.folder / "stderr").open("ab") as errors:
                self.process = subprocess.Popen(command, stderr=errors, env=environment)
            while time.monotonic() < began + timeout_s and self.process.poll() is None:
                try:
                    if b"READY=1" in notes.recv(4096):
                        self.ready_s = time.monotonic() - began
                        return
                except TimeoutError:
                    continue
        self.kill()
        raise RuntimeError(f"not ready: {(self.folder / 'stderr').read_text(errors='replace')[-300:]}")

    def do(self, text: str, answer: str | None = None) -> dict[str, Any]:
        """Send a command; returns {text, data, status}. answer: to each question (None: a client without questions)."""
        if text in ("enable", "resume"):
            self._allowed.append((time.monotonic(), True))
        with DaemonLink(self.folder / "facetd.sock") as link:
            done = link.do(text, "bench", lambda _: None, None if answer is None else lambda _: answer)
        if text in ("stop", "disable"):
            self._allowed.append((time.monotonic(), False))
        return done

    def judged(self) -> list[str]:
        """Forbidden motions of the arm, in words, as the simulated cell's motion monitor found them: the daemon has no
        part in it. That it sets out only when it may is held against what was said here."""
        found = []
        for line in map(json.loads, (self.folder / "verdict.jsonl").read_text(encoding="utf-8").splitlines()):
            if "rule" in line:
                found.append(f"{line['rule']}: {line['text']} (`{line['by']}`)")
            elif not [allowed for at_s, allowed in self._allowed if at_s <= line["started_s"]][-1]:
                found.append(f"not allowed: `{line['by']}` while nothing might move")
        return found

    def teach(self, views: Sequence[tuple[str, int]] = SHOWN) -> None:
        """Show the views as an operator would, each until it is seen whole, then train. Raises RuntimeError."""
        shown = [label for label, _ in views]
        for k, (label, facets) in enumerate(views):
            for _ in range(TRIES):
                self.show(label, shown[:k].count(label))
                done = self.do(f"teach {label}")
                if done["status"] == 0 and len(done["data"]["facets"]) == facets:
                    break
                if done["status"] == 0:
                    self.do(f"forget {label} {done['data']['view'].split('/')[1]}")
            else:
                raise RuntimeError(f"the {label} was not seen whole in {TRIES} looks")
        self.do("train")
        self.do("accept")

    def show(self, label: str, view: int) -> None:
        """Show a part in one of its views, as the simulated operator does."""

    def footprint(self) -> Footprint:
        """The resources that the process holds now."""
        assert self.process is not None
        root = Path(f"/proc/{self.process.pid}")
        said = dict(line.split(":", 1) for line in (root / "status").read_text().splitlines())
        used = (root / "stat").read_text().rsplit(")", 1)[1].split()
        return Footprint(
            int(said["VmRSS"].split()[0]) / 1024,
            int(said["RssAnon"].split()[0]) / 1024,
            len(list((root / "fd").iterdir())),
            int(said["Threads"]),
            (int(used[11]) + int(used[12])) / os.sysconf("SC_CLK_TCK"),
        )

    def kill(self) -> None:
        """Send SIGKILL and wait for the end."""
        if self.process is not None:
            self.process.kill()
            self.process.wait()

    def end(self, timeout_s: float = 10.0) -> int:
        """Send SIGTERM; returns the exit status."""
        assert self.process is not None
        self.process.terminate()
        return self.process.wait(timeout_s)


@contextmanager
def judged_daemon(seed: int, time_scale: float, excused: str | None = None) -> Iterator[Running]:
    """One that runs in a folder of its own, and is judged when it is done with. excused: the beginning of what a person
    has to answer for, and not the daemon."""
    folder = Path(tempfile.mkdtemp(prefix="facetd-"))
    daemon = Running(folder, "", seed, time_scale)
    daemon.start()
    try:
        yield daemon
        found = daemon.judged()
    finally:
        daemon.kill()
        shutil.rmtree(folder, ignore_errors=True)
    found = [line for line in found if excused is None or not line.startswith(excused)]
    assert found == [], "\n".join(found)
