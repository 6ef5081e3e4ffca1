"""Who holds the arm: one job at a time, stopped at any moment, held before a move. What the jobs are is cycle.py's.

The order is always the same: no new motion can leave (the fault is set), the arm is told to stop, the job is ended, and
only then is anything reported.
"""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from typing import Any, TypeVar

import numpy as np

from daemon.arm.guard import Command, Limits
from daemon.arm.mover import Arrival, Mover, MoveRefusedError, OutOfReachError
from daemon.arm.workcell import Workcell
from daemon.errors import FacetdError

T = TypeVar("T")
ABORT_S = 7.0
"""How long an answer to ABORT may take before the operator is sent to the emergency stop (the link gives up sooner)."""


class RefusedError(FacetdError):
    """Not done now; the message says why and what to do."""


class OperatorRefusedError(FacetdError):
    """In step mode the operator said no to a move."""


class Supervisor:
    """See the module. A subclass says what to do on `entered` (pause, resume, stop, abort, error)."""

    def __init__(self, cell: Workcell, limits: Limits, arrival: Arrival) -> None:
        self.cell = cell
        self.mover = Mover(cell, limits, arrival, self._gate)
        self._task: asyncio.Task[Any] | None = None
        self._doing = ""
        self._why = ""
        self._going = asyncio.Event()
        self._going.set()
        self._step = False
        self._pending: tuple[str, asyncio.Future[bool]] | None = None

    def entered(self, event: str) -> None:
        """Called when something happens to the job from outside."""
        raise NotImplementedError

    def reins(self) -> dict[str, object]:
        """How things stand, JSON values only."""
        return {
            "doing": self._doing or None,
            "fault": self.mover.fault,
            "enabled": self.mover.enabled,
            "paused": not self._going.is_set(),
            "step": self._step,
            "dry": self.mover.dry,
            "pending": None if self._pending is None else self._pending[0],
        }

    def enable(self) -> None:
        """Let the arm move."""
        self.mover.enabled = True

    async def disable(self) -> None:
        """Do not let the arm move; stop it where it does."""
        self.mover.enabled = False
        if self._task is not None:
            await self._halt("abort", "disabled", fault=None)

    async def stop(self, why: str = "by the operator") -> None:
        """Stop the arm, then report; the fault stands until resume."""
        await self._halt("stop", why, fault=f"stopped {why}")

    async def fail(self, code: str, text: str) -> None:
        """Stop the arm for a fault found elsewhere."""
        await self._halt("error", text, fault=f"{code}: {text}")

    async def abort(self) -> None:
        """Stop the arm and give up what it does."""
        await self._halt("abort", "aborted by the operator", fault=None)

    async def close(self) -> None:
        """Stop the arm and end the job."""
        if self._task is not None:
            await self._halt("abort", "the daemon ends", fault=None)

    def pause(self) -> None:
        """Hold before the next move."""
        self._going.clear()

    def resume(self) -> None:
        """Go on after pause; clear a fault (what was going on does not go on)."""
        if self.mover.fault is not None:
            if self._task is not None:
                raise RefusedError("the arm is still being stopped; say `resume` once more")
            self.mover.fault = None
            self.mover.at = None
            self.entered("resume")
        self._going.set()

    def step(self, on: bool) -> None:
        """One confirmed move at a time, or not."""
        self._step = on
        if not on and self._pending is not None:
            self.confirm()

    def confirm(self) -> None:
        """Yes to the pending move."""
        self._answer(True)

    def refuse(self) -> None:
        """No to the pending move: the job is given up."""
        self._answer(False)

    def dry(self, on: bool) -> None:
        """Everything but the bytes, or not."""
        if self._task is not None:
            raise RefusedError(f"busy: {self._doing}; dry is switched in between")
        self.mover.dry = on

    def may_move(self) -> None:
        """Raise RefusedError, with what to do, where nothing may move."""
        if self.mover.fault is not None:
            raise RefusedError(f"the fault `{self.mover.fault}` stands: say `resume`")
        if not self.mover.enabled:
            raise RefusedError("the arm is not enabled: say `enable`")

    async def alone(self, doing: str, work: Coroutine[Any, Any, T], moves: bool = True) -> T:
        """Run one job; it goes on when the one who asked goes away. moves: an error in it stops the arm."""
        if self._task is not None:
            work.close()
            raise RefusedError(f"busy: {self._doing}")
        task: asyncio.Task[T] = asyncio.create_task(self._watched(work, moves), name=f"cycle {doing}")
        self._doing, self._task = doing, task
        task.add_done_callback(self._done)
        try:
            return await asyncio.shield(task)
        except asyncio.CancelledError:
            if task.cancelled():
                raise RefusedError(f"{doing}: {self._why}") from None
            raise

    async def stop_arm(self, event: str, why: str, fault: str | None) -> None:
        """The arm first, then the report. fault: what stands from now on (None: nothing does)."""
        if fault is not None:
            self.mover.fault = fault
        self._why = why
        self.mover.at = None
        try:
            await asyncio.wait_for(self.cell.robot.abort(), ABORT_S)
        except Exception as error:
            fault = f"{fault or why}; and ABORT went unanswered ({type(error).__name__}: {error}): press emergency stop"
            self.mover.fault, event = fault, "error"
        if fault is not None:
            code = fault.partition(":")[0]
            self.cell.log.record("fault", cycle=self.mover.cycle, code=code, text=fault, **{"while": self._doing})
        self.entered(event)

    def _done(self, task: asyncio.Task[Any]) -> None:
        self._task, self._doing, self._pending = None, "", None
        if not task.cancelled():
            task.exception()  # whoever awaits the job hears of it; nobody has to

    async def _watched(self, work: Coroutine[Any, Any, T], moves: bool) -> T:
        try:
            return await work
        except (RefusedError, MoveRefusedError, OutOfReachError, OperatorRefusedError):
            raise
        except Exception as error:
            if moves and self.mover.fault is None:
                text = f"{type(error).__name__}: {error}"
                await self.stop_arm("error", text, text)
            raise

    async def _halt(self, event: str, why: str, fault: str | None) -> None:
        task = self._task
        if fault is not None:
            self.mover.fault = fault
        self._why = why
        if task is not None:
            task.cancel()
        await self.stop_arm(event, why, fault)
        if task is not None:
            await asyncio.wait({task})

    async def _gate(self, command: Command) -> None:
        """Before each move: wait out a pause, ask in step mode."""
        if not self._going.is_set():
            self.entered("pause")
            await self._going.wait()
            self.entered("resume")
        if self._step:
            x, y, z = np.round(command.world_from_tool[:3, 3], 1)
            how = "straight" if command.straight else "joints"
            text = f"{command.purpose}: {how} to {x:g} {y:g} {z:g} at {command.speed_pct:g} %"
            self._pending = (text, asyncio.get_running_loop().create_future())
            try:
                if not await self._pending[1]:
                    raise OperatorRefusedError(f"the operator refused: {text}")
            finally:
                self._pending = None

    def _answer(self, yes: bool) -> None:
        if self._pending is None or self._pending[1].done():
            raise RefusedError("no move waits for an answer")
        self._pending[1].set_result(yes)
