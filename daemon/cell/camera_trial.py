"""Test which cameras work, by their pictures while nothing moves.

After a fault each camera is tested alone. A camera that was out of use is used again only where both together show one
scene in agreement with the calibration. The operator decides (daemon/commands/camera_selection.py).
"""

from collections.abc import Callable, Collection

import numpy as np

from daemon.arm import CAMERA_NAMES, CameraName
from daemon.cell.cameras import StereoPair, ThreadedCameras
from daemon.cell.hardware import EXPECTED_ERRORS
from daemon.vision.geometry import StereoRig
from daemon.vision.health import (
    MAX_IMAGES,
    MEASURES,
    Finding,
    Steadiness,
    examine,
    measure_steadiness,
    misleading,
    overridden,
    troubles,
)

TRIAL_S = 2.0
"""Time limit of a picture in a test."""
STILL_IMAGES, AFTER_IMAGES = 8, 12
"""Pictures of a still scene before and after the exposure was shortened: automatic exposure needs some to act."""
SHORTENED = 0.7


async def camera_faults(cameras: ThreadedCameras, clock: Callable[[], float]) -> dict[CameraName, str]:
    """The fault of each camera that does not work alone; empty where both work. Leaves the cameras in use as before."""
    faults: dict[CameraName, str] = {}
    before = cameras.alone
    try:
        for name in CAMERA_NAMES:
            wrong = await _fault(cameras, name, clock)
            if wrong is not None:
                faults[name] = wrong
    finally:
        await cameras.use(before)
    return faults


async def _fault(cameras: ThreadedCameras, name: CameraName, clock: Callable[[], float]) -> str | None:
    try:
        await cameras.use(name)
        first, now = await _series(cameras, clock, 2)
    except EXPECTED_ERRORS as error:
        return " ".join(str(error).split())
    pictures = [(pair.left.pixels, pair.left.pixels) for pair in (now, first)]
    wrong = misleading(examine(pictures[0], pictures[1], sharp=False))
    return str(wrong[0]).partition(": ")[2] if wrong else None


async def unsteady(cameras: ThreadedCameras, clock: Callable[[], float]) -> dict[CameraName, list[str]]:
    """What each camera in use does not hold before a still scene: exposure, gain, focus; empty where it holds all.

    The exposure is shortened for some pictures and set back. Raises CameraError.
    """
    before = await _series(cameras, clock, STILL_IMAGES)
    accepted = await cameras.expose(SHORTENED, SHORTENED)
    after = before
    if accepted is not None:
        try:
            after = await _series(cameras, clock, AFTER_IMAGES)
        finally:
            await cameras.expose(1 / accepted[0], 1 / accepted[1])
    faults: dict[CameraName, list[str]] = {}
    for k, name in enumerate(CAMERA_NAMES):
        if cameras.alone not in (None, name):
            continue
        pixels = [[getattr(pair, name).pixels for pair in pairs] for pairs in (before, after)]
        lines = steadiness(before, name).faults()
        if accepted is not None and (wrong := overridden(pixels[0], pixels[1], accepted[k])) is not None:
            lines.append(wrong)
        if lines:
            faults[name] = lines
    return faults


async def shutters(cameras: ThreadedCameras, clock: Callable[[], float]) -> dict[CameraName, str]:
    """How each camera in use exposes its rows, for people, from pictures in which something moves to and fro; without
    those that show too little of that. Raises CameraError."""
    pairs = await _series(cameras, clock, MAX_IMAGES)
    found: dict[CameraName, str] = {}
    for name in CAMERA_NAMES:
        if cameras.alone in (None, name) and (shutter := steadiness(pairs, name).shutter) is not None:
            found[name] = shutter
    return found


def steadiness(pairs: Collection[StereoPair], name: CameraName) -> Steadiness:
    """What one camera holds, and how it exposes its rows, by successive pairs."""
    frames = [getattr(pair, name) for pair in pairs]
    return measure_steadiness([frame.pixels for frame in frames], [frame.taken_s for frame in frames])


async def _series(cameras: ThreadedCameras, clock: Callable[[], float], count: int) -> list[StereoPair]:
    pairs = [await cameras.grab(clock(), TRIAL_S)]
    while len(pairs) < count:
        pairs.append(await cameras.grab(max(pairs[-1].left.taken_s, pairs[-1].right.taken_s), TRIAL_S))
    return pairs


async def pair_fault(cameras: ThreadedCameras, rig: StereoRig, clock: Callable[[], float]) -> str | None:
    """Why the two cameras cannot be used together; None where their pictures are sound and agree with the calibrated
    rig. Leaves both in use where it returns None, else the cameras as before."""
    before = cameras.alone
    try:
        await cameras.use(None)
        first, now = await _series(cameras, clock, 2)
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
