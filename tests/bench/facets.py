"""Facets against ground truth: recall by set, corner errors, time by stage, corner detectors and stereo formulas
side by side.

Reads the rendered scenes of $FACETD_SHARED/scenes (default ../shared); a bench script, run by `make bench`.
"""

from __future__ import annotations

import collections
import sys
import time
from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from daemon.arrays import Array
from daemon.vision.facets.one_look.candidates import choose, find_candidates, outlines_of
from daemon.vision.facets.one_look.reconstruct import find_facets
from daemon.vision.geometry.rig import StereoRig
from daemon.vision.image.stereo_images import open_stereo
from daemon.vision.settings import CornerDetector, StereoFormula, VisionSettings
from daemon.vision.values import Facet, FacetView
from tests.fakes import rendered
from tests.fakes.limit import limit

NEAR_PX = 3.0


@dataclass
class Tally:
    """What one set of scenes came to."""

    found: int = 0
    visible: int = 0
    extra: int = 0
    corners_mm: list[float] = field(default_factory=list)
    pull: list[float] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)
    missed: list[str] = field(default_factory=list)


def visible_facets(truth: dict[str, Any]) -> list[dict[str, Any]]:
    """Facets that both cameras can see."""
    every = [f for o in truth["objects"] for f in o["facets"]]
    return [f for f in every if f["left"]["visible"] and f["right"]["visible"]]


def nearest(facet: dict[str, Any], found: list[Facet]) -> tuple[Facet, NDArray[np.intp]] | None:
    """The found facet with the same corners, and the order in which the true ones lie, or None."""
    left, right = (np.array(facet[camera]["corners_px"]) for camera in ("left", "right"))
    best, answer = NEAR_PX, None
    for f in found:
        n = len(left)
        if len(f.left_px) != n:
            continue
        for order in [np.roll(o, k) for o in (np.arange(n), np.arange(n)[::-1]) for k in range(n)]:
            off = max(np.abs(left[order] - f.left_px).max(), np.abs(right[order] - f.right_px).max())
            if off < best:
                best, answer = off, (f, order)
    return answer


def score(view: FacetView, truth: dict[str, Any], name: str, tally: Tally) -> None:
    """Add one look to its set."""
    found = [f for g in view.groups for f in g.facets]
    wanted = visible_facets(truth)
    hits = 0
    for k, t in enumerate(wanted):
        tally.visible += 1
        answer = nearest(t, found)
        if answer is None:
            tally.missed.append(f"{name}:{k}({len(t['corners_mm'])})")
            continue
        hits += 1
        f, order = answer
        error = f.corners_mm - np.array(t["corners_mm"])[order]
        tally.corners_mm.extend(np.linalg.norm(error, axis=1))
        chi2 = np.einsum("ni,nij,nj->n", error, np.linalg.pinv(f.covariance_mm2), error)
        tally.pull.extend(np.sqrt(chi2 / 3))
    tally.found += hits
    tally.extra += len(found) - hits


def run(settings: VisionSettings, only: str = "") -> dict[str, Tally]:
    """All scenes whose name holds `only`, by set."""
    rigs: dict[str, StereoRig] = {}
    tallies: dict[str, Tally] = collections.defaultdict(Tally)
    for scene in [path.parent for path in sorted(rendered.ALL.glob("*/truth.json"))]:
        name = scene.name
        if only not in name:
            continue
        truth = rendered.truth(scene)
        rig = rigs.setdefault(truth["rig"], rendered.rig(rendered.ALL, truth["rig"]))
        left, right = rendered.pair(scene)
        tally = tallies[name.rsplit("-", 1)[0]]
        start = time.process_time()
        view = find_facets(left, right, rig, settings)
        tally.seconds.append(time.process_time() - start)
        score(view, truth, name, tally)
    return tallies


def print_table(tallies: dict[str, Tally]) -> None:
    """One line a set."""
    print(
        f"{'set':<16}{'visible':>8}{'found':>8}{'extra':>7}{'corner mm: median':>19}{'95 %':>8}{'pull':>7}{'cpu ms':>8}"
    )
    for name, t in tallies.items():
        e = np.array(t.corners_mm) if t.corners_mm else np.array([np.nan])
        pull = float(np.median(t.pull)) if t.pull else float("nan")
        recall = t.found / max(t.visible, 1)
        print(
            f"{name:<16}{t.visible:>8}{recall:>8.3f}{t.extra:>7}{np.median(e):>19.3f}{np.percentile(e, 95):>8.3f}"
            f"{pull:>7.2f}{1e3 * np.median(t.seconds):>8.1f}"
        )


