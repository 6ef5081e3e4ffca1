"""Everything a maintainer would ask for, in one file. Reads and packs; nothing leaves the machine.

Configuration, the calibration in use, model state, the newest runs' records (pictures of the newest one only, up to a
limit), the journal, versions and what the kernel says of the devices.
"""

from __future__ import annotations

import contextlib
import importlib.metadata
import io
import json
import os
import platform
import secrets
import shutil
import subprocess
import sys
import tarfile
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager
from datetime import UTC, datetime
from pathlib import Path
from typing import BinaryIO

from daemon.config import Config
from daemon.maintenance import doctor
from daemon.store.outside import FileError, open_below, open_file
from daemon.store.runs import list_runs

RUNS = 5
PICTURES_MB, MOST_MB = 40, 1000
"""Of the newest run's pictures, and of all files together: one may say that it is as large as no disk."""
COMMANDS = {
    "journal.txt": ["journalctl", "-u", "facetd", "-b", "--no-pager", "-n", "5000"],
    "unit.txt": ["systemctl", "show", "facetd.service"],
    "kernel.txt": ["dmesg", "--level=err,warn"],
    "devices.txt": ["ls", "-lR", "/dev/v4l", "/dev/serial"],
    "usb.txt": ["lsusb", "-t"],
}


def pack(config: Config, into: Path) -> Path:
    """Write facetd-<host>-<time>.tar.gz into a folder and give its path. Raises OSError."""
    into.mkdir(parents=True, exist_ok=True)
    stem = f"facetd-{platform.node() or 'cell'}-{datetime.now(UTC):%Y%m%dT%H%M%SZ}"
    path = into / f"{stem}.tar.gz"
    making, left = path.with_name(f".{path.name}.{secrets.token_hex(4)}"), MOST_MB * 1_000_000
    try:
        with tarfile.open(making, "x:gz", compresslevel=6) as archive:  # never into what somebody put there
            for name, content in _texts(config):
                entry = tarfile.TarInfo(f"{stem}/{name}")
                entry.size, entry.mtime = len(content), int(time.time())
                archive.addfile(entry, io.BytesIO(content))
            for name, opened in _files(config):
                with contextlib.suppress(FileError), opened as file:
                    left -= _add(archive, f"{stem}/{name}", file, left)
        making.replace(path)
    finally:
        making.unlink(missing_ok=True)
    return path


def _add(archive: tarfile.TarFile, name: str, file: BinaryIO, most_bytes: int) -> int:
    """What a file holds: a link would point to somewhere on this machine, and a log that grows is cut where it was.
    Gives how many bytes that were."""
    entry = tarfile.TarInfo(name)
    about = os.fstat(file.fileno())
    entry.size, entry.mtime, entry.mode = min(about.st_size, most_bytes), int(about.st_mtime), 0o644
    archive.addfile(entry, file)
    return entry.size


def _texts(config: Config) -> Iterator[tuple[str, bytes]]:
    findings = doctor.examine(config, running=True)
    yield "doctor.txt", "\n".join(finding.line() for finding in findings).encode()
    versions = {d.name: d.version for d in importlib.metadata.distributions()}
    about = {"python": sys.version, "machine": platform.platform(), "packages": dict(sorted(versions.items()))}
    yield "versions.json", json.dumps(about, indent=1).encode()
    for name, command in COMMANDS.items():
        if shutil.which(command[0]) is not None:
            yield name, _output(command)


def _output(command: list[str]) -> bytes:
    try:
        done = subprocess.run(command, capture_output=True, timeout=10, check=False)
    except (OSError, subprocess.TimeoutExpired) as error:
        return f"{command[0]}: {error}".encode()
    return done.stdout + done.stderr


def _files(config: Config) -> Iterator[tuple[str, AbstractContextManager[BinaryIO]]]:
    """What a person named is read by whatever link; of a run, only what lies in it."""
    yield "facetd.yaml", open_file(config.path)
    yield "calibration.yaml", open_file(config.calibration)
    for name in ("facets", "parts"):
        yield f"{name}.yaml", open_file(config.file(getattr(config.values.files, name)))
    for name in ("models/state.json", "standing"):
        yield name, open_below(config.state, name)
    runs = list_runs(config.runs)[-RUNS:]
    for run in reversed(runs):
        for source in (run / "run.jsonl", run / "wire.jsonl", *sorted((run / "kept").glob("*"))):
            name = str(source.relative_to(run))
            yield f"runs/{run.name}/{name}", open_below(run, name)
    budget = PICTURES_MB * 1_000_000
    for picture in sorted(runs[-1].glob("images/*.png"), reverse=True) if runs else ():
        budget -= picture.lstat().st_size
        if budget < 0:
            return
        name = f"images/{picture.name}"
        yield f"runs/{runs[-1].name}/{name}", open_below(runs[-1], name)
