"""Who has the arm: one job at a time, stopped at any moment, held before a move. What the jobs are, others say.

The order is always the same: no new motion can leave (the fault is set), the arm is told to stop, the job is ended, and
only then is anything reported.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Coroutine
from enum import StrEnum
from typing import Any, TypeVar

import numpy as np

from daemon.arm.guard import Command, Limits
from daemon.arm.mover import Arrival, Mover, NotSentError
from daemon.arm.workcell import Workcell

T = TypeVar("T")
ABORT_S = 7.0
"""How long an answer to ABORT may take before the operator is sent to the emergency stop (the link gives up sooner)."""


class Interruption(StrEnum):
    """What comes over a job from outside."""

    PAUSE = "pause"
    RESUME = "resume"
    STOP = "stop"
    ABORT = "abort"
    ERROR = "error"


class RefusedError(NotSentError):
    """Not done now; the message says why and what to do."""


class OperatorRefusedError(NotSentError):
    """In step mode the operator said no to a move."""


class Supervisor:
    """See the module. interrupted: told of what comes over the job, after the arm was; all calls from one event loop.

    stop, fail, abort, disable and pause are heard at any moment; jobs (`run`) are taken one at a time.
    """

    def __init__(
        self, cell: Workcell, limits: Limits, arrival: Arrival, interrupted: Callable[[Interruption], None]
    ) -> None:
        self.mover = Mover(cell, limits, arrival, self._gate)
        self._interrupted = interrupted
        self._task: asyncio.Task[Any] | None = None
        self._doing = self._why = ""
        self._stopping = 0
        self.stops = 0
        """How often the arm was told to stop: who was asked about a fault compares."""
        self._going = asyncio.Event()
        self._going.set()
        self._step = False
        self._pending: tuple[str, asyncio.Future[bool]] | None = None

    @property
    def busy(self) -> bool:
        """Whether a job has the arm."""
        return self._task is not None

    def status(self) -> dict[str, object]:
        """How things stand, JSON values only. pending: the move, in words, that waits for confirm or refuse."""
        return {
            "doing": self._doing or None,
            "fault": self.mover.fault,
            "enabled": self.mover.enabled,
            "paused": not self._going.is_set(),
            "step": self._step,
            "dry": self.mover.dry,
            "pending": None if self._pending is None else self._pending[0],
        }

    # What may be.

    def enable(self) -> None:
        """Let the arm move. Raises RefusedError while it is being stopped (or disabled)."""
        self._not_while_stopping("enable")
        self.mover.enabled = True

    async def disable(self) -> None:
        """Do not let the arm move; stop it where it does."""
        self.mover.enabled = False
        if self._task is not None:
            await self._halt(Interruption.ABORT, "disabled", fault=None)

    def pause(self) -> None:
        """Hold before the next move."""
        self._going.clear()

    def resume(self, stops: int | None = None) -> None:
        """Go on after pause; clear a fault (what was going on does not go on). stops: as many as there had been when
        it was decided; a later one stands. Raises RefusedError."""
        if self.mover.fault is not None:
            self._not_while_stopping("resume", busy=self._task is not None)
            if stops is not None and stops != self.stops:
                raise RefusedError(f"meanwhile it was stopped again: {self.mover.fault}; say `resume` once more")
            self.mover.fault = None
            self.mover.forget()
            self._interrupted(Interruption.RESUME)
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
        self._between_jobs("dry is switched")
        self.mover.dry = on

    def refit(self, cell: Workcell, limits: Limits, arrival: Arrival) -> None:
        """Go on with another calibration or other limits; only while nothing is being done."""
        self._between_jobs("settings are changed")
        self.mover.cell, self.mover.limits, self.mover.arrival = cell, limits, arrival

    def may_move(self) -> None:
        """Raise RefusedError, with what to do, where nothing may move."""
        if self.mover.fault is not None:
            raise RefusedError(f"the fault `{self.mover.fault}` stands: say `resume`")
        if not self.mover.enabled:
            raise RefusedError("the arm is not enabled: say `enable`")

    # Jobs, and their end.

    async def run(self, doing: str, work: Coroutine[Any, Any, T], moves: bool = True) -> T:
        """Run one job; it goes on when the one who asked goes away. moves: an error in it stops the arm."""
        if self._task is not None:
            work.close()
            raise RefusedError(f"busy: {self._doing}")
        task: asyncio.Task[T] = asyncio.create_task(self._watched(work, moves), name=f"arm: {doing}")
        self._doing, self._task = doing, task
        task.add_done_callback(self._done)
        task.add_done_callback(lambda _: work.close())  # one that was ended before it began was never awaited
        try:
            return await asyncio.shield(task)
        except asyncio.CancelledError:
            if task.cancelled():
                raise RefusedError(f"{doing}: {self._why}") from None
            raise

    async def by_hand(self, doing: str, work: Callable[[], Awaitable[T]]) -> T:
        """Run as a job what an operator tells the controller himself, where it may set arm or hand in motion.

        The guard does not see where that goes; enable, fault, pause, step and every stop hold as for any move.
        """

        async def held() -> T:
            await self._hold(doing)
            self.may_move()
            return await work()

        self.may_move()
        if self.mover.dry:
            raise RefusedError(f"{doing}: not sent while `dry` is on")
        return await self.converse(doing, held, moves=True)

    async def converse(self, doing: str, work: Callable[[], Awaitable[T]], moves: bool) -> T:
        """Run as a job what others than us say to the controller; afterwards nothing is known of arm and hand."""

        async def conversation() -> T:
            try:
                return await work()
            finally:
                self.mover.forget()

        return await self.run(doing, conversation(), moves)

    async def stop(self, why: str = "by the operator") -> None:
        """Stop the arm, then report; the fault stands until resume."""
        await self._halt(Interruption.STOP, why, fault=f"stopped {why}")

    async def fail(self, code: str, text: str) -> None:
        """Stop the arm for a fault found elsewhere."""
        await self._halt(Interruption.ERROR, text, fault=f"{code}: {text}")

    async def abort(self) -> None:
        """Stop the arm and give up what it does."""
        await self._halt(Interruption.ABORT, "aborted by the operator", fault=None)

    async def close(self) -> None:
        """Stop the arm and end the job."""
        if self._task is not None:
            await self._halt(Interruption.ABORT, "the daemon ends", fault=None)

    def latch(self, fault: str) -> None:
        """A fault stands from now on; nothing is told to the arm."""
        self.mover.fault = fault

    async def stop_arm(self, event: Interruption, why: str, fault: str | None) -> None:
        """The arm first, then the report. fault: what stands from now on (None: nothing does)."""
        if fault is not None:
            self.latch(fault)
        self._why = why
        self.mover.forget()
        self.stops += 1
        self._stopping += 1
        try:
            await asyncio.wait_for(self.mover.cell.robot.abort(), ABORT_S)
        except Exception as error:
            fault = f"{fault or why}; and ABORT went unanswered ({type(error).__name__}: {error}): press emergency stop"
            self.latch(fault)
            event = Interruption.ERROR
        finally:
            self._stopping -= 1
        if fault is not None:
            code = fault.partition(":")[0]
            log, cycle = self.mover.cell.log, self.mover.cycle
            log.record("fault", cycle=cycle, code=code, text=fault, **{"while": self._doing})
        self._interrupted(event)

    async def _halt(self, event: Interruption, why: str, fault: str | None) -> None:
        """End the job: the fault is set in the same breath as its task is cancelled, before anything can run."""
        task = self._task
        self._stopping += 1
        try:
            if task is not None:
                task.cancel()
            await self.stop_arm(event, why, fault)
            if task is not None:
                await asyncio.wait({task})
        finally:
            self._stopping -= 1

    async def _watched(self, work: Coroutine[Any, Any, T], moves: bool) -> T:
        try:
            return await work
        except NotSentError:
            raise
        except Exception as error:
            if moves and self.mover.fault is None:
                text = f"{type(error).__name__}: {error}"
                await self.stop_arm(Interruption.ERROR, text, text)
            raise

    def _done(self, task: asyncio.Task[Any]) -> None:
        self._task, self._doing, self._pending = None, "", None
        if not task.cancelled():
            task.exception()  # whoever awaits the job hears of it; nobody has to

    def _not_while_stopping(self, word: str, busy: bool = False) -> None:
        if self._stopping or busy:
            raise RefusedError(f"the arm is still being stopped; say `{word}` once more")

    def _between_jobs(self, what: str) -> None:
        if self._task is not None:
            raise RefusedError(f"busy: {self._doing}; {what} in between")

    # Before a move.

    async def _gate(self, command: Command) -> bool:
        """Hold a move back; whether it was."""
        x, y, z = np.round(command.world_from_tool[:3, 3], 1)
        how = "straight" if command.straight else "joints"
        return await self._hold(f"{command.purpose}: {how} to {x:g} {y:g} {z:g} at {command.speed_pct:g} %")

    async def _hold(self, text: str) -> bool:
        """Wait out a pause, ask in step mode; whether there was any waiting. text: what is to be done."""
        held = self._step or not self._going.is_set()
        if not self._going.is_set():
            self._interrupted(Interruption.PAUSE)
            await self._going.wait()
            self._interrupted(Interruption.RESUME)
        if self._step:
            self._pending = (text, asyncio.get_running_loop().create_future())
            try:
                if not await self._pending[1]:
                    raise OperatorRefusedError(f"the operator refused: {text}")
            finally:
                self._pending = None
        return held

    def _answer(self, yes: bool) -> None:
        if self._pending is None or self._pending[1].done():
            raise RefusedError("no move waits for an answer")
        self._pending[1].set_result(yes)
