"""Whether each standard deviation that facetd reports holds the truth: every estimator over made cases.

usage: python -m tests.bench.sigmas [NAME ...] [--cases 200] [--first 0] [--step 2]

Cases are numbered; even ones (--first 0, the default) are for tuning, odd ones (--first 1) are held out. One row an
estimator: the numbers that it gave a standard deviation for, the share of their 95 % intervals that hold the truth
(93 to 97 is right), and the root mean square of the errors in these standard deviations (1 is right). `corners` and
`poses` come from rendered pictures and take some seconds a case, the others a fraction of one.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import cv2
import numpy as np

from daemon import frames
from daemon.arrays import Array
from daemon.calibration.arm_error import motion_by_parameters
from daemon.calibration.arm_from_readings import find_arm
from daemon.calibration.board import Board, DetectedBoard
from daemon.calibration.camera import calibrate_camera
from daemon.calibration.hand_eye import Sample, calibrate_hand_eye
from daemon.calibration.least_squares import chain, pose_of, project, solve, transform_of
from daemon.calibration.stereo import Pair, StereoResult, calibrate_stereo
from daemon.pick.pose_fusion import Doubt, Sighting, fuse, sighting
from daemon.vision.geometry import Polyhedron
from daemon.vision.geometry.rig import Camera, StereoRig
from daemon.vision.look import look
from daemon.vision.refine.edge_adjustment import OF_TOLERANCE
from daemon.vision.settings import TOLERANCE_MM
from daemon.vision.values import Part
from tests.bench.look_alikes import shown
from tests.bench.poses import NEAR_MM, onto
from tests.bench.simulated_looks import true_rig
from tests.fakes.boards import tilted
from tests.fakes.families import FAMILIES
from tests.fakes.many_parts import taught
from tests.fakes.photographed import Photograph, cell
from tests.fakes.rigs import rig

INTERVAL, CHI_SQUARE = 1.96, {3: 7.815, 6: 12.592}
TRUTH = rig(centres_px=((322.7, 241.0), (316.8, 237.4)), turn_rad=float(np.arctan2(30, 350)))
BOARD = Board(9, 6, 16.0)
HAND_EYE = frames.rigid(frames.rotation_from_vector(np.array([0.2, -0.1, 1.5])), np.array([-75.0, 3.0, -110.0]))
WORLD_FROM_BOARD = frames.rigid(frames.rotation_from_vector(np.array([3.1, 0.05, 0.1])), np.array([520.0, 0, -300.0]))
WORLD_FROM_CAMERAS = frames.rigid(
    frames.rotation_from_vector(np.array([2.2, 2.2, 0.0])), np.array([520.0, 60.0, 300.0])
)
TOOL_FROM_BOARD = frames.rigid(frames.rotation_from_vector(np.array([0.1, -0.05, 1.6])), np.array([-60.0, 70.0, 4.0]))
PAIRS, POSES, READINGS = 20, 24, 12
CUBE_MM = 30.0 * np.array(np.meshgrid([0, 1], [0, 1], [0, 1])).reshape(3, -1).T

Scores = list[tuple[float, int]]
"""Squared errors in standard deviations, each with its degrees of freedom."""


def held(scores: Scores) -> tuple[float, float]:
    """(share within 95 %, root mean square in standard deviations)."""
    within = [square <= CHI_SQUARE.get(freedom, INTERVAL**2) for square, freedom in scores]
    total = sum(square for square, _ in scores) / sum(freedom for _, freedom in scores)
    return float(np.mean(within)), float(np.sqrt(total))


def _axes(errors: Array, variances: Array) -> Scores:
    return [(float(square), 1) for square in errors**2 / variances]


def _seen(camera: Camera, pose: Array, noise_px: float, rng: np.random.Generator) -> DetectedBoard:
    """The board at cyclopean_from_board, its corners with noise."""
    px = camera.project(frames.apply(pose, BOARD.points_mm()))
    return DetectedBoard(np.arange(len(px)), px + rng.normal(0, noise_px, px.shape), 0.8)


def stereo(seed: int) -> Scores:
    """Both cameras from views of a board."""
    rng, pairs = np.random.default_rng([seed, 1]), []
    noise_px = rng.uniform(0.03, 0.2)
    for k in range(PAIRS):
        pose = tilted(BOARD, rng, rng.uniform(250, 450))
        pairs.append(Pair(str(k), *(_seen(camera, pose, noise_px, rng) for camera in (TRUTH.left, TRUTH.right))))
    return [(z**2, 1) for z in in_sigmas(calibrate_stereo(pairs, BOARD, TRUTH.image_size)).values()]


def in_sigmas(found: StereoResult) -> dict[str, float]:
    """How far each number of a calibration of TRUTH is off, in the standard deviations that are reported for it."""
    off = {"baseline_mm": found.rig.baseline_mm - TRUTH.baseline_mm}
    for name, camera, true in (("left", found.rig.left, TRUTH.left), ("right", found.rig.right, TRUTH.right)):
        for key, place in (("fx", (0, 0)), ("fy", (1, 1)), ("cx", (0, 2)), ("cy", (1, 2))):
            off[f"{name}.{key}"] = float(camera.matrix[place] - true.matrix[place])
    return {name: value / found.sigmas[name] for name, value in off.items()}


def one_camera(seed: int) -> Scores:
    """The focal length of a single camera from views of a board."""
    rng, seen = np.random.default_rng([seed, 2]), []
    noise_px = rng.uniform(0.03, 0.2)
    for k in range(PAIRS):
        seen.append((str(k), _seen(TRUTH.left, tilted(BOARD, rng, rng.uniform(250, 450)), noise_px, rng)))
    found = calibrate_camera(seen, BOARD, TRUTH.image_size)
    return [(float((found.camera.matrix[0, 0] - TRUTH.left.matrix[0, 0]) / found.focal_sigma_px) ** 2, 1)]


def _arm(rng: np.random.Generator) -> Array:
    """(6,) standard deviations of an arm's pose: mm, rad."""
    return np.repeat([rng.uniform(0.03, 0.3), np.radians(rng.uniform(0.01, 0.06))], 3)


