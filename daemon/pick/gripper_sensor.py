"""The gripper's part sensor, checked against the looks. Where the two differ, neither is believed: the arm stops, the
content of the gripper is unknown from then on, and a person must report it.
"""

import asyncio

from daemon.arm import BeliefSource, NotSettledError
from daemon.errors import FacetdError
from daemon.events.codes import CauseCode
from daemon.pick.following import Target
from daemon.pick.looks import CapturedPair, capture_pair
from daemon.pick.world import PickContext

MORE_DWELLS = 2
"""Additional waits for the vacuum before the lift."""


class SensorDisagreesError(FacetdError):
    """The gripper's sensor and a look disagree."""

    code = CauseCode.SENSOR_DISAGREES


async def read_sensor(context: PickContext, when: str) -> bool | None:
    """Read the gripper's sensor: whether it holds a part; None without a sensor or in a dry run."""
    if context.mover.dry:
        return None
    held = await context.part_held()
    if held is not None:
        context.cell.log.record("sensor", cycle=context.cycle, when=when, held=held)
    return held


async def wait_for_hold(context: PickContext) -> None:
    """Wait again, at most MORE_DWELLS times, while the sensor reports no part."""
    for _ in range(MORE_DWELLS):
        if await read_sensor(context, "closed") is not False:
            return
        await asyncio.sleep(context.settings.hand_time_s(closed=True))


def contradiction(label: str, sensor: bool | None, shows: str, holds: bool) -> str | None:
    """The contradiction between sensor and look as text, or None. shows: the look's result as text; holds: whether by
    that result the gripper holds the part."""
    if sensor is None or sensor is holds:
        return None
    says = "holds a part" if sensor else "holds nothing"
    return f"the gripper's sensor says that it {says}, and the look shows that {label} {shows}"


def stop_if_contradicted(context: PickContext, text: str | None) -> None:
    """Raise SensorDisagreesError for a contradiction. The content of the gripper is unknown from then on; the gripper
    is not moved."""
    if text is not None:
        context.mover.beliefs.learn(BeliefSource.OBSERVED, holding=None)
        raise SensorDisagreesError(f"{text}: look into the gripper, type `holding yes` or `holding no`, then `resume`")


async def gripper_pair(context: PickContext, target: Target | None) -> CapturedPair | None:
    """Capture a pair that shows the gripper, at the arm's present position; None without a target, in a dry run, or
    where the images do not become still (a conveyor below)."""
    cell, reading = context.cell, context.mover.belief.resting_reading
    if target is None or context.mover.dry:
        return None
    assert reading is not None
    try:
        return await capture_pair(cell, reading, cell.clock(), context.settings.settling)
    except NotSettledError:
        return None
