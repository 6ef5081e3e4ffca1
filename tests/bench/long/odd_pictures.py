"""Pictures that no cell shows, a thousand of them: how long does the longest look take, and is anything named in them?

usage: python -m tests.bench.long.odd_pictures [COUNT [SEED]]

Noise, gratings, chessboards, heaps of polygons, scribbles, photographs (of scikit-image's package; none is kept), and
pairs whose cameras look at different rendered scenes. The right camera sees mostly the left one's picture again as a
plane shows it, so that much has its like in the other camera. Taught: the six train-B views.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from daemon.main import tame_malloc
from daemon.store.pictures import read_grey
from daemon.vision.look import look
from daemon.vision.settings import VisionSettings
from daemon.vision.values import Scene
from tests.bench.data.packages import python_package
from tests.bench.recognise import test_folders, trained
from tests.fakes import rendered

Image = NDArray[np.uint8]
Chance = np.random.Generator
WIDE, HIGH = 640, 480
ASKED_MS = 250.0
"""What a look on a desktop's core is asked to take at most; the budget is for computers several times slower."""


def noise(rng: Chance) -> Image:
    """White, or coarse, or of two grains."""
    fine, coarse = (_grain(rng, float(rng.choice([0.0, 0.7, 1.5, 4.0, 12.0]))) for _ in range(2))
    return _levels(fine + rng.choice([0.0, 1.0]) * coarse, rng)


def grating(rng: Chance) -> Image:
    """Straight waves or bars, one way or two."""
    y, x = np.mgrid[0:HIGH, 0:WIDE]
    total = np.zeros((HIGH, WIDE))
    for _ in range(int(rng.integers(1, 3))):
        turn, length_px = rng.uniform(0, np.pi), rng.uniform(3, 80)
        wave = np.sin(2 * np.pi * (x * np.cos(turn) + y * np.sin(turn)) / length_px)
        total += np.sign(wave) if rng.random() < 0.5 else wave
    return _levels(total + rng.uniform(0, 0.3) * _grain(rng, 0.0), rng)


