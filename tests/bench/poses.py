"""How near parts are measured, and whether their covariances say so: real pairs of a printed cube, and rendered scenes.

usage: python -m tests.bench.poses

Rendered parts: the shared scenes, and look-alike families' even seeds and odd ones, which are held out.
Real pairs: the folder named by FACETD_SHARED (default ../shared), real/cube-* in it, and pairs made of any two frames
of these that sit as cameras may; the cube is taught from its drawing. Where it is, is known to TRUE_MM and TRUE_DEG,
which is added to what a look says. A pose of six numbers is within its 95 % where its chi-square is below 12.6: so
should 95 of 100 be, and half of them below 5.3; beyond three sigmas (20.1) one of 370. By these figures STRETCH_PX of
the pose by edges was set, and how far other poses that fit nearly as well widen it.
"""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from dataclasses import replace
from itertools import permutations, product
from typing import Any, NamedTuple

import cv2
import numpy as np

from daemon import frames
from daemon.arrays import Array
from daemon.calibration.file import load_calibration
from daemon.store.library import load_facets
from daemon.store.pictures import read_grey
from daemon.teaching.solid_from_mesh import solid_drawn
from daemon.vision.geometry.polyhedron import Polyhedron
from daemon.vision.geometry.rig import Camera, StereoRig, moved_rig
from daemon.vision.look import look
from daemon.vision.model import learn_solid
from daemon.vision.model.model import Model, empty_model
from daemon.vision.values import Part
from tests.bench.look_alikes import shown
from tests.bench.printed_cube import Image
from tests.bench.recognise import test_folders, trained
from tests.bench.simulated_looks import true_rig
from tests.fakes import rendered
from tests.fakes.drawn import box, obj
from tests.fakes.families import FAMILIES
from tests.fakes.many_parts import taught
from tests.fakes.photographed import cell

REAL = rendered.ALL.parent / "real"
LABEL, SIDE_MM = "printed_cube", 84.0
TRUE_MM, TRUE_DEG, DRAWN_MM, DRAWN_DEG = 0.17, 0.12, 0.02, 0.02
"""How well places of real cubes and of rendered parts are known, along and about each axis."""
OF_FAMILY = 40
"""Looks at parts of each look-alike family."""
APART_MM, AHEAD, TURNED_DEG, PAIRS, SEED = (25.0, 120.0), 0.35, 25.0, 100, 3
NEAR_MM = 6.0
WITHIN_95, WITHIN_3_SIGMAS = 12.59, 20.06
UPRIGHT = [
    np.eye(3)[list(order)] * np.array(signs)[:, None]
    for order in permutations(range(3))
    for signs in product((1.0, -1.0), repeat=3)
    if np.linalg.det(np.eye(3)[list(order)] * np.array(signs)[:, None]) > 0
]
"""The turns of a cube."""


class Frame(NamedTuple):
    """A picture with the camera that took it, and where that has the cube, camera_from_cube (4, 4)."""

    name: str
    image: Image
    camera: Camera
    camera_from_cube: Array


class QuickMeasurements(NamedTuple):
    """Of one part: how far off its corners are on average, mm, the chi-square of its pose, and whether edges alone
    named it."""

    off_mm: float
    chi_square: float
    by_edges: bool


def main() -> None:
    cv2.setNumThreads(1)
    print(f"{'parts':<22}{'looks':>6}{'named':>6}{'corner mm 50 %':>16}{'mean':>7}{'95 %':>7}{'worst':>7}"
          f"{'chi-square 50 %':>17}{'in 95 %':>9}{'beyond 3 sigmas':>17}{'ms':>6}")  # fmt: skip
    if REAL.is_dir():
        taken = list(_frames())
        _line("real pairs", _real(zip(taken[::2], taken[1::2], strict=True)))
        _line("real, any two frames", _real(_any_two(taken)))
    if rendered.ALL.is_dir():
        _lines("rendered", list(_rendered()))
    for first, name in enumerate(("families", "held out")):
        _lines(name, list(_families(range(first, 2 * OF_FAMILY, 2))))


