"""Calibrations of other tools: ROS camera_info YAML (a file an eye) and OpenCV's FileStorage (M1 D1 M2 D2 R T).

Those rectify; we do not, so that only what is geometry comes over: intrinsics, distortion, the pose between the eyes.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import cv2
import msgspec
import numpy as np
import yaml

from daemon import frames
from daemon.arrays import Array
from daemon.calibration.file import Calibration, Quality, load_calibration, save_calibration
from daemon.calibration.recorded import keep_old
from daemon.calibration.stereo import rig_of
from daemon.errors import FacetdError
from daemon.quantities import shown, whole
from daemon.store.files import write_atomically
from daemon.store.yamlfile import read
from daemon.vision.geometry import StereoRig

MM_PER_M = 1000.0


class InterchangeError(FacetdError):
    """A foreign file that cannot be used: which, and what it lacks."""


class _Matrix(msgspec.Struct, forbid_unknown_fields=True):
    rows: int
    cols: int
    data: list[float]


ROS = {"camera_matrix": (3, 3), "rectification_matrix": (3, 3), "projection_matrix": (3, 4)}
OPENCV = {"M1": 9, "M2": 9, "R": 9, "T": 3}
"""What their matrices must be: rows and columns; how many numbers."""


class _CameraInfo(msgspec.Struct):
    image_width: int
    image_height: int
    camera_matrix: _Matrix
    distortion_model: str
    distortion_coefficients: _Matrix
    rectification_matrix: _Matrix
    projection_matrix: _Matrix
    camera_name: str = ""


def from_ros(left: Path, right: Path) -> StereoRig:
    """Two camera_info files of one stereo pair (metres). Raises InterchangeError, FileError."""
    infos = [read(path).convert(_CameraInfo) for path in (left, right)]
    found: list[dict[str, Array]] = []
    for path, info in zip((left, right), infos, strict=True):
        found.append({name: _array(path, name, getattr(info, name)) for name in (*ROS, "distortion_coefficients")})
        if info.distortion_model != "plumb_bob":
            raise InterchangeError(f"{path}: distortion_model: expected plumb_bob, found {info.distortion_model}")
    sizes = {(info.image_width, info.image_height) for info in infos}
    if len(sizes) != 1:
        raise InterchangeError(f"{left}, {right}: image sizes differ: {sorted(sizes)}")
    projection = found[1]["projection_matrix"]
    shift_m = -projection[0, 3] / projection[0, 0]
    if not shift_m > 0:
        raise InterchangeError(
            f"{right}: projection_matrix: no baseline (P[0,3] = {projection[0, 3]:g}): one eye's file?"
        )
    turns = [one["rectification_matrix"] for one in found]
    left_from_right = frames.rigid(turns[0].T @ turns[1], turns[0].T @ np.array([shift_m * MM_PER_M, 0, 0]))
    eyes = [(one["camera_matrix"], _five(one["distortion_coefficients"])) for one in found]
    return rig_of(eyes[0], eyes[1], left_from_right, sizes.pop())


def _array(path: Path, name: str, matrix: _Matrix) -> Array:
    """(rows, columns). Raises InterchangeError where its name asks for others, or its numbers are not as many."""
    rows, columns = ROS.get(name, (1, matrix.cols))
    if (matrix.rows, matrix.cols) != (rows, columns) or len(matrix.data) != rows * columns:
        told = f"{matrix.rows}x{matrix.cols} of {len(matrix.data)} numbers"
        raise InterchangeError(f"{path}: {name}: expected {rows}x{columns} numbers, found {told}")
    return np.array(matrix.data, float).reshape(rows, columns)


def to_ros(rig: StereoRig, left: Path, right: Path) -> None:
    """Write two camera_info files. Both eyes are rectified onto the cyclopean frame's axes."""
    focal = float(np.mean([eye.matrix[k, k] for eye in (rig.left, rig.right) for k in (0, 1)]))
    width, height = rig.image_size
    for path, name, eye, shift_m in (
        (left, "left", rig.left, 0.0),
        (right, "right", rig.right, rig.baseline_mm / MM_PER_M),
    ):
        projection = np.array(
            [[focal, 0, (width - 1) / 2, -focal * shift_m], [0, focal, (height - 1) / 2, 0], [0, 0, 1, 0]]
        )
        document = {
            "image_width": width,
            "image_height": height,
            "camera_name": name,
            "camera_matrix": _plain(eye.matrix),
            "distortion_model": "plumb_bob",
            "distortion_coefficients": _plain(eye.distortion[None]),
            "rectification_matrix": _plain(eye.cyclopean_from_camera[:3, :3]),
            "projection_matrix": _plain(projection),
        }
        write_atomically(path, yaml.safe_dump(document, sort_keys=False, default_flow_style=None).encode())