def chessboard(rng: Chance) -> Image:
    """Squares of any size as seen aslant."""
    size = int(rng.integers(5, 90))
    squares = (np.indices((3 * HIGH, 3 * WIDE)) // size).sum(axis=0) % 2
    frame = np.array([[0, 0], [WIDE, 0], [WIDE, HIGH], [0, HIGH]], np.float32)
    seen = frame + np.array([WIDE, HIGH], np.float32) + rng.uniform(-120, 120, (4, 2)).astype(np.float32)
    way = cv2.getPerspectiveTransform(seen.astype(np.float32), frame)
    return _levels(cv2.warpPerspective(squares.astype(np.float32), way, (WIDE, HIGH)), rng)


def polygons(rng: Chance) -> Image:
    """One laid upon another, of any size."""
    picture = np.full((HIGH, WIDE), float(rng.uniform(0, 255)), np.float32)
    for _ in range(int(rng.choice([5, 40, 400]))):
        angles = np.sort(rng.uniform(0, 2 * np.pi, int(rng.integers(3, 8))))
        corners = np.stack([np.cos(angles), np.sin(angles)], 1) * rng.gamma(2.0, 40.0)
        corners += rng.uniform((0, 0), (WIDE, HIGH))
        cv2.fillPoly(picture, [np.rint(16 * corners).astype(np.int32)], float(rng.uniform(0, 255)), cv2.LINE_AA, 4)
    return _shot(picture, rng)


def scribble(rng: Chance) -> Image:
    """Strokes and words."""
    picture = np.full((HIGH, WIDE), int(rng.uniform(60, 255)), np.uint8)
    for _ in range(int(rng.choice([10, 100, 1000]))):
        ink, (x, y, u, v) = int(rng.uniform(0, 255)), rng.uniform(0, WIDE, 4).astype(int).tolist()
        if rng.random() < 0.5:
            cv2.line(picture, (x, y), (u, v), ink, int(rng.integers(1, 6)), cv2.LINE_AA)
        else:
            cv2.putText(picture, chr(65 + x % 26) * 3, (x, y), cv2.FONT_HERSHEY_SIMPLEX, 0.5 + u / 300, ink, 2)
    return _shot(picture.astype(np.float32), rng)


def _grain(rng: Chance, sigma_px: float) -> NDArray[np.float64]:
    grain: np.ndarray = rng.normal(size=(HIGH, WIDE))
    if sigma_px:
        grain = cv2.GaussianBlur(grain, (0, 0), sigma_px)
    return np.asarray(grain / grain.std(), np.float64)


def _levels(picture: np.ndarray, rng: Chance) -> Image:
    """Some contrast about some grey."""
    low, high = np.sort(rng.uniform(0, 255, 2))
    spread = (picture - picture.min()) / max(float(np.ptp(picture)), 1e-9)
    return _shot(np.asarray(low + (high - low) * spread, np.float32), rng)


def _shot(picture: NDArray[np.float32], rng: Chance) -> Image:
    """As a camera has it: a little blur and noise."""
    seen = cv2.GaussianBlur(picture, (0, 0), 0.7) + rng.normal(scale=rng.uniform(0.5, 4.0), size=picture.shape)
    return np.asarray(np.clip(np.rint(seen), 0, 255), np.uint8)


def seen_by_both(one: Image, rng: Chance) -> tuple[Image, Image]:
    """The picture for the left camera, and for the right one as a plane near the usual distance shifts it."""
    near_px, lean = rng.uniform(20, 180), rng.uniform(-0.15, 0.15, 2)
    shift = np.array([[1.0 + lean[0], lean[1], -near_px], [0.0, 1.0, 0.0]])
    right = cv2.warpAffine(one, shift, (WIDE, HIGH), borderMode=cv2.BORDER_REFLECT)
    return one, _shot(right.astype(np.float32), rng)


def photographs() -> list[Image]:
    """What scikit-image ships, in the cameras' size; none where it cannot be had."""
    with tempfile.TemporaryDirectory() as folder:
        root = python_package("scikit-image", Path(folder))
        if isinstance(root, str):
            print(f"photographs: {root}")
            return []
        files = sorted(f for f in (root / "skimage/data").iterdir() if f.suffix in (".png", ".jpg", ".jpeg"))
        sized: list[Any] = [cv2.resize(read_grey(file), (WIDE, HIGH), interpolation=cv2.INTER_AREA) for file in files]
        return sized


def pairs(count: int, seed: int) -> Iterator[tuple[str, Image, Image]]:
    """So many pairs, kind after kind."""
    rng, shown = np.random.default_rng(seed), photographs()
    scenes = [f for f in test_folders(rendered.ALL) if "-B-" in f.name]
    made: dict[str, Callable[[Chance], Image]] = {
        "noise": noise, "gratings": grating, "chessboards": chessboard, "polygons": polygons, "scribbles": scribble,
    }  # fmt: skip
    if shown:
        made["photographs"] = lambda chance: shown[int(chance.integers(len(shown)))]
    names = [*made, "two scenes"]
    for k in range(count):
        name = names[k % len(names)]
        if name == "two scenes":
            one, other = rng.choice(len(scenes), 2, replace=False)
            yield name, rendered.pair(scenes[one])[0], rendered.pair(scenes[other])[1]
        elif rng.random() < 0.2:
            yield name, made[name](rng), made[name](rng)
        else:
            yield name, *seen_by_both(made[name](rng), rng)


def main(count: int = 1000, seed: int = 1) -> None:
    """Look at all of them, and print a line for each kind."""
    if not rendered.ALL.is_dir():
        print("odd pictures: no scenes to teach (set FACETD_SHARED)")
        return
    cv2.setNumThreads(1)
    tame_malloc()
    rig = rendered.rig(rendered.ALL, "B")
    model, settings = trained(rig), VisionSettings()
    every, of_kind = Tally(), defaultdict[str, Tally](Tally)
    for k, (kind, left, right) in enumerate(pairs(count, seed)):
        scene = look(left, right, rig, model, settings, time.process_time)
        for tally in (every, of_kind[kind]):
            tally.add(k, scene)
    over = f"> {ASKED_MS:.0f} ms"
    print(f"{'pictures':<14}{'looks':>7}{'median':>9}{'95 %':>8}{'worst':>8} ms{over:>10}{'by budget':>11}")
    for kind, tally in of_kind.items():
        print(f"{kind:<14}{tally.row()}")
    print(f"{'all':<14}{every.row()}")
    print(f"named: {', '.join(every.named) or 'nothing'}")


@dataclass
class Tally:
    """ms each look took; how many ended by the budget; what was named, and in which picture."""

    ms: list[float] = field(default_factory=list)
    ended: int = 0
    named: list[str] = field(default_factory=list)

    def add(self, number: int, scene: Scene) -> None:
        """One more look."""
        self.ms.append(1000 * sum(scene.seconds.values()))
        self.ended += any("vision: budget_s" in note for note in scene.notes)
        self.named += [f"{part.recognition.label} in {number}" for part in scene.parts if part.named]

    def row(self) -> str:
        """For people."""
        median, most, worst = np.percentile(self.ms, (50, 95, 100))
        over = sum(ms > ASKED_MS for ms in self.ms)
        return f"{len(self.ms):>7}{median:>9.0f}{most:>8.0f}{worst:>8.0f}   {over:>10}{self.ended:>11}"


if __name__ == "__main__":
    main(*(int(word) for word in sys.argv[1:]))
