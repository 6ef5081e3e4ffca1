"""Run deploy/install.sh on a fake project and root, with a power cut at the n-th change of the disk.

Python, pip and the program are a few lines of shell. Every command of the script that changes the disk is a step; the
step at the power cut is half done, files of the new release that were not synced are empty, and nothing follows.
"""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from daemon.store.folders import HOUSE

OLDER, OLD, NEW, NEXT = "20250101T000000Z", "20260101T000000Z", "20260202T000000Z", "20260303T000000Z"
SETTINGS = ("facetd.yaml", "calibration.yaml", "facets.yaml", "parts.yaml", "simcell.yaml")
DEPLOYED = {
    "etc/systemd/system/facetd.service": "facetd.service",
    "etc/systemd/system/facetd-dashboard.service": "facetd-dashboard.service",
    "usr/lib/sysusers.d/facetd.conf": "facetd.sysusers",
    "usr/lib/tmpfiles.d/facetd.conf": "facetd.tmpfiles",
    "usr/lib/systemd/catalog/facetd.catalog": "facetd.catalog",
    "etc/udev/rules.d/60-facetd.rules": "60-facetd.rules",
}
COMPLETION = "usr/share/bash-completion/completions/facetctl"
COUNTED = ("mkdir", "cp", "install", "mv", "ln", "rm", "sync", "sed")

PROGRAM = """#!/bin/sh
cd "$(dirname "$0")/../.." && /usr/bin/sha1sum --quiet -c manifest && echo whole
"""
"""Runs where all that was installed with it is whole."""

PYTHON = """#!/bin/sh
# python -m venv FOLDER, -m compileall, -m daemon.ctl completion bash
case $2 in
venv)
    mkdir -p "$3/bin"
    cp -a "$STUBS/python" "$3/bin/python"
    cp -a "$STUBS/pip" "$3/bin/pip" ;;
daemon.ctl) echo "completion of $(/usr/bin/cat "$PYTHONPATH/daemon/version")" ;;
esac
"""

PIP = """#!/bin/sh
release=$(cd "$(dirname "$0")/../.." && pwd)
cd "$release"
/usr/bin/find . -type f ! -path './venv/*' ! -name manifest | /usr/bin/xargs /usr/bin/sha1sum >manifest
cp -a "$STUBS/program" "$release/venv/bin/facetd"
"""

STEP = """#!/bin/sh
name=${0##*/}
read -r count <"$STEPS"
count=$((count + 1))
echo $count >"$STEPS"
for last; do :; done
if [ $count = "$CUT" ]; then
    case $name in
    cp) /usr/bin/cp "$@"; /usr/bin/find "$last" -type f | /usr/bin/tail -n 1 | /usr/bin/xargs /usr/bin/truncate -s 3 ;;
    install) /usr/bin/install "$@"; /usr/bin/truncate -s 10 "$last" ;;
    rm) /usr/bin/find "$last" -type f | /usr/bin/head -n 1 | /usr/bin/xargs -r /usr/bin/rm ;;
    esac
    new=$(/usr/bin/ls "$DESTDIR/opt/facetd/releases" 2>/dev/null | /usr/bin/tail -n 1)
    if [ "$new" = "$FACETD_NOW" ] && [ ! -e "$STEPS.synced" ]; then
        /usr/bin/find "$DESTDIR/opt/facetd/releases/$new" -type f -exec /usr/bin/truncate -s 0 {} +
    fi
    kill -9 0
fi
case $name in
sync) [ "$1" = -f ] && : >"$STEPS.synced" ;;
esac
exec "/usr/bin/$name" "$@"
"""


