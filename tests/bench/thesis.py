"""Every experiment of the thesis beside ours, as the tables of docs/THESIS.md.

usage: python -m tests.bench.thesis [--write]     --write: put the tables into docs/THESIS.md, each between its marks

What needs no picture is the same on every machine; times are CPU times of this one, and the lengths and views need the
rendered scenes of $FACETD_SHARED/scenes. Where they are missing, those tables stay as they are.
"""

from __future__ import annotations

import re
import sys
import time
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

from daemon.art.others import ART1, FuzzyARTMAP, RotationLayer, best_numbering, choose
from daemon.store import folders
from daemon.vision.facets.reconstruct import find_facets
from daemon.vision.look import look
from daemon.vision.settings import CornerDetector, StereoFormula, VisionSettings
from tests.bench.facets import edge_errors, edges, visible_facets
from tests.bench.recognise import trained
from tests.fakes import rendered
from tests.fakes.thesis import (
    ALPHA,
    FIGURE_5_7,
    LABELS,
    NODES,
    PENTAGONAL_PRISM_THREE_SIDES,
    PRINTED,
    PRISM,
    matrix,
    silhouettes,
)

DOCUMENT = folders.HOUSE / "docs" / "THESIS.md"
OBJECTS = ("floppy", "cork", "pen", "screwdriver")
RUNS = 30


