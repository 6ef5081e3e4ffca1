"""Run jobs that use the arm, one at a time; stop the arm at any moment; grant and withdraw the motion permission.

Every stop has the same order: block new motion (set the fault); send the stop command until the controller reports the
arm at rest; end the job; only then report. If a report fails, the stop still works.
"""

import asyncio
from collections.abc import Awaitable, Callable, Coroutine
from contextvars import copy_context
from dataclasses import replace
from typing import Any, TypeVar

from daemon.arm.belief import VoidingEvent
from daemon.arm.guard import Limits
from daemon.arm.hold import PauseAndStep
from daemon.arm.motion import Arrival, Mover, NotSentError
from daemon.arm.operators import OPERATOR_COMMAND, JobEvent, RefusedError
from daemon.arm.permission import Fault, Grant
from daemon.arm.robot import HeldBackError
from daemon.arm.stopping import UNCONFIRMED, Stopping
from daemon.arm.workcell import Workcell
from daemon.errors import error_text
from daemon.events.codes import BY_OPERATOR, CauseCode, FaultCause, cause_of

T = TypeVar("T")
AT_REST_S = 2.0
"""How long the controller may take to report that the arm is at rest."""
THEN = "; then "
ANOTHER_LINE = (
    "an arm is at rest now, but the serial line was reopened after the alarm: go and check that this is the arm that "
    "was being stopped"
)


