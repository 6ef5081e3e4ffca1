"""Read and write calibration.yaml: the stereo rig, its pose on the tool, the quality of both.

In: a path. Out: checked geometry, or a ConfigError that names file, line, key, found and expected.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path

import msgspec
import numpy as np
import yaml

from daemon import frames
from daemon.arm import CameraName
from daemon.arrays import Array
from daemon.calibration.stereo import StereoResult
from daemon.pick.moved_pair import USUAL_BASELINE_MM
from daemon.store.files import write_atomically
from daemon.store.yamlfile import ConfigError, Document, Key, parse, read
from daemon.vision.geometry import Camera, StereoRig

Rows = Sequence[Sequence[float]]


SIMULATED = "simulated"
"""Method of the calibration that is installed for the simulated cell."""


class Quality(msgspec.Struct, forbid_unknown_fields=True, frozen=True, omit_defaults=True):
    """Quality of a calibration when it was made: rms px, rms mm and degrees; when and how it was made.

    hand_eye_mm and hand_eye_deg are over three axes, of fixed cameras about about_mm (world); arm_mm and arm_deg, a
    standard deviation per axis, how far the arm was from where it reported to be: it goes from one calibrated place to
    another to grasp, and no camera comes with it.
    """

    reprojection_px: float | None = None
    epipolar_px: float | None = None
    hand_eye_mm: float | None = None
    hand_eye_deg: float | None = None
    about_mm: tuple[float, float, float] | None = None
    arm_mm: float | None = None
    arm_deg: float | None = None
    views: int | None = None
    method: str | None = None
    made: datetime | None = None


@dataclass(frozen=True, eq=False)
class Calibration:
    """rig: both cameras; tool_from_cyclopean: (4, 4) mm, of cameras on the hand; world_from_cyclopean: (4, 4) mm, of
    fixed cameras. Both are None before the hand-eye calibration, and one always.

    flange_from_tool: (4, 4) mm, of the tool that tool_from_cyclopean is from; None: the file does not say it.
    alone: the only camera in use; the rig's other camera is then the same one at the second place of a usual moved
    pair.
    """

    rig: StereoRig
    tool_from_cyclopean: Array | None = None
    quality: Quality = field(default_factory=Quality)
    alone: CameraName | None = None
    world_from_cyclopean: Array | None = None
    flange_from_tool: Array | None = None

    @property
    def fixed(self) -> bool:
        """Whether the cameras stand in the world, and not on the hand."""
        return self.world_from_cyclopean is not None

    @property
    def hand_eye(self) -> Array | None:
        """The pose of the cameras (4, 4) mm, on the tool or in the world; None before the hand-eye calibration."""
        return self.tool_from_cyclopean if self.world_from_cyclopean is None else self.world_from_cyclopean

    def world_from_cyclopean_at(self, world_from_tool: Array) -> Array:
        """(4, 4) mm of the cameras while the tool is there. The calibration must have a hand-eye."""
        if self.world_from_cyclopean is not None:
            return self.world_from_cyclopean
        assert self.tool_from_cyclopean is not None
        return np.asarray(world_from_tool @ self.tool_from_cyclopean)


def now() -> datetime:
    """The present time to the second, as a calibration's is written."""
    return datetime.now(UTC).replace(microsecond=0)


def calibration_of(result: StereoResult, before: Calibration | None = None) -> Calibration:
    """The Calibration of a stereo result. A hand-eye from before is a start value at best: the cyclopean frame has
    moved."""
    quality = Quality(
        reprojection_px=round(result.stereo_rms_px, 4),
        epipolar_px=round(result.epipolar_px, 4),
        views=len(result.by_pair),
        method="stereo",
        made=now(),
    )
    if before is None:
        return Calibration(result.rig, quality=quality)
    return replace(before, rig=result.rig, quality=quality, alone=None)


def same_geometry(a: Calibration, b: Calibration) -> bool:
    """Whether cameras and hand-eye are identical, to the last digit."""

    def numbers(calibration: Calibration) -> Array:
        rig, hand_eye = calibration.rig, calibration.hand_eye
        arrays = [a for c in (rig.left, rig.right) for a in (c.matrix, c.distortion, c.cyclopean_from_camera)]
        arrays += [] if hand_eye is None else [hand_eye]
        return np.concatenate([rig.image_size, [calibration.fixed], *map(np.ravel, arrays)])

    return np.array_equal(numbers(a), numbers(b))


class _CameraEntry(msgspec.Struct, forbid_unknown_fields=True):
    camera_matrix: list[list[float]]
    distortion: list[float]
    cyclopean_from_camera: list[list[float]]


class _HandEye(msgspec.Struct, forbid_unknown_fields=True, omit_defaults=True):
    tool_from_cyclopean: list[list[float]] | None = None
    world_from_cyclopean: list[list[float]] | None = None
    flange_from_tool: list[list[float]] | None = None


class _CalibrationFile(msgspec.Struct, forbid_unknown_fields=True, omit_defaults=True):
    version: int
    image_size: list[int]
    left: _CameraEntry
    right: _CameraEntry | None = None
    hand_eye: _HandEye | None = None
    quality: Quality = Quality()


def load_calibration(path: Path) -> Calibration:
    """Read and check calibration.yaml. Raises ConfigError."""
    return _checked(read(path))


