"""Hard scenes with few and with many taught: alone, patterned, print like edges, look-alike strangers, heaps, all.

The parts shown are of the first that are taught in every column, and the strangers of none, so that all models look at
the same pictures. Even seeds (the default) are for tuning; odd ones are held out. `>= 0.95` counts wrong names and
strangers' names together; a look-alike that shows nothing by which it differs is not counted.

usage: python -m tests.bench.hard_sets [COUNT] [--taught N ...] [--first SEED] [--held-out] [--kind NAME ...] [--list]
COUNT scenes a kind (20), with N parts taught (64); `--taught 64 1000` teaches a thousand too. --list: every wrong name.
FACETD_RENDERED names a folder that keeps what was rendered.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import dataclass, field

import cv2
import numpy as np

from daemon import frames
from daemon.arrays import Array
from daemon.main import tame_malloc
from daemon.vision.geometry.rig import StereoRig
from daemon.vision.look import look
from daemon.vision.model.model import Model
from daemon.vision.values import Part
from tests.bench.simulated_looks import true_rig
from tests.fakes.hard_scenes import KINDS, Body, Staged, staged
from tests.fakes.many_parts import drawn_parts, taught
from tests.fakes.photographed import cell

SCENES, TAUGHT, STRANGERS = 20, 64, 64
SURE = 0.95
HERE_MM, OFF_MM = 25.0, 5.0
"""A name is a body's whose corners are this near, in the mean; and it is off where one of them is farther than that."""
IN_VIEW = 0.5
"""Of a part of which less is in view no name is asked, though a wrong one counts."""


@dataclass
class Row:
    """What became of the bodies of one kind's scenes; the wrong names, in words; processor time of each look, ms."""

    asked: int = 0
    right: int = 0
    wrong: int = 0
    sure: int = 0
    off: int = 0
    strangers: int = 0
    invented: int = 0
    ghosts: int = 0
    words: list[str] = field(default_factory=list)
    ms: list[float] = field(default_factory=list)


def main(arguments: list[str] | None = None) -> None:
    told = _arguments(sys.argv[1:] if arguments is None else arguments)
    cv2.setNumThreads(1)
    tame_malloc()
    rig = true_rig(cell())
    parts = drawn_parts(max(told.taught) + STRANGERS)
    shown, strangers = parts[: min(told.taught)], parts[max(told.taught) :]
    models, model, spent_s = dict[int, Model](), None, 0.0
    for count in sorted(told.taught):
        began = time.process_time()
        model = taught(parts[len(model.labels) if model else 0 : count], model)
        spent_s += time.process_time() - began
        models[count] = model
        print(f"{count} parts taught from drawings in {spent_s:.1f} s", flush=True)
    print(f"{told.count} scenes a kind, seeds {'held out' if told.held_out else 'for tuning'}, from {told.first}")
    print(f"{'kind':<12}{'taught':>7}{'asked':>7}{'right':>7}{'silent':>8}{'wrong':>7}{f'>= {SURE}':>8}{'off':>5}"
          f"{'strangers':>11}{'named':>7}{'ghosts':>8}{'ms 50 %':>9}{'worst':>7}")  # fmt: skip
    for kind in told.kind or KINDS:
        rows = {count: Row() for count in models}
        for k in range(told.count):
            scene = staged(kind, told.first + 2 * k + told.held_out, shown, strangers)
            for count, one in models.items():
                take_look(scene, rig, one, rows[count])
        for count, row in rows.items():
            print(_line(kind, count, row), flush=True)
            if told.list:
                print("".join(f"  {word}\n" for word in row.words), end="")


def _arguments(given: list[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="hard_sets", description="What hard scenes are taken for.")
    parser.add_argument("count", type=int, nargs="?", default=SCENES, help="scenes a kind")
    parser.add_argument("--taught", type=int, nargs="+", default=[TAUGHT], help="how many parts are taught")
    parser.add_argument("--first", type=int, default=0, help="the first seed, an even number")
    parser.add_argument("--held-out", action="store_true", help="the odd seeds instead of the even ones")
    parser.add_argument("--kind", nargs="+", choices=list(KINDS), help="these alone")
    parser.add_argument("--list", action="store_true", help="every wrong name")
    told = parser.parse_args(given)
    if told.first % 2:
        parser.error(f"--first {told.first}: an even number; --held-out takes the odd ones")
    return told


def take_look(scene: Staged, rig: StereoRig, model: Model, row: Row) -> None:
    """Count one look."""
    seen = look(scene.left, scene.right, rig, model, clock=time.process_time)
    row.ms.append(1000 * sum(seen.seconds.values()))
    left = [p for p in seen.parts if p.named]
    for body in scene.bodies:
        off = [_off_mm(p, body) for p in left]
        near = min(range(len(left)), key=lambda k: float(off[k].mean()), default=None)
        part = left.pop(near) if near is not None and off[near].mean() < HERE_MM else None
        wrong = part is not None and part.recognition.label != body.label
        asked = body.in_view >= IN_VIEW
        if not body.tells:
            continue
        if body.stranger:
            row.strangers += 1
            row.invented += part is not None
        elif asked or wrong:
            row.asked += 1
            row.wrong += wrong
            row.right += part is not None and not wrong
        if part is not None and near is not None:
            row.sure += wrong and part.recognition.confidence >= SURE
            row.off += not wrong and bool(off[near].max() > OFF_MM)
        if part is not None and wrong:
            told = part.recognition
            row.words.append(
                f"{scene.kind} {scene.seed}: {body.label} ({body.in_view:.0%} in view) named {told.label} "
                f"{told.confidence:.5f} ({told.reason})"
            )
    row.ghosts += len(left)


def _off_mm(part: Part, body: Body) -> Array:
    """(N,) mm of each corner found from the nearest of the body's."""
    corners = frames.apply(body.cyclopean_from_part, np.vstack([p.vertices for p in body.shape.pieces]))
    found = np.vstack(part.fitted_mm)
    return np.asarray(np.linalg.norm(found[:, None] - corners, axis=2).min(1))


def _line(kind: str, count: int, row: Row) -> str:
    silent, middle, worst = row.asked - row.right - row.wrong, np.median(row.ms), max(row.ms)
    return (f"{kind:<12}{count:>7}{row.asked:>7}{row.right:>7}{silent:>8}{row.wrong:>7}{row.sure:>8}{row.off:>5}"
            f"{row.strangers:>11}{row.invented:>7}{row.ghosts:>8}{middle:>9.0f}{worst:>7.0f}")  # fmt: skip


if __name__ == "__main__":
    main()
