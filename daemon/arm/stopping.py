"""The one stop: the arm is told, and told again until it was seen at rest; where nobody sees that, the alarm sounds.

Whatever a stop means for jobs, leave and faults is the supervisor's.
"""

import asyncio
from collections.abc import Callable
from typing import Any

from daemon.arm.robot import Robot, StopRefusedError

ABORT_S = 4.0
"""How long it may take until the arm was seen at rest before the operator is sent to the emergency stop; longer only
where the controller answers, and the stop took long as `enable` tried it."""
TRIES = 2
"""Of a stop as long as the one that was tried: noise may spoil one."""
AGAIN_S = 0.5
"""Between two rounds of telling the arm to stop (each types the word several times)."""
UNCONFIRMED = "NOT CONFIRMED"


class Stopping:
    """See the module. robot: which arm, at the time; alarmed: called with the alarm as it sounds, and with None where
    the arm was seen at rest after it. Nothing is permitted to move meanwhile."""

    def __init__(self, robot: Callable[[], Robot], alarmed: Callable[[str | None], None]) -> None:
        self._robot, self._alarmed = robot, alarmed
        self._why, self._answered_before = "", 0
        self._telling: asyncio.Task[None] | None = None
        self._alarm: asyncio.Future[str] | None = None

    @property
    def under_way(self) -> bool:
        """Whether the arm is being told to stop."""
        return self._telling is not None and not self._telling.done()

    @property
    def alarm(self) -> bool:
        """Whether the stop under way was not confirmed in time, or was refused."""
        return self.under_way and self._alarm is not None and self._alarm.done()

    @property
    def answered(self) -> bool:
        """Whether the controller has said something to the stop under way, and did not confirm it yet."""
        return self.under_way and not self.alarm and self._robot().permit.stop_answered > self._answered_before

    @property
    def within_s(self) -> float:
        """How long it may take until the arm was seen at rest; then the alarm sounds."""
        return max(ABORT_S, TRIES * self._robot().permit.stop_took_s)

    def tell(self, why: str) -> bool:
        """Begin to tell the arm, or join in: whether it was begun. why: what is told with the alarm."""
        self._why = why
        if self.under_way:
            return False
        self._alarm = asyncio.get_running_loop().create_future()
        permit = self._robot().permit
        self._answered_before = permit.stop_answered
        permit.stop_begins()
        self._telling = asyncio.create_task(self._until_at_rest(self._alarm), name="stop")
        self._telling.add_done_callback(lambda _: permit.stop_ends())
        return True

    async def outcome(self) -> str | None:
        """None when the arm was seen at rest, else the alarm: the arm goes on being told."""
        telling, alarm = self._telling, self._alarm
        assert telling is not None
        assert alarm is not None
        either: set[asyncio.Future[Any]] = {telling, alarm}
        await asyncio.wait(either, return_when=asyncio.FIRST_COMPLETED)
        if not alarm.done() and telling.cancelled():
            self._sound(alarm, "the daemon has ended")
        return alarm.result() if alarm.done() else None

    async def over(self) -> None:
        """Wait until a stop that is under way has ended, however long."""
        if self._telling is not None:
            await asyncio.wait({self._telling})

    async def _until_at_rest(self, alarm: asyncio.Future[str]) -> None:
        """However long it takes. The alarm sounds at once where the controller refuses, after ABORT_S where it says
        nothing, and after within_s."""
        problem, loop = "no answer", asyncio.get_running_loop()
        silent = loop.call_later(ABORT_S, lambda: None if self.answered else self._sound(alarm, problem))
        late = loop.call_later(self.within_s, lambda: self._sound(alarm, problem))
        try:
            while True:
                try:
                    await self._robot().abort()
                    break
                except StopRefusedError as refused:
                    self._sound(alarm, str(refused))
                except Exception as error:
                    problem = str(error) or type(error).__name__
                await asyncio.sleep(AGAIN_S)
        finally:
            silent.cancel()
            late.cancel()
        if alarm.done():
            self._alarmed(None)

    def _sound(self, alarm: asyncio.Future[str], problem: str) -> None:
        """The last resort, once."""
        if alarm.done():
            return
        text = f"{self._why}; {UNCONFIRMED}: {problem}: press the emergency stop"
        alarm.set_result(f"{text}; the arm goes on being told to stop")
        self._alarmed(text)