def _checked(document: Document) -> Calibration:
    file = document.convert(_CalibrationFile)
    if file.version != 1:
        raise document.error(("version",), f"expected 1, found {file.version}")
    if len(file.image_size) != 2 or min(file.image_size) < 16:
        raise document.error(("image_size",), f"expected [width, height] px, found {file.image_size}")
    left, size = _camera(document, "left", file.left), (file.image_size[0], file.image_size[1])
    rig = (
        rig_of_one(left, size) if file.right is None else StereoRig(left, _camera(document, "right", file.right), size)
    )
    if rig.baseline_mm < 1.0:
        raise document.error(("right", "cyclopean_from_camera"), "the two cameras are less than 1 mm apart")
    if rig.left.cyclopean_from_camera[0, 3] > rig.right.cyclopean_from_camera[0, 3]:
        raise document.error(
            ("left", "cyclopean_from_camera"), "the left camera is to the right of the right one: exchange the two"
        )
    named = ("tool_from_cyclopean", IN_WORLD, "flange_from_tool")
    on_tool, in_world, tool = (_hand_eye(document, file.hand_eye, name) for name in named)
    if file.hand_eye is not None and (on_tool is None) == (in_world is None):
        problem = f"expected tool_from_cyclopean (cameras on the hand) or {IN_WORLD} (fixed cameras), one of them"
        raise document.error(("hand_eye",), problem)
    return Calibration(rig, on_tool, file.quality, "left" if file.right is None else None, in_world, tool)


IN_WORLD = "world_from_cyclopean"


def _hand_eye(document: Document, entry: _HandEye | None, name: str) -> Array | None:
    rows = None if entry is None else getattr(entry, name)
    return None if rows is None else rigid(document, ("hand_eye", name), rows)


def rig_of_one(camera: Camera, image_size: tuple[int, int]) -> StereoRig:
    """The rig of a usual moved pair of one camera, in the frame of its calibration."""
    second = camera.cyclopean_from_camera @ frames.rigid(np.eye(3), np.array([USUAL_BASELINE_MM, 0.0, 0.0]))
    return StereoRig(camera, replace(camera, cyclopean_from_camera=second), image_size)


def save_calibration(calibration: Calibration, path: Path) -> None:
    """Write calibration.yaml atomically. Raises ConfigError for one that could not be read again, which is not written;
    OSError."""
    content = calibration_text(calibration)
    try:
        _checked(parse(path, content))
    except ConfigError as error:
        raise ConfigError(f"not written: {error}") from None
    write_atomically(path, content)


def calibration_text(calibration: Calibration) -> bytes:
    """The content of calibration.yaml."""
    rig = calibration.rig
    file = _CalibrationFile(
        version=1,
        image_size=list(rig.image_size),
        left=_entry(rig.left),
        right=None if calibration.alone else _entry(rig.right),
        hand_eye=_entry_of_hand_eye(calibration),
        quality=calibration.quality,
    )
    plain = msgspec.to_builtins(file, builtin_types=(datetime,))
    text = yaml.safe_dump(plain, sort_keys=False, default_flow_style=None, width=110)
    return f"# Lengths in mm, images in px (OpenCV pixel centres). Written by facetctl.\n{text}".encode()


def _entry_of_hand_eye(calibration: Calibration) -> _HandEye | None:
    pose = calibration.hand_eye
    if pose is None:
        return None
    if calibration.fixed:
        return _HandEye(world_from_cyclopean=pose.tolist())
    tool = calibration.flange_from_tool
    return _HandEye(pose.tolist(), flange_from_tool=None if tool is None else tool.tolist())


def _camera(document: Document, name: str, entry: _CameraEntry) -> Camera:
    matrix = _matrix(document, (name, "camera_matrix"), entry.camera_matrix, 3, 3)
    if min(matrix[0, 0], matrix[1, 1]) <= 0 or not np.allclose(matrix[2], [0, 0, 1]):
        raise document.error((name, "camera_matrix"), "expected focal lengths above 0 and a last row [0, 0, 1]")
    if len(entry.distortion) != 5 or not np.isfinite(entry.distortion).all():
        raise document.error(
            (name, "distortion"),
            f"expected 5 numbers k1 k2 p1 p2 k3, found {len(entry.distortion)}: {entry.distortion}",
        )
    pose = rigid(document, (name, "cyclopean_from_camera"), entry.cyclopean_from_camera)
    return Camera(matrix, np.array(entry.distortion, float), pose)


def _matrix(document: Document, keys: tuple[Key, ...], rows: Rows, height: int, width: int) -> Array:
    widths = {len(row) for row in rows}
    if len(rows) != height or widths != {width}:
        found = f"{len(rows)}x{'/'.join(str(w) for w in sorted(widths))}"
        raise document.error(keys, f"expected {height}x{width} numbers, found {found}")
    matrix = np.array(rows, float)
    if not np.isfinite(matrix).all():
        raise document.error(keys, "expected finite numbers")
    return matrix


def rigid(document: Document, keys: tuple[Key, ...], rows: Rows) -> Array:
    """A 4x4 rigid transform, mm."""
    matrix = _matrix(document, keys, rows, 4, 4)
    wrong = frames.not_rigid(matrix)
    if wrong is not None:
        raise document.error(keys, wrong)
    return matrix


def _entry(camera: Camera) -> _CameraEntry:
    return _CameraEntry(camera.matrix.tolist(), camera.distortion.tolist(), camera.cyclopean_from_camera.tolist())
