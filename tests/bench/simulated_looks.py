"""The simulated cell's pictures through find_facets: what is found of what is in sight, and how far corners are off.

By stand-off; once with the daemon's own calibration (etc/calibration.yaml, a little wrong) and once with the true one,
so that the camera's share of an error is seen apart from the finder's. A bench script, run by `make bench`.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field

import numpy as np

from daemon.arrays import Array
from daemon.calibration.file import load_calibration
from daemon.vision.facets.one_look.reconstruct import find_facets
from daemon.vision.geometry.rig import Camera, StereoRig
from daemon.vision.values import FacetView
from drivers.camera.pair import StereoPair
from drivers.rigid import apply, inverse
from drivers.simcell.camera import SimulatedPair, SimulatedScene
from drivers.simcell.parts import TAUGHT
from drivers.simcell.render import RenderedSolid
from drivers.simcell.truth import Truth, load_truth
from drivers.simcell.world import World
from tests.fakes.photographed import ETC, pose_above

STAND_OFFS_MM = (450.0, 300.0, 200.0)
LOOKS, SEED = 48, 11
SAME_MM = 6.0
LEAST_FACING, MARGIN_PX = 0.1, 3.0


@dataclass
class Tally:
    """What one calibration made of the looks from one distance."""

    in_sight: int = 0
    invented: int = 0
    errors_mm: list[float] = field(default_factory=list)

    def add(self, view: FacetView, wanted: list[Array]) -> None:
        found = [facet.corners_mm for group in view.groups for facet in group.facets]
        errors = [min((ring_error(f, w) for f in found if len(f) == len(w)), default=np.inf) for w in wanted]
        hits = [error for error in errors if error < SAME_MM]
        self.in_sight += len(wanted)
        self.errors_mm += hits
        self.invented += max(0, len(found) - len(hits))

    def row(self) -> str:
        share = 100 * len(self.errors_mm) / self.in_sight
        middle, worst = np.percentile(self.errors_mm, [50, 90])
        return f"{share:6.1f} %  {middle:7.2f} {worst:7.2f}  {self.invented:6d}"


def ring_error(found: Array, wanted: Array) -> float:
    """Mean distance in mm of (N, 3) corners from the wanted ones, whichever corner comes first."""
    return min(float(np.linalg.norm(np.roll(found, k, 0) - wanted, axis=1).mean()) for k in range(len(wanted)))


def facets_in_sight(truth: Truth, world: World, world_from_cyclopean: Array) -> list[Array]:
    """(N, 3) corners in the cyclopean frame of each facet that both cameras see whole."""
    part = world.parts[0]
    cyclopean_from_part = inverse(world_from_cyclopean) @ part.pose
    corners = apply(cyclopean_from_part, part.shape.hull.vertices)
    rings = []
    for face, normal in zip(part.shape.hull.faces, part.shape.hull.normals, strict=True):
        ring, seen = corners[list(face)], True
        for camera in (truth.left.lens(), truth.right.lens()):
            to_camera = camera.cyclopean_from_camera[:3, 3] - ring.mean(axis=0)
            facing = (cyclopean_from_part[:3, :3] @ normal) @ to_camera / np.linalg.norm(to_camera)
            pixels, size = camera.project(ring), np.array(truth.image_size)
            inside = np.all(pixels > MARGIN_PX) and np.all(pixels < size - MARGIN_PX)
            seen = seen and bool(facing > LEAST_FACING) and bool(inside)
        if seen:
            rings.append(ring)
    return rings


def true_rig(truth: Truth) -> StereoRig:
    cameras = [truth.left.lens(), truth.right.lens()]
    left, right = (Camera(camera.matrix, camera.distortion, camera.cyclopean_from_camera) for camera in cameras)
    return StereoRig(left, right, (truth.image_size[0], truth.image_size[1]))


class Stage:
    """One part at a time before simulated cameras that can be put anywhere."""

    def __init__(self, truth: Truth) -> None:
        self.world, self.pose = World(truth), np.eye(4)
        self._albedo = truth.lighting.facet_albedo
        self.cameras = SimulatedPair(truth, self._sight, np.random.default_rng(SEED))
        self.cameras.open()

    def _sight(self, _: float) -> SimulatedScene:
        things = [
            RenderedSolid(piece, part.pose, self._albedo) for part in self.world.parts for piece in part.shape.pieces
        ]
        return SimulatedScene(self.pose, tuple(things), self.world.changes)

    def look(self) -> tuple[StereoPair, float]:
        began = time.perf_counter()
        return self.cameras.grab(0.0, 2.0), time.perf_counter() - began


def main() -> None:
    truth = load_truth(ETC / "simcell.yaml")
    rigs = {"the daemon's": load_calibration(ETC / "calibration.yaml").rig, "the true one": true_rig(truth)}
    stage, rng = Stage(truth), np.random.default_rng(SEED)
    print(f"{LOOKS} looks a row at single parts on the table; corners in mm, median and 90th percentile")
    print("stand-off  calibration    found    median    90th  invented  ms to render a pair")
    for stand_off_mm in STAND_OFFS_MM:
        tallies, seconds = {name: Tally() for name in rigs}, []
        for k in range(LOOKS):
            stage.world.clear()
            stage.world.scatter([TAUGHT[k % len(TAUGHT)]], rng)
            at = np.array([*stage.world.parts[0].pose[:2, 3], truth.table.height_mm + 20.0])
            stage.pose = pose_above(stand_off_mm, at, rng)
            pair, spent_s = stage.look()
            seconds.append(spent_s)
            wanted = facets_in_sight(truth, stage.world, stage.pose)
            for name, rig in rigs.items():
                tallies[name].add(find_facets(pair.left.pixels, pair.right.pixels, rig), wanted)
        for name, tally in tallies.items():
            print(f"{stand_off_mm:6.0f} mm  {name:12s}  {tally.row()}  {1000 * np.median(seconds):9.0f}")


if __name__ == "__main__":
    main()
