"""Import calibration files of other tools, recognised by their content: a stereo rig, or a hand-eye.

ROS camera_info (as camera_calibration or OpenCV write it, or as `ros topic echo` prints it), OpenCV's FileStorage,
Kalibr's camchain, easy_handeye's result. Rectification is dropped: facetd uses the geometry only.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from daemon import frames
from daemon.arrays import Array
from daemon.calibration.lens_refit import FISHEYE, LensError, refit_lens
from daemon.calibration.plausible import UNITS_MM
from daemon.calibration.stereo import rig_of
from daemon.errors import FacetdError
from daemon.store.outside import read_file
from daemon.store.yamlfile import LARGEST_BYTES, parse
from daemon.vision.geometry import StereoRig

ROS = {"camera_matrix": (3, 3), "rectification_matrix": (3, 3), "projection_matrix": (3, 4)}
MESSAGE = {"camera_matrix": "K", "rectification_matrix": "R", "projection_matrix": "P", "distortion_coefficients": "D"}
"""Keys of a camera_info file -> keys of the message; ROS 2 has these in small letters."""
FISHEYE_MODELS, PINHOLE_MODELS = ("equidistant", "fisheye"), ("plumb_bob", "rational_polynomial", "radtan", "none", "")
OPENCV = {
    "M1": (9, ("m1", "k1", "cm1", "mtx1", "cameramatrix1", "cameramatrixleft", "leftcameramatrix", "kl", "ml")),
    "D1": (None, ("d1", "dist1", "distcoeffs1", "distortion1", "distcoeffsleft", "leftdistcoeffs", "dl")),
    "M2": (9, ("m2", "k2", "cm2", "mtx2", "cameramatrix2", "cameramatrixright", "rightcameramatrix", "kr", "mr")),
    "D2": (None, ("d2", "dist2", "distcoeffs2", "distortion2", "distcoeffsright", "rightdistcoeffs", "dr")),
    "R": (9, ("r", "rot", "rotation", "rotationmatrix")),
    "T": (3, ("t", "trans", "translation", "translationvector")),
}
"""Matrices of a stereo pair's FileStorage: size, and the usual names in small letters."""
ONE_CAMERA = {"cameramatrix", "mtx", "k", "intrinsicmatrix"}
"""Usual names, in small letters, of the matrix in a file of one camera, as OpenCV's own calibration program writes."""
SIZES = ("imagesize", "imgsize", "size", "resolution")
SIDES = (("imagewidth", "imageheight"), ("width", "height"))
FORMATS = "ROS camera_info, OpenCV FileStorage of a stereo pair, Kalibr camchain, easy_handeye result"


_Files = Sequence[tuple[Path, Mapping[str, Any]]]


class InterchangeError(FacetdError):
    """A file of another tool that cannot be imported; the message names the file and what it lacks."""


@dataclass(frozen=True, eq=False)
class ImportedGeometry:
    """Geometry from files of another tool. kind: their format; rig, or the pose of the left camera (4, 4) mm, in the
    world where fixed, else in the tool; refit_px: largest error of each lens in our model."""

    kind: str
    rig: StereoRig | None = None
    left: Array | None = None
    fixed: bool = False
    refit_px: tuple[float, float] = (0.0, 0.0)


