"""Test which cameras work, by their pictures while nothing moves.

After a fault each camera is tested alone. A camera that was out of use is used again only where both together show one
scene in agreement with the calibration. The operator decides (daemon/commands/camera_selection.py).
"""

from collections.abc import Callable

import numpy as np

from daemon.arm import EYES, EyeName
from daemon.cell.build import EXPECTED_ERRORS
from daemon.cell.cameras import ThreadedCameras
from daemon.vision.geometry import StereoRig
from daemon.vision.health import MEASURES, Finding, examine, misleading, troubles

TRIAL_S = 2.0
"""Time limit of a picture in a test."""


async def camera_faults(cameras: ThreadedCameras, clock: Callable[[], float]) -> dict[EyeName, str]:
    """The fault of each camera that does not work alone; empty where both work. Leaves the cameras in use as before."""
    faults: dict[EyeName, str] = {}
    before = cameras.alone
    try:
        for name in EYES:
            wrong = await _fault(cameras, name, clock)
            if wrong is not None:
                faults[name] = wrong
    finally:
        await cameras.use(before)
    return faults


async def _fault(cameras: ThreadedCameras, name: EyeName, clock: Callable[[], float]) -> str | None:
    try:
        await cameras.use(name)
        first = await cameras.grab(clock(), TRIAL_S)
        now = await cameras.grab(first.left.taken_s, TRIAL_S)
    except EXPECTED_ERRORS as error:
        return " ".join(str(error).split())
    pictures = [(pair.left.pixels, pair.left.pixels) for pair in (now, first)]
    wrong = misleading(examine(pictures[0], pictures[1], sharp=False))
    return str(wrong[0]).partition(": ")[2] if wrong else None


async def pair_fault(cameras: ThreadedCameras, rig: StereoRig, clock: Callable[[], float]) -> str | None:
    """Why the two cameras cannot be used together; None where their pictures are sound and agree with the calibrated
    rig. Leaves both in use where it returns None, else the cameras as before."""
    before = cameras.alone
    try:
        await cameras.use(None)
        first = await cameras.grab(clock(), TRIAL_S)
        now = await cameras.grab(max(first.left.taken_s, first.right.taken_s), TRIAL_S)
        pictures = [(pair.left.pixels, pair.right.pixels) for pair in (now, first)]
        wrong = _of_both(examine(pictures[0], pictures[1], rig, sharp=False))
    except EXPECTED_ERRORS as error:
        wrong = " ".join(str(error).split())
    if wrong is not None:
        await cameras.use(before)
    return wrong


def _of_both(findings: tuple[Finding, ...]) -> str | None:
    bad = [line for line, f in zip(troubles(findings), (f for f in findings if not f.good), strict=True)
           if MEASURES[f.name].misleads or f.name == "torn"]  # fmt: skip
    if bad:
        return bad[0]
    if not any(f.name == "knocked" and np.isfinite(f.value) for f in findings):
        return "both cameras have no common object in view: put a part before them, and repeat the command"
    return None
