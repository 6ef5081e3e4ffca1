"""What the gripper's own sensor says, held against what the looks show. It is never believed against a look: where the
two differ, the arm stops, what is in the gripper is unknown from then on, and a person is asked.
"""

import asyncio

from daemon.arm import BeliefSource, NotSettledError
from daemon.errors import FacetdError
from daemon.events.codes import CauseCode
from daemon.pick.following import Target
from daemon.pick.looks import CapturedPair, capture_pair
from daemon.pick.world import PickContext

MORE_DWELLS = 2
"""So often a vacuum that is not there yet is waited for again, before the lift."""


class SensorDisagreesError(FacetdError):
    """The gripper's sensor and a look say different things."""

    code = CauseCode.SENSOR_DISAGREES


async def read_sensor(context: PickContext, when: str) -> bool | None:
    """Whether a part is in the gripper, by its sensor now; None: it has none, or nothing was sent."""
    if context.mover.dry:
        return None
    held = await context.part_held()
    if held is not None:
        context.cell.log.record("sensor", cycle=context.cycle, when=when, held=held)
    return held


async def wait_for_hold(context: PickContext) -> None:
    """Wait as long again, twice at most, where the sensor says that the gripper holds nothing yet."""
    for _ in range(MORE_DWELLS):
        if await read_sensor(context, "closed") is not False:
            return
        await asyncio.sleep(context.settings.hand_time_s(closed=True))


def contradiction(label: str, sensor: bool | None, shows: str, holds: bool) -> str | None:
    """What the sensor and a look say, where they differ. shows: what the look shows of the part; holds: whether that
    means that the gripper holds it."""
    if sensor is None or sensor is holds:
        return None
    says = "holds a part" if sensor else "holds nothing"
    return f"the gripper's sensor says that it {says}, and the look shows that {label} {shows}"


def stop_if_contradicted(context: PickContext, text: str | None) -> None:
    """Raise SensorDisagreesError where there is a contradiction: what the gripper holds is unknown from now on, and the
    gripper stays as it is."""
    if text is not None:
        context.mover.beliefs.learn(BeliefSource.OBSERVED, holding=None)
        raise SensorDisagreesError(f"{text}: look into the gripper, type `holding yes` or `holding no`, then `resume`")


async def gripper_pair(context: PickContext, target: Target | None) -> CapturedPair | None:
    """A pair of the gripper that may hold the target, from where the arm is at rest; None where the pictures do not
    come to rest (a conveyor below)."""
    cell, reading = context.cell, context.mover.belief.resting_reading
    if target is None or context.mover.dry:
        return None
    assert reading is not None
    try:
        return await capture_pair(cell, reading, cell.clock(), context.settings.settling)
    except NotSettledError:
        return None
