"""`make arm64`: facetd's package for arm64, emulated, against this machine: the same names, the same poses, the demo.

usage: run.py [looks]        looks: without the demo, which takes longest

The demo here leaves pairs, a model and a calibration. The package, installed in a root of Debian 12 for arm64, is
given the same files. Exit status: 0 the same; 1 not, with a line for each difference, or a step failed; 2 it cannot be
run here.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

HERE = Path(__file__).resolve().parent
CHECKOUT = HERE.parents[1]
PREPARE = HERE / "prepare.sh"
CACHE = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "facetd" / "arm64"
PAIRS = 12
MOST_MM = 0.01
"""How far a pose may be from this machine's."""
SEED = "106"


REFUSED = 3
"""Exit status of prepare.sh where it cannot be run here."""


class Arm64Error(Exception):
    """A step failed; one line, and the exit status of all."""

    def __init__(self, text: str, status: int = 1) -> None:
        super().__init__(text)
        self.status = status


def run(*words: str | Path, **more: Any) -> subprocess.CompletedProcess[str]:
    done = subprocess.run(list(map(str, words)), cwd=CHECKOUT, text=True, check=False, **more)
    if done.returncode:
        refused = words[0] == PREPARE and done.returncode == REFUSED
        raise Arm64Error(f"arm64: {words[0]} ended with status {done.returncode}", 2 if refused else 1)
    return done


def facetctl(*words: str | Path) -> str:
    return run(sys.executable, "-m", "daemon.ctl", *words, stdout=subprocess.PIPE).stdout


def carry(runs: Path, work: Path) -> None:
    """Pairs, last model and calibration of the demo's run, as files to take along."""
    (log,) = runs.glob("*/run.jsonl")
    records = [json.loads(line) for line in log.read_text().splitlines()]
    start = next(record for record in records if record["kind"] == "run_start")
    shutil.copy(log.parent / start["calibration"], work / "calibration.yaml")
    models = [record["file"] for record in records if record["kind"] == "model" and record["file"] is not None]
    shutil.copy(log.parent / models[-1], work / "model.npz")
    lefts = sorted((log.parent / "images").glob("*-left.png"))
    for number in np.unique(np.linspace(0, len(lefts) - 1, PAIRS).astype(int)):
        left = lefts[number]
        (pair := work / "looks" / left.name.removesuffix("-left.png")).mkdir(parents=True)
        shutil.copy(left, pair / "left.png")
        shutil.copy(left.with_name(left.name.replace("-left", "-right")), pair / "right.png")


def differences(here: list[dict[str, Any]], there: list[dict[str, Any]]) -> Iterator[str]:
    """A line for each pair whose parts have other names, or a pose that is too far off."""
    for ours, theirs in zip(here, there, strict=True):
        names = [[part["label"] for part in pair["parts"]] for pair in (ours, theirs)]
        if names[0] != names[1]:
            yield f"{ours['pair']}: {names[1]} instead of {names[0]}"
            continue
        for mine, other in zip(ours["parts"], theirs["parts"], strict=True):
            same = other["equivalents"] or [other["cyclopean_from_part"]]  # a symmetric part has several
            off_mm = min(distance_mm(mine["cyclopean_from_part"], pose) for pose in same)
            if off_mm > MOST_MM:
                yield f"{ours['pair']}: the {mine['label']} is {off_mm:.4f} mm off"


def distance_mm(ours: list[list[float]] | None, theirs: list[list[float]] | None) -> float:
    """Between two poses: of the origins, and of points 50 mm from them along the axes; the largest."""
    if ours is None or theirs is None:
        return 0.0 if ours is theirs else np.inf
    points = np.vstack([np.zeros(3), 50.0 * np.eye(3)])
    apart = [points @ np.asarray(pose)[:3, :3].T + np.asarray(pose)[:3, 3] for pose in (ours, theirs)]
    return float(np.linalg.norm(apart[0] - apart[1], axis=1).max())


def compare(work: Path, looks_alone: bool) -> int:
    began_s = time.monotonic()
    run(PREPARE, CACHE)
    print(f"arm64: the root is there after {time.monotonic() - began_s:.0f} s", flush=True)
    run("debian/build.sh", "arm64", env={**os.environ, "EXTRAS": "no", "COMPRESS": "gzip"})
    (package,) = (CHECKOUT / "build").glob("facetd_*_arm64.deb")
    shutil.move(package, work / "facetd.deb")
    print(f"arm64: the package is built after {time.monotonic() - began_s:.0f} s", flush=True)
    facetctl("demo", "--seed", SEED, "--runs", work / "runs")
    carry(work / "runs", work)
    looks = sorted((work / "looks").iterdir())
    files = ("--calibration", work / "calibration.yaml", "--model", work / "model.npz")
    shutil.copy(HERE / "recognise.py", work)
    seen = run(sys.executable, HERE / "recognise.py", *files, *looks, stdout=subprocess.PIPE,
               env={**os.environ, "PYTHONPATH": str(CHECKOUT)}).stdout  # fmt: skip
    here = [json.loads(line) for line in seen.splitlines()]
    there_alone = ("unshare", "--mount", HERE / "inside.sh", CACHE / "root", work)
    run(*there_alone)
    there = [json.loads(line) for line in (work / "arm64.jsonl").read_text().splitlines()]
    found = list(differences(here, there))
    print("\n".join(f"arm64: {line}" for line in found), end="\n" if found else "")
    named = sum(part["label"] != "unknown" for pair in here for part in pair["parts"])
    print(
        f"arm64: {len(here)} pairs, {named} parts named, {len(found)} differences; {time.monotonic() - began_s:.0f} s"
    )
    if not looks_alone:
        run(*there_alone, "--seed", SEED)
        print(f"arm64: the demo picked all there; {time.monotonic() - began_s:.0f} s", flush=True)
    return int(bool(found) or not named)


def main() -> int:
    """See the top of this file."""
    try:
        with tempfile.TemporaryDirectory(prefix="facetd-arm64-") as work:
            return compare(Path(work), sys.argv[1:] == ["looks"])
    except Arm64Error as error:
        print(error, file=sys.stderr)
        return error.status


if __name__ == "__main__":
    sys.exit(main())
