"""A simulated cell with fingers and a suction cup, whose lip is farther out than the point where the fingers grasp."""

from __future__ import annotations

import shutil
from pathlib import Path

import yaml

from daemon.store import folders

ETC = folders.HOUSE / "etc"
LIP_MM = 160.0
LIP = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, LIP_MM], [0, 0, 0, 1]]
GRIPPERS = {
    "fingers": {},
    "cup": {
        "flange_from_tool": LIP,
        "gripper": {"kind": "suction", "cup_radius_mm": 8, "lip_mm": 4, "cup_length_mm": 60, "density_g_cm3": 1.2},
    },
}


def two_grippers(folder: Path) -> Path:
    """Write facetd.yaml of such a cell, with its files; returns its path. No gripper is selected yet."""
    for name in ("calibration.yaml", "facets.yaml", "parts.yaml"):
        shutil.copy(ETC / name, folder)
    truth = yaml.safe_load((ETC / "simcell.yaml").read_text())
    cup = yaml.safe_load((ETC / "suction" / "simcell.yaml").read_text())["suction"]
    truth |= {"suction": cup, "flange_from_lip": LIP, "mounted": "fingers"}
    (folder / "simcell.yaml").write_text(yaml.safe_dump(truth))
    limits = yaml.safe_load((ETC / "suction" / "facetd.yaml").read_text())["pick"]["limits"]
    values = {
        "version": 1,
        "cell": "simulated",
        "folders": {"state": "state", "runtime": "."},
        "simulated": {"truth": "simcell.yaml", "time_scale": 20.0, "seed": 7},
        "pick": {"limits": limits},
        "grippers": GRIPPERS,
    }
    path = folder / "facetd.yaml"
    path.write_text(yaml.safe_dump(values, sort_keys=False))
    return path