def hand_eye(seed: int) -> Scores:
    """Cameras on the hand, of an arm that errs anew in each pose, and by as much in all poses alike."""
    rng, samples = np.random.default_rng([seed, 3]), []
    arm, noise_px = _arm(rng), rng.uniform(0.03, 0.15)
    common = frames.perturb(np.eye(4), rng.normal(0, arm))
    for _ in range(POSES):
        pose = tilted(BOARD, rng, rng.uniform(260, 400))
        true = WORLD_FROM_BOARD @ frames.inverse(pose) @ frames.inverse(HAND_EYE)
        reported = true @ frames.perturb(np.eye(4), rng.normal(0, arm)) @ common
        left, right = (_seen(camera, pose, noise_px, rng).corners_px for camera in (TRUTH.left, TRUTH.right))
        samples.append(Sample(reported, BOARD.points_mm(), left, right))
    found = calibrate_hand_eye(samples, TRUTH)
    return _axes(frames.difference(found.mounting, HAND_EYE), np.diag(found.covariance))


def fixed(seed: int) -> Scores:
    """Fixed cameras before which the arm holds the board; its world is off by as much as it errs in each pose."""
    rng, samples = np.random.default_rng([seed, 4]), []
    arm, noise_px = _arm(rng), rng.uniform(0.03, 0.15)
    off = rng.normal(0, arm)
    for _ in range(POSES):
        pose = tilted(BOARD, rng, rng.uniform(360, 440))
        true = WORLD_FROM_CAMERAS @ pose @ frames.inverse(TOOL_FROM_BOARD)
        left, right = (_seen(camera, pose, noise_px, rng).corners_px for camera in (TRUTH.left, TRUTH.right))
        reported = true @ frames.perturb(np.eye(4), rng.normal(0, arm))
        samples.append(Sample(reported, BOARD.points_mm(), left, right, board_in_gripper=True))
    found = calibrate_hand_eye(samples, TRUTH)
    assert found.about_mm is not None
    motion = frames.difference(found.mounting, WORLD_FROM_CAMERAS)
    motion[:3] += np.cross(motion[3:], found.about_mm - found.mounting[:3, 3])
    return _axes(motion + off, np.diag(found.covariance))


