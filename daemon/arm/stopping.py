"""Stop the arm: repeat the stop command until the controller reports the arm at rest; raise the alarm if it does not.

The supervisor handles what a stop means for jobs, the motion permission and faults.
"""

import asyncio
from collections.abc import Callable
from typing import Any

from daemon.arm.robot import Robot, StopRefusedError

ABORT_S = 4.0
"""How long a stop may take before the operator is sent to the emergency stop. It may take longer only if the controller
answers and the stop that `enable` tested took long."""
TRIES = 2
"""How many stops as long as the tested one there is time for: noise on the line may spoil one."""
AGAIN_S = 0.5
"""Pause between two rounds of stop commands (each round sends the command several times)."""
UNCONFIRMED = "NOT CONFIRMED"


class Stopping:
    """The stop (see the module). robot: returns the present arm; alarmed: called with the alarm's text, and with None
    when the arm comes to rest after an alarm. While a stop is under way no motion is permitted."""

    def __init__(self, robot: Callable[[], Robot], alarmed: Callable[[str | None], None]) -> None:
        self._robot, self._alarmed = robot, alarmed
        self._why, self._answered_before = "", 0
        self._task: asyncio.Task[None] | None = None
        self._alarm: asyncio.Future[str] | None = None

    @property
    def under_way(self) -> bool:
        """Whether stop commands are being sent."""
        return self._task is not None and not self._task.done()

    @property
    def alarm(self) -> bool:
        """Whether the controller refused the stop that is under way, or did not confirm it in time."""
        return self.under_way and self._alarm is not None and self._alarm.done()

    @property
    def answered(self) -> bool:
        """Whether the controller has answered the stop that is under way, but has not confirmed it yet."""
        return self.under_way and not self.alarm and self._robot().permission.stop_answered > self._answered_before

    @property
    def within_s(self) -> float:
        """How long the stop may take before the alarm, s."""
        return max(ABORT_S, TRIES * self._robot().permission.stop_took_s)

    def begin(self, why: str) -> bool:
        """Begin a stop, or join the one that is under way. Returns whether it began one. why: the reason, for the
        alarm's text."""
        self._why = why
        if self.under_way:
            return False
        self._alarm = asyncio.get_running_loop().create_future()
        permission = self._robot().permission
        self._answered_before = permission.stop_answered
        permission.stop_begins()
        self._task = asyncio.create_task(self._until_at_rest(self._alarm), name="stop")
        self._task.add_done_callback(lambda _: permission.stop_ends())
        return True

    async def outcome(self) -> str | None:
        """Wait for the arm to be at rest, or for the alarm. Returns None or the alarm's text; after an alarm, stop
        commands are still sent."""
        stopping, alarm = self._task, self._alarm
        assert stopping is not None
        assert alarm is not None
        either: set[asyncio.Future[Any]] = {stopping, alarm}
        await asyncio.wait(either, return_when=asyncio.FIRST_COMPLETED)
        if not alarm.done() and stopping.cancelled():
            self._sound(alarm, "the daemon has ended")
        return alarm.result() if alarm.done() else None

    async def over(self) -> None:
        """Wait until a stop that is under way has ended, without a time limit."""
        if self._task is not None:
            await asyncio.wait({self._task})

    async def _until_at_rest(self, alarm: asyncio.Future[str]) -> None:
        """Send stop commands until the arm is at rest, without a time limit. The alarm is raised at once if the
        controller refuses the command, after ABORT_S if it does not answer, and otherwise after within_s."""
        problem, loop = "no answer", asyncio.get_running_loop()
        silent = loop.call_later(ABORT_S, lambda: None if self.answered else self._sound(alarm, problem))
        late = loop.call_later(self.within_s, lambda: self._sound(alarm, problem))
        try:
            while True:
                try:
                    await self._robot().stop_motion()
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
        """Raise the alarm, once a stop."""
        if alarm.done():
            return
        text = f"{self._why}; {UNCONFIRMED}: {problem}: press the emergency stop"
        alarm.set_result(f"{text}; facetd keeps sending the stop")
        self._alarmed(text)
