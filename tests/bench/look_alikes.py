"""Parts that look alike, one of which lies on the table: what is it taken for where both are taught, or one alone?

Every pair of a family is shown in three ways, on the same pictures: `both` are taught; it is taught `alone`; it is a
`stranger`, as the other alone is taught, and no name is right. Even seeds (the default) are for tuning; odd ones are
held out: look at their totals, and choose nothing by them. A wrong name is listed with the seed that makes it again.

Where a picture shows nothing by which the two differ (the cut corner is behind), no name can be held against the
recogniser: these `alike` looks are told apart from the others, and only counted.

usage: python -m tests.bench.look_alikes [COUNT] [--first SEED] [--held-out] [--family NAME ...] [--one-camera]
    [--draw N]
COUNT pairs a family, of the seeds from SEED on; --one-camera: seen so that both cameras have one facet well in view,
and one of them alone a second; the pictures of the first N wrong names go to a folder, as PNG.
FACETD_RENDERED names a folder that keeps what was rendered, so that two versions can be shown the same.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from daemon import frames
from daemon.arrays import Array
from daemon.main import tame_malloc
from daemon.vision.draw import draw_scene
from daemon.vision.look import look
from daemon.vision.model.model import Model
from daemon.vision.values import Scene
from tests.bench.simulated_looks import true_rig
from tests.fakes.distinguishable import TELLS_MM, telling_mm
from tests.fakes.families import FAMILIES, ConfusablePair, alike
from tests.fakes.many_parts import taught
from tests.fakes.photographed import Photograph, cell, photograph, seen_by_one

PAIRS = 20
MODES = ("both", "alone", "stranger")
SURE = 0.95
OFF_MM = 5.0
"""A part that is named rightly and whose corners are farther than this from where they are is not where it is told."""
NEAR_MM = 50.0
"""What is found farther from the part is another thing, and its name wrong."""
TOLD_S = 20.0
LARGE, ROUND_PX = 4, 60
"""How much larger what is said to be there is drawn, and how much is shown round it, px of that."""


class Answer(NamedTuple):
    """What became of one look: the pair, which of it lies there (0, 1), both pictures, the mode; the name given, if
    any, how sure and why; whether it is right, and how far its corners are off, mm; by how many mm of
    edge, of both cameras, the two differ there."""

    pair: ConfusablePair
    lies: int
    photo: Photograph
    mode: str
    named: str
    confidence: float
    reason: str
    right: bool
    off_mm: float
    telling_mm: float
    ms: float

    @property
    def wrong(self) -> bool:
        return bool(self.named) and not self.right

    @property
    def tells(self) -> bool:
        """Whether the two can be told apart there."""
        return self.telling_mm >= TELLS_MM


def main(arguments: list[str] | None = None) -> None:
    told = _arguments(sys.argv[1:] if arguments is None else arguments)
    cv2.setNumThreads(1)
    tame_malloc()
    print(f"{told.count} pairs a family, seeds {'held out' if told.held_out else 'for tuning'}, from {told.first}")
    print(f"{'family':<10}{'mode':<10}{'looks':>6}{'right':>7}{'silent':>8}{'wrong':>7}{f'>= {SURE}':>8}{'off':>5}"
          f"{'alike':>7}{'of them named':>15}{'ms 50 %':>9}{'worst':>7}")  # fmt: skip
    wrong: list[Answer] = []
    everything: list[Answer] = []
    for family in told.family or FAMILIES:
        seeds = [told.first + 2 * k + told.held_out for k in range(told.count)]
        found = list(
            _told(
                family, (one for seed in seeds for one in answers(family, seed, one_camera=told.one_camera)), len(seeds)
            )
        )
        for mode in MODES if found else ():
            print(_line(family, mode, [a for a in found if a.mode == mode]), flush=True)
        wrong += [a for a in found if a.wrong and a.tells]
        everything += found
    for mode in MODES:
        print(_line("all", mode, [a for a in everything if a.mode == mode]))
    sure, tell = sum(a.confidence >= SURE for a in wrong), sum(a.tells for a in everything)
    print(f"\n{len(wrong)} wrong names where the two can be told apart; at {SURE} and more {sure} in {tell} looks, "
          f"that is {500 * sure / max(tell, 1):.1f} in 500 (goal: 1)")  # fmt: skip
    for a in wrong:
        print(f"  {a.pair.family} {a.pair.seed} {a.mode}: {a.pair.parts[a.lies].label} named {a.named} "
              f"{a.confidence:.5f} by {a.telling_mm:.0f} mm of edge ({a.reason})")  # fmt: skip
    for a in everything:
        if a.right and a.off_mm > OFF_MM:
            where = f"{a.pair.family} {a.pair.seed} {a.mode}"
            print(f"  {where}: {a.named} {a.confidence:.5f}, rightly, is {a.off_mm:.1f} mm off")
    if told.draw and wrong:
        folder = Path(tempfile.mkdtemp(prefix="look-alikes-"))
        for a in wrong[: told.draw]:
            _drawn(folder, a)
        print(f"pictures: {folder}")


def _arguments(given: list[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="look_alikes", description="What look-alike parts are taken for.")
    parser.add_argument("count", type=int, nargs="?", default=PAIRS, help="pairs a family")
    parser.add_argument("--first", type=int, default=0, help="the first seed, an even number")
    parser.add_argument("--held-out", action="store_true", help="the odd seeds instead of the even ones")
    parser.add_argument("--family", nargs="+", choices=list(FAMILIES), help="these alone")
    parser.add_argument("--one-camera", action="store_true", help="views of which one camera has a second facet")
    parser.add_argument("--draw", type=int, default=0, metavar="N", help="pictures of the first N wrong names")
    told = parser.parse_args(given)
    if told.first % 2:
        parser.error(f"--first {told.first}: an even number; --held-out takes the odd ones")
    return told


def answers(family: str, seed: int, modes: Sequence[str] = MODES, one_camera: bool = False) -> Iterator[Answer]:
    """The looks at one pair of a family, one a mode; none where there is no such view."""
    try:
        pair, lies, photo = shown(family, seed, one_camera)
    except LookupError:
        return
    by_mm = telling_mm(pair.parts[lies].shape, pair.parts[1 - lies].shape, photo.cyclopean_from_part)
    for mode in modes:
        scene, ms = _looked(pair, lies, mode, photo)
        yield _judged(pair, lies, mode, photo, scene, by_mm, ms)


def shown(family: str, seed: int, one_camera: bool = False) -> tuple[ConfusablePair, int, Photograph]:
    """The pair, which of it lies on the table, and what both cameras see; one_camera: a view of which one camera alone
    has a second facet. Raises LookupError where there is none."""
    pair = alike(family, seed)
    rng = np.random.default_rng([*family.encode(), seed, 1])
    lies = int(rng.integers(2))
    shape = pair.parts[lies].shape
    return pair, lies, photograph(shape, rng, partial(seen_by_one, shape) if one_camera else None)


def _looked(pair: ConfusablePair, lies: int, mode: str, photo: Photograph) -> tuple[Scene, float]:
    model = _model(pair, lies, mode)
    scene = look(photo.left, photo.right, true_rig(cell()), model, clock=time.process_time)
    return scene, 1000 * sum(scene.seconds.values())


def _model(pair: ConfusablePair, lies: int, mode: str) -> Model:
    """What is taught in a mode."""
    known = {"both": pair.parts, "alone": (pair.parts[lies],), "stranger": (pair.parts[1 - lies],)}[mode]
    return taught(known)


def _judged(
    pair: ConfusablePair, lies: int, mode: str, photo: Photograph, scene: Scene, by_mm: float, ms: float
) -> Answer:
    """The name given; a wrong one where several are."""
    part = pair.parts[lies]
    corners = frames.apply(photo.cyclopean_from_part, part.shape.hull.vertices)
    said = []
    for found in scene.parts:
        if found.named:
            off_mm = _off_mm(np.vstack(found.fitted_mm), corners)
            right = (
                found.recognition.label == part.label and mode != "stranger" and off_mm < np.ptp(corners, axis=0).max()
            )
            said.append((right, found.recognition, off_mm))
    if not said:
        return Answer(pair, lies, photo, mode, "", 0.0, "", False, 0.0, by_mm, ms)
    right, told, off_mm = min(said, key=lambda one: one[0])
    return Answer(pair, lies, photo, mode, told.label, told.confidence, told.reason, right, off_mm, by_mm, ms)


def _off_mm(found: Array, corners: Array) -> float:
    """The greatest distance of a corner found (N, 3) from the nearest of the part's (K, 3)."""
    return float(np.linalg.norm(found[:, None] - corners, axis=2).min(1).max())


