"""The one place where a pick gets what it works with: the workcell, and settings that doubt as the calibration does."""

from __future__ import annotations

from dataclasses import replace
from math import degrees, sqrt
from statistics import median

import numpy as np

from daemon.arm import ARM, Limits, Recorder, Workcell, body_like
from daemon.calibration.file import Calibration, Quality
from daemon.calibration.session import EPIPOLAR_LIMIT_PX, SPREAD_LIMIT_MM
from daemon.calibration.tour import DISTANCES_MM
from daemon.cell.build import Hardware
from daemon.compute.calls import Compute
from daemon.config import Config
from daemon.pick.moved_pair import seen_by_one
from daemon.pick.pose_fusion import Doubt
from daemon.pick.settings import Settings
from drivers.puma560 import ArmGeometry

WORST_MM = SPREAD_LIMIT_MM / sqrt(3)
WORST_DEG = degrees(SPREAD_LIMIT_MM / sqrt(2) / median(DISTANCES_MM))
"""Standard deviations, an axis, of a hand-eye that verification just lets pass: the spread it allows all from being
beside its place, or all from being turned about the two axes across the view, at the tour's middle distance."""


def pick_cell(
    config: Config, calibration: Calibration, hardware: Hardware, log: Recorder, compute: Compute
) -> tuple[Workcell, Settings]:
    """What `PickCycle` takes. Without a hand-eye yet the cameras count as in the tool (no move is enabled then)."""
    tool_from_cyclopean = np.eye(4) if calibration.tool_from_cyclopean is None else calibration.tool_from_cyclopean
    rig, alone = calibration.rig, hardware.eyes.alone
    if alone is not None:
        rig, tool_from_cyclopean = seen_by_one(rig, tool_from_cyclopean, alone)
    workcell = Workcell(hardware.robot, hardware.eyes, log, hardware.clock, rig, tool_from_cyclopean, compute, alone)
    settings = config.values.pick
    limits, doubt = guarded(settings.limits, hardware.robot.arm), doubt_of(calibration.quality, settings.doubt)
    return workcell, replace(settings, limits=limits, doubt=doubt)


def guarded(limits: Limits, arm: ArmGeometry) -> Limits:
    """The limits; capsules that the file leaves as they are become those of the arm that stands there: the one that
    moves are computed for, whatever its file says by now."""
    return replace(limits, capsules=body_like(arm.a2_mm, arm.d3_mm, arm.d4_mm)) if limits.capsules == ARM else limits


def doubt_of(quality: Quality, doubt: Doubt) -> Doubt:
    """The doubt with what the calibration says of itself; where it says nothing, as the worst that passes."""
    return replace(
        doubt,
        pixels=EPIPOLAR_LIMIT_PX if quality.reprojection_px is None else quality.reprojection_px,
        hand_eye_mm=WORST_MM if quality.hand_eye_mm is None else quality.hand_eye_mm,
        hand_eye_deg=WORST_DEG if quality.hand_eye_deg is None else quality.hand_eye_deg,
    )
