"""Pairs of parts that only a hole tells apart, one of which lies on the table: what is it taken for?

Without an option the even seeds' pairs are looked at with both parts taught and with the one that lies there alone; a
name is wrong if it is the other's, or if the part is told in a turn that its hole, in view of both cameras, refutes.
`--held-out` takes the odd seeds: choose nothing by them. `--fit` makes the constants of
daemon/vision/evidence/hole_rims.py again from what is kept in tests/data/hole_rims.csv and holds them beside the
code's; with `--dump` that table is made anew, of the even seeds: what both cameras show of each hole that is there, and
of one that the other part, or another turn, would have there.

usage: python -m tests.bench holes [SEEDS] [--held-out | --fit | --dump]
FACETD_RENDERED names a folder that keeps what was rendered.
"""

from __future__ import annotations

import argparse
import csv
import sys
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from daemon import frames
from daemon.arrays import Array
from daemon.main import tame_malloc
from daemon.store.library import load_facets
from daemon.vision.evidence import hole_rims
from daemon.vision.evidence.hole_rims import hole_nats
from daemon.vision.geometry import StereoRig
from daemon.vision.image import StereoImages, open_stereo
from daemon.vision.look import look
from daemon.vision.model import empty_model, learn_solids, turns_but_for_holes
from daemon.vision.refine import RimSeen, rim_samples, rims_seen
from daemon.vision.settings import TOLERANCE_MM
from daemon.vision.values import Part
from tests.bench.simulated_looks import true_rig
from tests.fakes.holed import KINDS, Holed, holed_pair
from tests.fakes.photographed import Photograph, cell, photograph

KEPT = Path(__file__).resolve().parents[1] / "data" / "hole_rims.csv"
MEASURED = RimSeen._fields[:-1]
"""But for where the rim is."""
SEEDS = 8
OFF_MM = 2.5
"""A hole that is farther than this from where it is shown as told lies in another turn of the part."""
RIDGE = 0.05
TOLD_S = 20.0
OUTCOMES = "right", "silent", "turned", "WRONG"


class Look(NamedTuple):
    """One of a pair on the table: the kind, the pair, which of it lies there (0, 1), its pictures."""

    kind: str
    pair: tuple[Holed, Holed]
    lies: int
    photo: Photograph

    @property
    def pose(self) -> Array:
        """cyclopean_from_drawn (4, 4), of the solid's frame."""
        return self.photo.cyclopean_from_part @ _part_from_solid(self.pair[self.lies])


class Seen(NamedTuple):
    """Of one hole at one pose: whether it is there; its kind; what the cameras show of it."""

    there: bool
    kind: str
    both: list[RimSeen]


def main(arguments: list[str] | None = None) -> None:
    told = _arguments(sys.argv[1:] if arguments is None else arguments)
    cv2.setNumThreads(1)
    tame_malloc()
    if told.fit or told.dump:
        if told.dump:
            write([one for each in looks(range(0, 2 * told.seeds, 2)) for one in holes_seen(each)])
        print(verdict(read()))
        return
    counts = {(kind, mode): Counter[str]() for kind in KINDS for mode in ("both", "alone")}
    for each in looks(range(int(told.held_out), 2 * told.seeds, 2)):
        for mode in ("both", "alone"):
            outcome, said = named(each, mode)
            counts[each.kind, mode][outcome] += 1
            if outcome in OUTCOMES[2:]:
                print(f"  {each.kind} {mode}, {each.pair[each.lies].label} lies there: {outcome} {said}")
    print(f"{'kind':<12}{'mode':<8}" + "".join(f"{name:>8}" for name in OUTCOMES))
    for (kind, mode), count in counts.items():
        print(f"{kind:<12}{mode:<8}" + "".join(f"{count[name]:>8}" for name in OUTCOMES))
    for mode in ("both", "alone"):
        whole = sum((count for (_, one), count in counts.items() if one == mode), Counter[str]())
        print(f"{'all':<12}{mode:<8}" + "".join(f"{whole[name]:>8}" for name in OUTCOMES))


