"""The thesis's experiments on pictures: lengths, corner detectors, vergence, compensation, views, time.

The simulated cell's renderer makes the pictures (tests/fakes/thesis_scenes.py), with exact truth.
"""

from __future__ import annotations

import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from functools import cache, partial
from math import inf

import numpy as np

from daemon.arrays import Array
from daemon.calibration.quick import Depth, QuickMeasurements, Width, calibrate_quick
from daemon.store.library import load_facets
from daemon.vision.facets.one_look.reconstruct import find_facets
from daemon.vision.geometry import Camera, StereoRig
from daemon.vision.look import look
from daemon.vision.model import Model, TeachError, empty_model, learn_view
from daemon.vision.settings import CornerDetector, StereoFormula, VisionSettings
from daemon.vision.thesis import by_formula, converging, find_corners
from tests.bench.facets import edges
from tests.bench.networks import FuzzyARTMAP, RotationLayer
from tests.bench.thesis.document import chart, table
from tests.fakes.rigs import thesis_rig
from tests.fakes.thesis import ALPHA, FIGURE_5_7, NODE_LABELS, NODES
from tests.fakes.thesis_scenes import (
    NOISE,
    TRAINING,
    Shot,
    box_shots,
    corner_face,
    corner_picture,
    other_shots,
    rig_of,
    training_shots,
)

RUNS = 30
EACH = 12
"""Other views shown of each part."""
SAME_MM = 60.0
DETECTORS: tuple[CornerDetector, ...] = ("line_fit", "mic", "median", "slope")
FORMULAS: tuple[StereoFormula, ...] = ("exact", "thesis", "thesis_compensated")
CORNERS_DEG = (60.0, 90.0, 110.0, 130.0, 145.0, 160.0, 165.0, 170.0)
CORNER_TURNS, CORNER_PX = 24, 4.0
BASELINES_MM = (30.0, 60.0, 100.0, 150.0, 200.0, 250.0)
AWAY_MM = 700.0


def lengths_table() -> str:
    """Figure 5.7 and its graphs, figures 5.8 to 5.10: errors of a box's lengths by distance."""
    found = _length_errors(VisionSettings())[0]
    rows = []
    for mm, printed in FIGURE_5_7.items():
        off = np.abs(found[mm])
        ours = [f"{np.median(off):.2f}", f"{off.max():.2f}", str(len(off))] if len(off) else ["-"] * 3
        rows.append([f"{mm / 10:g}", *(f"{e:+.1f}" for e in printed), *ours])
    errors = np.abs([e for line in FIGURE_5_7.values() for e in line])
    every = np.abs(np.concatenate(list(found.values())))
    rows.append(["mean size of all", *(f"{np.mean(np.abs(c)):.1f}" for c in zip(*FIGURE_5_7.values(), strict=True)),
                 f"{every.mean():.2f}", f"{every.max():.2f}", str(len(every))])  # fmt: skip
    heads = ["cm away", *(f"thesis {name}, mm" for name in "ABC"), "facetd, median size, mm", "facetd, largest, mm",
             "edges"]  # fmt: skip
    drawn = chart(
        "Errors of the lengths of figures 5.8 to 5.10",
        ("cm away", [f"{mm / 10:g}" for mm in FIGURE_5_7]),
        "mm",
        {
            **{f"thesis, length {name}": [e[k] for e in FIGURE_5_7.values()] for k, name in enumerate("ABC")},
            "facetd, median of all edges": [float(np.median(found[mm])) for mm in FIGURE_5_7],
        },
    )
    mean = f"Mean of all: {errors.mean():.2f} mm there, {every.mean():.2f} mm here."
    return f"{table(heads, rows)}\n\n{mean}\n\n{drawn}"


def detectors_table() -> str:
    """Figure 5.7 again, with each corner detector and each way to depth."""
    rows = []
    for detector in DETECTORS:
        row = [f"`{detector}`"]
        for formula in FORMULAS:
            found, missing = _length_errors(VisionSettings(corner_detector=detector, stereo_formula=formula))
            error = np.abs(np.concatenate(list(found.values())))
            row.append(f"{error.mean():.2f}" + (f" ({missing} edges not found)" if missing else ""))
        rows.append(row)
    return table(["corners by", *(f"depth: `{f}`" for f in FORMULAS)], rows)


def obtuse_table() -> str:
    """Chapter 6: the corners that each detector of the thesis finds, by angle, and those of faces that facetd finds."""
    rows = []
    for detector in DETECTORS[1:]:
        row = [f"`{detector}`"]
        for angle in CORNERS_DEG:
            shown = [corner_picture(angle, 3.0 + 360 * k / CORNER_TURNS, seed=k) for k in range(CORNER_TURNS)]
            found = [find_corners(image, at[None], detector, NOISE)[0] for image, at in shown]
            near = [np.hypot(*(corner - at)) < CORNER_PX for corner, (_, at) in zip(found, shown, strict=True)]
            row.append(str(sum(near)))
        rows.append(row)
    rows.append(["facetd, face 60 mm wide", *(str(sum(_gable_found(angle))) for angle in CORNERS_DEG)])
    return table([f"found of {CORNER_TURNS}", *(f"{angle:g} degrees" for angle in CORNERS_DEG)], rows)


