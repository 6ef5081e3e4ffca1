"""What more taught parts cost: training, loading, and looks at clean pictures, at strangers and at a factory's.

The parts of the rendered scenes are taught from views, all others from drawings. Every picture is shown to every model
in turn, in one process, so that the ratios hold whatever else the computer does meanwhile. Models are read from their
files, as the daemon has them.

usage: python -m tests.bench.growth [COUNT...]   (default 4 64 254; rising)
"""

from __future__ import annotations

import resource
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from daemon.main import tame_malloc
from daemon.store.model import load, save
from daemon.vision.geometry.rig import StereoRig
from daemon.vision.look import look
from daemon.vision.model.model import Model
from tests.bench.recognise import Tally, judge, test_folders, trained
from tests.fakes import rendered
from tests.fakes.many_parts import drawn_parts, taught

COUNTS = (4, 64, 254)
KINDS = {"clean": ("clean",), "strangers": ("unknown", "factoryunknown"), "factory": ("factory",)}


class Made(NamedTuple):
    """A model as it is read from its file; s of processor that its training took, of the clock that loading and making
    ready for the first look took; MiB of the file, and by which the process grew meanwhile."""

    model: Model
    training_s: float
    loading_s: float
    ready_s: float
    file_mib: float
    grown_mib: float


def main(*counts: int) -> None:
    if not rendered.ALL.is_dir():
        print(f"no scenes at {rendered.ALL}: set FACETD_SHARED to the folder that holds scenes/")
        return
    cv2.setNumThreads(1)
    tame_malloc()
    rig = rendered.rig(rendered.ALL, "B")
    models = dict(_models(rig, sorted(counts or COUNTS)))
    for kind, prefixes in KINDS.items():
        folders = [f for f in test_folders(rendered.ALL) if f.name.partition("-")[0] in prefixes and "-B-" in f.name]
        tallies = {count: Tally() for count in models}
        for folder in folders:
            for count, model in models.items():
                scene = look(*rendered.pair(folder), rig, model, clock=time.process_time)
                judge(scene, rendered.truth(folder), model.labels, tallies[count])
                tallies[count].looks_ms.append(1000 * sum(scene.seconds.values()))
        _table(kind, tallies)


def _models(rig: StereoRig, counts: list[int]) -> list[tuple[int, Model]]:
    """A model of so many parts each, read from its file, ready; what that took is told."""
    print(f"{'taught':>6}{'views':>7}{'training s':>12}{'ms a part':>11}{'file MiB':>10}{'load s':>8}{'ready s':>9}"
          f"{'resident MiB':>14}")  # fmt: skip
    model, parts, spent_s, found = trained(rig), drawn_parts(max(counts)), 0.0, list[tuple[int, Model]]()
    for count in counts:
        more = parts[max(len(model.labels) - 4, 0) : count - 4]
        began = time.process_time()
        model = taught(more, model)
        new_s = time.process_time() - began
        spent_s += new_s
        made = _made(model, rig, spent_s)
        a_part = f"{1000 * new_s / len(more):.0f}" if more else "-"
        print(f"{len(model.labels):>6}{len(model.views):>7}{spent_s:>12.1f}{a_part:>11}{made.file_mib:>10.2f}"
              f"{made.loading_s:>8.2f}{made.ready_s:>9.2f}{made.grown_mib:>14.0f}", flush=True)  # fmt: skip
        found.append((count, made.model))
    return found


def _made(model: Model, rig: StereoRig, training_s: float) -> Made:
    """The model after a trip through its file. Ready: what the first look at an empty picture takes over the second."""
    blank = np.full(rig.image_size[::-1], 40, np.uint8)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "model.npz"
        save(model, path)
        size_mib = path.stat().st_size / 2**20
        before = _resident_mib()
        start = time.perf_counter()
        again = load(path)
        loaded = time.perf_counter()
        look(blank, blank, rig, again)
        first = time.perf_counter()
        look(blank, blank, rig, again)
        last = time.perf_counter()
    ready_s = max(first - loaded - (last - first), 0.0)
    return Made(again, training_s, loaded - start, ready_s, size_mib, _resident_mib() - before)


def _resident_mib() -> float:
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize() / 2**20


def _table(kind: str, tallies: dict[int, Tally]) -> None:
    least = np.median(next(iter(tallies.values())).looks_ms)
    print(f"\n{kind:<12}{'taught':>7}{'looks':>7}{'ms 50 %':>9}{'95 %':>7}{'worst':>7}{'of the first':>14}"
          f"{'right':>7}{'silent':>8}{'wrong':>7}{'invented':>10}")  # fmt: skip
    for count, tally in tallies.items():
        middle, most, worst = np.percentile(tally.looks_ms, [50, 95, 100])
        c, looks = tally.counts, len(tally.looks_ms)
        print(
            f"{'':<12}{count:>7}{looks:>7}{middle:>9.0f}{most:>7.0f}{worst:>7.0f}{middle / least:>14.2f}"
            f"{c['right']:>7}{c['silent']:>8}{c['mistaken']:>7}{c['invented'] + c['ghost']:>10}",
            flush=True,
        )


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
