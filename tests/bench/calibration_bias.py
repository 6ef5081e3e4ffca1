"""Whether a stereo calibration is as good as it says: boards painted through known cameras, corners with known noise.

Painted: each kind of board at several distances and blurs, told as errors in the standard deviations that are reported.
Made: many calibrations from noisy corners; how many of their 95 % intervals hold the truth.
"""

from __future__ import annotations

import argparse

import numpy as np

from daemon import frames
from daemon.calibration.board import Board, BoardError, SeenBoard
from daemon.calibration.board_detection import find_board
from daemon.calibration.stereo import Pair, StereoError, StereoResult, calibrate_stereo
from tests.fakes.boards import Painter, tilted
from tests.fakes.rigs import rig

TRUTH = rig(centres_px=((322.7, 241.0), (316.8, 237.4)), turn_rad=float(np.arctan2(30, 350)))
BOARDS = (
    Board(9, 6, 16.0),
    Board(9, 6, 16.0, "charuco"),
    Board(9, 6, 16.0, "charuco", 0.5),
    Board(8, 5, 16.0, "charuco", 0.6, legacy=True),
)
SEEN_AT = ((300.0, 0.5), (330.0, 1.0), (420.0, 0.7))
"""Distance mm and blur px."""
PAIRS = 14
INTERVAL = 1.96


def scores(found: StereoResult) -> dict[str, float]:
    """How far each number is from the truth, in the standard deviations that are reported for it."""
    off = {"baseline_mm": found.rig.baseline_mm - TRUTH.baseline_mm}
    for name, eye, true in (("left", found.rig.left, TRUTH.left), ("right", found.rig.right, TRUTH.right)):
        for key, place in (("fx", (0, 0)), ("fy", (1, 1)), ("cx", (0, 2)), ("cy", (1, 2))):
            off[f"{name}.{key}"] = float(eye.matrix[place] - true.matrix[place])
    return {name: value / found.sigmas[name] for name, value in off.items()}


def painted(board: Board, distance_mm: float, blur_px: float, seed: int) -> tuple[StereoResult, float] | str:
    """One calibration from painted pictures, and the rms error of its corners (px); or why there is none."""
    rng, pairs, errors = np.random.default_rng(seed), list[Pair](), []
    painters = [Painter(camera, board, blur_px=blur_px, rays=5) for camera in (TRUTH.left, TRUTH.right)]
    for k in range(PAIRS):
        pose = tilted(board, rng, distance_mm * rng.uniform(0.85, 1.2))
        try:
            seen = [find_board(painter.picture(pose, rng), board) for painter in painters]
        except BoardError:
            continue
        pairs.append(Pair(str(k), *seen))
        for one, painter in zip(seen, painters, strict=True):
            true_px = painter.camera.project(frames.apply(pose, board.points_mm()))[one.corner_ids]
            errors.append(one.corners_px - true_px)
    try:
        result = calibrate_stereo(pairs, board, TRUTH.image_size)
    except StereoError as error:
        return str(error)
    return result, float(np.sqrt((np.concatenate(errors) ** 2).mean()))


def made(seed: int, noise_px: float = 0.1) -> dict[str, float]:
    """One calibration from corners that are where they are but for noise."""
    rng, board, pairs = np.random.default_rng(seed), BOARDS[0], []
    for k in range(20):
        pose = tilted(board, rng, rng.uniform(250, 450))
        ids = np.arange(len(board.points_mm()))
        points = frames.apply(pose, board.points_mm())
        seen = [
            SeenBoard(ids, camera.project(points) + rng.normal(0, noise_px, (len(ids), 2)), 0.8)
            for camera in (TRUTH.left, TRUTH.right)
        ]
        pairs.append(Pair(str(k), *seen))
    return scores(calibrate_stereo(pairs, board, TRUTH.image_size))


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=200, help="calibrations from made corners")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    print(f"true focal length 700 px, baseline 60 mm; {PAIRS} pairs each; the worst number in its own sigmas")
    print(f"{'board':34} {'mm':>5} {'blur':>5} {'corners px':>11} {'f left':>8} {'baseline':>9} {'worst':>6}  of")
    for board in BOARDS:
        for distance_mm, blur_px in SEEN_AT:
            found = painted(board, distance_mm, blur_px, args.seed)
            head = f"{board!s:26} {board.marker_share:7.3g} {distance_mm:5.0f} {blur_px:5.1f}"
            if isinstance(found, str):
                print(f"{head}  {found}")
                continue
            result, off_px = found
            worst = max(scores(result).items(), key=lambda one: abs(one[1]))
            focal_px = result.rig.left.matrix[0, 0]
            print(
                f"{head} {off_px:11.4f} {focal_px:8.2f} {result.rig.baseline_mm:9.3f} {worst[1]:+6.1f}  {worst[0]}",
                flush=True,
            )
    held = [abs(z) <= INTERVAL for seed in range(args.cases) for z in made(args.seed + seed).values()]
    print(f"made: {args.cases} calibrations, {100 * np.mean(held):.1f} % of their 95 % intervals hold the truth")


if __name__ == "__main__":
    main()
