"""Hold the next move of arm or gripper: during a pause, and in step mode until the operator confirms it.

The supervisor decides whether anything may move at all; this module only makes a move wait.
"""

import asyncio
import time
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from math import inf

from daemon.arm.motion import UnansweredError
from daemon.arm.operators import JobEvent, OperatorRefusedError, RefusedError
from daemon.arm.permission import MotionPermission


@dataclass(frozen=True, eq=False)
class Waiting:
    """A move that waits for confirmation. It is compared by identity: another move may have the same text. since_s,
    until_s: loop time when it began to wait, and until when it can be confirmed (inf: at any time)."""

    what: str
    answer: asyncio.Future[bool]
    since_s: float
    until_s: float = inf

    @property
    def text(self) -> str:
        """The move as text, with the time left to confirm it."""
        if self.until_s == inf:
            return self.what
        return f"{self.what}; its look is valid for {max(self.until_s - self.answer.get_loop().time(), 0.0):.0f} s"


class PauseAndStep:
    """Pause and step mode. permission: its motion is held as soon as a pause or step mode begins; interrupted: called
    when a pause holds a job, and when the job continues."""

    def __init__(self, permission: MotionPermission, interrupted: Callable[[JobEvent], None]) -> None:
        self._permission, self._interrupted = permission, interrupted
        self.pauses = 0
        """Number of pauses so far: a resume that was decided before the last of them has no effect."""
        self.paused_by, self._paused_s = "", -inf
        """Who paused last."""
        self.stepping = False
        """Whether each move waits for confirmation."""
        self._running = asyncio.Event()
        self._running.set()
        self.waiting: Waiting | None = None
        """The move that waits for confirm or refuse."""

    @property
    def paused(self) -> bool:
        """Whether moves are held."""
        return not self._running.is_set()

    @property
    def paused_s(self) -> float:
        """Seconds since the last pause; inf where there was none."""
        return time.monotonic() - self._paused_s

    @property
    def pending_s(self) -> float:
        """How long the pending move has waited, s; inf where none waits."""
        return inf if self.waiting is None else asyncio.get_running_loop().time() - self.waiting.since_s

    def pause(self, by: str = "") -> None:
        """Hold before the next move of arm or gripper. by: who pauses."""
        self.pauses += 1
        self.paused_by, self._paused_s = by, time.monotonic()
        self._permission.require_wait()
        self._running.clear()

    def end_pause(self, pauses: int | None = None) -> None:
        """Continue after a pause. pauses: the number of pauses when this was decided; a later pause stays in force."""
        if pauses in (None, self.pauses):
            self._running.set()

    def step(self, on: bool) -> None:
        """Switch step mode on or off. A move that waits for confirmation goes on waiting: an operator may be reading
        the question."""
        if on and not self.stepping:
            self._permission.require_wait()
        self.stepping = on

    def confirm(self) -> None:
        """Confirm the pending move. Raises RefusedError where none waits."""
        self._answer(True)

    def refuse(self) -> None:
        """Refuse the pending move; its job ends. Raises RefusedError where none waits."""
        self._answer(False)

    async def wait(
        self, text: str, recheck: Callable[[], Awaitable[object]] | None = None, valid_s: float = inf, ask: bool = False
    ) -> None:
        """Wait until a pause ends, and in step mode (or with ask) until the operator confirms the move. After each wait
        `recheck` runs; then a pause that began meanwhile is waited for too. text: the move; valid_s: for how long from
        now it can be confirmed. Raises OperatorRefusedError where the operator refuses, UnansweredError where nobody
        answers in that time."""
        until_s = asyncio.get_running_loop().time() + valid_s
        confirmed = False
        while self.paused or ((self.stepping or ask) and not confirmed):
            if self.paused:
                self._interrupted(JobEvent.PAUSE)
                await self._running.wait()
                self._interrupted(JobEvent.RESUME)
            else:
                await self._confirmed(text, until_s)
                confirmed = True
            if recheck is not None:
                await recheck()
        self._permission.release()

    async def _confirmed(self, text: str, until_s: float) -> None:
        loop = asyncio.get_running_loop()
        self.waiting = waiting = Waiting(text, loop.create_future(), loop.time(), until_s)
        expires = None if until_s == inf else loop.call_at(until_s, self._expire, waiting)
        try:
            if not await waiting.answer:
                what, _, _ = text.partition(", from here ")  # the distance helped to decide; it is no reason
                raise OperatorRefusedError(f"somebody answered no to: {what}")
        finally:
            self.waiting = None
            if expires is not None:
                expires.cancel()

    def _expire(self, waiting: Waiting) -> None:
        if not waiting.answer.done():
            waiting.answer.set_exception(
                UnansweredError("nobody confirmed the move while its look was valid; facetd looks again")
            )

    def _answer(self, yes: bool) -> None:
        if self.waiting is None or self.waiting.answer.done():
            raise RefusedError("no move is waiting for confirmation")
        self.waiting.answer.set_result(yes)