def table(heads: list[str], rows: list[list[str]]) -> str:
    """A table in Markdown."""
    lines = [heads, ["---"] * len(heads), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def silhouettes_table() -> str:
    """Section 4.1: which node each silhouette calls up, by vigilance."""
    shapes = silhouettes()
    rows = []
    for rho in (0.3, 0.35, 0.4, 0.5, 0.6):
        nodes = ART1(rho=rho, capacity=4).learn(shapes).tolist()
        again = ART1(rho=rho, capacity=4).learn(shapes[[0, 1, 3, 0]]).tolist()
        case_2 = "its own" if again[-1] == again[0] else "another"
        rows.append([f"{rho:g}", *(str(n + 1) for n in nodes), str(len(set(nodes))), case_2])
    return table(["vigilance", *OBJECTS, "categories", "floppy shown again calls up"], rows)


def activations_table() -> str:
    """Figures 5.25 and 5.26: printed, computed his way, and as it is in use here."""
    rows = []
    for shown in PRINTED:
        his = choose(best_numbering(shown.view, NODES, ALPHA, complement=False, scope="occupied"), LABELS, rho=0.98)
        ours = choose(best_numbering(shown.view[::-1, ::-1], NODES, ALPHA, complement=False), LABELS)
        rows.append([shown.figure, shown.truth, f"{shown.said}, {shown.activation:g}, {shown.ratio:g}",
                     f"{his.label}, {his.activation:.3f}, {his.match_ratio:.3f}",
                     f"{ours.label}, {ours.activation:.3f}, {ours.match_ratio:.3f}"])  # fmt: skip
    return table(["figure", "shown", "printed: prediction, activation, match ratio", "first slots only, as he tried",
                   "all six slots, as here"], rows)  # fmt: skip


def rotation_table() -> str:
    """Section 5.5 and figure 5.20: every numbering of every taught view calls up its own part."""
    rows = []
    rng = np.random.default_rng(0)
    for name, view, label in (
        ("prism, 3 facets", PRISM, 0),
        ("pentagonal prism, 4 facets", PENTAGONAL_PRISM_THREE_SIDES, 1),
    ):
        orders = [rng.permutation(6) for _ in range(200)]
        said = [choose(best_numbering(view[np.ix_(o, o)], NODES, ALPHA), LABELS) for o in orders]
        right = sum(v.label == LABELS[label] and v.match == 1.0 for v in said)
        layer = RotationLayer(NODES, ALPHA)
        rows.append(
            [name, f"{right} of {len(said)}", _ms(lambda view=view, layer=layer: layer.recall(view[::-1, ::-1]))]
        )
    heads = ["view, facets numbered at random", "called up exactly", "a recall here, over all 720 numberings"]
    return table(heads, rows)


def times_table() -> str:
    """Sections 5.3 and 6: his times on 166 MHz, ours here, on one core."""
    rng = np.random.default_rng(3)
    views = np.stack([_random_view(rng) for _ in range(18)]).reshape(18, 36)
    labels = [f"object {k % 4}" for k in range(18)]
    taught = FuzzyARTMAP(0.9, 0.1, 1.0).fit(views, labels)
    rows = [
        ["teach 18 patterns", "60 ms", _ms(lambda: FuzzyARTMAP(0.9, 0.1, 1.0).fit(views, labels))],
        ["recall a pattern", "10 ms", _ms(lambda: taught.predict(views[:1]))],
    ]
    if rendered.ALL.is_dir():
        model, rig = trained(rendered.rig(rendered.ALL, "B")), rendered.rig(rendered.ALL, "B")
        spent = []
        for folder in sorted(rendered.ALL.glob("clean-B-*")):
            pair = rendered.pair(folder)
            began = time.process_time()
            look(*pair, rig, model)
            spent.append(time.process_time() - began)
        rows.append(["a look, images to named parts", "18 s", f"{1e3 * float(np.median(spent)):.0f} ms"])
    return table(["", "thesis, 166 MHz", "here"], rows)


def _random_view(rng: np.random.Generator) -> np.ndarray:
    facets = int(rng.integers(2, 5))
    pairs = [(p, q) for p in range(facets) for q in range(p) if rng.random() < 0.6]
    return matrix(rng.choice((0.15, 0.3, 0.5, 0.6, 0.75), facets).tolist(), pairs)


def _ms(call: Callable[[], object]) -> str:
    """The best CPU time of some runs."""
    best = float("inf")
    for _ in range(RUNS):
        began = time.process_time()
        call()
        best = min(best, time.process_time() - began)
    return f"{1e3 * best:.2g} ms"


def lengths_table() -> str:
    """Figure 5.7: errors of a box's lengths by distance."""
    settings, found, ours_at = VisionSettings(), defaultdict(list), dict[int, float]()
    for scene in sorted(rendered.ALL.glob("table57-*")):
        truth = rendered.truth(scene)
        view = find_facets(*rendered.pair(scene), rendered.rig(rendered.ALL, truth["rig"]), settings)
        got = edges([f.corners_mm for g in view.groups for f in g.facets])
        true = edges([np.array(f["corners_mm"]) for f in visible_facets(truth)])
        corners = [c for facet in truth["objects"][0]["facets"] for c in facet["corners_mm"]]
        away_mm = float(np.mean(corners, axis=0)[2])
        distance = min(FIGURE_5_7, key=lambda mm: abs(mm - away_mm))
        ours_at[distance] = away_mm / 10
        for edge in true:
            away = [min(np.abs(g - edge).max(), np.abs(g[::-1] - edge).max()) for g in got]
            if away and min(away) < 60:
                near = got[int(np.argmin(away))]
                found[distance].append(np.linalg.norm(near[0] - near[1]) - np.linalg.norm(edge[0] - edge[1]))
    rows = []
    for mm, printed in FIGURE_5_7.items():
        ours = ["-"] * 4
        if found[mm]:
            off = np.abs(found[mm])
            ours = [f"{ours_at[mm]:.1f}", f"{np.median(off):.2f}", f"{off.max():.2f}", str(len(off))]
        rows.append([f"{mm / 10:g}", *(f"{e:+.1f}" for e in printed), *ours])
    errors = np.abs([e for line in FIGURE_5_7.values() for e in line])
    every = np.abs([e for line in found.values() for e in line])
    rows.append(["mean", *(f"{np.mean(np.abs(c)):.1f}" for c in zip(*FIGURE_5_7.values(), strict=True)),
                 "", f"{every.mean():.2f}", f"{every.max():.2f}", str(len(every))])  # fmt: skip
    heads = ["cm away", "thesis A, mm", "B", "C", "ours at", "ours, median mm", "worst", "edges"]
    made = table(heads, rows)
    return f"{made}\n\nMean of all: {errors.mean():.2f} mm there, {every.mean():.2f} mm here."


def detectors_table() -> str:
    """Figure 5.7 again, with each corner detector and each way to depth."""
    detectors: tuple[CornerDetector, ...] = ("line_fit", "mic", "median")
    formulas: tuple[StereoFormula, ...] = ("exact", "thesis", "thesis_compensated")
    rows = []
    for detector in detectors:
        row = [detector]
        for formula in formulas:
            error, missing = edge_errors(VisionSettings(corner_detector=detector, stereo_formula=formula))
            row.append(f"{error.mean():.2f}" + (f" ({missing} not found)" if missing else ""))
        rows.append(row)
    return table(["corners by", *(f"depth: {f}" for f in formulas)], rows)


def views_table() -> str:
    """Six characteristic views, then any other: named right, left unnamed, named wrong."""
    rigs = {name: rendered.rig(rendered.ALL, name) for name in ("A0", "B")}
    model, counts = trained(rigs["B"]), defaultdict(lambda: [0, 0, 0])
    for folder in sorted(rendered.ALL.glob("clean-*")):
        truth = rendered.truth(folder)
        (body,) = truth["objects"]
        said = [p.recognition.label for p in look(*rendered.pair(folder), rigs[truth["rig"]], model).parts]
        named = [label for label in said if label != "unknown"]
        verdict = 2 if any(label != body["label"] for label in named) else 0 if named else 1
        counts[body["label"]][verdict] += 1
    views = {label: sum(label == known for known in _taught()) for label in counts}
    rows = [
        [label.replace("_", " "), str(views[label]), str(sum(of)), *map(str, of)]
        for label, of in sorted(counts.items())
    ]
    every = [sum(column) for column in zip(*counts.values(), strict=True)]
    rows.append(["all", str(sum(views.values())), str(sum(every)), *map(str, every)])
    return table(["part", "views taught", "other views shown", "named right", "left unnamed", "named wrong"], rows)


def _taught() -> list[str]:
    return [rendered.truth(f)["objects"][0]["label"] for f in sorted(rendered.ALL.glob("train-B-*"))]


EVERYWHERE = {"silhouettes": silhouettes_table, "activations": activations_table}
"""Tables that come out the same on every machine."""
HERE = {"rotation": rotation_table, "times": times_table}
WITH_SCENES = {"lengths": lengths_table, "detectors": detectors_table, "views": views_table}


def written(text: str, name: str, made: str) -> str:
    """The document with the table between the marks of its name. Raises ValueError where it has none."""
    marks = re.compile(rf"(<!-- table {name} -->\n).*?(<!-- end -->)", re.DOTALL)
    if not marks.search(text):
        raise ValueError(f"no marks for the table {name}")
    return marks.sub(lambda found: f"{found[1]}{made}\n{found[2]}", text)


def main() -> None:
    """Measure and print, or write."""
    cv2.setNumThreads(1)
    makers = {**EVERYWHERE, **HERE, **(WITH_SCENES if rendered.ALL.is_dir() else {})}
    path: Path | None = DOCUMENT if "--write" in sys.argv[1:] else None
    for name, make in makers.items():
        made = make()
        print(f"\n{name}\n{made}", flush=True)
        if path is not None:
            path.write_text(written(path.read_text(), name, made))


if __name__ == "__main__":
    main()
