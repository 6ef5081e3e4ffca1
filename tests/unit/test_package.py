"""The Debian package: its scripts, and that it has every extra and every settings file."""

from __future__ import annotations

import re
import subprocess
import tomllib
from pathlib import Path
from typing import Any

import pytest

from daemon.store.folders import HOUSE

DEBIAN = HOUSE / "debian"
SCRIPTS = ("preinst", "postinst", "prerm", "postrm")
IN_THE_BASE = {"metrics", "dashboard", "systemd", "modbus"}
"""Extras that the package facetd has; systemd's is Debian's own python3-systemd."""
ELSEWHERE = {"dev", "live"}
"""For development; another name of the dashboard."""


def packages() -> dict[str, str]:
    """Each binary package's paragraph of debian/control."""
    paragraphs = (DEBIAN / "control").read_text().split("\n\n")
    return {found[1]: text for text in paragraphs if (found := re.search(r"^Package: (\S+)", text, re.MULTILINE))}


@pytest.mark.parametrize("name", [*(f"facetd.{script}" for script in SCRIPTS), "build.sh"])
def test_the_scripts_are_shell(name: str) -> None:
    shell = "bash" if name == "build.sh" else "sh"
    assert subprocess.run([shell, "-n", str(DEBIAN / name)], check=False).returncode == 0
    if shell == "sh":
        assert "#DEBHELPER#" in (DEBIAN / name).read_text()


def test_every_extra_is_in_a_package() -> None:
    project: dict[str, Any] = tomllib.loads((HOUSE / "pyproject.toml").read_text())["project"]
    apart = set(project["optional-dependencies"]) - IN_THE_BASE - ELSEWHERE
    assert set(packages()) == {"facetd", *(f"facetd-{extra}" for extra in apart)}
    assert "python3-systemd" in packages()["facetd"]


def test_every_link_leads_to_a_file() -> None:
    links = [path for path in DEBIAN.iterdir() if path.is_symlink()]
    assert {path.name for path in links} >= {"facetd.service", "facetd.sysusers", "facetd.tmpfiles"}
    assert [path for path in links if not path.exists()] == []


def test_everything_that_is_installed_by_name_is_there() -> None:
    for line in (DEBIAN / "facetd.install").read_text().splitlines():
        for pattern in line.split()[:-1]:
            assert list(HOUSE.glob(pattern)), pattern


@pytest.mark.parametrize("made", [True, False])
def test_it_is_not_installed_over_what_a_script_installed_before(tmp_path: Path, made: bool) -> None:
    (tmp_path / "opt/facetd").mkdir(parents=True)
    if made:
        (tmp_path / "opt/facetd/current").symlink_to("/")
    script = ["sh", str(DEBIAN / "facetd.preinst"), "install"]
    done = subprocess.run(script, env={"DPKG_ROOT": str(tmp_path)}, capture_output=True, text=True, check=False)
    assert done.returncode == int(made)
    assert ("install.sh remove" in done.stderr) is made
