"""Calibration by ruler and pin (D'Souza, section 4.2.1): baseline, a known width at several distances; his
compensation.

For a cell without a board. It prints how far off the measured depths come out, before and after
compensation, and the readings that `stereo_formula: thesis_compensated` takes.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta

from daemon import frames
from daemon.arrays import Array
from daemon.calibration.file import Calibration, Quality, now, save_calibration
from daemon.calibration.recorded import keep_old
from daemon.calibration.session import triangulate
from daemon.store.yamlfile import read
from daemon.vision.geometry import Camera, StereoRig
from daemon.vision.thesis import Converging, by_formula

Length = Annotated[float, Meta(gt=0)]
Pixel = tuple[float, float]


class Width(msgspec.Struct, forbid_unknown_fields=True):
    """A known width, square to the cyclopean axis: its length, its distance, its extent in the image."""

    mm: Length
    at_mm: Length
    px: Length


class Depth(msgspec.Struct, forbid_unknown_fields=True):
    """A point on the cyclopean axis at a known distance, in both images."""

    at_mm: Length
    left_px: Pixel
    right_px: Pixel


class QuickMeasurements(msgspec.Struct, forbid_unknown_fields=True):
    """The measurements: baseline D and fixation distance Z0 by ruler, the pin at the fixation point in both images."""

    image_size: tuple[int, int]
    baseline_mm: Length
    fixation_mm: Length
    pin_left_px: Pixel
    pin_right_px: Pixel
    widths: Annotated[list[Width], Meta(min_length=1)]
    depths: list[Depth] = []


@dataclass(frozen=True, eq=False)
class QuickResult:
    """The rig and how far off the measured depths are.

    focal_px and its standard deviation over the widths (nan for one). K depths: at_mm (K,) true; errors (K,) mm of
    formula (2.3), of the same compensated by all readings and by the others alone (what a new depth may expect), and of
    exact rays; readings_mm: (depth by the formula, its error), the setting `vision.depth_readings_mm`.
    """

    rig: StereoRig
    focal_px: float
    focal_sigma_px: float
    at_mm: Array
    formula_mm: Array
    compensated_mm: Array
    left_out_mm: Array
    rays_mm: Array

    @property
    def readings_mm(self) -> list[tuple[float, float]]:
        """The setting `vision.depth_readings_mm`, to 0.01 mm, nearest first."""
        return sorted(
            (round(float(at + off), 2), round(float(off), 2))
            for at, off in zip(self.at_mm, self.formula_mm, strict=True)
        )


def calibrate_quick(measured: QuickMeasurements) -> QuickResult:
    """The rig from ruler and pin: f = x Z / X (4.1), cameras turned in by atan(D / 2 Z0), no distortion."""
    focal = np.array([w.px * w.at_mm / w.mm for w in measured.widths])
    rig = _rig(measured, float(focal.mean()))
    left, right = (
        np.array([getattr(d, f"{side}_px") for d in measured.depths], float).reshape(-1, 2)
        for side in ("left", "right")
    )
    at = np.array([d.at_mm for d in measured.depths], float)
    bare = Converging(measured.baseline_mm, float(focal.mean()), measured.fixation_mm, np.zeros(1), np.zeros(1))
    sigma = float(focal.std(ddof=1)) if len(focal) > 1 else float("nan")
    if not len(at):
        return QuickResult(rig, float(focal.mean()), sigma, *[at] * 5)
    seen = by_formula(left, right, rig, bare)[:, 2]
    read = bare.with_readings(seen, seen - at)
    compensated = by_formula(left, right, rig, read, compensated=True)[:, 2]
    left_out = _left_out(seen, seen - at) if len(at) > 2 else seen
    rays = triangulate(rig, left, right)[:, 2]
    return QuickResult(rig, float(focal.mean()), sigma, at, seen - at, compensated - at, left_out - at, rays - at)


def _rig(measured: QuickMeasurements, focal: float) -> StereoRig:
    half = measured.baseline_mm / 2
    turn = float(np.arctan2(half, measured.fixation_mm))
    cameras = []
    for side, pin in ((-1.0, measured.pin_left_px), (1.0, measured.pin_right_px)):
        pose = frames.rigid(
            frames.rotation_from_vector(np.array([0.0, -side * turn, 0.0])), np.array([side * half, 0.0, 0.0])
        )
        matrix = np.array([[focal, 0, pin[0]], [0, focal, pin[1]], [0, 0, 1.0]])
        cameras.append(Camera(matrix, np.zeros(5), pose))
    return StereoRig(cameras[0], cameras[1], measured.image_size)


def _left_out(depths: Array, error: Array) -> Array:
    """Each depth less the error interpolated between the other readings (section 4.2.4): none corrects itself."""
    order = np.argsort(depths)
    mended = depths.copy()
    for k in range(len(depths)):
        others = order[order != k]
        mended[k] = depths[k] - np.interp(depths[k], depths[others], error[others])
    return mended


def register(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add `quick` to the calibrate command."""
    parser = subparsers.add_parser("quick", help="by ruler and pin, as the thesis did it")
    parser.add_argument("measured", type=Path, metavar="MEASURED.yaml", help="keys: " + _KEYS)
    parser.add_argument("--out", required=True, type=Path, help="calibration.yaml to write; an old one is kept")
    parser.add_argument("--json", action="store_true", help="one line for machines")
    parser.set_defaults(run=run)