def _gable_found(angle_deg: float) -> Iterator[bool]:
    """Whether a corner of a facet is near the corner of that angle, for each turn of a face."""
    rig = thesis_rig()
    for k in range(CORNER_TURNS):
        left, right, at = corner_face(angle_deg, 3.0 + 360 * k / CORNER_TURNS, rig, seed=k)
        found = [f.left_px for g in find_facets(left, right, rig).groups for f in g.facets]
        yield any(bool((np.hypot(*(px - at).T) < CORNER_PX).any()) for px in found)


def vergence_table() -> str:
    """Section 6.1: accuracy against baseline and vergence, at 70 cm, exact depth and the thesis's formula."""
    rows, lines = [], defaultdict[str, list[float]](list)
    for baseline in BASELINES_MM:
        row = [f"{baseline:g}", f"{np.degrees(2 * np.arctan2(baseline / 2, AWAY_MM)):.1f}"]
        for fixation, name in ((inf, "parallel"), (AWAY_MM, "converging")):
            rig = rig_of(baseline, fixation)
            for formula in ("exact", "thesis"):
                off, missing = _errors(box_shots(rig, [AWAY_MM]), rig, VisionSettings(stereo_formula=formula))
                whole = np.abs(np.concatenate(list(off.values()))) if off else np.zeros(0)
                row.append(f"{whole.mean():.2f}" if len(whole) and not missing else "not in both pictures")
                if len(whole) and not missing:
                    lines[f"{name}, depth `{formula}`"].append(float(whole.mean()))
        rows.append(row)
    heads = ["baseline, mm", "vergence that meets at 70 cm, degrees", "parallel: exact", "parallel: thesis",
             "converging: exact", "converging: thesis"]  # fmt: skip
    whole_lines = {name: line for name, line in lines.items() if len(line) == len(BASELINES_MM)}
    across = "baseline, mm", [f"{mm:g}" for mm in BASELINES_MM]
    return f"{table(heads, rows)}\n\n{chart('Mean error of an edge at 70 cm', across, 'mm', whole_lines)}"


def compensation_table() -> str:
    """Section 4.2.4: depth errors on the axis before and after compensation by measured readings, and beside it."""
    rig = thesis_rig()
    rng = np.random.default_rng(2)

    def px(camera: Camera, point: Sequence[float]) -> tuple[float, float]:
        u, v = camera.project(np.array([point]))[0] + rng.normal(0, 0.25, 2)
        return float(u), float(v)

    def pin(z: float, x: float = 0.0) -> tuple[tuple[float, float], tuple[float, float]]:
        return px(rig.left, (x, 0.0, z)), px(rig.right, (x, 0.0, z))

    at = np.arange(440.0, 761.0, 40.0)
    widths = [Width(50.0, z, 760 * 50 / z) for z in (500.0, 600.0, 700.0)]
    made = QuickMeasurements((512, 480), 200.0, 567.0, *pin(567.0), widths, [Depth(z, *pin(z)) for z in at])
    result = calibrate_quick(made)
    rows = [
        ["on the axis", *(_percent(off, at) for off in (result.formula_mm, result.compensated_mm, result.left_out_mm))]
    ]
    constants = converging(result.rig, result.readings_mm)
    left, right = (np.array(p) for p in zip(*(pin(z, 80.0) for z in at), strict=True))
    beside = [by_formula(left, right, result.rig, constants, compensated)[:, 2] - at for compensated in (False, True)]
    rows.append(["80 mm beside it", *(_percent(off, at) for off in beside), "-"])
    return table(["depth of a pin, mean error", "formula (2.3)", "compensated", "each by the other readings"], rows)


def views_table() -> str:
    """Section 5.6: six characteristic views, then any other: named right, left unnamed, named wrong."""
    model, counts = _trained(len(TRAINING)), defaultdict[str, Counter[str]](Counter)
    for shot in _others():
        counts[shot.label][_answer(shot, model)] += 1
    taught = Counter(name for name, _ in TRAINING)
    rows = [
        [label.replace("_", " "), str(taught[label]), str(of.total()), *(str(of[a]) for a in ANSWERS)]
        for label, of in counts.items()
    ]
    every = sum(counts.values(), Counter[str]())
    rows.append(["all", str(len(TRAINING)), str(every.total()), *(str(every[a]) for a in ANSWERS)])
    return table(["part", "views taught", "other views shown", *ANSWERS], rows)


def taught_views_table() -> str:
    """Chapter 6, against VIEWNET: how many views of all parts are taught, and what is named."""
    rows = []
    for number in range(1, len(TRAINING) + 1):
        model = _trained(number)
        answers = Counter(_answer(shot, model) for shot in _others())
        known = len({name for name, _ in _order()[:number]})
        rows.append([str(number), str(known), *(str(answers[a]) for a in ANSWERS)])
    shown = len(_others())
    return table(
        ["views taught", "number of parts taught", *(f"{a}, of {shown} views of four parts" for a in ANSWERS)], rows
    )