def read_foreign(
    files: Sequence[Path], size: tuple[int, int] | None = None, unit_mm: float | None = None, exchanged: bool = False
) -> ImportedGeometry:
    """Read one calibration from files of one format. size: width, height px, overrides the files'; unit_mm: unit of
    their lengths, None for the format's own; exchanged: the right camera is named first.

    Raises InterchangeError, FileError.
    """
    values = [(path, _values(path)) for path in files]
    kinds = [(path, _kind(one)) for path, one in values]
    for (path, kind), (_, one) in zip(kinds, values, strict=True):
        if kind is None:
            if ONE_CAMERA & {_plain(key) for key in one}:
                raise InterchangeError(f"{path}: {_of_one_camera(len(files))}")
            if {"version", "left", "image_size"} <= set(one):
                raise InterchangeError(f"{path}: facetd's own calibration.yaml: name it in files.calibration")
            keys = ", ".join(list(one)[:6]) or "nothing"
            raise InterchangeError(f"{path}: not one of {FORMATS}; it has {keys}")
    if len({kind for _, kind in kinds}) > 1:
        found = ", ".join(f"{path}: {kind}" for path, kind in kinds)
        raise InterchangeError(f"files of different formats: {found}")
    kind = kinds[0][1]
    read = {"camera_info": _camera_infos, "FileStorage": _storages, "camchain": _camchain, "easy_handeye": _hand_eye}
    try:
        with np.errstate(all="ignore"):
            return read[str(kind)](values, size, unit_mm, exchanged)
    except LensError as error:
        raise InterchangeError(f"{', '.join(map(str, files))}: {error}") from None


def _of_one_camera(files: int) -> str:
    """The message for OpenCV's file of one camera; files: how many files were named."""
    what = "OpenCV FileStorage of one camera (its matrix and distortion)"
    if files > 1:
        what += ", and no file says how the two cameras lie to each other (R and T of a stereo pair)"
    return (
        f"{what}: calibrate both with `facetctl calibrate stereo`, or one alone with `calibrate camera` at the console"
    )


def _values(path: Path) -> dict[str, Any]:
    """Keys and values of the file's first document (a printed topic has several)."""
    content = read_file(path, LARGEST_BYTES)
    if content.lstrip()[:1] == b"<":
        return _xml(path)
    lines = content.replace(b"!!opencv-matrix", b"").replace(b"\r\n", b"\n").split(b"\n")
    lines = [line for line in lines if not line.startswith(b"%YAML")]
    while lines and (not lines[0].strip() or lines[0].strip() == b"---"):
        del lines[0]
    first = next((k for k, line in enumerate(lines) if line.rstrip() in (b"---", b"...")), len(lines))
    data = parse(path, b"\n".join(lines[:first])).data
    if not isinstance(data, dict):
        raise InterchangeError(f"{path}: not one of {FORMATS}: no keys and values in it")
    return {str(key): value for key, value in data.items()}


def _xml(path: Path) -> dict[str, Any]:
    try:
        storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
        if not storage.isOpened():
            raise InterchangeError(f"{path}: cannot be read as an OpenCV FileStorage file")
        root = storage.root()
        found = {name: _node(root.getNode(name)) for name in root.keys()}  # noqa: SIM118 (a node, not a dict)
        storage.release()
    except (cv2.error, SystemError):
        raise InterchangeError(f"{path}: not an OpenCV FileStorage file") from None
    return found


def _node(node: cv2.FileNode) -> Any:
    if node.isMap():
        if (matrix := node.mat()) is None:
            return None
        return {"rows": matrix.shape[0], "cols": matrix.shape[-1], "data": matrix.ravel().tolist()}
    if node.isSeq():
        return [_node(node.at(k)) for k in range(node.size())]
    return node.string() if node.isString() else node.real()


def _kind(values: Mapping[str, Any]) -> str | None:
    plain = {_plain(key) for key in values}
    if "cam0" in values:
        return "camchain"
    if "transformation" in values or {"parameters", "transform"} <= set(values):
        return "easy_handeye"
    if {"camera_matrix", "projection_matrix"} <= set(values) or "distortion_model" in values:
        return "camera_info"
    if any(plain & set(names) for _, names in OPENCV.values()):
        return "FileStorage"
    return None


def _plain(key: str) -> str:
    return "".join(letter for letter in key.lower() if letter.isalnum())