def _lines(name: str, found: list[tuple[QuickMeasurements | None, float]]) -> None:
    for by_edges, words in ((False, "by facets"), (True, "by edges")):
        _line(f"{name}, {words}", [(m if m is None or m.by_edges == by_edges else None, ms) for m, ms in found])


def _line(name: str, looks: list[tuple[QuickMeasurements | None, float]]) -> None:
    found = [one for one, _ in looks if one is not None]
    off, chi = (np.array([getattr(one, each) for one in found]) for each in ("off_mm", "chi_square"))
    places = f"{np.median(off):>16.2f}{off.mean():>7.2f}{np.quantile(off, 0.95):>7.2f}{off.max():>7.2f}"
    doubts = f"{np.median(chi):>17.1f}{np.mean(chi < WITHIN_95):>9.0%}{np.count_nonzero(chi > WITHIN_3_SIGMAS):>17}"
    print(f"{name:<22}{len(looks):>6}{len(found):>6}{places}{doubts}{np.median([ms for _, ms in looks]):>6.0f}")


def _frames() -> Iterator[Frame]:
    """Left and right of every pair, in turn."""
    for folder in sorted(REAL.glob("cube-*")):
        if not (folder / "truth.json").exists():
            continue
        rig = load_calibration(folder / "calibration.yaml").rig
        cyclopean_from_cube = np.array(json.loads((folder / "truth.json").read_text())["cyclopean_from_part"])
        for camera, side in ((rig.left, "left"), (rig.right, "right")):
            there = frames.inverse(camera.cyclopean_from_camera) @ cyclopean_from_cube
            yield Frame(folder.name, read_grey(folder / f"{side}.png"), camera, there)


def _any_two(taken: list[Frame]) -> Iterator[tuple[Frame, Frame]]:
    """Pairs of frames of different pairs, the second to the right of the first, PAIRS of them drawn by lot."""
    pairs = []
    for one, other in permutations(taken, 2):
        motion = _motion(one, other)
        apart_mm, turned = frames.size(motion)
        beside = motion[0] > 0 and abs(motion[2]) < AHEAD * apart_mm and APART_MM[0] < apart_mm < APART_MM[1]
        if one.name != other.name and beside and np.degrees(turned) < TURNED_DEG:
            pairs.append((one, other))
    for k in sorted(np.random.default_rng(SEED).permutation(len(pairs))[:PAIRS]):
        yield pairs[k]


def _motion(one: Frame, other: Frame) -> Array:
    """(6,) from where one camera was to where the other was, as the first sees it."""
    return frames.difference(one.camera_from_cube @ frames.inverse(other.camera_from_cube), np.eye(4))


def _real(pairs: Iterator[tuple[Frame, Frame]]) -> list[tuple[QuickMeasurements | None, float]]:
    drawn = solid_drawn("cube.obj", obj(*box(SIDE_MM, SIDE_MM, SIDE_MM)), "mm", load_facets())
    looks = []
    for one, other in pairs:
        beside = _motion(one, other)[0] > 0
        left, right = (one, other) if beside else (other, one)
        size = (left.image.shape[1], left.image.shape[0])
        cameras = frames.inverse(left.camera_from_cube), frames.inverse(right.camera_from_cube)
        rig, cube_from_cyclopean = moved_rig(replace(left.camera, cyclopean_from_camera=np.eye(4)), size, cameras)
        model = learn_solid(empty_model(load_facets()), drawn, LABEL)
        parts, ms = _named(left.image, right.image, rig, model)
        true = _of_cube(frames.inverse(cube_from_cyclopean), model.metric[LABEL].solid, parts[0]) if parts else None
        doubt = np.diag([TRUE_MM**2] * 3 + [np.radians(TRUE_DEG) ** 2] * 3)
        looks.append((_measured(parts[0], model, true, doubt) if true is not None else None, ms))
    return looks


def _rendered() -> Iterator[tuple[QuickMeasurements | None, float]]:
    model = trained(rendered.rig(rendered.ALL, "B"))
    for folder in test_folders(rendered.ALL):
        told = rendered.truth(folder)
        parts, ms = _named(*rendered.pair(folder), rendered.rig(rendered.ALL, told["rig"]), model)
        for body in told["objects"]:
            own = (measured_as_drawn(body, p, model) for p in parts if p.recognition.label == body["label"])
            yield next((one for one in own if one is not None), None), ms


