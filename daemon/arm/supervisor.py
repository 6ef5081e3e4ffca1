"""Who has the arm: one job at a time, stopped at any moment, held before a move. What the jobs are, others say.

The one owner of whether the arm may move, and the one stop. Its order is always the same: no new motion can leave (the
fault is set), the arm is told to stop, and told again until it was seen at rest; the job is ended, and only then is
anything reported. Who hears of it may fail: the stop does not.
"""

import asyncio
from collections.abc import Awaitable, Callable, Coroutine
from contextvars import copy_context
from typing import Any, TypeVar

from daemon.arm.belief import VoidingEvent
from daemon.arm.guard import Limits
from daemon.arm.hold import Hold
from daemon.arm.motion import Arrival, Mover, NotSentError
from daemon.arm.operators import SAID, Interruption, RefusedError
from daemon.arm.permit import Grant
from daemon.arm.robot import HeldBackError
from daemon.arm.stopping import UNCONFIRMED, Stopping
from daemon.arm.workcell import Workcell
from daemon.events.codes import BY_OPERATOR, CauseCode, FaultCause, cause_of

T = TypeVar("T")
AT_REST_S = 2.0
"""How long an arm that is at rest takes to show it."""
THEN = "; then "
ANOTHER_LINE = (
    "an arm was seen at rest, on a line that was opened anew since the alarm: go and see whether it is the one that "
    "was being stopped"
)