def _numbers(path: Path, name: str, value: Any, shape: tuple[int, int] | None = None) -> Array:
    """A list, a list of lists, or an OpenCV matrix -> array of finite numbers, flat where it needs no shape. Raises
    InterchangeError."""
    expected = "" if shape is None else f"{shape[0]}x{shape[1]} numbers"
    described = ""
    if isinstance(value, dict):
        rows, columns, value = value.get("rows"), value.get("cols"), value.get("data")
        described = f"{rows}x{columns} of {len(value or ())} numbers"
        if shape not in (None, (rows, columns)):
            raise InterchangeError(f"{path}: {name}: expected {expected}, found {described}")
        sizes = [n for n in (rows, columns) if isinstance(n, int)]
        if isinstance(value, list) and len(sizes) == 2 and np.prod(sizes) != len(value):
            raise InterchangeError(f"{path}: {name}: found {described}")
    try:
        array = np.array(value, float)
    except (TypeError, ValueError):
        raise InterchangeError(f"{path}: {name}: expected numbers, found {str(value)[:40]!r}") from None
    if array.size == 0 or not np.isfinite(array).all():
        if array.size == 0 and shape is None:
            return np.zeros(0)
        raise InterchangeError(f"{path}: {name}: expected finite numbers")
    if shape is None:
        return array.ravel()
    if array.size != shape[0] * shape[1]:
        raise InterchangeError(f"{path}: {name}: expected {expected}, found {described or array.size}")
    return array.reshape(shape)


@dataclass(frozen=True, eq=False)
class _Info:
    matrix: Array
    coefficients: Array
    rectification: Array
    projection: Array
    model: str
    size: tuple[int, int]


def _camera_infos(
    values: _Files, size: tuple[int, int] | None, unit_mm: float | None, exchanged: bool
) -> ImportedGeometry:
    paths = [path for path, _ in values]
    if len(paths) != 2:
        raise InterchangeError(
            f"{paths[0]}: camera_info of one camera; name two files, the left camera's and the right's"
        )
    if exchanged:
        values, paths = values[::-1], paths[::-1]
    infos = [_info(path, one, size) for path, one in values]
    if infos[0].size != infos[1].size:
        raise InterchangeError(f"{paths[0]}, {paths[1]}: image sizes differ: {sorted(one.size for one in infos)}")
    shift = -infos[1].projection[0, 3] / infos[1].projection[0, 0]
    if infos[0].projection[0, 3] < 0 and not shift > 0:
        raise InterchangeError(
            f"{paths[0]}: projection_matrix: of a right camera (P[0,3] = {infos[0].projection[0, 3]:g}), named first: "
            "exchange the files (--swap)"
        )
    if not abs(shift) > 0:
        raise InterchangeError(
            f"{paths[1]}: projection_matrix: no baseline (P[0,3] = {infos[1].projection[0, 3]:g}): one camera twice?"
        )
    turns = [_rotation(path, "rectification_matrix", one.rectification) for path, one in zip(paths, infos, strict=True)]
    along = np.array([shift * (UNITS_MM["m"] if unit_mm is None else unit_mm), 0, 0])
    right_from_left = frames.rigid(turns[1].T @ turns[0], -turns[1].T @ along)
    cameras = [(one.matrix, one.coefficients, one.model in FISHEYE_MODELS) for one in infos]
    return _of_pair(f"ROS camera_info ({infos[0].model or 'no distortion'})", cameras, right_from_left, infos[0].size)


def _info(path: Path, values: Mapping[str, Any], size: tuple[int, int] | None) -> _Info:
    def value(name: str) -> Any:
        short = MESSAGE[name]
        for key in (name, short, short.lower()):
            if key in values:
                return values[key]
        raise InterchangeError(f"{path}: ROS camera_info that lacks {name} ({short} of the message)")

    found = {name: _numbers(path, name, value(name), shape) for name, shape in ROS.items()}
    model = str(values.get("distortion_model", ""))
    if model not in (*PINHOLE_MODELS, *FISHEYE_MODELS):
        expected = ", ".join(filter(None, (*PINHOLE_MODELS, *FISHEYE_MODELS)))
        raise InterchangeError(f"{path}: distortion_model: expected one of {expected}, found {model}")
    coefficients = _numbers(path, "distortion_coefficients", value("distortion_coefficients"))
    matrices = found["camera_matrix"], coefficients, found["rectification_matrix"], found["projection_matrix"]
    return _Info(*matrices, model, _size(path, values, size))


