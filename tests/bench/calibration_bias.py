"""Whether a stereo calibration has no bias: each kind of board painted through known cameras at several distances and
blurs, and the worst error in the standard deviations that are reported. sigmas.py asks many made cases of every
estimator.
"""

from __future__ import annotations

import argparse

import numpy as np

from daemon import frames
from daemon.calibration.board import Board, BoardError
from daemon.calibration.board_detection import find_board
from daemon.calibration.stereo import Pair, StereoError, StereoResult, calibrate_stereo
from tests.bench.sigmas import TRUTH, in_sigmas
from tests.fakes.boards import Painter, tilted

BOARDS = (
    Board(9, 6, 16.0),
    Board(9, 6, 16.0, "charuco"),
    Board(9, 6, 16.0, "charuco", 0.5),
    Board(8, 5, 16.0, "charuco", 0.6, legacy=True),
)
SEEN_AT = ((300.0, 0.5), (330.0, 1.0), (420.0, 0.7))
"""Distance mm and blur px."""
PAIRS = 14


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


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
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
            worst = max(in_sigmas(result).items(), key=lambda one: abs(one[1]))
            focal_px = result.rig.left.matrix[0, 0]
            print(
                f"{head} {off_px:11.4f} {focal_px:8.2f} {result.rig.baseline_mm:9.3f} {worst[1]:+6.1f}  {worst[0]}",
                flush=True,
            )


if __name__ == "__main__":
    main()
