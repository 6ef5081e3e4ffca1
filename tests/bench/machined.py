"""Twelve machined parts, all taught from their drawings; each lies on the table: is it named, and where is it?

The drawings (tests/data/machined.npz) are of a bracket, a flange, a T-nut, a V-block, a clevis, a knob, a pillow block,
a gusset, a lever, a cover, a shaft block and a block with rounded edges. Without an argument the simulated cell shows
them: odd seeds, which nothing was chosen by, half of the tables patterned, half of the parts printed. With a folder the
looks in it are taken instead: left.png, right.png, truth.json with label and cyclopean_from_part (4, 4) of the
drawing's frame, taken with rig B of the rendered scenes. A part is where it was said to be if no
corner is farther off than 3 mm, or if only what no camera has in view of its holes tells the two turns apart.

usage: python -m tests.bench machined [SEEDS [FIRST] | FOLDER]
"""

from __future__ import annotations

import json
import sys
from collections import Counter, defaultdict
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from daemon import frames
from daemon.arrays import Array
from daemon.main import tame_malloc
from daemon.store.library import load_facets
from daemon.store.pictures import read_as_stored
from daemon.teaching.solid_from_mesh import Drawing
from daemon.vision.evidence.hole_rims import hole_nats
from daemon.vision.geometry import StereoRig
from daemon.vision.image import open_stereo
from daemon.vision.look import look
from daemon.vision.model import Model, TeachError, empty_model, learn_solid, symmetries, turns_but_for_holes
from tests.bench.simulated_looks import true_rig
from tests.fakes import rendered
from tests.fakes.drawn import obj
from tests.fakes.machined import drawing, drawing_from_taught, shape_from_drawing, shown_shape
from tests.fakes.photographed import DISTANCE_MM, cell, photograph

KEPT = Path(__file__).resolve().parents[1] / "data" / "machined.npz"
SEEDS = 2
OFF_MM, NATS = 3.0, 2.0
OUTCOMES = "right", "silent", "misplaced", "WRONG"


class Look(NamedTuple):
    """Of one part: its name, where it lies (4, 4) cyclopean_from_drawing, both pictures, the rig, what table."""

    label: str
    pose: Array
    left: np.ndarray
    right: np.ndarray
    rig: StereoRig
    table: str


def main(arguments: list[str] | None = None) -> None:
    told = sys.argv[1:] if arguments is None else arguments
    cv2.setNumThreads(1)
    tame_malloc()
    counts, places = defaultdict[tuple[str, str], Counter[str]](Counter), list[float]()
    kept = bool(told) and not told[0].isdigit()
    for one in in_folder(Path(told[0])) if kept else simulated(*([int(word) for word in told] or [SEEDS])):
        outcome, off = named(one)
        counts[one.label, one.table][outcome] += 1
        if outcome == "right":
            places.append(off)
        if outcome in OUTCOMES[2:]:
            print(f"  {one.label}, {one.table}: {outcome} {off:.1f} mm", flush=True)
    print(f"{'part':<16}{'table':<11}" + "".join(f"{name:>10}" for name in OUTCOMES))
    for (label, table), count in sorted(counts.items()):
        print(f"{label:<16}{table:<11}" + "".join(f"{count[name]:>10}" for name in OUTCOMES))
    for table in sorted({table for _, table in counts}):
        every = sum((count for (_, own), count in counts.items() if own == table), Counter[str]())
        print(f"{'all':<16}{table:<11}" + "".join(f"{every[name]:>10}" for name in OUTCOMES))
    if places:
        print(f"farthest corner of those that are right: median {np.median(places):.2f} mm")


@cache
def drawings() -> dict[str, Drawing]:
    """The twelve."""
    with np.load(KEPT) as file:
        names = sorted(name.removesuffix("_corners_mm") for name in file if name.endswith("_corners_mm"))
    return {name: drawn(name) for name in names}


@cache
def drawn(label: str) -> Drawing:
    """One of them."""
    with np.load(KEPT) as file:
        mesh = file[f"{label}_corners_mm"].astype(float), file[f"{label}_triangles"].tolist()
    return drawing(f"{label}.obj", obj(*mesh))


@cache
def taught() -> Model:
    """Those of them that can be taught, from their drawings."""
    model = empty_model(load_facets())
    for name, one in drawings().items():
        try:
            model = learn_solid(model, one.solid, name)
        except TeachError as error:
            print(error, file=sys.stderr)
    return model


def simulated(seeds: int, first: int = 1) -> Iterator[Look]:
    """Each part as many times, in the simulated cell, from an odd seed on."""
    for label in drawings():
        for seed in range(first, first + 2 * seeds, 2):
            yield simulated_look(label, seed)


def simulated_look(label: str, seed: int) -> Look:
    """One part alone on the simulated cell's table."""
    return on_table(label, drawn(label), np.random.default_rng([*label.encode(), seed]))


def on_table(
    label: str, one: Drawing, rng: np.random.Generator, distance_mm: tuple[float, float] = DISTANCE_MM
) -> Look:
    """A drawn part alone on the simulated cell's table, from so far away."""
    shape = shown_shape(label, one)
    assert shape.surface is not None
    photo = photograph(shape, rng, distance_mm=distance_mm)
    pose = photo.cyclopean_from_part @ shape_from_drawing(shape, one)
    table = "plain" if photo.table is None else "patterned"
    return Look(label, pose, photo.left, photo.right, true_rig(cell()), table)


def in_folder(folder: Path) -> Iterator[Look]:
    """The looks that a folder keeps, all at plain tables."""
    rig = rendered.rig(rendered.HERE, "B")
    for path in sorted(folder.glob("*/truth.json")):
        told = json.loads(path.read_text())
        left, right = (read_as_stored(path.with_name(f"{camera}.png")) for camera in ("left", "right"))
        yield Look(told["label"], np.array(told["cyclopean_from_part"]), left, right, rig, "plain")


def named(one: Look) -> tuple[str, float]:
    """What a look says: one of OUTCOMES, and how far off the farthest corner is, mm."""
    scene = look(one.left, one.right, one.rig, taught())
    found = [part for part in scene.parts if part.named]
    if not found:
        return "silent", 0.0
    if any(part.recognition.label != one.label for part in found):
        return "WRONG", 0.0
    solid, true = taught().metric[one.label].solid, one.pose @ drawing_from_part(one.label)
    cameras, pose = open_stereo(one.left, one.right, one.rig), found[0].cyclopean_from_part
    unseen = hole_nats(solid, pose, cameras) > hole_nats(solid, true, cameras) - NATS
    turns = turns_but_for_holes(solid) if unseen else np.eye(4)[None]
    corners = frames.apply(pose, solid.corners_mm)
    ways = (frames.apply(true @ turn @ own, solid.corners_mm) for turn in turns for own in _own_turns(one.label))
    off = min(float(np.linalg.norm(corners - way, axis=1).max()) for way in ways)
    return ("right" if off < OFF_MM else "misplaced"), off


@cache
def _own_turns(label: str) -> Array:
    return symmetries(taught().metric[label].solid).motions


@cache
def drawing_from_part(label: str) -> Array:
    """(4, 4) from the frame of the taught solid to that of its drawing."""
    return drawing_from_taught(drawn(label), taught().metric[label].solid)


if __name__ == "__main__":
    main()
