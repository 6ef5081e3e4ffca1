"""The controller's own terminal for an operator while the daemon stands aside: every line is logged, none surprises.

What an operator types goes to the controller as it is, but while the arm may not move: then only words known to be
harmless do (drivers/val2/commands.py).
"""

from __future__ import annotations

from collections.abc import Callable

from daemon.cell.arm_on_link import moves_the_arm
from daemon.console.context import ANSWERABLE, CommandContext
from daemon.console.interpreter import Answer, CommandError, Door

ENDS, RUBOUTS, CANCEL = b"\r\n", b"\x08\x7f", b"\x15"
SPOIL = CANCEL + b"!!\r"
"""Takes a typed line back; makes it an error where the controller knows no such key."""
GREETING = "The controller's own terminal; the daemon stands aside. Control-] comes back, control-C stops the arm."
HAND_WORDS = ("OPEN", "CLOSE", "GRASP", "RELAX", "MOVET", "MOVEST")


async def monitor(context: CommandContext, door: Door) -> Answer:
    """Talk to the controller until control-]. Raises CommandError where the door is no terminal."""
    if not door.asks:
        raise CommandError("only at a terminal; from here one line at a time: robot monitor TEXT", 2)
    await door.say(GREETING)
    try:
        return await context.cycle.supervisor.converse("monitor", lambda: _monitored(context, door), moves=True)
    except ANSWERABLE as error:
        fault = context.cycle.status()["fault"]
        raise CommandError(f"the controller's terminal has ended: {fault or error}") from error


async def _monitored(context: CommandContext, door: Door) -> Answer:
    typist = Typist(context, door)
    async with context.hardware.robot.terminal(door.show) as send:
        send(b"\r")  # an empty line, for the controller to show its prompt
        await door.terminal(lambda keys: typist.typed(keys, send))
    return Answer(f"\nBack from the controller's terminal: {typist.lines} lines typed.", {"lines": typist.lines})


class Typist:
    """Follows what is typed, line by line: records each line, and keeps back the end of one that may not be sent."""

    def __init__(self, context: CommandContext, door: Door) -> None:
        self._context, self._door = context, door
        self._line = bytearray()
        self.lines = 0

    def typed(self, keys: bytes, send: Callable[[bytes], None]) -> None:
        """Take some keys and send on what may be sent: plain characters and the keys known here. Others could edit the
        line past our knowledge: a controller may pass over a byte that is no ASCII, and read a motion behind it."""
        for key in (bytes([k]) for k in keys):
            if key in ENDS:
                self._end_line(send)
            elif key == CANCEL:
                self._line.clear()
                send(key)
            elif key in RUBOUTS:
                del self._line[-1:]
                send(key)
            elif b" " <= key <= b"~":
                self._line += key
                send(key)

    def _end_line(self, send: Callable[[bytes], None]) -> None:
        text = self._line.decode("latin-1").strip()
        self._line.clear()
        if text and may_not_move(self._context, text):
            send(SPOIL)
            self._door.show(b"\r\nfacetd: the arm may not move now (`enable`, `resume` first); not sent\r\n")
            self._record(f"not sent: {text}")
            return
        if text:
            self.lines += 1
            self._record(text)
        note_hand(self._context, text)
        send(b"\r")

    def _record(self, text: str) -> None:
        self._context.log.record("command", who=self._door.who, door=f"{self._door.name}, monitor", text=text)


def note_hand(context: CommandContext, text: str) -> None:
    """Where a line may work the hand, by a word or by a program it starts, nobody knows whether a part is in it."""
    program = moves_the_arm(text) and text.split()[0].upper() != "DO"
    if program or any(word in text.upper() for word in HAND_WORDS):
        context.cycle.hand_full = None


def may_not_move(context: CommandContext, text: str) -> bool:
    """Whether a line may set the arm in motion while it may not move."""
    state = context.cycle.status()
    return (state["fault"] is not None or not state["enabled"]) and moves_the_arm(text)