def from_opencv(files: list[Path], size: tuple[int, int] | None) -> StereoRig:
    """FileStorage file(s) with M1 D1 M2 D2 R T (mm) and, where it is not given, imageSize. Raises InterchangeError."""
    found: dict[str, Array] = {}
    for path in files:
        found.update(_nodes(path))
    missing = [name for name in ("M1", "D1", "M2", "D2", "R", "T") if name not in found]
    if missing:
        raise InterchangeError(f"{', '.join(map(str, files))}: lacks {' '.join(missing)}")
    for name, count in OPENCV.items():
        if found[name].size != count:
            raise InterchangeError(f"{files[0]}: {name}: expected {count} numbers, found {found[name].size}")
    if size is None and "imageSize" not in found:
        raise InterchangeError(f"{files[0]}: lacks imageSize; give --size WIDTHxHEIGHT")
    width, height = size if size is not None else (int(v) for v in found["imageSize"].ravel()[:2])
    left_from_right = frames.inverse(frames.rigid(found["R"], found["T"].ravel()))
    eyes = [(found[f"M{k}"], _five(found[f"D{k}"])) for k in (1, 2)]
    return rig_of(eyes[0], eyes[1], left_from_right, (width, height))


def _nodes(path: Path) -> dict[str, Array]:
    """The matrices we know of in one FileStorage file."""
    found: dict[str, Array] = {}
    try:
        storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
        if not storage.isOpened():
            raise InterchangeError(f"{path}: cannot be read as an OpenCV FileStorage file")
        for name in ("M1", "D1", "M2", "D2", "R", "T", "imageSize"):
            node = storage.getNode(name)
            if node.isMap():
                found[name] = np.asarray(node.mat(), float)
        storage.release()
    except (cv2.error, SystemError):
        raise InterchangeError(f"{path}: not an OpenCV FileStorage file") from None
    return found


def to_opencv(rig: StereoRig, path: Path) -> None:
    """Write one FileStorage YAML file with M1 D1 M2 D2 R T (mm) and imageSize."""
    right_from_left = frames.inverse(rig.right.cyclopean_from_camera) @ rig.left.cyclopean_from_camera
    storage = cv2.FileStorage(".yml", cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY)
    values = {
        "imageSize": np.array([rig.image_size], float),
        "M1": rig.left.matrix,
        "D1": rig.left.distortion[None],
        "M2": rig.right.matrix,
        "D2": rig.right.distortion[None],
        "R": right_from_left[:3, :3].copy(),
        "T": right_from_left[:3, 3:].copy(),
    }
    for name, value in values.items():
        storage.write(name, value)
    write_atomically(path, storage.releaseAndGetString().encode())


def _five(distortion: Array) -> Array:
    """k1 k2 p1 p2 k3, zeros where fewer were given. Raises InterchangeError on the rational or thin-prism models."""
    values = distortion.ravel()
    if np.any(values[5:] != 0):
        raise InterchangeError(f"{len(values)} distortion coefficients: only k1 k2 p1 p2 k3 are supported")
    return np.concatenate([values[:5], np.zeros(max(0, 5 - len(values)))])


def _plain(matrix: Array) -> dict[str, object]:
    return {"rows": matrix.shape[0], "cols": matrix.shape[1], "data": [float(v) for v in matrix.ravel()]}


def register(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add `import` and `export` to the calibrate command."""
    come = subparsers.add_parser("import", help="from ROS camera_info or OpenCV FileStorage")
    go = subparsers.add_parser("export", help="to ROS camera_info or OpenCV FileStorage")
    for parser in (come, go):
        kind = parser.add_mutually_exclusive_group(required=True)
        kind.add_argument("--ros", nargs=2, type=Path, metavar=("LEFT", "RIGHT"), help="camera_info YAML, one an eye")
        kind.add_argument("--opencv", nargs="+", type=Path, metavar="FILE", help="FileStorage with M1 D1 M2 D2 R T, mm")
    come.add_argument("--size", metavar="WxH", help="image size where the file does not say")
    come.add_argument("--out", required=True, type=Path, help="calibration.yaml to write; an old one is kept")
    come.set_defaults(run=_import)
    go.add_argument("--calibration", required=True, type=Path, help="calibration.yaml to read")
    go.set_defaults(run=_export)


def _import(args: argparse.Namespace) -> int:
    rig = from_ros(*args.ros) if args.ros else from_opencv(args.opencv, _size(args.size))
    kept = keep_old(args.out)
    save_calibration(Calibration(rig, None, Quality(method="imported")), args.out)
    print(f"{args.out}: baseline {rig.baseline_mm:.2f} mm" + (f"; the old one is {kept.name}" if kept else ""))
    return 0


def _export(args: argparse.Namespace) -> int:
    rig = load_calibration(args.calibration).rig
    if args.ros:
        to_ros(rig, *args.ros)
    else:
        to_opencv(rig, args.opencv[0])
    print("written: " + ", ".join(map(str, args.ros or args.opencv[:1])))
    return 0


def _size(text: str | None) -> tuple[int, int] | None:
    if text is None:
        return None
    width, _, height = text.partition("x")
    try:
        return whole(width), whole(height)
    except ValueError:
        raise InterchangeError(f"--size {shown(text)}: expected WIDTHxHEIGHT, such as 640x480") from None
