"""Which of the cameras can be trusted, asked of their own pictures while nothing moves.

After a fault each eye is tried alone; one that was away is trusted again only when both together show one scene as the
calibration says. What to do with the answer is an operator's to say (daemon/commands/camera_selection.py).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from daemon.arm import EYES, EyeName
from daemon.cell.build import EXPECTED_ERRORS
from daemon.cell.cameras import ThreadedEyes
from daemon.vision.geometry import StereoRig
from daemon.vision.health import MEASURES, Finding, examine, misleading, troubles

TRIAL_S = 2.0
"""How long a camera may take for a picture when it is tried."""


async def ailments(eyes: ThreadedEyes, clock: Callable[[], float]) -> dict[EyeName, str]:
    """What is wrong with each eye that does not see by itself; empty where both do. Whatever eyes were looked with
    before are looked with afterwards."""
    found: dict[EyeName, str] = {}
    before = eyes.alone
    try:
        for eye in EYES:
            wrong = await _ailment(eyes, eye, clock)
            if wrong is not None:
                found[eye] = wrong
    finally:
        await eyes.use(before)
    return found


async def _ailment(eyes: ThreadedEyes, eye: EyeName, clock: Callable[[], float]) -> str | None:
    try:
        await eyes.use(eye)
        first = await eyes.grab(clock(), TRIAL_S)
        now = await eyes.grab(first.left.taken_s, TRIAL_S)
    except EXPECTED_ERRORS as error:
        return " ".join(str(error).split())
    pictures = [(pair.left.pixels, pair.left.pixels) for pair in (now, first)]
    wrong = misleading(examine(pictures[0], pictures[1], sharp=False))
    return str(wrong[0]).partition(": ")[2] if wrong else None


async def distrust(eyes: ThreadedEyes, rig: StereoRig, clock: Callable[[], float]) -> str | None:
    """Why both eyes together cannot be trusted, None where they can: their pictures are sound, and show things that lie
    where the rig has both eyes see them. rig: both eyes', as calibrated. Leaves both looked with where it gives None,
    else what was."""
    before = eyes.alone
    try:
        await eyes.use(None)
        first = await eyes.grab(clock(), TRIAL_S)
        now = await eyes.grab(max(first.left.taken_s, first.right.taken_s), TRIAL_S)
        pictures = [(pair.left.pixels, pair.right.pixels) for pair in (now, first)]
        wrong = _of_both(examine(pictures[0], pictures[1], rig, sharp=False))
    except EXPECTED_ERRORS as error:
        wrong = " ".join(str(error).split())
    if wrong is not None:
        await eyes.use(before)
    return wrong


def _of_both(findings: tuple[Finding, ...]) -> str | None:
    bad = [line for line, f in zip(troubles(findings), (f for f in findings if not f.good), strict=True)
           if MEASURES[f.name].misleads or f.name == "torn"]  # fmt: skip
    if bad:
        return bad[0]
    if not any(f.name == "knocked" and np.isfinite(f.value) for f in findings):
        return "nothing is in view that both eyes show: lay a part before them, and say it again"
    return None