def _size(path: Path, values: Mapping[str, Any], size: tuple[int, int] | None) -> tuple[int, int]:
    if size is not None:
        return size
    plain = {_plain(key): value for key, value in values.items()}
    for name in SIZES:
        if name in plain:
            numbers = _numbers(path, name, plain[name])
            if len(numbers) >= 2:
                return int(numbers[0]), int(numbers[1])
    for width, height in SIDES:
        if width in plain and height in plain:
            numbers = _numbers(path, f"{width}, {height}", [plain[width], plain[height]])
            return int(numbers[0]), int(numbers[1])
    raise InterchangeError(f"{path}: lacks imageSize; give --size WIDTHxHEIGHT")


def _rotation(path: Path, name: str, matrix: Array) -> Array:
    wrong = frames.not_a_rotation(matrix, 1e-3)
    if wrong is not None:
        raise InterchangeError(f"{path}: {name}: expected a rotation, found {wrong}")
    return frames.nearest_rotation(matrix)


def _storages(values: _Files, size: tuple[int, int] | None, unit_mm: float | None, exchanged: bool) -> ImportedGeometry:
    by_key = {_plain(key): (path, value) for path, one in values for key, value in one.items()}
    found: dict[str, Array] = {}
    names = ", ".join(str(path) for path, _ in values)
    for name, (count, aliases) in OPENCV.items():
        key = next((key for key in aliases if key in by_key), None)
        if key is None:
            continue
        path, value = by_key[key]
        found[name] = _numbers(path, name, value)
        if count is not None and found[name].size != count:
            raise InterchangeError(f"{path}: {name}: expected {count} numbers, found {found[name].size}")
    missing = [name for name in OPENCV if name not in found]
    if missing:
        raise InterchangeError(f"{names}: OpenCV FileStorage that lacks {' '.join(missing)}")
    whole = {key: value for _, one in values for key, value in one.items()}
    first = values[0][0]
    right_from_left = frames.rigid(
        _rotation(first, "R", found["R"].reshape(3, 3)), found["T"] * (1.0 if unit_mm is None else unit_mm)
    )
    fisheye = _is_fisheye(names, by_key, (found["D1"], found["D2"]))
    cameras = [(found[f"M{k}"].reshape(3, 3), found[f"D{k}"], fisheye) for k in (1, 2)]
    return _of_pair("OpenCV FileStorage", cameras, right_from_left, _size(first, whole, size), exchanged)


def _is_fisheye(names: str, by_key: Mapping[str, tuple[Path, Any]], lenses: Sequence[Array]) -> bool:
    """Whether a FileStorage's coefficients are those of cv::fisheye: by the key that OpenCV's own program writes, as
    numbers do not tell. Raises InterchangeError."""
    if "fisheyemodel" in by_key:
        path, value = by_key["fisheyemodel"]
        return bool(_numbers(path, "fisheye_model", value).any())
    if any(len(one) == FISHEYE and one.any() for one in lenses):
        raise InterchangeError(
            f"{names}: four distortion coefficients are k1 k2 p1 p2, or those of cv::fisheye: add the line "
            "`fisheye_model: 0` to the file for the first, `fisheye_model: 1` for the second"
        )
    return False


