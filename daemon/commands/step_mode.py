"""Wait for the end of a motion; in step mode ask the operator to confirm each move, or report that it waits."""

import asyncio
import contextlib
import time
from collections.abc import Awaitable
from typing import Any, TypeVar

from daemon.arm import RefusedError, Waiting
from daemon.console.context import CommandContext
from daemon.console.interpreter import CommandResult, Frontend, yes_or_no
from daemon.errors import CommandError
from daemon.pick.following import Target
from daemon.pick.pose_fusion import Estimate
from daemon.pick.transitions import PickState

T = TypeVar("T")
READ_S = 1.0
"""The shortest time in which an operator can read a question. A yes that comes sooner, by `confirm` or as an answer,
was meant for something else (frontends/command_queue.py)."""
POLL_S = 0.05
REMIND_S = 60.0
"""How long a move waits for confirmation before it is reported once more, where nobody is asked."""
STILL_WAITING = "The move still waits: `confirm` or `refuse`."
CHECK_WAITING_S = 0.5
"""Interval of the check for such a move."""


async def with_questions(context: CommandContext, work: Awaitable[T], frontend: Frontend) -> T:
    """Wait for the end of a motion. In step mode show each move at this frontend and ask whether to send it."""
    task = asyncio.ensure_future(work)
    cycle, reported = context.cycle, (0, 0)
    waits, held = PendingMoveReminder(), False
    with context.notices.answered(frontend):
        while not task.done():
            await asyncio.wait([task], timeout=POLL_S)
            target = cycle.target
            if target is not None and target.estimate is not None and (cycle.number, target.looks) != reported:
                reported = cycle.number, target.looks
                await frontend.say(_progress(target, target.estimate))
            paused = cycle.state is PickState.PAUSED
            if paused and not held:
                await frontend.say("Paused before the next move: `resume` continues.")
            held = paused
            waiting = cycle.supervisor.hold.waiting
            if waiting is not None and frontend.asks:
                await _ask_to_send(context, waiting, task, frontend)
            elif (line := waits.due(waiting)) is not None:
                await frontend.say(line)
        return await task


class PendingMoveReminder:
    """When to report the move that waits for confirmation."""

    def __init__(self) -> None:
        self._reported: tuple[Waiting | None, float] = None, 0.0

    def due(self, waiting: Waiting | None) -> str | None:
        """The line to show when a move begins to wait, and a short one every REMIND_S; None where nothing is due."""
        now_s, (reported, reported_s) = time.monotonic(), self._reported
        if waiting is reported and (waiting is None or now_s < reported_s + REMIND_S):
            return None
        self._reported = waiting, now_s
        if waiting is None or waiting is reported:
            return None if waiting is None else STILL_WAITING
        return f"Waiting for confirmation: {waiting.text}. `confirm` (y) sends it, `refuse` (n) cancels it."


async def report_waiting_move(context: CommandContext) -> None:
    """Report a move that waits for confirmation at every frontend, while no operator is asked."""
    waits = PendingMoveReminder()
    while True:
        await asyncio.sleep(CHECK_WAITING_S)
        waiting = None if context.notices.can_ask else context.cycle.supervisor.hold.waiting
        if (line := waits.due(waiting)) is not None:
            context.notices.tell(line)


async def _ask_to_send(context: CommandContext, waiting: Waiting, job: asyncio.Future[Any], frontend: Frontend) -> None:
    """Ask whether to send the waiting move, as long as it waits: another operator may decide, or stop the arm."""
    hold = context.cycle.supervisor.hold
    asking = asyncio.ensure_future(yes_or_no(frontend, f"{waiting.text}. Send it? [y/n]"))
    while not (asking.done() or job.done()) and hold.waiting is waiting:
        await asyncio.wait([asking, job], timeout=POLL_S, return_when=asyncio.FIRST_COMPLETED)
    if asking.done() and hold.waiting is waiting:
        with contextlib.suppress(RefusedError):  # another operator has just decided
            decide(context, asking.result() is True)
    asking.cancel()
    await asyncio.wait([asking])


def _progress(target: Target, estimate: Estimate) -> str:
    error = f"{estimate.predicted_mm:.2f} mm {estimate.predicted_deg:.2f} degrees"
    return f"{target.label}, look {target.looks}: predicted error at the grasp {error}"


def refuse_hasty_confirm(context: CommandContext) -> None:
    """Refuse a `confirm` meant for the previous move, which another operator confirmed. Raises CommandError."""
    hold = context.cycle.supervisor.hold
    if hold.waiting is not None and hold.pending_s < READ_S:
        raise CommandError(f"not sent, this move came up less than 1 s ago: {hold.waiting.text}; `confirm` sends it")


def refuse_hasty_resume(context: CommandContext, frontend: Frontend) -> None:
    """Refuse a `resume` typed before its operator could read of another's pause. Raises CommandError."""
    hold = context.cycle.supervisor.hold
    if hold.paused and hold.paused_s < READ_S and hold.paused_by != frontend.who:
        raise CommandError(f"not resumed: {hold.paused_by} paused less than 1 s ago; `resume` again to continue")


def decide(context: CommandContext, yes: bool) -> CommandResult:
    """Confirm or refuse the waiting move. Raises CommandError where none waits."""
    hold = context.cycle.supervisor.hold
    if hold.waiting is None:
        raise CommandError("no move is waiting for confirmation")
    if yes:
        hold.confirm()
    else:
        hold.refuse()
    if yes and hold.paused:
        return CommandResult("Move confirmed. Motion is paused: `resume` sends the move.")
    return CommandResult("Move confirmed." if yes else "Move not sent; the job is cancelled.")
