"""`facetctl calibrate import` and `export`: exchange calibrations with other tools.

foreign.py reads their files, plausible.py checks the result.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import yaml

from daemon import frames
from daemon.arrays import Array
from daemon.calibration.file import Calibration, Quality, load_calibration, save_calibration
from daemon.calibration.foreign import ImportedGeometry, InterchangeError, read_foreign
from daemon.calibration.plausible import UNITS_MM, changed_parameters, implausible_rig
from daemon.calibration.recorded import calibration_before, keep_old
from daemon.quantities import decimal, shown, whole
from daemon.store.files import write_atomically
from daemon.vision.geometry import StereoRig

MM_PER_M = 1000.0


def to_ros(rig: StereoRig, left: Path, right: Path) -> None:
    """Write two camera_info files, rectified to the axes of the cyclopean frame."""
    focal = float(np.mean([camera.matrix[k, k] for camera in (rig.left, rig.right) for k in (0, 1)]))
    width, height = rig.image_size
    for path, name, camera, shift_m in (
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
            "camera_matrix": _plain(camera.matrix),
            "distortion_model": "plumb_bob",
            "distortion_coefficients": _plain(camera.distortion[None]),
            "rectification_matrix": _plain(camera.cyclopean_from_camera[:3, :3]),
            "projection_matrix": _plain(projection),
        }
        write_atomically(path, yaml.safe_dump(document, sort_keys=False, default_flow_style=None).encode())


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


def _plain(matrix: Array) -> dict[str, object]:
    return {"rows": matrix.shape[0], "cols": matrix.shape[1], "data": [float(v) for v in matrix.ravel()]}


def register(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add `import` and `export` to the calibrate command."""
    importer = subparsers.add_parser(
        "import", help="from files of ROS, OpenCV, Kalibr or easy_handeye, recognised by their content"
    )
    importer.add_argument("files", nargs="*", type=Path, metavar="FILE", help="of two files the left camera's first")
    importer.add_argument("--ros", nargs=2, type=Path, metavar=("LEFT", "RIGHT"), help="the same as FILE FILE")
    importer.add_argument("--opencv", nargs="+", type=Path, metavar="FILE", help="the same as FILE ...")
    importer.add_argument("--size", metavar="WxH", help="image size; overrides the files'")
    importer.add_argument(
        "--unit",
        metavar="UNIT",
        help="unit of the files' lengths: mm, cm, m, inch, or a number of mm (a square's side); "
        "default m for ROS, Kalibr and easy_handeye, mm for OpenCV",
    )
    importer.add_argument("--swap", action="store_true", help="the right camera is named first")
    importer.add_argument("--out", required=True, type=Path, help="calibration.yaml to write; an old one is kept")
    importer.set_defaults(run=_import)
    exporter = subparsers.add_parser("export", help="to ROS camera_info or OpenCV FileStorage")
    kind = exporter.add_mutually_exclusive_group(required=True)
    kind.add_argument("--ros", nargs=2, type=Path, metavar=("LEFT", "RIGHT"), help="camera_info YAML, one a camera")
    kind.add_argument("--opencv", type=Path, metavar="FILE", help="FileStorage with M1 D1 M2 D2 R T, mm")
    exporter.add_argument("--calibration", required=True, type=Path, help="calibration.yaml to read")
    exporter.set_defaults(run=_export)


def _import(args: argparse.Namespace) -> int:
    files = [*args.files, *(args.ros or ()), *(args.opencv or ())]
    if not files:
        raise InterchangeError("no file was named: facetctl calibrate import FILE... --out calibration.yaml")
    found = read_foreign(files, _size(args.size), _unit_mm(args.unit), args.swap)
    print(f"{', '.join(map(str, files))}: read as {found.kind}")
    before = calibration_before(args.out)
    if found.rig is None:
        calibration = _hand_eye_added(found, before, args.out)
    else:
        calibration = Calibration(found.rig, None, Quality(method="imported"))
        if before is not None and before.hand_eye is not None:
            print("the old file's hand-eye is of the old cameras and is dropped: run calibrate hand-eye next")
    for wrong in implausible_rig(calibration.rig):
        raise InterchangeError(f"{', '.join(map(str, files))}: not written: {wrong.problem}")
    for side, off_px in zip(("left", "right"), found.refit_px, strict=True):
        if off_px:
            print(f"{side} camera: lens converted to k1 k2 p1 p2 k3, off by {off_px:.3f} px at most, at the corners")
    if found.rig is not None and before is not None:
        for line in changed_parameters(found.rig, before.rig):
            print(f"warning: {line}")
    kept = keep_old(args.out)
    save_calibration(calibration, args.out)
    rig = calibration.rig
    size, focal = "x".join(map(str, rig.image_size)), [camera.matrix[0, 0] for camera in (rig.left, rig.right)]
    print(
        f"{args.out}: {size} px, focal lengths {focal[0]:.1f} and {focal[1]:.1f} px, "
        f"baseline {rig.baseline_mm:.2f} mm" + (f"; the old one is {kept.name}" if kept else "")
    )
    return 0


def _hand_eye_added(found: ImportedGeometry, before: Calibration | None, path: Path) -> Calibration:
    if before is None:
        raise InterchangeError(
            f"{path}: a hand-eye needs the calibration of its cameras: import or calibrate them into this file first"
        )
    assert found.left is not None
    pose = found.left @ frames.inverse(before.rig.left.cyclopean_from_camera)
    quality = Quality(method="imported")
    if found.fixed:
        print(
            "read as the pose of the left camera's optical frame in the WORLD frame (origin at the shoulder, z up); "
            "another base frame moves every part by as much. For it, facetd.yaml has cameras: {mounting: world}"
        )
        return replace(before, tool_from_cyclopean=None, world_from_cyclopean=pose, quality=quality)
    print("read as the pose of the left camera's optical frame in the TOOL frame (z forward, out of the gripper)")
    return replace(before, tool_from_cyclopean=pose, world_from_cyclopean=None, flange_from_tool=None, quality=quality)


def _export(args: argparse.Namespace) -> int:
    rig = load_calibration(args.calibration).rig
    if args.ros:
        to_ros(rig, *args.ros)
    else:
        to_opencv(rig, args.opencv)
    print("written: " + ", ".join(map(str, args.ros or [args.opencv])))
    return 0


def _size(text: str | None) -> tuple[int, int] | None:
    if text is None:
        return None
    width, _, height = text.partition("x")
    try:
        return whole(width), whole(height)
    except ValueError:
        raise InterchangeError(f"--size {shown(text)}: expected WIDTHxHEIGHT, such as 640x480") from None


def _unit_mm(text: str | None) -> float | None:
    if text is None:
        return None
    if text in UNITS_MM:
        return UNITS_MM[text]
    try:
        unit_mm = decimal(text)
    except ValueError:
        unit_mm = 0.0
    if not unit_mm > 0:
        raise InterchangeError(f"--unit {shown(text)}: expected {', '.join(UNITS_MM)}, or a number of mm")
    return unit_mm
