"""The recogniser on the rendered scenes: right, silent or wrong by set; what its confidence is worth; time; memory.

Scenes: the folder named by FACETD_SHARED (default ../shared), scenes/ in it, and those named by FACETD_SCENES
(several with `:` between), each with calibration-<RIG>.yaml beside the scenes. Trained on the six train-B views of the
first only.
"""

from __future__ import annotations

import resource
import time
from collections import Counter, defaultdict
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from daemon.arrays import Array
from daemon.main import tame_malloc
from daemon.store.library import load_facets
from daemon.vision.facets.one_look.reconstruct import find_facets
from daemon.vision.geometry.rig import StereoRig
from daemon.vision.look import look
from daemon.vision.model.model import Model, empty_model, learn_view
from daemon.vision.settings import VisionSettings
from daemon.vision.values import Part, Scene
from tests.fakes import rendered

NEAR_MM = 25.0  # a part found belongs to a true one when their corners' centroids are this close
BINS = (0.0, 0.5, 0.9, 0.99, 0.999, 1.0 + 1e-9)


@dataclass
class Tally:
    """What became of one set's parts; corner errors of the named ones, mm; processor time of each look, ms."""

    counts: Counter[str] = field(default_factory=Counter)
    fitted_mm: list[float] = field(default_factory=list)
    measured_mm: list[float] = field(default_factory=list)
    looks_ms: list[float] = field(default_factory=list)


def main() -> None:
    if not rendered.ALL.is_dir():
        print(f"no scenes at {rendered.ALL}: set FACETD_SHARED to the folder that holds scenes/")
        return
    rigs = {name: rendered.rig(rendered.ALL, name) for name in ("A0", "B")}
    model = trained(rigs["B"])
    cv2.setNumThreads(1)
    tame_malloc()  # as the daemon does: fresh memory costs a look up to a seventh of its time
    stages: dict[str, list[float]] = defaultdict(list)
    named = [confidence for home in (rendered.ALL, *rendered.MORE) for confidence in _accuracy(home, model, stages)]
    _reliability(named)
    _time(stages)
    _detectors(rigs, model)
    _memory()


def trained(rig: StereoRig, settings: VisionSettings | None = None) -> Model:
    """The model taught on the six characteristic views."""
    model = empty_model(load_facets())
    for folder in sorted(rendered.ALL.glob("train-B-*")):
        left, right = rendered.pair(folder)
        groups = find_facets(left, right, rig, settings).groups
        label = rendered.truth(folder)["objects"][0]["label"]
        model = learn_view(model, max(groups, key=lambda g: len(g.facets)), label)
    return model


def test_folders(home: Path) -> list[Path]:
    folders = sorted(path.parent for path in home.glob("*/truth.json"))
    return [folder for folder in folders if not folder.name.startswith(("train", "table57"))]


def judge(scene: Scene, told: dict[str, Any], known: tuple[str, ...], tally: Tally) -> list[tuple[float, bool]]:
    """Count one scene; (confidence, right) of every part that was named."""
    bodies, ghosts = matched(scene, told)
    named: list[tuple[float, bool]] = []
    for body, part in bodies:
        label = part.recognition.label if part else "nothing"
        silent = label in ("unknown", "nothing")
        right = label == body["label"]
        if body["label"] in known:
            tally.counts["right" if right else "silent" if silent else "mistaken"] += 1
        else:
            tally.counts["rejected" if silent else "invented"] += 1
        if part is not None and not silent:
            named.append((part.recognition.confidence, right))
        if part is not None and right:
            _errors(part, np.vstack([np.asarray(f["corners_mm"], float) for f in body["facets"]]), tally)
    tally.counts["ghost"] += len(ghosts)
    return named + [(p.recognition.confidence, False) for p in ghosts]


def matched(scene: Scene, told: dict[str, Any]) -> tuple[list[tuple[dict[str, Any], Part | None]], list[Part]]:
    """Each true body with the part found where it is, if any; and the named parts that are where no body is."""
    left = [p for p in scene.parts if p.facets]
    bodies: list[tuple[dict[str, Any], Part | None]] = []
    for body in told["objects"]:
        facets = [f for f in body["facets"] if f["left"]["visible"] and f["right"]["visible"]]
        corners = np.vstack([np.asarray(f["corners_mm"], float) for f in facets]) if facets else np.zeros((0, 3))
        part = _nearest(left, corners)
        if part is not None:
            left.remove(part)
        bodies.append((body, part))
    return bodies, [p for p in left if p.named]


def _nearest(parts: list[Part], corners: Array) -> Part | None:
    if not len(corners):
        return None
    away = [float(np.linalg.norm(np.vstack(p.fitted_mm).mean(0) - corners.mean(0))) for p in parts]
    return parts[int(np.argmin(away))] if away and min(away) < NEAR_MM else None


def _errors(part: Part, corners: Array, tally: Tally) -> None:
    """How far the part's corners are from the nearest of all the body's: a facet hardly in view may be found, too."""
    for found, kind in ((part.fitted_mm, tally.fitted_mm), ([f.corners_mm for f in part.facets], tally.measured_mm)):
        points = np.vstack(list(found))
        kind.extend(np.linalg.norm(points[:, None] - corners[None], axis=2).min(1).tolist())