class Supervisor:
    """Runs jobs and stops them (see the module). interrupted: called with each interruption of the job, after the arm
    was commanded; all calls come from one event loop.

    stop, fail, abort, disable and pause work at any moment; jobs (`run`) run one at a time.
    """

    def __init__(
        self, cell: Workcell, limits: Limits, arrival: Arrival, interrupted: Callable[[JobEvent], None]
    ) -> None:
        self.permission = cell.robot.permission
        """Whether arm and gripper may move; only this class grants and withdraws it."""
        self.hold = PauseAndStep(self.permission, interrupted)
        """Pause, step mode, and the move that waits for confirmation."""
        self.mover = Mover(cell, limits, arrival, self.hold.wait)
        self.stop_cause = BY_OPERATOR
        """The cause of the last stop; an alarm about that stop has the same cause."""
        self._interrupted = interrupted
        self._task: asyncio.Task[Any] | None = None
        self._doing = ""
        self.job_moves = False
        """Whether the running job may move the arm."""
        self.ended_by: JobEvent | None = None
        """What ended the last job that was ended: a person (STOP, ABORT) or an error."""
        self._ending = 0
        self._stopping = Stopping(lambda: self.mover.cell.robot, self._alarmed)
        self._rest_query: asyncio.Future[bool] | None = None
        """The query whether the arm is at rest, while it runs."""
        self._reported: set[str] = set()
        """The faults reported in the present stop: each is reported once."""
        self.stops = 0
        """How often the arm was stopped or disabled: a request from before the last of these is void."""
        self._heard_before: int | None = None
        """permission.heard when the query for rest began."""
        self._closed = False
        self._openings = self._alarmed_in = 0
        """How often the line was reconnected, and that number at the last alarm."""

    @property
    def busy(self) -> bool:
        """Whether a job is running."""
        return self._task is not None

    @property
    def doing(self) -> str | None:
        """The running job; None: there is none."""
        return self._doing or None

    @property
    def awaits_confirmation_s(self) -> float | None:
        """How long a stop that the controller has answered but not yet confirmed may take in all, s. None: there is no
        such stop."""
        return self._stopping.within_s if self._stopping.answered else None

    @property
    def rest_reports(self) -> int:
        """How often the controller has sent something since the query for rest began; 0 where none runs."""
        return 0 if self._heard_before is None else self.permission.heard - self._heard_before

    async def at_rest(self) -> bool:
        """Whether the controller reports the arm at rest, and no job or stop began meanwhile. Calls at the same time
        share one query: otherwise a key held down would keep the line busy for a minute."""
        if self.busy or self.permission.stopping:
            return False
        if self._rest_query is None or self._rest_query.done():
            self._rest_query = asyncio.ensure_future(self.mover.cell.robot.at_rest())
            self._rest_query.add_done_callback(lambda query: query.cancelled() or query.exception())
        self._heard_before = self.permission.heard
        try:
            async with asyncio.timeout(AT_REST_S):
                rests = await asyncio.shield(self._rest_query)
        except Exception as error:
            self._latch_others(error)
            return False
        finally:
            self._heard_before = None
        return rests and not (self.busy or self.permission.stopping)

    @property
    def fault_text(self) -> str | None:
        """The active fault as a line for people."""
        return None if self.permission.fault is None else self.permission.fault.text

    def status(self) -> dict[str, Any]:
        """The state as JSON values. pending: the move, as text, that waits for confirm or refuse."""
        return {
            "doing": self.doing,
            "fault": self.fault_text,
            "fault_code": None if self.permission.fault is None else self.permission.fault.cause.code,
            "stopping": self.permission.stopping,
            "enabled": self.permission.enabled,
            "by_hand_only": self.permission.typed_lines_only,
            "paused": self.hold.paused,
            "step": self.hold.stepping,
            "dry": self.mover.dry,
            "pending": None if self.hold.waiting is None else self.hold.waiting.text,
        }

    # The motion permission.

    async def test_stop(self) -> None:
        """Verify that the controller accepts the stop command, once each time the line was opened. Raises
        StopRefusedError."""
        if not self.permission.stop_tests:
            await self.run("try the stop", self.mover.cell.robot.test_stop(), moves=False)

    def enable(self, stops: int | None = None, grant: Grant = Grant.ALL) -> None:
        """Permit motion. stops: the number of stops when it was requested; a later stop or disable voids the request.
        Raises RefusedError."""
        if self._closed:
            raise RefusedError("facetd is shutting down")
        self.refuse_while_stopping("enable")
        self.refuse_if_stopped_since(stops, "enable")
        if not self.permission.stop_tests:
            raise RefusedError("the stop was not tested since the line was opened: type `enable` again")
        self.permission.grant(grant)

    async def disable(self) -> str | None:
        """Withdraw the motion permission; if the arm may be moving, stop it. Returns what `stop` returns."""
        may_move = self.permission.granted or self.busy or self.permission.stopping
        self.permission.withdraw()
        self.stops += 1
        return await self._halt(JobEvent.ABORT, "disabled", fault=None) if may_move else None

    def line_opened_anew(self) -> None:
        """Withdraw the permission after a reconnection: another controller may be at the line now. An operator must
        enable the arm again, which tests the stop."""
        self.permission.withdraw()
        self.stops += 1
        self._openings += 1
        self.mover.beliefs.void(VoidingEvent.RECONNECTED)

    def resume(self, stops: int | None = None, pauses: int | None = None) -> None:
        """Continue after a pause; clear a fault (the interrupted job does not continue). stops, pauses: their numbers
        when this was decided; a later stop or pause stays in force. Raises RefusedError."""
        self.refuse_if_stopped_since(stops, "resume")
        if self.permission.fault is not None:
            self.refuse_while_stopping("resume", busy=self._task is not None)
            self.permission.fault = None
            self.mover.beliefs.void(VoidingEvent.FAULT_CLEARED)
            self._notify(lambda: self._interrupted(JobEvent.RESUME))
        self.hold.end_pause(pauses)

    def dry(self, on: bool) -> None:
        """Switch dry run on or off: everything is done but the sending."""
        self.refuse_during_job("dry is switched")
        self.mover.dry = on

    def refit(self, cell: Workcell, limits: Limits, arrival: Arrival) -> None:
        """Use another calibration or other limits with the same robot. Raises RefusedError while another job runs."""
        self.refuse_during_job("settings are changed")
        self.mover.cell, self.mover.limits, self.mover.arrival = cell, limits, arrival

    def refuse_unless_permitted(self, typed: bool = False) -> None:
        """Refuse a motion that is not permitted now. typed: whether an operator types it to the controller. Raises
        RefusedError with what to do."""
        refusal = self.permission.refusal(typed)
        if refusal is not None:
            raise RefusedError(refusal.text)
        if typed and self.mover.dry:
            raise RefusedError("nothing moves while `dry` is on: type `dry off` first")

    # Jobs and stops.

    async def run(self, doing: str, work: Coroutine[Any, Any, T], moves: bool = True) -> T:
        """Run one job; it continues if its caller is cancelled. moves: an error in it stops the arm. Whatever `moves`
        is, somebody else's typing on the line stops an arm that is enabled."""
        return await self.end_of(doing, self.begin(doing, work, moves))

    def begin(self, doing: str, work: Coroutine[Any, Any, T], moves: bool = True) -> asyncio.Task[T]:
        """Begin one job, as `run` does, without waiting."""
        try:
            self._may_begin(moves)
        except RefusedError:
            work.close()
            raise
        own = copy_context()
        own.run(OPERATOR_COMMAND.set, None)  # tasks that outlive the job do not belong to the operator's command
        task: asyncio.Task[T] = asyncio.create_task(self._supervised(work, moves), name=f"arm: {doing}", context=own)
        self._doing, self._task, self.job_moves = doing, task, moves
        task.add_done_callback(self._done)
        task.add_done_callback(lambda _: work.close())  # a job that was cancelled before it began was never awaited
        return task

    async def end_of(self, doing: str, task: asyncio.Task[T]) -> T:
        """Wait for the end of a job that was begun."""
        try:
            return await asyncio.shield(task)
        except asyncio.CancelledError:
            if task.cancelled():
                raise RefusedError(f"{doing}: {self.permission.why}") from None
            raise

    async def run_typed_line(self, doing: str, work: Callable[[], Awaitable[T]], ask: bool = False) -> T:
        """Run as a job what an operator types to the controller, where it may move arm or gripper.

        The guard cannot check where it moves; permission, fault, pause, step mode and every stop work as for any move.
        ask: it waits for confirmation as in step mode.
        """

        async def when_free() -> T:
            await self.hold.wait(doing, ask=ask)
            self.refuse_unless_permitted(typed=True)
            try:
                return await work()
            except HeldBackError:
                return await when_free()

        self.refuse_unless_permitted(typed=True)
        return await self.converse(doing, when_free, moves=True)

    async def converse(self, doing: str, work: Callable[[], Awaitable[T]], moves: bool) -> T:
        """Run as a job what an operator types to the controller; afterwards the beliefs about the arm are void."""

        async def conversation() -> T:
            try:
                return await work()
            finally:
                self.mover.beliefs.void(VoidingEvent.OPERATOR_TYPED)

        return await self.run(doing, conversation(), moves)

    async def stop(self, why: str = "by the operator") -> str | None:
        """Stop the arm, then report; the fault is active until resume. Returns None when the arm is at rest, else the
        alarm's text; then stop commands are still sent."""
        return await self._halt(JobEvent.STOP, f"stopped {why}", f"stopped {why}", BY_OPERATOR)

    async def fail(self, source: str, text: str, cause: FaultCause) -> None:
        """Stop the arm because of a fault that another module (source) found."""
        await self._halt(JobEvent.ERROR, text, f"{source}: {text}", replace(cause, source=source))

    async def abort(self) -> str | None:
        """Stop the arm and end its job, without a fault. Returns what `stop` returns."""
        return await self._halt(JobEvent.ABORT, "aborted by the operator", fault=None)

    async def close(self) -> None:
        """Stop the arm if it may be moving, and end the job; nothing moves afterwards."""
        may_move = self.permission.granted or self.busy or self.permission.stopping
        self.permission.withdraw()
        self._closed = True
        if may_move:
            await self._halt(JobEvent.ABORT, "the daemon ends", fault=None)

    async def wait_for_stop_end(self) -> None:
        """Wait until a stop that is under way has ended, without a time limit."""
        await self._stopping.over()

    def latch(self, fault: str, cause: FaultCause = BY_OPERATOR) -> None:
        """Make a fault active; nothing is sent to the arm."""
        self.permission.fault = Fault(fault, (cause,))

    def _join(self, fault: str, cause: FaultCause) -> None:
        """Make a fault active beside one that is active already."""
        self.permission.fault = _joined(self.permission.fault, fault, cause)

    async def stop_arm(
        self, event: JobEvent, why: str, fault: str | None, cause: FaultCause = BY_OPERATOR
    ) -> str | None:
        """Stop the arm, then report. fault: the fault to make active, if any. Returns what `stop` returns."""
        if fault is not None and not self._stopping.alarm:
            self._join(fault, cause)
        if not self._stopping.alarm:
            self.stop_cause = cause
        if not self.permission.stop_as_granted:
            self.permission.withdraw()
        self.ended_by = event
        self.permission.why = why
        self.mover.beliefs.void(VoidingEvent.STOPPED)
        self.stops += 1
        if self._stopping.begin(self.fault_text or why):
            self._reported.clear()
        # The next stop may cancel the caller; this stop is reported nevertheless.
        return await asyncio.shield(
            asyncio.create_task(self._report_outcome(event, fault, cause), name="report a stop")
        )

    async def _halt(
        self, event: JobEvent, why: str, fault: str | None = None, cause: FaultCause = BY_OPERATOR
    ) -> str | None:
        """Stop the arm and end the job: no other task can run between the job's cancellation and the setting of the
        fault."""
        task = self._task
        self._ending += 1
        self.permission.stop_begins()
        try:
            if task is not None:
                task.cancel()
            alarm = await self.stop_arm(event, why, fault, cause)
            if task is not None:
                await asyncio.wait({task})
        finally:
            self._ending -= 1
            self.permission.stop_ends()
        return alarm

    async def _report_outcome(self, event: JobEvent, fault: str | None, cause: FaultCause) -> str | None:
        """Wait until the arm is at rest, and report that; return the alarm's text if there is an alarm."""
        alarm = await self._stopping.outcome()
        if alarm is None:
            self._report(event, fault, cause)
        return alarm

    def _alarmed(self, text: str | None) -> None:
        if text is None:
            same = self._openings == self._alarmed_in
            rests = "the arm is now at rest: the stop is confirmed" if same else ANOTHER_LINE
            self._notify(lambda: self.mover.cell.log.record("rest", text=rests))
        else:
            self._alarmed_in = self._openings
            active = self.permission.fault
            self.permission.fault = Fault(text) if active is None else replace(active, text=text)
            self._report(JobEvent.ERROR, text, self.stop_cause)

    def _report(self, event: JobEvent, fault: str | None, cause: FaultCause) -> None:
        if fault is not None:
            self._report_fault(fault, cause)
        self._notify(lambda: self._interrupted(event))

    def _report_fault(self, fault: str, cause: FaultCause) -> None:
        if fault not in self._reported:
            self._reported.add(fault)
            fields = {"code": cause.code, "findings": cause.findings, "text": fault, "while": self._doing}
            self._notify(lambda: self.mover.cell.log.record("fault", cycle=self.mover.cycle, **fields))

    def _notify(self, report: Callable[[], None]) -> None:
        """Call a reporting function; its failure must not break the stop."""
        try:
            report()
        except Exception as error:
            context = {"message": "a report of a stop failed", "exception": error}
            asyncio.get_running_loop().call_exception_handler(context)

    async def _supervised(self, work: Coroutine[Any, Any, T], moves: bool) -> T:
        try:
            return await work
        except NotSentError:
            raise
        except Exception as error:
            cause, permission = cause_of(error), self.permission
            if self._ending:  # an error caused by ending the job is no fault
                self._latch_others(error)
            elif permission.fault is None and (
                moves or (cause.code is CauseCode.OTHER_TERMINAL and permission.granted)
            ):
                text = error_text(error)
                await self.stop_arm(JobEvent.ERROR, text, text, cause)
            raise

    def _latch_others(self, error: Exception) -> None:
        """Make a fault active where an otherwise ignored error says that somebody else types on the line."""
        cause, text = cause_of(error), error_text(error)
        if cause.code is CauseCode.OTHER_TERMINAL:
            self._join(text, cause)
            self._report_fault(text, cause)

    def _done(self, task: asyncio.Task[Any]) -> None:
        self._task, self._doing = None, ""
        if not task.cancelled():
            task.exception()  # mark it as retrieved: nobody has to await the job

    def refuse_while_stopping(self, word: str, busy: bool = False) -> None:
        """Refuse a command (word) while a stop is under way. Raises RefusedError."""
        if self.permission.stopping or busy:
            doubt = f" ({self.permission.fault})" if self._stopping.alarm else ""
            raise RefusedError(f"facetd is still stopping the arm{doubt}; type `{word}` again when it is at rest")

    def refuse_if_stopped_since(self, stops: int | None, word: str) -> None:
        """Refuse a command (word), or the answer to a question, that was given before the last stop or disable. stops:
        the number of stops then. Raises RefusedError."""
        if stops is not None and stops != self.stops:
            why = f": {self.permission.fault}" if self.permission.fault else ""
            raise RefusedError(f"somebody stopped the arm meanwhile{why}; type `{word}` again")

    def _may_begin(self, moves: bool) -> None:
        if self._task is not None or (moves and self.permission.stopping):
            raise RefusedError(f"busy: {self._doing or f'being stopped ({self.permission.why})'}")
        word, stops = OPERATOR_COMMAND.get() or ("", None)
        if moves:
            self.refuse_if_stopped_since(stops, word)

    def refuse_during_job(self, what: str) -> None:
        """Refuse to change something that must stay the same during a job, unless the job itself changes it. Raises
        RefusedError."""
        if self._task is not None and self._task is not asyncio.current_task():
            raise RefusedError(f"busy: {self._doing}; {what} only when that has ended: wait, or `abort`")


def _joined(active: Fault | None, text: str, cause: FaultCause) -> Fault:
    """The active fault when another joins it: the texts of both, but not that of an alarm that is over."""
    if active is None:
        return Fault(text, (cause,))
    first = active.text.partition(THEN)[0]
    if first == text or UNCONFIRMED in first:
        return Fault(text, tuple(dict.fromkeys((cause, *active.causes))))
    return Fault(f"{first}{THEN}{text}", tuple(dict.fromkeys((*active.causes, cause))))