def arm_geometry(seed: int) -> Scores:
    """Lengths and base of an arm from WHEREs with their rounding."""
    from tests.unit.calibration.test_arm_from_readings import HIGH, LOW, Truth, geometry

    rng = np.random.default_rng([seed, 5])
    lengths = (rng.uniform(200, 700), rng.uniform(10, 60), rng.uniform(80, 250), rng.uniform(200, 700))
    shape = geometry(lengths, rng, tilted=bool(rng.integers(2)))
    truth = Truth(shape, rng.choice([-1.0, 1.0], 6), rng.uniform(-180, 180, 6))
    joints = rng.uniform(LOW, HIGH, (READINGS, 6))
    found = find_arm(truth.places(joints), truth.printed_deg(joints))
    errors = [abs(one) - true for one, true in zip(found.lengths_mm, lengths, strict=True)]
    errors += list(np.array(found.base_mm) - shape.world_from_base[:3, 3])
    names = ("a2", "a3", "d3", "d4", "base_x", "base_y", "base_z")
    return _axes(np.array(errors), np.array([found.sigma[name] for name in names]) ** 2)


def _laid(points: Array, views: Sequence[tuple[Camera, Array]], start: Array, noise_px: float) -> tuple[Array, Array]:
    """cyclopean_from_points (4, 4) of points seen in both images, and its covariance (6, 6)."""

    def problem(x: Array) -> tuple[Array, Array]:
        rows, slopes = [], []
        for camera, px in views:
            pose, by_pose, _ = chain(x, pose_of(frames.inverse(camera.cyclopean_from_camera)))
            m = camera.matrix
            there, slope, _ = project(points, pose, np.array([m[0, 0], m[1, 1], m[0, 2], m[1, 2], *camera.distortion]))
            rows.append((there - px).ravel() / noise_px)
            slopes.append(slope @ by_pose / noise_px)
        return np.concatenate(rows), np.vstack(slopes)

    found = solve(problem, pose_of(start), passes=20)
    slope = motion_by_parameters(found.parameters)
    freedom = len(found.residuals) - len(found.parameters)
    covariance = found.covariance / (np.sum(found.residuals**2) / freedom)
    return transform_of(found.parameters), slope @ covariance @ slope.T


def grasp(seed: int) -> Scores:
    """Where a part is thought to be as the gripper closes: a few looks, by cameras whose hand-eye and image centres
    are off and by an arm that errs at each pose, as pick.doubt has it."""
    rng, doubt, noise_px = np.random.default_rng([seed, 6]), Doubt(), 0.2
    arm = np.sqrt(np.diag(doubt.arm()))
    shared = rng.normal(0, np.sqrt(np.diag(doubt.shared())))
    believed = frames.perturb(np.eye(4), shared[:6]) @ HAND_EYE
    thought = _off_centre(TRUTH, shared[6:])
    world_from_part = frames.rigid(frames.rotation_from_vector(rng.normal(0, 1, 3)), np.array([520.0, 40.0, -250.0]))
    looks: list[Sighting] = []
    for distance_mm in (450.0, 300.0, 200.0)[: rng.integers(1, 4)]:
        turn = frames.rotation_from_vector(rng.uniform(-0.4, 0.4, 3)) @ world_from_part[:3, :3]
        pose = frames.rigid(turn, np.array([*rng.uniform(-20, 20, 2), distance_mm]))
        true = world_from_part @ frames.inverse(pose) @ frames.inverse(HAND_EYE)
        reported = true @ frames.perturb(np.eye(4), rng.normal(0, arm))
        px = [camera.project(frames.apply(pose, CUBE_MM)) for camera in (TRUTH.left, TRUTH.right)]
        noisy = [one + rng.normal(0, noise_px, one.shape) for one in px]
        views = list(zip((thought.left, thought.right), noisy, strict=True))
        found, covariance = _laid(CUBE_MM, views, pose, noise_px)
        focal_px = float(TRUTH.left.matrix[0, 0])
        looks.append(sighting(reported, believed, found, covariance, doubt, focal_px, TRUTH.baseline_mm))
    estimate = fuse(looks, doubt)
    errors = frames.difference(estimate.world_from_part, world_from_part) + rng.normal(0, arm)
    return _axes(errors, np.diag(estimate.covariance + doubt.arm()))


