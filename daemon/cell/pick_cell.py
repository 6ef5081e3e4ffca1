"""The Workcell and settings of a pick, with standard deviations from the calibration's quality."""

from dataclasses import replace
from math import degrees, sqrt
from statistics import median

import numpy as np

from daemon.arm import (
    CAMERA_POINTS_MM,
    CAMERAS_ON_HAND,
    CameraMounting,
    InWorld,
    OnHand,
    Recorder,
    Workcell,
    cameras_box,
)
from daemon.calibration.file import Calibration, Quality
from daemon.calibration.session import EPIPOLAR_LIMIT_PX, SPREAD_LIMIT_MM
from daemon.calibration.tour import DISTANCES_MM
from daemon.cell.hardware import Hardware
from daemon.cell.sections import guarded
from daemon.compute.calls import Compute
from daemon.config import Config
from daemon.pick.moved_pair import rig_of_one_camera
from daemon.pick.place_table import PlaceTable
from daemon.pick.planning import fixture_boxes
from daemon.pick.pose_fusion import Doubt
from daemon.pick.settings import Settings
from daemon.store.place_status import PlaceStatuses

WORST_MM = SPREAD_LIMIT_MM / sqrt(3)
WORST_DEG = degrees(SPREAD_LIMIT_MM / sqrt(2) / median(DISTANCES_MM))
"""Standard deviations, per axis, of the worst hand-eye that passes verification: its spread limit due to translation
alone, or to rotation alone about the two axes across the view at the tour's median distance."""


def pick_cell(
    config: Config, calibration: Calibration, hardware: Hardware, log: Recorder, compute: Compute
) -> tuple[Workcell, Settings]:
    """The arguments of `PickCycle`. Without a hand-eye the cyclopean frame is the tool's (no move is enabled then)."""
    tool_from_cyclopean = np.eye(4) if calibration.tool_from_cyclopean is None else calibration.tool_from_cyclopean
    rig, alone = calibration.rig, hardware.cameras.alone
    if alone is not None:
        rig, tool_from_cyclopean = rig_of_one_camera(rig, tool_from_cyclopean, alone)
    settings = config.values.pick
    keep_out = settings.limits.keep_out + fixture_boxes(config.places.fixtures)
    limits = replace(guarded(config, hardware.robot.kinematics), keep_out=keep_out)
    settings = replace(settings, limits=limits, doubt=doubt_of(calibration.quality, settings.doubt))
    mounting: CameraMounting = OnHand(tool_from_cyclopean)
    if calibration.world_from_cyclopean is not None:
        settings = looking_once(settings, calibration)
        about = calibration.quality.about_mm
        pivot = calibration.world_from_cyclopean[:3, 3] if about is None else np.array(about)
        mounting = InWorld(calibration.world_from_cyclopean, settings.home.pose(), pivot)
    workcell = Workcell(hardware.robot, hardware.cameras, log, hardware.clock, rig, mounting, compute, alone)
    return workcell, settings


def looking_once(settings: Settings, calibration: Calibration) -> Settings:
    """The settings of a pick with fixed cameras: all looks at a part come from one place, so that one before the grasp
    is enough. The cameras are a keep-out box, and no part of the gripper; the arm's accuracy counts at the grasp."""
    assert calibration.world_from_cyclopean is not None
    limits, quality = settings.limits, calibration.quality
    stops = replace(settings.stops, stand_offs_mm=settings.stops.stand_offs_mm[-1:], least_looks=1, most_looks=1)
    hand = tuple(piece for piece in limits.capsules if piece not in CAMERAS_ON_HAND)
    points = tuple(point for point in limits.body_mm if point not in CAMERA_POINTS_MM)
    box = cameras_box(calibration.rig, calibration.world_from_cyclopean)
    return replace(
        settings,
        surveys=settings.surveys[:1],
        last_surveys=(),
        views_of_doubtful=0,
        stops=stops,
        limits=replace(limits, capsules=hand, body_mm=points, keep_out=(*limits.keep_out, box)),
        doubt=replace(
            settings.doubt,
            arm_mm=max(settings.doubt.arm_mm, WORST_MM if quality.arm_mm is None else quality.arm_mm),
            arm_deg=max(settings.doubt.arm_deg, WORST_DEG if quality.arm_deg is None else quality.arm_deg),
        ),
    )


def place_table(config: Config) -> PlaceTable:
    """Where parts belong, and what is known of each place."""
    return PlaceTable(config.places, PlaceStatuses(config.state))


def doubt_of(quality: Quality, doubt: Doubt) -> Doubt:
    """The standard deviations from the calibration's quality, whose hand-eye is over three axes; where that is missing,
    the worst that pass verification."""
    return replace(
        doubt,
        pixels=EPIPOLAR_LIMIT_PX if quality.reprojection_px is None else quality.reprojection_px,
        hand_eye_mm=WORST_MM if quality.hand_eye_mm is None else quality.hand_eye_mm / sqrt(3),
        hand_eye_deg=WORST_DEG if quality.hand_eye_deg is None else quality.hand_eye_deg / sqrt(3),
    )