def edges(facets: list[Array]) -> list[Array]:
    """Different edges (2, 3) mm of facets' corners (N, 3), each once."""
    found: list[Array] = []
    for corners in facets:
        for edge in np.stack([corners, np.roll(corners, -1, 0)], 1):
            if not any(min(np.abs(edge - g).max(), np.abs(edge[::-1] - g).max()) < 1e-3 for g in found):
                found.append(edge)
    return found


def edge_errors(settings: VisionSettings) -> tuple[Array, int]:
    """The thesis's figure 5.7: absolute errors of a box's edge lengths, mm, and how many edges were not found."""
    errors, missing = [], 0
    for scene in sorted(rendered.ALL.glob("table57-*")):
        truth = rendered.truth(scene)
        view = find_facets(*rendered.pair(scene), rendered.rig(rendered.ALL, truth["rig"]), settings)
        got = edges([f.corners_mm for g in view.groups for f in g.facets])
        for edge in edges([np.array(f["corners_mm"]) for f in visible_facets(truth)]):
            away = [min(np.abs(g - edge).max(), np.abs(g[::-1] - edge).max()) for g in got]
            if not away or min(away) > 60:
                missing += 1
                continue
            nearest_edge = got[int(np.argmin(away))]
            errors.append(abs(np.linalg.norm(nearest_edge[0] - nearest_edge[1]) - np.linalg.norm(edge[0] - edge[1])))
    return np.array(errors), missing


def print_comparison() -> None:
    """Corner detectors and stereo formulas on figure 5.7."""
    print(f"\n{'figure 5.7, rig A0: corners by':<32}{'depth by':<22}{'mean |edge error| mm':>22}{'missing':>9}")
    detectors: tuple[CornerDetector, ...] = ("line_fit", "mic", "median")
    formulas: tuple[StereoFormula, ...] = ("exact", "thesis", "thesis_compensated")
    for detector in detectors:
        for formula in formulas:
            settings = VisionSettings(corner_detector=detector, stereo_formula=formula)
            error, missing = edge_errors(settings)
            print(f"{detector:<32}{formula:<22}{error.mean():>22.3f}{missing:>9}")
    print("the thesis itself, with its own cameras: 2.99 mm")


def print_stages() -> None:
    """Median CPU time by stage over the clean scenes of rig B, and the limit meter's reading."""
    spent: dict[str, list[float]] = collections.defaultdict(list)
    ratios = []
    rig, settings = rendered.rig(rendered.ALL, "B"), VisionSettings()
    for scene in sorted(rendered.ALL.glob("clean-B-*")):
        pair = rendered.pair(scene)
        t = [time.process_time()]
        cameras = open_stereo(*pair, rig)
        outlines = outlines_of(cameras, settings, in_one=True)
        t.append(time.process_time())
        candidates = find_candidates(outlines, cameras, settings)
        t.append(time.process_time())
        choose(candidates, settings)
        t.append(time.process_time())
        view = find_facets(*pair, rig, settings)
        t.append(time.process_time())
        reading = limit(view)
        if reading is not None:
            ratios.append((reading.seen_px, reading.bound_px, reading.blur_px, reading.contrast, reading.noise_sigma))
        for name, a, b in zip(("outlines, both eyes", "match and fit", "choose", "all"), t[:-1], t[1:], strict=True):
            spent[name].append(b - a)
    print("\nCPU ms, median over clean-B: " + ", ".join(f"{k} {1e3 * np.median(v):.1f}" for k, v in spent.items()))
    seen, bound, blur, contrast, sigma = np.median(np.array(ratios), 0)
    print(
        f"limit meter, medians: corners {seen:.3f} px seen, {bound:.3f} px possible (blur {blur:.2f} px, "
        f"contrast {contrast:.0f}, noise {sigma:.1f} grey levels)"
    )


def main() -> None:
    """Print the tables."""
    cv2.setNumThreads(1)
    if not rendered.ALL.is_dir():
        print("facets: no scenes (set FACETD_SHARED)")
        return
    only = sys.argv[1] if len(sys.argv) > 1 else ""
    tallies = run(VisionSettings(), only)
    print_table(tallies)
    if only:
        print(*(m for t in tallies.values() for m in t.missed), sep="\n")
    else:
        print_comparison()
        print_stages()


if __name__ == "__main__":
    main()