_ENTRIES = {"widths": Width.__struct_fields__, "depths": Depth.__struct_fields__}
_KEYS = ", ".join(
    f"{key} (each {', '.join(_ENTRIES[key])})" if key in _ENTRIES else key
    for key in QuickMeasurements.__struct_fields__
)


def run(args: argparse.Namespace) -> int:
    """Raises FileError, OSError."""
    result = calibrate_quick(read(args.measured).convert(QuickMeasurements))
    kept = keep_old(args.out)
    save_calibration(Calibration(result.rig, None, Quality(method="quick", made=now())), args.out)
    if args.json:
        print(
            json.dumps(
                {
                    "focal_px": round(result.focal_px, 3),
                    "depths": len(result.at_mm),
                    **_figures(result),
                    "depth_readings_mm": result.readings_mm,
                }
            )
        )
        return 0
    doubt = f" +- {result.focal_sigma_px:.1f}" if np.isfinite(result.focal_sigma_px) else ""
    print(f"focal length {result.focal_px:.1f}{doubt} px over the widths")
    if len(result.at_mm):
        print("Error of the depth, mm:")
        print("  depth mm   formula (2.3)   compensated   by the others   exact rays")
        columns = result.formula_mm, result.compensated_mm, result.left_out_mm, result.rays_mm
        for at, *errors in zip(result.at_mm, *columns, strict=True):
            print(f"{at:10.0f}" + "".join(f"{e:14.2f}" for e in errors))
        share = [f"{100 * np.abs(off / result.at_mm).mean():.2f} %" for off in columns]
        print("      mean" + "".join(f"{s:>14}" for s in share))
        readings = ", ".join(f"[{at:.2f}, {off:.2f}]" for at, off in result.readings_mm)
        print("To compensate by these readings, put this into facetd.yaml:")
        print(f"  vision: {{stereo_formula: thesis_compensated, depth_readings_mm: [{readings}]}}")
    else:
        print("No depths were measured, so the accuracy is unverified: expect errors of some percent.")
    print(f"written: {args.out}" + ("" if kept is None else f" (the old one is {kept.name})"))
    print(
        "A ruler measures a baseline to some percent, and so does every depth: calibrate with a board before picking."
    )
    return 0


def _figures(result: QuickResult) -> dict[str, float | None]:
    def rms(errors: Array) -> float | None:
        return round(float(np.sqrt((errors**2).mean())), 3) if len(errors) else None

    return {
        "formula_rms_mm": rms(result.formula_mm),
        "compensated_rms_mm": rms(result.compensated_mm),
        "left_out_rms_mm": rms(result.left_out_mm),
        "rays_rms_mm": rms(result.rays_mm),
    }