def measured_as_drawn(body: dict[str, Any], part: Part, model: Model) -> QuickMeasurements | None:
    """How near a named part is to a rendered scene's true body; None where it is not near."""
    corners = np.unique(np.vstack([f["corners_mm"] for f in body["facets"]]).round(3), axis=0)
    true = onto(corners, part.cyclopean_from_part, model.metric[part.recognition.label].solid)
    doubt = np.diag([DRAWN_MM**2] * 3 + [np.radians(DRAWN_DEG) ** 2] * 3)
    return None if true is None else _measured(part, model, true, doubt)


def _families(seeds: range) -> Iterator[tuple[QuickMeasurements | None, float]]:
    """Parts of the look-alike families, each taught alone."""
    doubt = np.diag([DRAWN_MM**2] * 3 + [np.radians(DRAWN_DEG) ** 2] * 3)
    for family, seed in product(FAMILIES, seeds):
        pair, lies, photo = shown(family, seed)
        part = pair.parts[lies]
        model = taught((part,))
        parts, ms = _named(photo.left, photo.right, true_rig(cell()), model)
        corners = np.unique(np.vstack([piece.vertices for piece in part.shape.pieces]).round(3), axis=0)
        there = frames.apply(photo.cyclopean_from_part, corners)
        true = [onto(there, p.cyclopean_from_part, model.metric[part.label].solid) for p in parts]
        good = [(p, pose) for p, pose in zip(parts, true, strict=True) if pose is not None]
        yield (_measured(good[0][0], model, good[0][1], doubt) if good else None), ms


def _named(left: Image, right: Image, rig: StereoRig, model: Model) -> tuple[list[Part], float]:
    scene = look(left, right, rig, model, clock=time.process_time)
    return [p for p in scene.parts if p.named], 1000 * sum(scene.seconds.values())


def _measured(part: Part, model: Model, true: Array, doubt: Array) -> QuickMeasurements:
    """doubt (6, 6): of the true pose, about the part's middle."""
    corners = model.metric[part.recognition.label].solid.corners_mm
    pose = part.cyclopean_from_part
    about = np.eye(6)
    about[:3] = frames.point_motion((pose[:3, 3] - frames.apply(pose, corners).mean(0))[None])[0]
    off = frames.difference(pose, true)
    chi_square = float(off @ np.linalg.solve(part.covariance + about @ doubt @ about.T, off))
    apart = np.linalg.norm(frames.apply(pose, corners) - frames.apply(true, corners), axis=1)
    return QuickMeasurements(float(apart.mean()), chi_square, "edges" in part.recognition.reason)


def _of_cube(cyclopean_from_cube: Array, solid: Polyhedron, part: Part) -> Array:
    """Where the cube is, turned as the part that was found is: cyclopean_from_part (4, 4)."""
    pose, middle = part.cyclopean_from_part, frames.apply(cyclopean_from_cube, np.full((1, 3), SIDE_MM / 2))[0]
    turns = [cyclopean_from_cube[:3, :3] @ turn for turn in UPRIGHT]
    turn = max(turns, key=lambda one: float(np.trace(pose[:3, :3] @ one.T)))
    return frames.rigid(turn, middle - turn @ solid.corners_mm.mean(0))


def onto(true_mm: Array, pose: Array, solid: Polyhedron) -> Array | None:
    """The pose (4, 4) that lays a solid onto true corners (N, 3), from one nearby; None where that is not near."""
    for _ in range(6):
        corners = frames.apply(pose, solid.corners_mm)
        apart = np.linalg.norm(corners[:, None] - true_mm, axis=2)
        met = apart.min(1) < NEAR_MM
        if met.sum() < 4:
            return None
        ones, others = corners[met], true_mm[apart.argmin(1)[met]]
        u, _, v = np.linalg.svd((ones - ones.mean(0)).T @ (others - others.mean(0)))
        turn = v.T @ np.diag([1.0, 1.0, np.sign(np.linalg.det(v.T @ u.T))]) @ u.T
        pose = frames.rigid(turn, others.mean(0) - turn @ ones.mean(0)) @ pose
    return pose


if __name__ == "__main__":
    main()
