"""What holds the next move of arm or hand: a pause, and step mode, in which each waits for a yes.

Whether anything may move at all is the supervisor's; here only, whether it waits.
"""

import asyncio
import time
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from math import inf

from daemon.arm.motion import UnansweredError
from daemon.arm.operators import Interruption, OperatorRefusedError, RefusedError
from daemon.arm.permit import MotionPermit


async def _nothing_to_see() -> None:
    return None


@dataclass(frozen=True, eq=False)
class Waiting:
    """A move that waits for a yes, and no other, whatever it is called; since_s, until_s: the loop's time as it began
    to, and until when a yes counts (inf: at any time)."""

    what: str
    answer: asyncio.Future[bool]
    since_s: float
    until_s: float = inf

    @property
    def text(self) -> str:
        """The move in words, with the time that is left for a yes."""
        if self.until_s == inf:
            return self.what
        return f"{self.what}; its look is valid for {max(self.until_s - self.answer.get_loop().time(), 0.0):.0f} s"

    @property
    def expired(self) -> bool:
        """Whether nobody answered while a yes counted."""
        return self.answer.done() and not self.answer.cancelled() and self.answer.exception() is not None


class Hold:
    """See the module. permit: withheld from what was released as a pause or step mode begins; interrupted: called as a
    pause holds a job, and as it goes on."""

    def __init__(self, permit: MotionPermit, interrupted: Callable[[Interruption], None]) -> None:
        self._permit, self._interrupted = permit, interrupted
        self.pauses = 0
        """How often moves were told to be held: what was to let them go before the last of them does not."""
        self.paused_by, self._paused_s = "", -inf
        """Who said so last."""
        self.stepping = False
        """Whether each move waits for a yes."""
        self._going = asyncio.Event()
        self._going.set()
        self.waiting: Waiting | None = None
        """The move that waits for confirm or refuse."""

    @property
    def paused(self) -> bool:
        """Whether moves are held."""
        return not self._going.is_set()

    @property
    def paused_s(self) -> float:
        """How long ago moves were told to be held last; endless where they never were."""
        return time.monotonic() - self._paused_s

    @property
    def pending_s(self) -> float:
        """For how long it has waited; endless where none does."""
        return inf if self.waiting is None else asyncio.get_running_loop().time() - self.waiting.since_s

    def pause(self, by: str = "") -> None:
        """Hold before the next move of arm or hand. by: who says so."""
        self.pauses += 1
        self.paused_by, self._paused_s = by, time.monotonic()
        self._permit.hold()
        self._going.clear()

    def let_go(self, pauses: int | None = None) -> None:
        """Go on after pause. pauses: as many as there had been when it was decided; a later one stands."""
        if pauses in (None, self.pauses):
            self._going.set()

    def step(self, on: bool) -> None:
        """One confirmed move at a time, or not. One that waits goes on waiting: somebody may be asked about it."""
        if on and not self.stepping:
            self._permit.hold()
        self.stepping = on

    def confirm(self) -> None:
        """Yes to the pending move. Raises RefusedError where none waits."""
        self._answer(True)

    def refuse(self) -> None:
        """No to the pending move: the job is given up. Raises RefusedError where none waits."""
        self._answer(False)

    async def wait(
        self,
        text: str,
        seen: Callable[[], Awaitable[object]] = _nothing_to_see,
        valid_s: float = inf,
        ask: bool = False,
    ) -> None:
        """Wait out a pause, also one that began while it was asked, or while it was seen how things stand by then; ask
        in step mode (or where told to). text: what is to be done; valid_s: for how long from now a yes counts. Raises
        OperatorRefusedError on a no, UnansweredError where there is no answer in that time."""
        until_s = asyncio.get_running_loop().time() + valid_s
        agreed = False
        while self.paused or ((self.stepping or ask) and not agreed):
            if self.paused:
                self._interrupted(Interruption.PAUSE)
                await self._going.wait()
                self._interrupted(Interruption.RESUME)
            else:
                await self._agreed(text, until_s)
                agreed = True
            await seen()
        self._permit.release()

    async def _agreed(self, text: str, until_s: float) -> None:
        loop = asyncio.get_running_loop()
        self.waiting = waiting = Waiting(text, loop.create_future(), loop.time(), until_s)
        expires = None if until_s == inf else loop.call_at(until_s, self._expire, waiting)
        try:
            if not await waiting.answer:
                what, _, _ = text.partition(", from here ")  # the way there was for whoever was asked
                raise OperatorRefusedError(f"the operator refused: {what}")
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
