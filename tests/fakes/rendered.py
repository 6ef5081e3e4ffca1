"""The rendered scenes and their ground truth: those in tests/data, and all of them in FACETD_SHARED.

A scene is a folder with left.png, right.png and truth.json; the calibration of its rig lies beside it.
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daemon.calibration.file import load_calibration
from daemon.store.pictures import read_grey
from daemon.vision.geometry.rig import StereoRig

HERE = Path(__file__).resolve().parents[1] / "data" / "scenes"
ALL = Path(os.environ.get("FACETD_SHARED", Path(__file__).resolve().parents[3] / "shared")) / "scenes"
"""May be missing: tests that need it skip."""
MORE = tuple(Path(folder) for folder in os.environ.get("FACETD_SCENES", "").split(os.pathsep) if folder)
"""More folders of scenes to measure on, each with the calibrations of its rigs beside the scenes."""


def pair(scene: Path) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Left and right picture, (H, W) grey."""
    return read_grey(scene / "left.png"), read_grey(scene / "right.png")


def truth(scene: Path) -> dict[str, Any]:
    """What was rendered: objects with their facets, and by which rig."""
    told: dict[str, Any] = json.loads((scene / "truth.json").read_text())
    return told


def rig(folder: Path, name: str) -> StereoRig:
    """One of the rigs, A0 or B, that the scenes of a folder were rendered with."""
    return load_calibration(folder / f"calibration-{name}.yaml").rig
