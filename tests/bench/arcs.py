"""Rounded parts 300 mm away: are their arcs typed, how exact are radius, corners and centres, are sizes told apart?

Discs, knobs, half discs, stadiums, quarters and blocks with a bore, each taught from drawings in three sizes whose
radii are SIZES of the middle one's and all else alike; the middle one lies on the simulated cell's table, half of the
tables patterned, half of the parts printed. Typed: of the facets with an arc in their outline that both cameras meet
under 60 degrees, those that may have the drawing's type in a look without a model. Circles: of all arcs, bores' as
well, those that both cameras show as a circle, and its radius. Named: with all three taught, and the other two as
strangers. Where: corners, and centres of arcs and bores, of named parts.

usage: python -m tests.bench arcs, or python -m tests.bench.arcs [SEEDS [FIRST]]
"""

from __future__ import annotations

import sys
from collections import Counter
from dataclasses import dataclass, field
from typing import NamedTuple

import cv2
import numpy as np

from daemon import frames
from daemon.arrays import Array
from daemon.main import tame_malloc
from daemon.store.library import load_facets
from daemon.teaching.solid_from_mesh import Drawing
from daemon.vision.facets import find_circles
from daemon.vision.geometry import Polyhedron
from daemon.vision.hypotheses.circles import rims_of
from daemon.vision.image import open_stereo
from daemon.vision.look import look
from daemon.vision.model import axis_of_revolution, empty_model, symmetries, types_of
from tests.bench.machined import Look, on_table
from tests.fakes.drawn import obj, prism
from tests.fakes.holed import holed_block, rounded
from tests.fakes.machined import drawing, drawing_from_taught, taught_from

KINDS = "disc", "knob", "half", "stadium", "quarter", "bore"
SIZES = 0.95, 1.0, 1.05
RADIUS_MM, AWAY_MM = (10.0, 22.0), (290.0, 310.0)
MET_AT_LEAST = np.cos(np.radians(60.0))
NEAR_MM, OFF_MM, OF_RADIUS = 3.0, 3.0, 0.03
STRIPS, SEEDS = 48, 4


OUTCOMES = "right", "silent", "misplaced", "WRONG"


@dataclass
class Tally:
    """arcs of facets that both cameras meet well; of those: outer ones, in outlines, and these typed as in the drawing;
    seen as circles, with a good radius; what names
    came to, by what was taught; how far off radii (share), corners and centres of bores (mm) are."""

    arcs: int = 0
    outer: int = 0
    typed: int = 0
    circles: int = 0
    good: int = 0
    names: Counter[tuple[str, str]] = field(default_factory=Counter)
    radii: list[float] = field(default_factory=list)
    corners_mm: list[float] = field(default_factory=list)
    centres_mm: list[float] = field(default_factory=list)


def main(arguments: list[str] | None = None) -> None:
    told = list(map(int, sys.argv[1:] if arguments is None else arguments))
    seeds, first = (*told, *(SEEDS, 1)[len(told) :])
    cv2.setNumThreads(1)
    tame_malloc()
    tally = Tally()
    for kind in KINDS:
        for seed in range(first, first + seeds):
            _look_at(kind, seed, tally)
    many = max(tally.arcs, 1)
    print(f"{tally.arcs} arcs met under 60 degrees: {tally.typed} of {tally.outer} in outlines typed")
    print(f"seen as circles {tally.circles / many:.0%}, to {OF_RADIUS:.0%} of their radius {tally.good / many:.0%}")
    for which in ("three sizes", "the other two"):
        print(f"{which} taught: " + ", ".join(f"{what} {tally.names[which, what]}" for what in OUTCOMES))
    for name, values, unit in (
        ("radii of circles", 100 * np.array(tally.radii), "%"),
        ("corners of named parts", np.array(tally.corners_mm), "mm"),
        ("centres of their arcs and bores", np.array(tally.centres_mm), "mm"),
    ):
        if len(values):
            print(f"{name} are off: median {np.median(values):.2f} {unit}, 95 % {np.quantile(values, 0.95):.2f} {unit}")


def _look_at(kind: str, seed: int, tally: Tally) -> None:
    """One part of a kind, seen alone."""
    one = staged(kind, seed)
    _measure_arcs(one.shown, one.solid, one.pose, tally)
    for which, without in (("three sizes", ""), ("the other two", "1")):
        model = taught_from({name: drawn for name, drawn in one.sizes.items() if name != without})
        found = [part for part in look(one.shown.left, one.shown.right, one.shown.rig, model).parts if part.named]
        outcome = "silent" if not found else "WRONG" if any(p.recognition.label != "1" for p in found) else "right"
        if outcome == "right":
            outcome = _measure_place(found[0].cyclopean_from_part, one.solid, one.pose, tally)
        tally.names[which, outcome] += 1


class Staged(NamedTuple):
    """Drawings of a part in three sizes, the middle one "1"; a look at that, its solid as taught, and its pose (4, 4)
    cyclopean_from_part."""

    sizes: dict[str, Drawing]
    shown: Look
    solid: Polyhedron
    pose: Array