@dataclass(frozen=True)
class Installer:
    """A house of two versions (old/, new/), and what stands for the programs it calls (stubs/)."""

    folder: Path

    def __post_init__(self) -> None:
        stubs = self.folder / "stubs"
        stubs.mkdir(parents=True)
        scripts = {"program": PROGRAM, "python": PYTHON, "pip": PIP, "date": '#!/bin/sh\necho "$FACETD_NOW"\n'}
        for name, text in {**scripts, **dict.fromkeys(COUNTED, STEP)}.items():
            (stubs / name).write_text(text)
            (stubs / name).chmod(0o755)
        for version in ("old", "new"):
            self._house(version)

    def _house(self, version: str) -> None:
        house = self.folder / version
        for name in ("daemon", "drivers", "etc", "docs"):
            (house / name).mkdir(parents=True)
            (house / name / "version").write_text(version)
        shutil.copytree(HOUSE / "deploy", house / "deploy")
        script = (house / "deploy/install.sh").read_text()
        asked = script.replace('{ [ -n "$root" ] || runs', "{ runs")  # what was made up here runs here
        assert asked != script
        (house / "deploy/install.sh").write_text(asked)
        for name in SETTINGS:
            (house / "etc" / name).write_text(f"# {name} of the {version} release\n")
        for name in DEPLOYED.values():
            with (house / "deploy" / name).open("a") as file:
                file.write(f"# {version}\n")

    def run(
        self, root: Path, word: str, version: str = "new", now: str = NEW, cut: int = 0
    ) -> subprocess.CompletedProcess[str]:
        """The script of a version, until the power goes at step `cut`, or after the last (0: it stays)."""
        steps = self.folder / f"steps-{root.name}"
        steps.write_text("0\n")
        steps.with_name(f"{steps.name}.synced").unlink(missing_ok=True)
        stubs = self.folder / "stubs"
        environment = {
            "PATH": f"{stubs}:/usr/bin:/bin", "DESTDIR": str(root), "FACETD_APT": "no", "PYTHON": str(stubs / "python"),
            "STUBS": str(stubs), "STEPS": str(steps), "CUT": str(cut), "FACETD_NOW": now,
        }  # fmt: skip
        script = self.folder / version / "deploy/install.sh"
        done = subprocess.run(["sh", str(script), word], env=environment, capture_output=True, text=True, check=False,
                              start_new_session=True)  # fmt: skip
        if cut > self.steps(root) and not steps.with_name(f"{steps.name}.synced").exists():
            for file in (path for path in (root / "opt/facetd/releases" / now).rglob("*") if path.is_file()):
                os.truncate(file, 0)
        return done

    def installed(self, root: Path) -> None:
        """The old release in use in a root, one before it, and a facetd.yaml that its people have edited."""
        for now in (OLDER, OLD):
            done = self.run(root, "install", "old", now)
            assert done.returncode == 0, done.stderr
        (root / "etc/facetd/facetd.yaml").write_text("# ours\n")

    def steps(self, root: Path) -> int:
        """How many the last run took."""
        return int((self.folder / f"steps-{root.name}").read_text())

    def faults(self, root: Path, mine: Mapping[str, str]) -> list[str]:
        """What in a root is neither the old nor the new. mine: settings that people have edited, which stay."""
        found = []
        for name in SETTINGS:
            found += self._neither(root / "etc/facetd" / name, "etc", name, mine.get(name))
            found += self._neither(root / "etc/facetd" / f"{name}.new", "etc", name, None)
        for place, name in DEPLOYED.items():
            found += self._neither(root / place, "deploy", name, None)
        completion = root / COMPLETION
        if completion.exists() and completion.read_text() not in ("completion of old\n", "completion of new\n"):
            found.append(f"{completion}: half")
        return found

    def _neither(self, path: Path, folder: str, name: str, mine: str | None) -> list[str]:
        told = [(self.folder / version / folder / name).read_text() for version in ("old", "new")]
        here = path.read_text() if path.exists() else None
        wanted = [mine] if mine is not None else [None, *told]
        return [] if here in wanted else [f"{path}: neither the old nor the new"]


def runs(root: Path) -> bool:
    """Whether the release in use is whole."""
    program = root / "opt/facetd/current/venv/bin/facetd"
    return subprocess.run(["sh", str(program)], capture_output=True, check=False).stdout == b"whole\n"