def _accuracy(home: Path, model: Model, stages: dict[str, list[float]]) -> list[tuple[float, bool]]:
    """One folder's table, a line a set; (confidence, right) of every part named. stages: seconds of rig B's looks."""
    tallies: dict[str, Tally] = defaultdict(Tally)
    named: list[tuple[float, bool]] = []
    dense = cv2.StereoSGBM.create(minDisparity=0, numDisparities=128, blockSize=5, P1=200, P2=800)
    for folder in test_folders(home):
        told, pair = rendered.truth(folder), rendered.pair(folder)
        scene = look(*pair, rendered.rig(home, told["rig"]), model, clock=time.process_time)
        tally = tallies[f"{told['tags'][0]}-{told['rig']}"]
        named += judge(scene, told, model.labels, tally)
        tally.looks_ms.append(1000 * sum(scene.seconds.values()))
        if told["rig"] == "B":
            start = time.process_time()
            dense.compute(*pair)
            stages["StereoSGBM"].append(time.process_time() - start)
            for name, seconds in {"one look": sum(scene.seconds.values()), **scene.seconds}.items():
                stages[name].append(seconds)
    print(f"\n{home}")
    print(f"{'set':<18}{'looks':>6}{'taught':>7}{'right':>8}{'silent':>8}{'wrong':>8}{'other':>7}{'rejected':>9}"
          f"{'ghost':>6}{'corner mm 50 %':>16}{'95 %':>7}{'measured 50 %':>15}{'95 %':>7}{'ms 50 %':>9}"
          f"{'worst':>7}")  # fmt: skip
    for name, tally in sorted(tallies.items()):
        print(_line(name, tally))
    return named


def _line(name: str, tally: Tally) -> str:
    """Shares are of the parts that were taught and of those that were not; a wrong name counts where it was given."""
    c = tally.counts
    taught, others = c["right"] + c["silent"] + c["mistaken"], c["rejected"] + c["invented"]
    corners = "".join(
        f"{_quantile(values, percent):>{width}}"
        for values, widths in ((tally.fitted_mm, (16, 7)), (tally.measured_mm, (15, 7)))
        for percent, width in zip((50, 95), widths, strict=True)
    )
    return (
        f"{name:<18}{len(tally.looks_ms):>6}{taught:>7}{_share(c['right'], taught):>8}{_share(c['silent'], taught):>8}"
        f"{_share(c['mistaken'] + c['invented'], taught + others):>8}{others:>7}{_share(c['rejected'], others):>9}"
        f"{c['ghost']:>6}{corners}{np.median(tally.looks_ms):>9.0f}{max(tally.looks_ms):>7.0f}"
    )


def _share(count: int, of: int) -> str:
    return f"{100 * count / of:.1f} %" if of else "-"


def _quantile(values: list[float], percent: float) -> str:
    return f"{np.percentile(values, percent):.3f}" if values else "-"


def _reliability(named: list[tuple[float, bool]]) -> None:
    print("\nconfidence of named parts     parts    mean    right")
    for low, high in pairwise(BINS):
        inside = [(c, r) for c, r in named if low <= c < high]
        if inside:
            mean, share = np.mean([c for c, _ in inside]), np.mean([r for _, r in inside])
            print(f"{low:>10.3f} to {min(high, 1):<10.3f}{len(inside):>11}{mean:>8.4f}{share:>9.4f}")


def _detectors(rigs: dict[str, StereoRig], model: Model) -> None:
    """Corner detectors and stereo formulas side by side, all on the same clean scenes."""
    print("\ncorners by            stereo by             right  of   corner mm 50 %    95 %  measured 50 %")
    folders = [f for f in test_folders(rendered.ALL) if f.name.startswith("clean")]
    for settings in (
        VisionSettings(),
        VisionSettings(corner_detector="mic"),
        VisionSettings(corner_detector="median"),
        VisionSettings(stereo_formula="thesis"),
        VisionSettings(stereo_formula="thesis_compensated"),
    ):
        tally = Tally()
        for folder in folders:
            told = rendered.truth(folder)
            scene = look(*rendered.pair(folder), rigs[told["rig"]], model, settings)
            judge(scene, told, model.labels, tally)
        print(f"{settings.corner_detector:<22}{settings.stereo_formula:<22}{tally.counts['right']:>5}{len(folders):>4}"
              f"{_quantile(tally.fitted_mm, 50):>17}{_quantile(tally.fitted_mm, 95):>8}"
              f"{_quantile(tally.measured_mm, 50):>15}")  # fmt: skip


def _time(stages: dict[str, list[float]]) -> None:
    """Processor time over the B scenes, one core, beside OpenCV's dense matcher on the same pairs in this process."""
    print("\nstage          median ms   95 % ms  worst ms   (processor time, one core)")
    for name, spent in stages.items():
        print(f"{name:<14}" + "".join(f"{1000 * np.percentile(spent, percent):>10.2f}" for percent in (50, 95, 100)))
    print(f"one look over StereoSGBM: {np.median(stages['one look']) / np.median(stages['StereoSGBM']):.3f}")


def _memory() -> None:
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"\npeak memory of this process: {peak:.0f} MiB")


if __name__ == "__main__":
    main()