def rotation_table() -> str:
    """Section 5.5: a recall over all numberings."""
    rng, rows = np.random.default_rng(0), []
    for index in (3, 4):
        view, layer = NODES[index], RotationLayer(NODES, ALPHA)
        order = rng.permutation(6)
        turned = view[np.ix_(order, order)]
        facets = int((view.any(0) | view.any(1)).sum())
        rows.append([f"{NODE_LABELS[index]}, {facets} facets", _ms(partial(layer.recall, turned))])
    return table(
        ["view, facets numbered at random", "a recall here, over all 720 numberings of six slots, six nodes"], rows
    )


def times_table() -> str:
    """Sections 5.3 and 6: his times on 166 MHz, ours here, on one core."""
    views, labels = np.repeat(NODES, 3, axis=0).reshape(18, 36), [label for label in NODE_LABELS for _ in range(3)]
    taught = FuzzyARTMAP(0.9, 0.1, 1.0).fit(views, labels)
    model, spent = _trained(len(TRAINING)), []
    for shot in _others():
        began = time.process_time()
        look(shot.left, shot.right, thesis_rig(), model)
        spent.append(time.process_time() - began)
    rows = [
        ["teach 18 patterns", "60 ms", _ms(lambda: FuzzyARTMAP(0.9, 0.1, 1.0).fit(views, labels))],
        ["recall a pattern", "10 ms", _ms(lambda: taught.predict(views[:1]))],
        ["a look, images to named parts", "18 s", f"{1e3 * float(np.median(spent)):.0f} ms"],
    ]
    return table(["", "thesis, 166 MHz", "here"], rows)


ANSWERS = ("named right", "left unnamed", "named wrong")


def _answer(shot: Shot, model: Model, rig: StereoRig | None = None) -> str:
    scene = look(shot.left, shot.right, rig or thesis_rig(), model, VisionSettings().without_time_limit())
    named = [p.recognition.label for p in scene.parts if p.named]
    return ANSWERS[2] if any(label != shot.label for label in named) else ANSWERS[0] if named else ANSWERS[1]


@cache
def _others() -> tuple[Shot, ...]:
    return tuple(other_shots(thesis_rig(), EACH))


def _order() -> list[tuple[str, tuple[int, ...]]]:
    """The training views, one of each part first."""
    first = [k for k, (name, _) in enumerate(TRAINING) if name not in [n for n, _ in TRAINING[:k]]]
    return [TRAINING[k] for k in (*first, *(k for k in range(len(TRAINING)) if k not in first))]


@cache
def _trained(number: int) -> Model:
    """The model taught so many of the training views, one of each part first."""
    shots = dict(zip(TRAINING, training_shots(thesis_rig()), strict=True))
    return _taught([shots[view] for view in _order()[:number]], thesis_rig())


def _taught(shots: Iterable[Shot], rig: StereoRig) -> Model:
    """The model taught some views; those that teaching refuses are left out."""
    model = empty_model(load_facets())
    for shot in shots:
        groups = find_facets(shot.left, shot.right, rig).groups
        with suppress(TeachError):
            if groups:
                model = learn_view(model, max(groups, key=lambda g: len(g.facets)), shot.label)
    return model


def _length_errors(settings: VisionSettings) -> tuple[dict[float, Array], int]:
    return _errors(_figure_5_7(), thesis_rig(), settings)


@cache
def _figure_5_7() -> tuple[tuple[float, Shot], ...]:
    return tuple(box_shots(thesis_rig(), list(FIGURE_5_7)))


def _errors(
    shots: Iterable[tuple[float, Shot]], rig: StereoRig, settings: VisionSettings
) -> tuple[dict[float, Array], int]:
    """Errors of edge lengths, mm, by distance, of those that both cameras see; and how many edges were not found."""
    found, missing = defaultdict[float, list[float]](list), 0
    for distance, shot in shots:
        view = find_facets(shot.left, shot.right, rig, settings)
        got = edges([f.corners_mm for g in view.groups for f in g.facets])
        for edge in edges(shot.facets_mm):
            away = [min(np.abs(g - edge).max(), np.abs(g[::-1] - edge).max()) for g in got]
            if not away or min(away) > SAME_MM:
                missing += 1
                continue
            near = got[int(np.argmin(away))]
            found[distance].append(float(np.linalg.norm(near[0] - near[1]) - np.linalg.norm(edge[0] - edge[1])))
    return {mm: np.array(off) for mm, off in found.items()}, missing


def _percent(off: Array, at: Array) -> str:
    return f"{100 * np.abs(off / at).mean():.2f} %"


def _ms(call: Callable[[], object]) -> str:
    """The best CPU time of some runs."""
    best = inf
    for _ in range(RUNS):
        began = time.process_time()
        call()
        best = min(best, time.process_time() - began)
    return f"{1e3 * best:.2g} ms"