def _told(family: str, found: Iterable[Answer], pairs: int) -> Iterator[Answer]:
    """The same answers; every now and then it is told how far it is."""
    last = time.monotonic()
    for number, one in enumerate(found):
        yield one
        if time.monotonic() - last > TOLD_S:
            last = time.monotonic()
            print(f"  {family}: {number // len(MODES) + 1} of {pairs}", file=sys.stderr, flush=True)


def _line(family: str, mode: str, found: list[Answer]) -> str:
    tell = [a for a in found if a.tells]
    same = [a for a in found if not a.tells]
    right, wrong = [a for a in tell if a.right], [a for a in tell if a.wrong]
    sure, off = sum(a.confidence >= SURE for a in wrong), sum(a.off_mm > OFF_MM for a in right)
    ms = [a.ms for a in found]
    silent = len(tell) - len(right) - len(wrong)
    return (f"{family:<10}{mode:<10}{len(tell):>6}{len(right):>7}{silent:>8}{len(wrong):>7}"
            f"{sure:>8}{off:>5}{len(same):>7}{sum(bool(a.named) for a in same):>15}"
            f"{np.median(ms):>9.0f}{max(ms):>7.0f}")  # fmt: skip


def _drawn(folder: Path, a: Answer) -> None:
    """The pictures as they are; what the look made of them; and, large, every edge of what it says is there."""
    photo, rig = a.photo, true_rig(cell())
    scene, _ = _looked(a.pair, a.lies, a.mode, photo)
    name = f"{a.pair.family}-{a.pair.seed}-{a.mode}"
    cv2.imwrite(str(folder / f"{name}.png"), np.hstack([photo.left, photo.right]))
    cv2.imwrite(str(folder / f"{name}-look.png"), draw_scene(photo.left, photo.right, scene))
    (part,) = [p for p in scene.parts if p.named][:1]
    solid = _model(a.pair, a.lies, a.mode).metric[part.recognition.label].solid
    corners = frames.apply(part.cyclopean_from_part, solid.corners_mm)
    both = []
    for image, camera in ((photo.left, rig.left), (photo.right, rig.right)):
        large = cv2.cvtColor(cv2.resize(image, None, fx=LARGE, fy=LARGE), cv2.COLOR_GRAY2BGR)
        px = np.rint((camera.project(corners) + 0.5) * LARGE - 0.5).astype(int)
        for start, end in solid.edges:
            cv2.line(large, px[start].tolist(), px[end].tolist(), (0, 0, 255), 1, cv2.LINE_AA)
        low, high = np.maximum(px.min(0) - ROUND_PX, 0), px.max(0) + ROUND_PX
        both.append(cv2.resize(large[low[1] : high[1], low[0] : high[0]], (800, 800)))
    cv2.imwrite(str(folder / f"{name}-said.png"), np.hstack(both))


if __name__ == "__main__":
    main()