def _arguments(given: list[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="holes", description="What parts are taken for that only a hole tells apart.")
    parser.add_argument("seeds", type=int, nargs="?", default=SEEDS, help="pairs a kind")
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--held-out", action="store_true", help="the odd seeds instead of the even ones")
    what.add_argument("--fit", action="store_true", help="the constants made again")
    what.add_argument("--dump", action="store_true", help=f"make {KEPT.name} anew, then as --fit")
    return parser.parse_args(given)


def looks(seeds: range) -> Iterator[Look]:
    """Each part of each pair, once."""
    last = time.monotonic()
    for kind, seed in product(KINDS, seeds):
        pair = holed_pair(kind, seed)
        for lies in (0, 1):
            yield Look(kind, pair, lies, photograph(pair[lies].shape, np.random.default_rng([seed, lies])))
        if time.monotonic() - last > TOLD_S:
            last = time.monotonic()
            print(f"  {kind} {seed}", file=sys.stderr, flush=True)


def cameras_of(one: Look) -> StereoImages:
    return open_stereo(one.photo.left, one.photo.right, _rig())


def _rig() -> StereoRig:
    return true_rig(cell())


def _part_from_solid(one: Holed) -> Array:
    """Where the simulated cell's frame of a part has its solid."""
    assert one.shape.surface is not None
    shift = np.eye(4)
    shift[:3, 3] = (one.shape.surface.corners_mm - one.drawing.surface.corners_mm).mean(0)
    return shift


def named(one: Look, mode: str) -> tuple[str, str]:
    """What a look says: one of OUTCOMES, and the reason."""
    parts = one.pair if mode == "both" else (one.pair[one.lies],)
    model = learn_solids(empty_model(load_facets()), [(part.label, part.drawing.solid, part.label) for part in parts])
    scene = look(one.photo.left, one.photo.right, _rig(), model)
    found = [part for part in scene.parts if part.named]
    label = one.pair[one.lies].label
    if not found:
        return "silent", ""
    if any(part.recognition.label != label for part in found):
        return "WRONG", found[0].recognition.reason
    drawn = one.pair[one.lies].drawing.solid
    shown = hole_nats(drawn, one.pose, cameras_of(one)) > 0
    turned = shown and hole_off_mm(found[0], [h.ring_mm for h in model.metric[label].solid.holes], one) > OFF_MM
    return ("turned" if turned else "right"), found[0].recognition.reason


def hole_off_mm(found: Part, rims_mm: list[Array], one: Look) -> float:
    """How far the holes of a part that was found, with rims (N, 3) in its frame, are from the true ones at most."""
    true = [frames.apply(one.pose, hole.ring_mm).mean(0) for hole in one.pair[one.lies].drawing.solid.holes]
    told = [frames.apply(found.cyclopean_from_part, rim).mean(0) for rim in rims_mm]
    return max(min(float(np.linalg.norm(a - b)) for b in told) for a in true)


def holes_seen(one: Look) -> Iterator[Seen]:
    """The holes of the part that lies there, and those of the other part in its place, and of either in other turns, as
    far as these lie where none is."""
    cameras, own = cameras_of(one), one.pair[one.lies].drawing.solid
    true = [frames.apply(one.pose, hole.ring_mm) for hole in own.holes]
    for k, part in enumerate(one.pair):
        solid = part.drawing.solid
        shift = np.eye(4)
        shift[:3, 3] = own.centres_mm.mean(0) - solid.centres_mm.mean(0) if k != one.lies else 0.0
        for number, turn in enumerate(turns_but_for_holes(solid) if solid.holes else ()):
            there, pose = k == one.lies and number == 0, one.pose @ shift @ turn
            for hole in solid.holes:
                ring = frames.apply(pose, hole.ring_mm)
                if there or not any(_overlap(ring, other) for other in true):
                    for both in rims_seen(replace(solid, holes=(hole,)), pose, cameras, TOLERANCE_MM):
                        yield Seen(there, one.kind, both)


def _overlap(one: Array, other: Array) -> bool:
    """Whether two rims (N, 3), (M, 3) are nearer to each other than both are large."""
    middles, sizes = zip(
        *((ring.mean(0), np.linalg.norm(ring - ring.mean(0), axis=1).max()) for ring in (one, other)), strict=True
    )
    return bool(np.linalg.norm(middles[0] - middles[1]) < sizes[0] + sizes[1])


def write(seen: list[Seen]) -> None:
    """The kept table made anew: a line a hole, the cameras' values one after the other."""
    with KEPT.open("w", newline="") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(["there", "kind", *MEASURED, *MEASURED])
        for one in seen:
            rows.writerow([int(one.there), one.kind, *(f"{value:.4f}" for both in one.both for value in both[:-1])])


def read() -> list[Seen]:
    """The kept table."""
    count = len(MEASURED)
    with KEPT.open(newline="") as file:
        rows = list(csv.reader(file))[1:]
    found = []
    for there, kind, *values in rows:
        cameras = [RimSeen._make([*map(float, values[k : k + count]), None]) for k in range(0, len(values), count)]
        found.append(Seen(there == "1", kind, cameras))
    return found


class Fit(NamedTuple):
    """The constants: how much of a rim that is there shows; how much the nats of edges weigh; the nats at which one is
    as surely missing, and as surely there, as rims of this table tell; what smoothing draws a rim in, and how far its
    size is off besides."""

    SHOWS: float
    BY_RIM: float
    HIDDEN_NATS: float
    MOST_NATS: float
    SHRUNK_PX: float
    RADIUS_PX: float


def fitted(seen: list[Seen]) -> Fit:
    """The constants of a table. BY_RIM is a logistic regression, through nought, of a rim's being there on the nats of
    its edges; the two limits are the log of how seldom a rim that is there shows none, and one that is not shows all
    the same (Laplace's rule of succession); the rest are means and a median deviation of rims that are there."""
    there = [one for one in seen if one.there]
    absent = [one for one in seen if not one.there]
    shows = float(np.mean([camera.shows for one in there for camera in one.both]))
    nats = np.array([sum(camera.edge_nats for camera in one.both) for one in (*there, *absent)])
    label = np.array([1.0] * len(there) + [0.0] * len(absent))
    weight = 0.1
    for _ in range(100):
        chance = 1 / (1 + np.exp(-weight * nats))
        slope = float(nats @ (label - chance)) - RIDGE * weight
        weight += slope / (float((nats**2 * chance * (1 - chance)).sum()) + RIDGE)
    hidden = (nats[: len(there)] < 0).sum()
    feigned = (nats[len(there) :] > 0).sum()
    larger = np.array([np.mean([camera.larger_px for camera in one.both]) for one in there])
    usual = float(np.median(larger))
    spread = float(1.4826 * np.median(np.abs(larger - usual)))
    return Fit(
        shows, float(weight), float(np.log((hidden + 1) / (len(there) + 2))),
        -float(np.log((feigned + 1) / (len(absent) + 2))), rim_samples.SHRUNK_PX + usual, spread,
    )  # fmt: skip


def in_code() -> Fit:
    """The constants of the code."""
    known = vars(rim_samples) | vars(hole_rims)
    return Fit(*(known[name] for name in Fit._fields))


def verdict(seen: list[Seen]) -> str:
    """The fitted constants beside the code's."""
    found, code = fitted(seen), in_code()
    there = sum(one.there for one in seen)
    lines = [f"{there} holes that are there, {len(seen) - there} that are not", f"{'':<14}{'fitted':>8}{'in code':>9}"]
    lines += [f"{name:<14}{getattr(found, name):>8.2f}{getattr(code, name):>9.2f}" for name in Fit._fields]
    return "\n".join(lines)


if __name__ == "__main__":
    main()