class Supervisor:
    """See the module. interrupted: told of what comes over the job, after the arm was; all calls from one event loop.

    stop, fail, abort, disable and pause are heard at any moment; jobs (`run`) are taken one at a time.
    """

    def __init__(
        self, cell: Workcell, limits: Limits, arrival: Arrival, interrupted: Callable[[Interruption], None]
    ) -> None:
        self.permit = cell.robot.permit
        """Whether arm and gripper may move; granted and withdrawn here alone."""
        self.hold = Hold(self.permit, interrupted)
        """Pause, step mode, and the move that waits for a yes."""
        self.mover = Mover(cell, limits, arrival, self.hold.wait)
        self.fault_cause = BY_OPERATOR
        """What the last stop was caused by; an alarm that it was not confirmed has the same cause."""
        self._interrupted = interrupted
        self._task: asyncio.Task[Any] | None = None
        self._doing = ""
        self.job_moves = False
        """Whether the job that has the arm may move it."""
        self.ended_by: Interruption | None = None
        """What ended the job that was ended last: a person (STOP, ABORT) or an error."""
        self._ending = 0
        self._stopping = Stopping(lambda: self.mover.cell.robot, self._alarmed)
        self._asking: asyncio.Future[bool] | None = None
        """Whether it rests, while it is being asked."""
        self._told: set[str] = set()
        """The faults told of in the present stop: whoever joins in with the same one need not tell it again."""
        self.stops = 0
        """How often the arm was stopped or disabled: what was asked for before the last of them is void."""
        self._heard_before: int | None = None
        """How often the controller had been heard as it was asked whether the arm is at rest."""
        self._closed = False
        self._openings = self._alarmed_in = 0
        """How often the line was opened anew, and as the last alarm sounded."""

    @property
    def busy(self) -> bool:
        """Whether a job has the arm."""
        return self._task is not None

    @property
    def stopping(self) -> bool:
        """Whether a stop is under way: until the arm was seen at rest and the job has ended."""
        return self.permit.stopping

    @property
    def awaits_confirmation_s(self) -> float | None:
        """Of a stop that the controller has answered and not confirmed yet: how long that may take in all, s."""
        return self._stopping.within_s if self._stopping.answered else None

    @property
    def fault(self) -> str | None:
        """What is active until resume."""
        return self.permit.fault

    @property
    def enabled(self) -> bool:
        """Whether an operator lets the arm move, its stop seen to work."""
        return self.permit.enabled

    @property
    def by_hand_only(self) -> bool:
        """Whether an operator lets the arm do what he tells the controller himself, and nothing else."""
        return self.permit.by_hand_only

    @property
    def rest_reports(self) -> int:
        """How often the controller was heard since it is being asked whether the arm is at rest; 0 where it is not."""
        return 0 if self._heard_before is None else self.permit.heard - self._heard_before

    async def at_rest(self) -> bool:
        """Whether nothing moves, by the arm's own word, and nothing that may move it began while it was asked. Who asks
        while it is being asked waits for the same word: a key held down would have the line busy for a minute."""
        if self.busy or self.stopping:
            return False
        if self._asking is None or self._asking.done():
            self._asking = asyncio.ensure_future(self.mover.cell.robot.at_rest())
            self._asking.add_done_callback(lambda asking: asking.cancelled() or asking.exception())
        self._heard_before = self.permit.heard
        try:
            async with asyncio.timeout(AT_REST_S):
                rests = await asyncio.shield(self._asking)
        except Exception as error:
            self._latch_others(error)
            return False
        finally:
            self._heard_before = None
        return rests and not (self.busy or self.stopping)

    def status(self) -> dict[str, object]:
        """How things stand, JSON values only. pending: the move, in words, that waits for confirm or refuse."""
        return {
            "doing": self._doing or None,
            "fault": self.fault,
            "stopping": self.stopping,
            "enabled": self.enabled,
            "by_hand_only": self.by_hand_only,
            "paused": self.hold.paused,
            "step": self.hold.stepping,
            "dry": self.mover.dry,
            "pending": None if self.hold.waiting is None else self.hold.waiting.text,
        }

    # What may be.

    async def prove_stop(self) -> None:
        """See that the controller takes the word that stops the arm, once each time the line was opened. Raises
        StopRefusedError where it does not."""
        if not self.permit.stop_seen:
            await self.run("try the stop", self.mover.cell.robot.prove_stop(), moves=False)

    def enable(self, stops: int | None = None, grant: Grant = Grant.ALL) -> None:
        """Let the arm move. stops: as many as there had been when it was asked for; a later stop or disable voids it.
        Raises RefusedError."""
        if self._closed:
            raise RefusedError("facetd is shutting down")
        self.not_while_stopping("enable")
        self.not_after(stops, "enable")
        if not self.permit.stop_seen:
            raise RefusedError("facetd has not seen the stop work since the line was opened; say `enable` once more")
        self.permit.grant(grant)

    async def disable(self) -> str | None:
        """Do not let the arm move; stop it where it may. Gives what `stop` does."""
        may_move = self.permit.granted or self.busy or self.stopping
        self.permit.withdraw()
        self.stops += 1
        return await self._halt(Interruption.ABORT, "disabled", fault=None) if may_move else None

    def line_opened_anew(self) -> None:
        """Nobody knows what is at its other end now: an operator enables the arm again, its stop tried."""
        self.permit.withdraw()
        self.stops += 1
        self._openings += 1
        self.mover.beliefs.void(VoidingEvent.RECONNECTED)

    def resume(self, stops: int | None = None, pauses: int | None = None) -> None:
        """Go on after pause; clear a fault (what was going on does not go on). stops, pauses: as many as there had been
        when it was decided; a later one stands. Raises RefusedError."""
        self.not_after(stops, "resume")
        if self.fault is not None:
            self.not_while_stopping("resume", busy=self._task is not None)
            self.permit.fault = None
            self.mover.beliefs.void(VoidingEvent.FAULT_CLEARED)
            self._tell(lambda: self._interrupted(Interruption.RESUME))
        self.hold.let_go(pauses)

    def dry(self, on: bool) -> None:
        """Everything but the bytes, or not."""
        self.between_jobs("dry is switched")
        self.mover.dry = on

    def refit(self, cell: Workcell, limits: Limits, arrival: Arrival) -> None:
        """Go on with another calibration or other limits, and the same robot; only while nothing else is being done."""
        self.between_jobs("settings are changed")
        self.mover.cell, self.mover.limits, self.mover.arrival = cell, limits, arrival

    def may_move(self) -> None:
        """Raise RefusedError, with what to do, where nothing may move."""
        self._nothing_hinders()
        if self.by_hand_only:
            raise RefusedError(
                "the arm is enabled for `robot` only: calibrate hand-eye first (calibration.yaml has no hand_eye)"
            )
        if not self.enabled:
            raise RefusedError("the arm is not enabled: `enable` first")

    def may_move_by_hand(self) -> None:
        """Raise RefusedError, with what to do, where what an operator tells the controller himself may not move."""
        self._nothing_hinders()
        if not (self.enabled or self.by_hand_only):
            raise RefusedError("the arm is not enabled: `enable` first")
        if self.mover.dry:
            raise RefusedError("nothing moves while `dry` is on: say `dry off` first")

    def _nothing_hinders(self) -> None:
        if self.fault is not None:
            raise RefusedError(f"clear the fault first, `resume`: {self.fault}")
        if self.stopping:
            raise RefusedError(f"the arm is {self.permit.hindrance}; try again when it is at rest")

    # Jobs, and their end.

    async def run(self, doing: str, work: Coroutine[Any, Any, T], moves: bool = True) -> T:
        """Run one job; it goes on when the one who asked goes away. moves: an error in it stops the arm, as it always
        does where an arm may move and somebody else types on its line."""
        return await self.end_of(doing, self.begin(doing, work, moves))

    def begin(self, doing: str, work: Coroutine[Any, Any, T], moves: bool = True) -> asyncio.Task[T]:
        """Begin one job, as `run` does, in this very moment."""
        try:
            self._may_begin(moves)
        except RefusedError:
            work.close()
            raise
        own = copy_context()
        own.run(SAID.set, None)  # what a job leaves to be done after it is nobody's word
        task: asyncio.Task[T] = asyncio.create_task(self._watched(work, moves), name=f"arm: {doing}", context=own)
        self._doing, self._task, self.job_moves = doing, task, moves
        task.add_done_callback(self._done)
        task.add_done_callback(lambda _: work.close())  # one that was ended before it began was never awaited
        return task

    async def end_of(self, doing: str, task: asyncio.Task[T]) -> T:
        """Wait for the end of a job that was begun."""
        try:
            return await asyncio.shield(task)
        except asyncio.CancelledError:
            if task.cancelled():
                raise RefusedError(f"{doing}: {self.permit.why}") from None
            raise

    async def by_hand(self, doing: str, work: Callable[[], Awaitable[T]], ask: bool = False) -> T:
        """Run as a job what an operator tells the controller himself, where it may set arm or hand in motion.

        The guard does not see where that goes; enable, fault, pause, step and every stop hold as for any move.
        ask: it waits for a yes as if in step mode.
        """

        async def held() -> T:
            await self.hold.wait(doing, ask=ask)
            self.may_move_by_hand()
            try:
                return await work()
            except HeldBackError:
                return await held()

        self.may_move_by_hand()
        return await self.converse(doing, held, moves=True)

    async def converse(self, doing: str, work: Callable[[], Awaitable[T]], moves: bool) -> T:
        """Run as a job what an operator types to the controller; afterwards nothing is believed of arm and gripper."""

        async def conversation() -> T:
            try:
                return await work()
            finally:
                self.mover.beliefs.void(VoidingEvent.OPERATOR_TYPED)

        return await self.run(doing, conversation(), moves)

    async def stop(self, why: str = "by the operator") -> str | None:
        """Stop the arm, then report; the fault stands until resume. Gives None when the arm was seen at rest, else the
        alarm: the arm goes on being told to stop."""
        return await self._halt(Interruption.STOP, f"stopped {why}", f"stopped {why}", BY_OPERATOR)

    async def fail(self, source: str, text: str, cause: FaultCause) -> None:
        """Stop the arm for a fault found elsewhere."""
        await self._halt(Interruption.ERROR, text, f"{source}: {text}", cause)

    async def abort(self) -> str | None:
        """Stop the arm and give up what it does. Gives what `stop` does."""
        return await self._halt(Interruption.ABORT, "aborted by the operator", fault=None)

    async def close(self) -> None:
        """Stop the arm where it may move, and end the job; from then on nothing moves."""
        may_move = self.permit.granted or self.busy or self.stopping
        self.permit.withdraw()
        self._closed = True
        if may_move:
            await self._halt(Interruption.ABORT, "the daemon ends", fault=None)

    async def rested(self) -> None:
        """Wait until a stop that is under way has ended, however long."""
        await self._stopping.over()

    def latch(self, fault: str) -> None:
        """A fault is active from now on; nothing is sent to the arm."""
        self.permit.fault = fault

    async def stop_arm(
        self, event: Interruption, why: str, fault: str | None, cause: FaultCause = BY_OPERATOR
    ) -> str | None:
        """The arm first, then the report. fault: what stands from now on, if anything. Gives what `stop` does."""
        if fault is not None and not self._stopping.alarm:
            self.latch(_on_top_of(self.fault, fault))
        if not self._stopping.alarm:
            self.fault_cause = cause
        if not self.permit.stop_as_granted:
            self.permit.withdraw()
        self.ended_by = event
        self.permit.why = why
        self.mover.beliefs.void(VoidingEvent.STOPPED)
        self.stops += 1
        if self._stopping.tell(self.fault or why):
            self._told.clear()
        # Whoever waits may be ended by the next stop: what is to be known of this one is told all the same.
        return await asyncio.shield(
            asyncio.create_task(self._brought_to_rest(event, fault, cause), name="report a stop")
        )

    async def _halt(
        self, event: Interruption, why: str, fault: str | None = None, cause: FaultCause = BY_OPERATOR
    ) -> str | None:
        """End the job: the fault is set in the same breath as its task is cancelled, before anything can run."""
        task = self._task
        self._ending += 1
        self.permit.stop_begins()
        try:
            if task is not None:
                task.cancel()
            alarm = await self.stop_arm(event, why, fault, cause)
            if task is not None:
                await asyncio.wait({task})
        finally:
            self._ending -= 1
            self.permit.stop_ends()
        return alarm

    async def _brought_to_rest(self, event: Interruption, fault: str | None, cause: FaultCause) -> str | None:
        """Comes back when the arm was seen at rest, and that was reported, or else with the alarm."""
        alarm = await self._stopping.outcome()
        if alarm is None:
            self._report(event, fault, cause)
        return alarm

    def _alarmed(self, text: str | None) -> None:
        if text is None:
            same = self._openings == self._alarmed_in
            rests = "the arm was seen at rest at last" if same else ANOTHER_LINE
            self._tell(lambda: self.mover.cell.log.record("rest", text=rests))
        else:
            self._alarmed_in = self._openings
            self.latch(text)
            self._report(Interruption.ERROR, text, self.fault_cause)

    def _report(self, event: Interruption, fault: str | None, cause: FaultCause) -> None:
        if fault is not None:
            self._report_fault(fault, cause)
        self._tell(lambda: self._interrupted(event))

    def _report_fault(self, fault: str, cause: FaultCause) -> None:
        if fault not in self._told:
            self._told.add(fault)
            fields = {"code": cause.code, "findings": cause.findings, "text": fault, "while": self._doing}
            self._tell(lambda: self.mover.cell.log.record("fault", cycle=self.mover.cycle, **fields))

    def _tell(self, telling: Callable[[], None]) -> None:
        """Whoever hears of a stop may fail."""
        try:
            telling()
        except Exception as error:
            context = {"message": "what is to be known of a stop was not told", "exception": error}
            asyncio.get_running_loop().call_exception_handler(context)

    async def _watched(self, work: Coroutine[Any, Any, T], moves: bool) -> T:
        try:
            return await work
        except NotSentError:
            raise
        except Exception as error:
            cause = cause_of(error)
            if self._ending:  # what being ended makes of it is no fault
                self._latch_others(error)
            elif self.fault is None and (moves or (cause.code is CauseCode.OTHER_TERMINAL and self.permit.granted)):
                text = f"{type(error).__name__}: {error}"
                await self.stop_arm(Interruption.ERROR, text, text, cause)
            raise

    def _latch_others(self, error: Exception) -> None:
        """Of an error that nobody hears: that others type on the line is a fault all the same."""
        cause, text = cause_of(error), f"{type(error).__name__}: {error}"
        if cause.code is CauseCode.OTHER_TERMINAL:
            self.latch(_on_top_of(self.fault, text))
            self._report_fault(text, cause)

    def _done(self, task: asyncio.Task[Any]) -> None:
        self._task, self._doing = None, ""
        if not task.cancelled():
            task.exception()  # whoever awaits the job hears of it; nobody has to

    def not_while_stopping(self, word: str, busy: bool = False) -> None:
        """Raise RefusedError where a stop is under way: this word is not heard then."""
        if self.stopping or busy:
            doubt = f" ({self.fault})" if self._stopping.alarm else ""
            raise RefusedError(f"facetd is still stopping the arm{doubt}; say `{word}` once more when it is at rest")

    def not_after(self, stops: int | None, word: str) -> None:
        """Raise RefusedError where the arm was stopped or disabled since there had been so many stops: void is a word,
        or the yes to a question, from before."""
        if stops is not None and stops != self.stops:
            why = f": {self.fault}" if self.fault else ""
            raise RefusedError(f"somebody stopped the arm meanwhile{why}; say `{word}` once more")

    def _may_begin(self, moves: bool) -> None:
        if self._task is not None or (moves and self.stopping):
            raise RefusedError(f"busy: {self._doing or self.permit.hindrance}")
        word, stops = SAID.get() or ("", None)
        if moves:
            self.not_after(stops, word)

    def between_jobs(self, what: str) -> None:
        """Raise RefusedError where something is being done, but by that itself: what holds for the whole of it is not
        changed under it."""
        if self._task is not None and self._task is not asyncio.current_task():
            raise RefusedError(f"busy: {self._doing}; {what} in between")


def _on_top_of(standing: str | None, fault: str) -> str:
    """What stands from now on: who clears a stop is told of the fault before it, too, but of no alarm that is over."""
    first = (standing or fault).partition(THEN)[0]
    return fault if first == fault or UNCONFIRMED in first else f"{first}{THEN}{fault}"
