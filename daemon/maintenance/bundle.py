"""Pack the support bundle: one file with all that a maintainer needs. Nothing leaves the machine.

It has configuration, calibration in use, model state, records of the newest runs, images of the newest run up to a
limit, journal, versions, and the kernel's messages about devices.
"""

import contextlib
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
"""Limits for the newest run's images, and for all files: a sparse file may be larger than the disk."""
COMMANDS = {
    "journal.txt": ["journalctl", "-u", "facetd", "-b", "--no-pager", "-n", "5000"],
    "unit.txt": ["systemctl", "show", "facetd.service"],
    "kernel.txt": ["dmesg", "--level=err,warn"],
    "devices.txt": ["ls", "-lR", "/dev/v4l", "/dev/serial"],
    "usb.txt": ["lsusb", "-t"],
}


def pack(config: Config, into: Path) -> Path:
    """Write facetd-<host>-<time>.tar.gz into a folder; returns its path. Raises OSError."""
    into.mkdir(parents=True, exist_ok=True)
    stem = f"facetd-{platform.node() or 'cell'}-{datetime.now(UTC):%Y%m%dT%H%M%SZ}"
    path = into / f"{stem}.tar.gz"
    making, left = path.with_name(f".{path.name}.{secrets.token_hex(4)}"), MOST_MB * 1_000_000
    try:
        with tarfile.open(making, "x:gz", compresslevel=6) as archive:  # a new name: never into an existing file
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
    """Add a file's content (never a link), up to its present size, as a log may grow. Returns the number of bytes."""
    entry = tarfile.TarInfo(name)
    about = os.fstat(file.fileno())
    entry.size, entry.mtime, entry.mode = min(about.st_size, most_bytes), int(about.st_mtime), 0o644
    archive.addfile(entry, file)
    return entry.size


def _texts(config: Config) -> Iterator[tuple[str, bytes]]:
    findings = doctor.examine(config, running=True)
    yield "doctor.txt", "\n".join(finding.line() for finding in findings).encode()
    import importlib.metadata

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
    """Links are followed for files that the configuration names, not inside runs."""
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
