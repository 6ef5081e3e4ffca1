"""Public packages that carry data to measure on: as installed, or fetched into a folder that is thrown away."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path


def debian_package(package: str, holds: str, folder: Path) -> Path | str:
    """The root under which a Debian package's files lie, `holds` being one of them; or why they cannot be had."""
    if (Path("/") / holds).exists():
        return Path("/")
    if not (shutil.which("apt-get") and shutil.which("dpkg-deb")):
        return f"needs apt-get and dpkg-deb, or {package} installed"
    try:
        _run(["apt-get", "download", package], folder)
        (fetched,) = folder.glob("*.deb")
        _run(["dpkg-deb", "-x", fetched.name, "."], folder)
    except (subprocess.SubprocessError, ValueError) as error:
        return f"{package} could not be fetched ({error})"
    return folder


def python_package(package: str, folder: Path) -> Path | str:
    """A folder with a Python package's files, none of it installed or run; or why they cannot be had."""
    try:
        _run([sys.executable, "-m", "pip", "install", "-q", "--no-deps", "--target", ".", package], folder)
    except subprocess.SubprocessError as error:
        return f"{package} could not be fetched ({error})"
    return folder


def _run(command: list[str], folder: Path) -> None:
    subprocess.run(command, cwd=folder, check=True, capture_output=True, timeout=120)
