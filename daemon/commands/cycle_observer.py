"""Work of the daemon after each look and each pick: drift detection, one camera instead of two, notices."""

import asyncio
import contextlib
from collections.abc import Callable, Coroutine
from datetime import datetime
from typing import Any

from daemon.arm import Fault, JobEvent
from daemon.calibration.drift import DriftWatch
from daemon.commands import camera_selection
from daemon.commands.moving import report_end
from daemon.commands.placing import report_moved
from daemon.console.context import CommandContext
from daemon.errors import FacetdError
from daemon.events.codes import CauseCode, FaultCause
from daemon.events.outcomes import GRASPED
from daemon.pick.looks import Look
from daemon.pick.outcome import CycleEnd


class CycleObserver:
    """See the module. start: starts a named coroutine in the background."""

    def __init__(self, context: CommandContext, start: Callable[[Coroutine[Any, Any, None], str], None]) -> None:
        self._context, self._start = context, start
        self._drift, self._calibration = DriftWatch(), context.calibration

    def looked(self, look: Look) -> None:
        """Feed the drift detection with a look; report a drift, and stop autonomous picking beyond its limit."""
        context = self._context
        camera = None if look.taken.moved is None else look.taken.moved.camera
        if camera != self._drift.alone or context.calibration is not self._calibration:
            self._drift, self._calibration = DriftWatch(alone=camera), context.calibration
        drift = self._drift.add(look.clue, datetime.now().strftime("%H:%M"))
        context.troubles.report("calibration", None if drift is None else drift.text)
        if drift is not None and drift.stops and context.cycle.auto_on:
            failing = context.cycle.supervisor.fail("calibration", drift.text, FaultCause(CauseCode.CAMERA_KNOCKED))
            self._start(failing, "calibration drift")

    def ended(self, end: CycleEnd) -> None:
        """Do what is due between two picks."""
        context = self._context
        self._note_truth(end)
        report_end(context, end)
        report_moved(context)
        context.roll_if_due()
        allowed = context.one_camera_allowed and context.config.values.pick.auto_degrade
        stopped = context.cycle.supervisor.permission.stopping  # a person's stop: the one for the fault is done by now
        if end.ended_by is JobEvent.ERROR and allowed and not stopped and context.cycle.pick_order is not None:
            self._start(self.continue_with_one_camera(), "one camera")

    def continue_with_one_camera(self) -> Coroutine[Any, Any, None]:
        """Continue an auto with one camera after this fault of the other, if an operator allowed it beforehand."""
        supervisor = self._context.cycle.supervisor
        return self._continue(supervisor.stops, supervisor.permission.fault)

    async def _continue(self, stops: int, fault: Fault | None) -> None:
        context, supervisor = self._context, self._context.cycle.supervisor
        while supervisor.busy:
            await asyncio.sleep(0.05)
        with contextlib.suppress(FacetdError):  # stopped meanwhile, or refused: the operator decides
            left = None if fault is None else await camera_selection.remaining_camera(context, fault.cause)
            if left is None or context.cycle.belief.holds_part is None or not supervisor.permission.enabled:
                return
            await context.look_with(*left)
            pick_order = context.cycle.pick_order
            if pick_order is None or supervisor.hold.paused:
                return
            supervisor.resume(stops)
            await context.begin_auto(pick_order)
            context.notices.tell(f"Auto continues with the {left[0]} camera alone (pick.auto_degrade): {left[1]}")

    def _note_truth(self, end: CycleEnd) -> None:
        """Record the true error of the grasp and of the set-down, which only a simulated cell knows."""
        context, hand = self._context, self._context.hardware.operator
        if hand is None or end.outcome not in GRASPED or end.grasp is None or end.corners is None:
            return
        if (truth := hand.grasp_error(end.grasp, end.corners)) is None:
            return
        error_mm, error_deg, held = truth
        placed = None
        if end.place is not None and (goal := context.cycle.placing.goals.get(end.place)) is not None:
            axis = None if goal.axis is None else goal.axis.direction
            placed = hand.place_error(goal.place.part, goal.poses, goal.shape.corners_mm, axis)
        place_mm, place_deg = placed or (None, None)
        fields = {"error_mm": error_mm, "error_deg": error_deg, "held": held}
        context.run_log.record("truth", cycle=end.cycle, **fields, place_mm=place_mm, place_deg=place_deg)