def staged(kind: str, seed: int) -> Staged:
    """A part of a kind alone on the table."""
    rng = np.random.default_rng([*kind.encode(), seed])
    radius, long, high = rng.uniform(*RADIUS_MM), rng.uniform(20.0, 36.0), rng.uniform(14.0, 26.0)
    long = max(long, 1.4 * radius) if kind == "bore" else long  # in all sizes the bore is in the block
    sizes = {f"{size:g}": drawing("one.obj", obj(*_mesh(kind, size * radius, long, high))) for size in SIZES}
    shown = on_table("1", sizes["1"], rng, AWAY_MM)
    solid = taught_from({"1": sizes["1"]}).metric["1"].solid
    return Staged(sizes, shown, solid, shown.pose @ drawing_from_taught(sizes["1"], solid))


def off_mm(pose: Array, solid: Polyhedron, true: Array) -> Array:
    """(K,) how far the corners of a part at a pose (4, 4) are from where they are at the true one (4, 4), or at the one
    of those that look the same which is nearest."""
    same = symmetries(solid).motions
    axis = axis_of_revolution(solid)
    if axis is not None:
        quarter = np.radians(np.arange(0, 90, 0.2))  # further turns lay chords on chords
        turns = frames.rotations_from_vectors(np.outer(quarter, axis.direction))
        about = frames.rigid(turns, axis.point_mm - turns @ axis.point_mm)
        same = (about[:, None] @ same).reshape(-1, 4, 4)
    ways = true @ same
    there = solid.corners_mm @ ways[:, :3, :3].swapaxes(1, 2) + ways[:, None, :3, 3]
    off = np.linalg.norm(frames.apply(pose, solid.corners_mm) - there, axis=2)
    return np.asarray(off[off.max(1).argmin()])


def _mesh(kind: str, radius: float, long: float, high: float) -> tuple[Array, list[tuple[int, ...]]]:
    if kind == "bore":
        rim = rounded(2 * radius, 2 * radius, radius)
        return holed_block(np.array([2 * long, 56.0, high]), rim, (0.9 * long, 28.0))
    sweep = {"disc": 2 * np.pi, "knob": 1.7 * np.pi, "quarter": np.pi / 2}.get(kind, np.pi)
    turns = np.linspace(0, sweep, STRIPS + 1)[: STRIPS + (kind != "disc")]
    round_ = radius * np.column_stack([np.cos(turns), np.sin(turns)])
    rest = {
        "half": [[-radius, -long], [radius, -long]],
        "stadium": [*(-round_ - [0.0, long])],
        "quarter": [[-long, radius], [-long, -long], [radius, -long]],
    }.get(kind, [])
    return prism([(float(x), float(y)) for x, y in [*round_, *rest]], high)


def _measure_arcs(shown: Look, solid: Polyhedron, true: Array, tally: Tally) -> None:
    """Whether pictures without a model type the arcs that they show well, and their radii as circles in space."""
    cameras = open_stereo(shown.left, shown.right, shown.rig)
    nothing = empty_model(load_facets())
    facets = [facet for part in look(shown.left, shown.right, shown.rig, nothing).parts for facet in part.facets]
    rims, kinds = rims_of(solid), {solid.types[arc.facet] for arc in solid.arcs}
    seen = find_circles(cameras, np.array([rim.radius_mm for rim in rims]))
    for rim in rims:
        centre, normal = frames.apply(true, rim.centre_mm[None])[0], true[:3, :3] @ rim.normal
        towards = [(camera - centre) / np.linalg.norm(camera - centre) for camera in cameras.geometry.cameras_mm]
        if min(normal @ way for way in towards) < MET_AT_LEAST:
            continue
        tally.arcs += 1
        if rim.outer:
            tally.outer += 1
            tally.typed += any(
                kinds.intersection(names) and np.linalg.norm(facet.corners_mm.mean(0) - centre) < 2 * rim.radius_mm
                for facet, names in zip(facets, types_of(facets, nothing.library), strict=True)
            )
        near = [
            abs(one.radius_mm / rim.radius_mm - 1) for one in seen if np.linalg.norm(one.centre_mm - centre) < NEAR_MM
        ]
        if near:
            tally.circles += 1
            tally.good += min(near) < OF_RADIUS
            tally.radii.append(min(near))


def _measure_place(pose: Array, solid: Polyhedron, true: Array, tally: Tally) -> str:
    """Whether a part is where it lies, and how far off its corners and the centres of its rims are."""
    off = off_mm(pose, solid, true)
    if off.max() > OFF_MM:
        return "misplaced"
    tally.corners_mm.extend(off)
    centres = [frames.apply(at, np.stack([rim.centre_mm for rim in rims_of(solid)])) for at in (pose, true)]
    apart = np.linalg.norm(centres[0][:, None] - centres[1], axis=2)
    tally.centres_mm.extend(apart.min(1))
    return "right"


if __name__ == "__main__":
    main()
