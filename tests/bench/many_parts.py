"""Four, sixteen and sixty-four taught parts and as many strangers of the same families: names, confidence, time.

usage: python -m tests.bench.many_parts [PICTURES [COUNT...]]

Each part lies alone on the simulated cell's table and is taught from its drawing. Half the pictures of a row show a
taught part, half one of the same families that was not taught: what confidence says is measured at that share. How it
stands is told as it goes. The rendered scenes follow, once as they are taught (four parts) and once with sixty drawings
more, unless counts of taught parts are given.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from itertools import pairwise
from typing import Any, NamedTuple

import cv2
import numpy as np

from daemon.arrays import Array
from daemon.main import tame_malloc
from daemon.teaching.view_coverage import visible_facets
from daemon.vision.geometry.rig import StereoRig
from daemon.vision.look import look
from daemon.vision.model import learn_solid
from daemon.vision.model.model import Model
from daemon.vision.values import Scene as Seen
from drivers.camera.pair import StereoPair
from drivers.rigid import inverse, rigid, turn
from drivers.simcell.camera import SimulatedPair, SimulatedScene
from drivers.simcell.render import RenderedSolid
from drivers.simcell.truth import Truth, load_truth
from tests.bench.recognise import Tally, judge, test_folders, trained
from tests.bench.simulated_looks import true_rig
from tests.fakes import rendered
from tests.fakes.drawn import obj, solid
from tests.fakes.many_parts import DrawnPart, drawn_parts, taught
from tests.fakes.photographed import ETC, pose_above

COUNTS = (4, 16, 64)
PICTURES = 24
"""Of taught parts and as many of strangers; `200 64` shows 200 of each to 64 taught parts alone."""
TOLD_S = 20.0
"""So often is told how a row stands."""
DISTANCE_MM, ELEVATION_DEG = (300.0, 400.0), (30.0, 70.0)
FACETS, FACING = 3, 0.25
"""How many facets the cameras have whole before them in each picture, turned to them by what cosine."""
SEED = 5
NEAR_MM = 25.0
BINS = (0.0, 0.9, 0.99, 0.999, 1.0 + 1e-9)


class Answer(NamedTuple):
    """What became of one picture: whether its part was taught, what was named there and how sure, rightly or not."""

    taught: bool
    named: str
    confidence: float
    right: bool
    ms: float


def main(pictures: int = PICTURES, *only: int) -> None:
    cv2.setNumThreads(1)
    tame_malloc()
    truth = load_truth(ETC / "simcell.yaml")
    rig = true_rig(truth)
    parts = drawn_parts(2 * max(COUNTS))
    known, strangers = parts[: max(COUNTS)], parts[max(COUNTS) :]
    print(f"{pictures} pictures of taught parts and {pictures} of strangers of the same families, each row")
    print(f"{'taught':>6}{'right':>9}{'silent':>9}{'wrong':>9}{'strangers named':>17}"
          f"{'ms 50 %':>9}{'95 %':>7}{'worst':>7}{'strangers 50 %':>16}{'95 %':>7}{'worst':>7}")  # fmt: skip
    answers = dict[int, list[Answer]]()
    for count in only or COUNTS:
        model = taught(known[:count])
        others = [part for part in strangers if part.family in {p.family for p in known[:count]}]
        mine, theirs = _cycled(known[:count], pictures), _cycled(others, pictures)
        shown = [part for both in zip(mine, theirs, strict=True) for part in both]
        answers[count] = list(_told(answer(model, rig, *one) for one in photographed(shown, truth)))
        print(_line(count, answers[count]), flush=True)
    for count, found in answers.items():
        _reliability(count, found)
    if rendered.ALL.is_dir() and not only:
        _rendered(known)
        _strangers_drawn()


def _told(answers: Iterator[Answer]) -> Iterator[Answer]:
    """The same answers; every now and then it is told how they stand."""
    found, last = list[Answer](), time.monotonic()
    for one in answers:
        yield one
        found.append(one)
        if time.monotonic() - last > TOLD_S:
            last = time.monotonic()
            mine, others = ([a for a in found if a.taught is taught] for taught in (True, False))
            right, named = sum(a.right for a in mine), sum(bool(a.named) for a in others)
            print(f"        {right} of {len(mine)} right, {named} of {len(others)} strangers named", flush=True)


def _cycled(parts: list[DrawnPart] | tuple[DrawnPart, ...], number: int) -> list[DrawnPart]:
    return [parts[k % len(parts)] for k in range(number)]


def photographed(parts: list[DrawnPart], truth: Truth) -> Iterator[tuple[DrawnPart, StereoPair, Array]]:
    """Each part alone on the table, on any of its rests, three facets whole before the cameras; and where it
    is, cyclopean_from_part (4, 4) mm."""
    rng = np.random.default_rng(SEED)
    stage: list[SimulatedScene] = []
    cameras = SimulatedPair(truth, lambda _: stage[-1], np.random.default_rng(SEED))
    cameras.open()
    for number, part in enumerate(parts):
        spot = np.array([*np.add(truth.table.centre_mm, rng.uniform(-40, 40, 2)), truth.table.height_mm])
        drawn = solid(f"{part.label}.obj", part.drawing)
        while True:
            rest = part.shape.rests[int(rng.integers(len(part.shape.rests)))]
            lies = rigid(turn([0, 0, 1], rng.uniform(-np.pi, np.pi)), spot) @ rest
            middle = np.array([*spot[:2], lies[2, 3]])
            stand = pose_above(float(rng.uniform(*DISTANCE_MM)), middle, rng, ELEVATION_DEG)
            if len(visible_facets(drawn, -lies[:3, :3].T @ stand[:3, 2], FACING)) >= FACETS:
                break
        things = tuple(RenderedSolid(piece, lies, truth.lighting.facet_albedo) for piece in part.shape.pieces)
        stage[:] = [SimulatedScene(stand, things, number)]
        yield part, cameras.grab(0.0, 2.0), inverse(stand) @ lies


def answer(model: Model, rig: StereoRig, part: DrawnPart, pair: StereoPair, where: Array) -> Answer:
    """One look: the name that is given, if any; a wrong one where several are."""
    scene: Seen = look(pair.left.pixels, pair.right.pixels, rig, model, clock=time.process_time)
    ms = 1000 * sum(scene.seconds.values())
    wrong, right = [], []
    for found in scene.parts:
        if found.named:
            near = np.linalg.norm(np.vstack(found.fitted_mm).mean(0) - where[:3, 3]) < NEAR_MM + 25.0
            (right if near and found.recognition.label == part.label else wrong).append(found.recognition)
    said = [*wrong, *right]
    name, confidence = (said[0].label, said[0].confidence) if said else ("", 0.0)
    return Answer(part.label in model.labels, name, confidence, bool(said) and not wrong, ms)


def _line(count: int, found: list[Answer]) -> str:
    mine, others = ([a for a in found if a.taught is taught] for taught in (True, False))
    right, wrong = (sum(bool(a.named) and a.right is r for a in mine) for r in (True, False))
    shares = f"{_share(right, mine):>9}{_share(len(mine) - right - wrong, mine):>9}{_share(wrong, mine):>9}"
    times = [[np.percentile([a.ms for a in some], p) for p in (50, 95, 100)] for some in (mine, others)]
    named = _share(sum(bool(a.named) for a in others), others)
    columns = zip((9, 7, 7, 16, 7, 7), np.ravel(times), strict=True)
    return f"{count:>6}{shares}{named:>17}" + "".join(f"{ms:>{width}.0f}" for width, ms in columns)


def _share(number: int, of: list[Answer]) -> str:
    return f"{100 * number / len(of):.1f} %"


def _reliability(count: int, found: list[Answer]) -> None:
    print(f"\nconfidence of names, {count:>2} taught     names    mean    right")
    for low, high in pairwise(BINS):
        inside = [a for a in found if a.named and low <= a.confidence < high]
        if inside:
            mean, share = np.mean([a.confidence for a in inside]), np.mean([a.right for a in inside])
            print(f"{low:>12.3f} to {min(high, 1):<10.3f}{len(inside):>12}{mean:>8.4f}{share:>9.4f}")


def _rendered(parts: tuple[DrawnPart, ...]) -> None:
    """The rendered scenes with four parts and with sixty more: what is named, and how long it takes."""
    rig = rendered.rig(rendered.ALL, "B")
    few = trained(rig)
    many = taught(parts[:60], few)
    print(f"\n{'rendered scenes':<18}{'taught':>7}{'right':>7}{'silent':>7}{'wrong':>7}{'invented':>9}"
          f"{'ms 50 %':>9}{'95 %':>7}{'worst':>7}")  # fmt: skip
    folders = [f for f in test_folders(rendered.ALL) if "-B-" in f.name]
    for kind in dict.fromkeys(folder.name.partition("-")[0] for folder in folders):
        for model in (few, many):
            tally = Tally()
            for folder in folders:
                if folder.name.startswith(f"{kind}-"):
                    scene = look(*rendered.pair(folder), rig, model, clock=time.process_time)
                    judge(scene, rendered.truth(folder), few.labels, tally)
                    tally.looks_ms.append(1000 * sum(scene.seconds.values()))
            c, times = tally.counts, [np.percentile(tally.looks_ms, p) for p in (50, 95, 100)]
            counts = f"{c['right']:>7}{c['silent']:>7}{c['mistaken']:>7}{c['invented'] + c['ghost']:>9}"
            columns = "".join(f"{ms:>{width}.0f}" for ms, width in zip(times, (9, 7, 7), strict=True))
            print(f"{kind:<18}{len(model.labels):>7}{counts}{columns}", flush=True)


MOST_DRAWN = 20
"""Facets of a stranger that is taught from a drawing: not a cylinder's."""