def _off_centre(true: StereoRig, off_px: Array) -> StereoRig:
    """The rig with its image centres off by u, v, and by a disparity, left less right."""
    shifts = [(off_px[0] + half * off_px[2], off_px[1]) for half in (0.5, -0.5)]
    cameras = []
    for camera, (u, v) in zip((true.left, true.right), shifts, strict=True):
        matrix = camera.matrix.copy()
        matrix[:2, 2] += u, v
        cameras.append(replace(camera, matrix=matrix))
    return StereoRig(cameras[0], cameras[1], true.image_size)


def corners(seed: int) -> Scores:
    """Corners in space of a part's facets, as a look reports them."""
    found = []
    for one in looked(seed):
        for facet in one.found.facets:
            for corner, covariance in zip(facet.corners_mm, facet.covariance_mm2, strict=True):
                gaps = one.corners_mm - corner
                off = gaps[np.linalg.norm(gaps, axis=1).argmin()]
                if np.linalg.norm(off) < NEAR_MM:
                    found.append((float(off @ np.linalg.solve(covariance, off)), 3))
    return found


def poses(seed: int) -> Scores:
    """The pose of a named part, as a look reports it."""
    offs = [(frames.difference(one.found.cyclopean_from_part, one.true), one.found.covariance) for one in looked(seed)]
    return [(float(off @ np.linalg.solve(covariance, off)), 6) for off, covariance in offs]


class Looked(NamedTuple):
    """A named part of a look: as it was found; the solid that was taught; true (4, 4) the pose that lays this onto the
    corners that are there (N, 3) mm, cyclopean; what both cameras saw."""

    found: Part
    solid: Polyhedron
    true: Array
    corners_mm: Array
    photo: Photograph


@lru_cache(maxsize=2)
def looked(seed: int, made_mm: float = OF_TOLERANCE * TOLERANCE_MM) -> list[Looked]:
    """The named parts of a rendered look. made_mm: standard deviation of each corner from its drawing, as looks take
    it to be: no part is made just as it was drawn."""
    cv2.setNumThreads(1)
    names = list(FAMILIES)
    pair, lies, photo = shown(names[seed // 2 % len(names)], seed)
    part = pair.parts[lies]
    model = taught((part,))
    metric, rng = model.metric[part.label], np.random.default_rng([seed, 7])
    off = rng.normal(0, made_mm, metric.solid.corners_mm.shape)
    solid = replace(metric.solid, corners_mm=metric.solid.corners_mm + off)
    model = replace(model, metric={part.label: replace(metric, solid=solid)})
    every = np.unique(np.vstack([piece.vertices for piece in part.shape.pieces]).round(3), axis=0)
    there = frames.apply(photo.cyclopean_from_part, every)
    named = [one for one in look(photo.left, photo.right, true_rig(cell()), model).parts if one.named]
    trues = [onto(there, one.cyclopean_from_part, solid) for one in named]
    pairs = zip(named, trues, strict=True)
    return [Looked(one, solid, true, there, photo) for one, true in pairs if true is not None]


ESTIMATORS: dict[str, tuple[str, Callable[[int], Scores]]] = {
    "stereo": ("both cameras: focal lengths, centres, baseline", stereo),
    "camera": ("one camera: focal length", one_camera),
    "hand-eye": ("hand-eye, cameras on the hand", hand_eye),
    "fixed": ("fixed cameras, about where the board was", fixed),
    "arm": ("an arm's lengths and base, from WHERE", arm_geometry),
    "grasp": ("a part at the grasp, from 1 to 3 looks", grasp),
    "corners": ("corners of facets in space, rendered", corners),
    "poses": ("poses of named parts, rendered", poses),
}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", choices=[*ESTIMATORS, []], metavar="NAME", help=", ".join(ESTIMATORS))
    parser.add_argument("--cases", type=int, default=200)
    parser.add_argument("--first", type=int, default=0, help="0: tuned on; 1: held out")
    parser.add_argument("--step", type=int, default=2)
    args = parser.parse_args()
    print(f"{'estimator':52} {'cases':>6} {'numbers':>8} {'in 95 %':>8} {'rms, sigmas':>12}")
    for name in args.names or ESTIMATORS:
        words, one = ESTIMATORS[name]
        scores = [score for k in range(args.cases) for score in one(args.first + args.step * k)]
        share, spread = held(scores)
        print(f"{words:52} {args.cases:6} {len(scores):8} {100 * share:8.1f} {spread:12.2f}", flush=True)


if __name__ == "__main__":
    main()