def _camchain(values: _Files, size: tuple[int, int] | None, unit_mm: float | None, exchanged: bool) -> ImportedGeometry:
    path, chain = values[0]
    entries = [chain.get("cam0"), chain.get("cam1")]
    if not all(isinstance(entry, dict) for entry in entries):
        raise InterchangeError(f"{path}: Kalibr camchain of one camera: cam0 and cam1 are needed")
    cameras, sizes = [], []
    for name, entry in zip(("cam0", "cam1"), entries, strict=True):
        assert isinstance(entry, dict)
        model, bent = str(entry.get("camera_model", "pinhole")), str(entry.get("distortion_model", "none"))
        if model != "pinhole" or bent not in (*PINHOLE_MODELS, *FISHEYE_MODELS):
            raise InterchangeError(
                f"{path}: {name}: a {model} camera with {bent}: pinhole with radtan or equidistant only"
            )
        fx, fy, cx, cy = _numbers(path, f"{name}.intrinsics", entry.get("intrinsics"), (1, 4))[0]
        matrix = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])
        coefficients = _numbers(path, f"{name}.distortion_coeffs", entry.get("distortion_coeffs"))
        cameras.append((matrix, coefficients, bent in FISHEYE_MODELS))
        sizes.append(_size(path, entry, size))
    assert isinstance(entries[1], dict)
    pose = _numbers(path, "cam1.T_cn_cnm1", entries[1].get("T_cn_cnm1"), (4, 4))
    shift_mm = pose[:3, 3] * (UNITS_MM["m"] if unit_mm is None else unit_mm)
    right_from_left = frames.rigid(_rotation(path, "cam1.T_cn_cnm1", pose[:3, :3]), shift_mm)
    if sizes[0] != sizes[1]:
        raise InterchangeError(f"{path}: image sizes differ: {sizes}")
    return _of_pair("Kalibr camchain", cameras, right_from_left, sizes[0], exchanged)


def _of_pair(
    kind: str,
    cameras: Sequence[tuple[Array, Array, bool]],
    second_from_first: Array,
    size: tuple[int, int],
    exchanged: bool = False,
) -> ImportedGeometry:
    left_from_right = second_from_first if exchanged else frames.inverse(second_from_first)
    if exchanged:
        cameras = cameras[::-1]
    lenses = [refit_lens(matrix, coefficients, size, fisheye) for matrix, coefficients, fisheye in cameras]
    left, right = ((lens.matrix, lens.distortion) for lens in lenses)
    rig = rig_of(left, right, left_from_right, size)
    return ImportedGeometry(kind, rig, refit_px=(lenses[0].off_px, lenses[1].off_px))


def _hand_eye(values: _Files, size: tuple[int, int] | None, unit_mm: float | None, exchanged: bool) -> ImportedGeometry:
    path, found = values[0]
    settings = found.get("parameters")
    settings = settings if isinstance(settings, dict) else {}
    fixed = settings.get("eye_on_hand") is False or "base" in str(settings.get("calibration_type", ""))
    pose = found.get("transformation", found.get("transform"))
    pose = pose if isinstance(pose, dict) else {}
    nested = {f"q{key}": value for key, value in dict(pose.get("rotation") or {}).items()}
    flat = {**pose, **nested, **dict(pose.get("translation") or {})}
    try:
        w, x, y, z = (float(flat[key]) for key in ("qw", "qx", "qy", "qz"))
        shift = np.array([float(flat[key]) for key in "xyz"])
    except (KeyError, TypeError, ValueError):
        raise InterchangeError(f"{path}: easy_handeye result that lacks a quaternion or a translation") from None
    length = float(np.linalg.norm([w, x, y, z]))
    if not abs(length - 1) < 1e-3 or not np.isfinite(shift).all():
        raise InterchangeError(f"{path}: easy_handeye result: a quaternion of length {length:.3g}, expected 1")
    axis = np.array([x, y, z]) * np.sign(w or 1.0)
    sine = float(np.linalg.norm(axis))
    turn = axis / sine * 2 * np.arctan2(sine, abs(w)) if sine > 0 else np.zeros(3)
    shift_mm = shift * (UNITS_MM["m"] if unit_mm is None else unit_mm)
    pose_mm = frames.rigid(frames.rotation_from_vector(turn), shift_mm)
    return ImportedGeometry(f"easy_handeye result{' of fixed cameras' * fixed}", left=pose_mm, fixed=fixed)