def _strangers_drawn() -> None:
    """The strangers of the rendered scenes, each taught by its own drawing beside the four parts."""
    rig = rendered.rig(rendered.ALL, "B")
    few, models, tallies = trained(rig), dict[str, Model](), dict[str, Tally]()
    for folder in test_folders(rendered.ALL):
        told = rendered.truth(folder)
        for body in told["objects"]:
            label, kind = body["label"], folder.name.partition("-")[0]
            if label in few.labels or len(body["facets"]) > MOST_DRAWN:
                continue
            if label not in models:
                models[label] = learn_solid(few, solid(f"{label}.obj", _drawing(body)), label)
            tally = tallies.setdefault(kind, Tally())
            judge(look(*rendered.pair(folder), rig, models[label]), told, models[label].labels, tally)
    print(f"\n{'strangers, drawn':<18}{'right':>7}{'silent':>7}{'wrong':>7}{'corners mm 50 %':>17}{'95 %':>7}")
    for kind, tally in tallies.items():
        c, off = tally.counts, np.percentile(tally.fitted_mm or [np.nan], [50, 95])
        wrong = c["mistaken"] + c["invented"] + c["ghost"]
        print(f"{kind:<18}{c['right']:>7}{c['silent']:>7}{wrong:>7}{off[0]:>17.2f}{off[1]:>7.2f}", flush=True)


def _drawing(body: dict[str, Any]) -> bytes:
    """An OBJ file of a body as the scene's truth has it; its rings run anticlockwise from outside."""
    part_from_cyclopean = inverse(np.array(body["cyclopean_from_part"]))
    faces = [np.asarray(f["corners_mm"]) @ part_from_cyclopean[:3, :3].T + part_from_cyclopean[:3, 3]
             for f in body["facets"]]  # fmt: skip
    corners, number = np.unique(np.concatenate(faces).round(2), axis=0, return_inverse=True)
    rings = np.split(number.reshape(-1), np.cumsum([len(face) for face in faces])[:-1])
    return obj(corners, [tuple(ring.tolist()) for ring in rings])


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
