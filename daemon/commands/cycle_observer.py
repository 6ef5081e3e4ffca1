"""What the daemon does of itself after each look and each pick: the drift watch, one eye instead of two, notices.

The observer of the cycle (pick/outcome.py). The arm is stopped and let go on by the supervisor, as for a person's word.
"""

import asyncio
import contextlib
from collections.abc import Callable, Coroutine
from datetime import datetime
from typing import Any

from daemon.arm import Interruption
from daemon.calibration.drift import DriftWatch
from daemon.commands import camera_selection
from daemon.commands.moving import tell_end
from daemon.commands.placing import report_moved
from daemon.console.context import CommandContext
from daemon.errors import FacetdError
from daemon.events.codes import CauseCode, FaultCause
from daemon.pick.looks import Look
from daemon.pick.outcome import CycleEnd


class CycleObserver:
    """See the module. beside: does something, of a name, while all else goes on."""

    def __init__(self, context: CommandContext, beside: Callable[[Coroutine[Any, Any, None], str], None]) -> None:
        self._context, self._beside = context, beside
        self._drift, self._calibration = DriftWatch(), context.calibration

    def looked(self, look: Look) -> None:
        """Each look says a little of the calibration; a drift is told, and past its limit picking by itself ends."""
        context = self._context
        eye = None if look.taken.moved is None else look.taken.moved.eye
        if eye != self._drift.alone or context.calibration is not self._calibration:
            self._drift, self._calibration = DriftWatch(alone=eye), context.calibration
        drift = self._drift.seen(look.clue, datetime.now().strftime("%H:%M"))
        context.troubles.report("calibration", None if drift is None else drift.text)
        if drift is not None and drift.stops and context.cycle.status()["auto"]:
            failing = context.cycle.supervisor.fail("calibration", drift.text, FaultCause(CauseCode.CAMERA_KNOCKED))
            self._beside(failing, "calibration drift")

    def ended(self, end: CycleEnd) -> None:
        """What is to be done between two picks."""
        context = self._context
        self._note_truth(end)
        tell_end(context, end)
        report_moved(context)
        context.roll_if_due()
        allowed = context.one_camera_allowed and context.config.values.pick.auto_degrade
        stopped = context.cycle.supervisor.stopping  # by somebody: what the fault asked for is done by now
        if end.ended_by is Interruption.ERROR and allowed and not stopped and context.cycle.pick_order is not None:
            self._beside(self.go_on_with_one_eye(), "one eye")

    def go_on_with_one_eye(self) -> Coroutine[Any, Any, None]:
        """After a camera's fault in an auto, which an operator allowed beforehand: what `resume` would ask. Of the
        fault that stands now, and of none that comes before this is begun."""
        supervisor = self._context.cycle.supervisor
        return self._gone_on(supervisor.stops, supervisor.fault)

    async def _gone_on(self, stops: int, fault: str | None) -> None:
        context, supervisor = self._context, self._context.cycle.supervisor
        while supervisor.busy:
            await asyncio.sleep(0.05)
        with contextlib.suppress(FacetdError):  # stopped meanwhile, or refused: it is left to the operator
            left = None if fault is None else await camera_selection.remaining(context, fault)
            if left is None or context.cycle.belief.holds_part is None or not supervisor.enabled:
                return
            await context.look_with(*left)
            pick_order = context.cycle.pick_order
            if pick_order is None or supervisor.hold.paused:
                return
            supervisor.resume(stops)
            await context.begin_auto(pick_order)
            context.notices.tell(f"Auto continues with the {left[0]} camera alone (pick.auto_degrade): {left[1]}")

    def _note_truth(self, end: CycleEnd) -> None:
        """A simulated cell knows how well each grasp met the part, and how far from its place the part lies, and the
        log keeps it beside what was predicted and seen."""
        context, hand = self._context, self._context.hardware.operator
        if (
            hand is None
            or end.outcome not in ("picked", "released", "missed", "off")
            or end.grasp is None
            or end.corners is None
        ):
            return
        truth = hand.grasp_error(end.grasp, end.corners)
        if truth is None:
            return
        error_mm, error_deg, held = truth
        placed = None
        if end.place is not None and (goal := context.cycle.placing.goals.get(end.place)) is not None:
            placed = hand.place_error(goal.place.part, goal.poses, goal.shape.corners_mm)
        place_mm, place_deg = placed or (None, None)
        context.run_log.record(
            "truth",
            cycle=end.cycle,
            error_mm=error_mm,
            error_deg=error_deg,
            held=held,
            place_mm=place_mm,
            place_deg=place_deg,
        )
