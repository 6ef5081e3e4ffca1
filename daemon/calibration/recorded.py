"""`facetctl calibrate stereo`: calibrate from recorded pictures; files in, calibration.yaml and a table or JSON out."""

from __future__ import annotations

import argparse
import json
from collections import Counter
from collections.abc import Sequence
from datetime import UTC, datetime
from glob import glob
from pathlib import Path

from daemon.calibration.board import USUAL_DICTIONARY, Board, BoardError, parse_board
from daemon.calibration.board_detection import find_board
from daemon.calibration.file import Calibration, calibration_of, load_calibration, save_calibration
from daemon.calibration.stereo import Pair, StereoResult, calibrate_stereo, match_corners
from daemon.quantities import decimal
from daemon.store.files import write_atomically
from daemon.store.outside import FileError, read_file
from daemon.store.pictures import read_grey
from daemon.store.yamlfile import LARGEST_BYTES


def register(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add `stereo` to the calibrate command."""
    parser = subparsers.add_parser("stereo", help="both cameras, from recorded pictures of a board")
    parser.add_argument(
        "--board", required=True, metavar="CxR", help="inner corners along a row and a column, e.g. 9x6"
    )
    parser.add_argument("--square-mm", required=True, type=decimal, help="side of one square")
    parser.add_argument("--charuco", action="store_true", help="a ChArUco board, which may be partly in view")
    parser.add_argument("--dictionary", metavar="NAME", help=f"dictionary of its markers (default {USUAL_DICTIONARY})")
    parser.add_argument("--legacy", action="store_true", help="layout of OpenCV before 4.6")
    parser.add_argument("--left", required=True, nargs="+", metavar="GLOB", help="pictures of the left camera")
    parser.add_argument(
        "--right", required=True, nargs="+", metavar="GLOB", help="the right camera's, in the same order"
    )
    parser.add_argument("--out", required=True, type=Path, help="calibration.yaml to write; an old one is kept")
    parser.add_argument("--json", action="store_true", help="one line for machines")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Calibrate from files. Raises BoardError, StereoError, OSError for unusable arguments, pictures or views."""
    board = _board(args)
    left, right = _expand(args.left, "--left"), _expand(args.right, "--right")
    if len(left) != len(right):
        raise BoardError(f"--left names {len(left)} pictures and --right {len(right)}: name the same number of each")
    pairs, unused, size = read_pairs(list(zip(left, right, strict=True)), board)
    result = calibrate_stereo(pairs, board, size)
    warning = _changed_baseline(calibration_before(args.out), result)
    kept = keep_old(args.out)
    save_calibration(calibration_of(result), args.out)
    _print(args, result, unused, kept, warning)
    return 0


def _board(args: argparse.Namespace) -> Board:
    legacy, dictionary = ["legacy"] * args.legacy, [args.dictionary] * (args.dictionary is not None)
    if not args.charuco and (legacy or dictionary):
        raise BoardError("--legacy and --dictionary belong to a ChArUco board: add --charuco")
    return parse_board(args.board, args.square_mm, ["charuco", *legacy, *dictionary] if args.charuco else ())


def _expand(patterns: Sequence[str], option: str) -> list[Path]:
    files = [Path(name) for pattern in patterns for name in sorted(glob(pattern))]
    if not files:
        raise BoardError(f"{option} {' '.join(patterns)}: no such picture")
    return files


def read_pairs(files: Sequence[tuple[Path, Path]], board: Board) -> tuple[list[Pair], dict[str, str], tuple[int, int]]:
    """Find the board in each pair of files: (usable pairs, reason by unusable pair, image size).

    The size is that of most pictures; a pair of another size (such as thumbnails) is unusable. Raises BoardError: a
    file cannot be read, or the board is in no pair.
    """
    pairs: list[Pair] = []
    unused: dict[str, str] = {}
    try:
        images = {path: read_grey(path) for pair in files for path in pair}
    except FileError as error:
        raise BoardError(str(error)) from None
    sizes = Counter((image.shape[1], image.shape[0]) for image in images.values())
    size = sizes.most_common(1)[0][0]
    unique = len({path.name for path in images}) == len(images)
    for left, right in files:
        name = f"{left.name}, {right.name}" if unique else f"{left}, {right}"
        try:
            for path in (left, right):
                height, width = images[path].shape
                if (width, height) != size:
                    raise BoardError(f"{path.name} is {width}x{height} px, most are {size[0]}x{size[1]}")
            pair = Pair(name, find_board(images[left], board), find_board(images[right], board))
            match_corners(pair, board)  # of too few corners in both images it is unusable
            pairs.append(pair)
        except BoardError as error:
            unused[name] = str(error)
    if not pairs:
        name, reason = next(iter(unused.items()))
        raise BoardError(f"the board is in no pair of {len(files)}; {name}: {reason}")
    return pairs, unused, size


def calibration_before(path: Path) -> Calibration | None:
    """The calibration that is in a file that will be written, or None."""
    try:
        return load_calibration(path)
    except (FileError, OSError):
        return None


def keep_old(path: Path) -> Path | None:
    """Copy an existing file to one with its time in the name. Returns the copy, or None where there was no file. Raises
    FileError, OSError."""
    if not path.exists():
        return None
    stamp = datetime.fromtimestamp(path.stat().st_mtime, UTC).strftime("%Y%m%dT%H%M%SZ")
    kept = path.with_name(f"{path.stem}-{stamp}{path.suffix}")
    write_atomically(kept, read_file(path, LARGEST_BYTES))
    return kept


def _changed_baseline(before: Calibration | None, result: StereoResult) -> str | None:
    """A warning where the baseline differs from the old file's, which a wrong square size causes."""
    if before is None:
        return None
    was, now = before.rig.baseline_mm, result.rig.baseline_mm
    if abs(now / was - 1) < 0.03:
        return None
    return (
        f"the baseline is {now:.1f} mm, {was:.1f} mm in the old file: a wrong --square-mm "
        f"(x {was / now:.3f} would agree), or other cameras"
    )


def _print(
    args: argparse.Namespace, result: StereoResult, unused: dict[str, str], kept: Path | None, warning: str | None
) -> None:
    if args.json:
        line = {
            "pairs": len(result.by_pair),
            "stereo_rms_px": round(result.stereo_rms_px, 4),
            "left_rms_px": round(result.left_rms_px, 4),
            "right_rms_px": round(result.right_rms_px, 4),
            "epipolar_px": round(result.epipolar_px, 4),
            "baseline_mm": round(result.rig.baseline_mm, 4),
            "coverage": round(result.coverage, 3),
            "sigmas": {k: float(f"{v:.4g}") for k, v in result.sigmas.items()},
            "by_pair": {k: round(v, 4) for k, v in result.by_pair.items()},
            "dropped": result.dropped,
            "unused": unused,
            "warning": warning,
            "kept": None if kept is None else str(kept),
            "out": str(args.out),
        }
        print(json.dumps(line))
        return
    rig, sigma = result.rig, result.sigmas
    for name, reason in {**unused, **result.dropped}.items():
        print(f"not used: {name}: {reason}")
    print(f"{len(result.by_pair)} pairs, corners in {100 * result.coverage:.0f} % of the image")
    print(f"residual: {result.stereo_rms_px:.3f} px rms, {result.epipolar_px:.3f} px mean to the epipolar line")
    for name, camera in (("left", rig.left), ("right", rig.right)):
        fx, cx, cy = camera.matrix[0, 0], camera.matrix[0, 2], camera.matrix[1, 2]
        print(
            f"{name:5}  f {fx:.2f} +- {sigma[f'{name}.fx']:.2f} px, centre {cx:.2f} {cy:.2f} "
            f"+- {sigma[f'{name}.cx']:.2f} px, k1 {camera.distortion[0]:+.4f} +- {sigma[f'{name}.k1']:.4f}"
        )
    print(f"baseline {rig.baseline_mm:.3f} +- {sigma['baseline_mm']:.3f} mm")
    if warning:
        print(f"warning: {warning}")
    print(f"written: {args.out}" + ("" if kept is None else f" (the old one is {kept.name})"))
    print("a residual is not an accuracy: calibrate hand-eye next, then measure with `facetctl calibrate verify`")
