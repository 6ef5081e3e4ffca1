"""Build the Debian packages that the job `package` installs: this checkout's, and one of a higher version.

The higher version is the same package with another number and a line more in two settings files: what an upgrade has to
keep or bring. Neither is compressed: the guest, emulated, would take long over it.
"""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import guest

FOLDER = guest.FOLDER / "packages"
NEXT = "99.0.0"
CHANGED = ("etc/facetd/parts.yaml", "etc/facetd/facets.yaml")


def build() -> None:
    """Leave both, and Debian's python3-systemd, in FOLDER. Raises RigError."""
    shutil.rmtree(FOLDER, ignore_errors=True)
    FOLDER.mkdir(parents=True)
    environment = {**os.environ, "EXTRAS": "no", "COMPRESS": "none"}
    _run(["debian/build.sh", "amd64"], guest.CHECKOUT, environment)
    for package in (guest.CHECKOUT / "build").glob("facetd_*_amd64.deb"):
        shutil.move(package, FOLDER)
    _run(["apt-get", "-qq", "download", "python3-systemd"], FOLDER)
    (built,) = FOLDER.glob("facetd_*.deb")
    _raise_version(built)


def _raise_version(built: Path) -> None:
    unpacked = FOLDER / "next"
    _run(["dpkg-deb", "-R", str(built), str(unpacked)], FOLDER)
    control = unpacked / "DEBIAN/control"
    lines = [f"Version: {NEXT}" if line.startswith("Version:") else line for line in control.read_text().splitlines()]
    control.write_text("\n".join(lines) + "\n")
    for name in CHANGED:
        with (unpacked / name).open("a") as file:
            file.write(f"# of release {NEXT}\n")
    _run(["dpkg-deb", "-Znone", "-b", str(unpacked), f"facetd_{NEXT}_amd64.deb"], FOLDER)
    shutil.rmtree(unpacked)


def _run(words: list[str], where: Path, environment: dict[str, str] | None = None) -> None:
    done = subprocess.run(words, cwd=where, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        raise guest.RigError(f"rig: {' '.join(words)}: {(done.stderr or done.stdout).strip()}")
