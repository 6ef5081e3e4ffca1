"""Waiting for the end of a motion: in step mode each move is shown and asked about, or told where nobody is asked; that
`pause` holds it is told, too."""

import asyncio
import contextlib
import time
from collections.abc import Awaitable
from typing import Any, TypeVar

from daemon.arm import RefusedError, Waiting
from daemon.console.context import CommandContext
from daemon.console.interpreter import CommandError, CommandResult, Frontend, yes_or_no

T = TypeVar("T")
READ_S = 1.0
"""Nobody has read what is asked and said yes to it sooner than this after it came up, whether by `confirm` or as the
answer to a question (frontends/command_queue.py)."""
POLL_S = 0.05
REMIND_S = 60.0
"""How long a move waits for a yes before it is told once more, where nobody is asked."""
STILL = "Still waits: `confirm` or `refuse`."
UNASKED_S = 0.5
"""How often it is looked whether one waits so."""


async def with_questions(context: CommandContext, work: Awaitable[T], frontend: Frontend) -> T:
    """Wait for the end of a motion. In step mode show each move at this frontend and ask whether to send it."""
    task = asyncio.ensure_future(work)
    told: Any = None
    waits, held = PendingMoveReminder(), False
    with context.notices.answered(frontend):
        while not task.done():
            await asyncio.wait([task], timeout=POLL_S)
            state = context.cycle.status()
            if state["predicted_mm"] is not None and (state["cycle"], state["stop"]) != told:
                told = state["cycle"], state["stop"]
                await frontend.say(_progress(state))
            if state.get("state") == "paused" and not held:
                await frontend.say("Paused before the next move: `resume` continues.")
            held = state.get("state") == "paused"
            waiting = context.cycle.supervisor.hold.waiting
            if waiting is not None and frontend.asks:
                await _ask_to_send(context, waiting, task, frontend)
            elif (line := waits.due(waiting)) is not None:
                await frontend.say(line)
        return await task


class PendingMoveReminder:
    """The move that waits for a yes: whether it is time to tell of it."""

    def __init__(self) -> None:
        self._told: tuple[Waiting | None, float] = None, 0.0

    def due(self, waiting: Waiting | None) -> str | None:
        """The line to tell, once as it begins to wait, and a short one every REMIND_S: a narrow screen has few lines.
        None where there is none."""
        now_s, (told, told_s) = time.monotonic(), self._told
        if waiting is told and (waiting is None or now_s < told_s + REMIND_S):
            return None
        self._told = waiting, now_s
        if waiting is None or waiting is told:
            return None if waiting is None else STILL
        return f"Waiting for confirmation: {waiting.text}. `confirm` (y) sends it, `refuse` (n) cancels it."


async def tell_what_waits(context: CommandContext) -> None:
    """For as long as the daemon runs: a move that waits for a yes while nobody is asked for it is told at every
    frontend."""
    waits = PendingMoveReminder()
    while True:
        await asyncio.sleep(UNASKED_S)
        waiting = None if context.notices.can_ask else context.cycle.supervisor.hold.waiting
        if (line := waits.due(waiting)) is not None:
            context.notices.tell(line)


async def _ask_to_send(
    context: CommandContext, waiting: Waiting, work: asyncio.Future[Any], frontend: Frontend
) -> None:
    """Ask whether to send the move that waits, for as long as that one does: others may decide, or stop the arm."""
    hold = context.cycle.supervisor.hold
    asking = asyncio.ensure_future(yes_or_no(frontend, f"{waiting.text}. Send it? [y/n]"))
    while not (asking.done() or work.done()) and hold.waiting is waiting:
        await asyncio.wait([asking, work], timeout=POLL_S, return_when=asyncio.FIRST_COMPLETED)
    if asking.done() and hold.waiting is waiting:
        with contextlib.suppress(RefusedError):  # somebody else has decided in this moment
            decide(context, asking.result() is True)
    asking.cancel()
    await asyncio.wait([asking])


def _progress(state: dict[str, Any]) -> str:
    error = f"{state['predicted_mm']:.2f} mm {state['predicted_deg']:.2f} degrees"
    return f"{state['target']}, look {state['stop']}: predicted error at the grasp {error}"


def not_too_soon(context: CommandContext) -> None:
    """Raise CommandError where a `confirm` was typed for the move before the one that waits: of two operators who say
    yes to one move, the slower would send the next."""
    hold = context.cycle.supervisor.hold
    if hold.waiting is not None and hold.pending_s < READ_S:
        raise CommandError(f"not sent, this move came up less than 1 s ago: {hold.waiting.text}; `confirm` sends it")


def not_behind_a_pause(context: CommandContext, frontend: Frontend) -> None:
    """Raise CommandError where a `resume` was typed before its operator could read of the pause of somebody else: it
    was for another one, or for a fault."""
    hold = context.cycle.supervisor.hold
    if hold.paused and hold.paused_s < READ_S and hold.paused_by != frontend.who:
        raise CommandError(f"not resumed: {hold.paused_by} paused less than 1 s ago; `resume` again to continue")


def decide(context: CommandContext, yes: bool) -> CommandResult:
    """Yes or no to the move that waits. Raises CommandError where none does."""
    hold = context.cycle.supervisor.hold
    if hold.waiting is None:
        raise CommandError("no move is waiting for confirmation")
    if yes:
        hold.confirm()
    else:
        hold.refuse()
    if yes and context.cycle.status()["paused"]:
        return CommandResult("Move confirmed, not sent yet: motion is paused. `resume` sends it.")
    return CommandResult("Move confirmed." if yes else "Move not sent; the job is cancelled.")
