"""The controller's own terminal for an operator, through the daemon: it logs every line and holds back those that move.

Lines known to be harmless (ControllerMonitor of daemon/arm/robot.py decides) go to the controller as they are typed. Of
any other line the end is held back: while the arm may not move or motion is paused, and otherwise until the operator
confirms it. A line in which keys were deleted is cancelled and typed again, as the controller's delete keys are
unknown.
"""

import asyncio
import contextlib
from collections.abc import Callable, Coroutine
from functools import partial
from typing import Any

from daemon.arm import ControllerMonitor, VoidingEvent
from daemon.cell.no_arm import CellError
from daemon.commands.step_mode import with_questions
from daemon.console.context import ANSWERABLE, CommandContext
from daemon.console.interpreter import CommandResult, Frontend, command, no_more, one_of
from daemon.console.phrases import is_yes, plural
from daemon.console.stop_words import means_stop
from daemon.errors import CommandError, FacetdError

ENDS, RUBOUTS, CANCEL = b"\r\n", b"\x08\x7f", b"\x15"
YES = (b"Y", b"y")
"""First letters of a line that a controller takes for a yes."""
SPOIL = CANCEL + b"!!\r"
"""Cancels a typed line; makes it invalid where the controller does not know the cancel key."""
GREETING = "The controller's own terminal. Control-] returns, control-C stops the arm."
LEFT = "\nYou left the controller's terminal. facetd waits until the arm is at rest, and stops a motion that goes on."
ASKED = "this may move the arm, and the guard does not check it. Send it? [y/n]"
NO_TURNING_OVER = "it may turn shoulder, elbow or wrist over (turn the joints by DO DRIVE instead)"
POLL_S = 0.2
"""Interval of the check that the controller's line is still open."""
ANSWER_AFTER_S = 0.3
"""A key that comes sooner after the question was typed before the operator could read it."""


NOT_OF_POWER_UP = (
    "`{}` is not a known power-up question (arm.dialect.power_up_asks). A yes may move the arm, and the arm is not "
    "enabled. `stop` answers N and ends the program that asks"
)
NO_MONITOR = "the {} cell has no controller with a command line"
CAL = "CAL, in which each joint turns a little and the guard checks nothing"
ROBOT = ("power-up", "cal", "monitor")
ROBOT_USAGE = "robot power-up [Y N ...] | robot cal | robot monitor [TEXT]"


@command(ROBOT_USAGE, "move", most=None, choices=ROBOT)
async def robot(context: CommandContext, words: list[str], frontend: Frontend) -> CommandResult:
    """Talk to the controller of the arm directly.

    power-up       answer the questions that the controller asks after power-up (Y Y unless you give others)
    cal            calibrate the arm: it finds its zero; `enable` first
    monitor TEXT   send one line and show the answer
    monitor        the controller's own terminal, every line logged; control-] returns, control-C stops the arm
    A line that may move the arm must be confirmed. `pause` and `stop` work; the guard does not check its path.
    """
    what = one_of(words, 0, ROBOT, "word", ROBOT_USAGE)
    arm, supervisor = _monitor_of(context), context.cycle.supervisor
    run_line = partial(supervisor.run_typed_line, ask=frontend.asks)
    text = " ".join(words[1:])
    if what == "power-up":
        question = arm.question
        if question is None:
            raise CommandError("the controller asks no power-up question")
        replies = words[1:] or ["Y", "Y"]
        for reply in replies:
            arm.check_typable(reply)
        if arm.asks_whether_to_move:
            if not (supervisor.permission.enabled or supervisor.permission.typed_lines_only):
                raise CommandError(NOT_OF_POWER_UP.format(question))

            async def answered() -> list[str]:
                context.cycle.beliefs.void(VoidingEvent.GRIPPER_TYPED)
                return await arm.power_up(replies)

            output = await with_questions(context, run_line("power-up", answered), frontend)
        else:
            output = await supervisor.converse("power-up", lambda: arm.power_up(replies), moves=False)
        return _replies([question, *output])
    if what == "cal":
        no_more(words, 1, "robot cal")
        reply = context.config.values.arm.calibrate_answer
        output = await with_questions(context, run_line(CAL, lambda: arm.calibrate(reply)), frontend)
        return _replies([*output, f"(answered {reply}) The arm is calibrated and at rest."])
    if not text:
        return await monitor(context, frontend)
    arm.check_typable(text)
    if arm.turns_over(text):
        raise CommandError(f"{text}: {NO_TURNING_OVER}; not sent")

    async def typed() -> list[str]:
        void_gripper_belief(context, arm, text)
        return await arm.monitor(text)

    if arm.moves_the_arm(text):
        return _replies(await with_questions(context, run_line(text, typed), frontend))
    return _replies(await supervisor.converse(text, typed, moves=False))


def _monitor_of(context: CommandContext) -> ControllerMonitor:
    """The controller's monitor. Raises CommandError where the robot has none."""
    monitor = context.hardware.robot.controller
    if monitor is None:
        raise CommandError(NO_MONITOR.format(context.hardware.kind))
    return monitor


def _replies(lines: list[str]) -> CommandResult:
    return CommandResult("\n".join(lines) or "(no answer)", {"lines": lines})


async def monitor(context: CommandContext, frontend: Frontend) -> CommandResult:
    """Connect the operator to the controller until control-]. Raises CommandError where the frontend is no terminal."""
    if not frontend.asks:
        raise CommandError("only at a terminal; here send one line at a time: robot monitor TEXT", 2)
    await frontend.say(GREETING)
    try:
        return await context.cycle.supervisor.converse("monitor", lambda: _monitored(context, frontend), moves=True)
    except ANSWERABLE as error:
        raise CommandError(
            f"the controller's terminal was closed: {context.cycle.supervisor.fault_text or error}"
        ) from error


async def _monitored(context: CommandContext, frontend: Frontend) -> CommandResult:
    controller = _monitor_of(context)
    stops_reported: list[str] = []
    async with controller.terminal(lambda data: frontend.show(shown(data)), stops_reported.append) as send:
        typist = Typist(context, controller, frontend, send)
        if controller.question is None:
            send(b"\r")  # an empty line makes the controller show its prompt
        else:  # an empty line might answer it
            frontend.show(f"{controller.question} ".encode("ascii", "replace"))

        def typed(keys: bytes) -> None:
            with contextlib.suppress(*ANSWERABLE):  # a lost line or a stop is reported elsewhere
                typist.typed(keys)

        await _while_connected(context, frontend.terminal(typed))
        await frontend.say(LEFT)
    back = f"\nBack at the console; {plural(typist.lines, 'line')} sent to the controller."
    return CommandResult("\n".join([back, *stops_reported]), {"lines": typist.lines})


async def _while_connected(context: CommandContext, leaving: Coroutine[Any, Any, None]) -> None:
    """Wait until the operator leaves. Raises CellError when the controller's line is lost: while a person types, the
    daemon does not check the line and would neither report the loss nor stop the arm."""
    leaving_task = asyncio.ensure_future(leaving)
    try:
        while not leaving_task.done():
            await asyncio.wait([leaving_task], timeout=POLL_S)
            if not context.hardware.robot.connected:
                raise CellError("the serial line to the controller is lost")
        leaving_task.result()
    finally:
        leaving_task.cancel()
        await asyncio.wait([leaving_task])


def shown(data: bytes) -> bytes:
    """The controller's output, safe for a terminal: no byte does more than move the cursor within its line."""
    return b"".join(_SHOWN[byte] for byte in data)


_SHOWN = [
    bytes([k]) if chr(k) in "\r\n\b\t\a\0\x7f" or 0x20 <= k < 0x7F else b"^%c" % (k ^ 64) if k < 0x20 else b"?"
    for k in range(256)
]


class Typist:
    """Follows typed lines: records each, and holds back the end of one that may not be sent."""

    def __init__(
        self, context: CommandContext, controller: ControllerMonitor, frontend: Frontend, send: Callable[[bytes], None]
    ) -> None:
        self._context, self._frontend, self._clock = context, frontend, context.hardware.clock
        self._controller, self._to_controller = controller, send
        self._line, self._plain = bytearray(), bytearray()
        """The line without deleted keys; and every key typed."""
        self._unsent = bytearray()
        """Part of the line that the controller does not have yet. A Y that may start a motion is sent only with the
        line's end: once sent it is a yes, and nothing typed behind it cancels it."""
        self._unconfirmed: tuple[str, float] | None = None
        """The line that waits for confirmation, and when the operator was asked."""
        self._keys_deleted, self._yes_may_move = False, controller.asks_whether_to_move
        """Whether keys of the line were deleted; whether a yes may move the arm, to this line or an earlier one."""
        self._stopping: asyncio.Task[str | None] | None = None
        self.lines = 0

    def typed(self, keys: bytes) -> None:
        """Take keys and send those that may be sent: plain characters and the editing keys known here. A controller may
        ignore a byte that is not ASCII and read a motion command behind it."""
        for key in (bytes([k]) for k in keys):
            self._plain += key
            if key in ENDS and self._is_stop():
                self._withdraw()
            elif self._unconfirmed is not None:
                self._take_answer(key, *self._unconfirmed)
            elif key in ENDS:
                self._end_line()
            elif key == CANCEL or key in RUBOUTS:
                self._take_back(0 if key == CANCEL else -1, key)
            elif b" " <= key <= b"~":
                self._add(key)

    def _add(self, key: bytes) -> None:
        begins = not self._line.strip()
        self._line += key
        if self._unsent or (self._yes_may_move and begins and key in YES):
            self._unsent += key
        else:
            self._to_controller(key)

    def _take_back(self, to: int, key: bytes) -> None:
        del self._line[to:]
        if self._unsent:
            del self._unsent[to:]
        else:
            self._keys_deleted = True
            self._to_controller(key)

    def _is_stop(self) -> bool:
        """Stop the arm where the line that ends here is a stop, even one typed as an answer or too soon for one."""
        text = self._plain.decode("latin-1")
        self._plain.clear()
        stops = means_stop(text) or means_stop(self._line.decode("latin-1"))
        if stops:
            self._stopping = asyncio.ensure_future(self._context.cycle.supervisor.stop(f"by {self._frontend.who}"))
        return stops

    def _withdraw(self) -> None:
        """Send nothing of what was typed, and cancel the question."""
        self._line.clear()
        self._unsent.clear()
        if self._unconfirmed is not None:
            text, _ = self._unconfirmed
            self._unconfirmed = None
            self._hold_back(text, "stopped")

    def _end_line(self) -> None:
        text = self._line.decode("latin-1").strip()
        self._line.clear()
        moves, why = self._controller.moves_the_arm(text), self._reason_held()
        if why is not None and (moves or (self._yes_may_move and text[:1].encode() in YES)):
            self._hold_back(text, why)
        elif self._controller.turns_over(text):
            self._hold_back(text, NO_TURNING_OVER)
        elif moves:
            self._unconfirmed = text, self._clock()
            self._frontend.show(f"\r\nfacetd: {ASKED} ".encode())
        else:
            self._send(text)

    def _take_answer(self, key: bytes, text: str, asked_s: float) -> None:
        if key in ENDS or self._clock() - asked_s < ANSWER_AFTER_S:
            return
        self._unconfirmed = None
        why = self._reason_held() if is_yes(key.decode("latin-1")) else "not confirmed"
        if why is None:
            self._send(text)
        else:
            self._hold_back(text, why)

    def _reason_held(self) -> str | None:
        """The reason why a line that may move the arm may not be sent now, or None."""
        supervisor = self._context.cycle.supervisor
        try:
            supervisor.refuse_unless_permitted(typed=True)
        except FacetdError as refused:
            return f"the arm may not move now: {refused}"
        return "motion is paused: `resume`" if supervisor.hold.paused else None

    def _hold_back(self, text: str, why: str) -> None:
        self._to_controller(SPOIL)
        self._unsent.clear()
        self._keys_deleted = False
        self._frontend.show(f"\r\nfacetd: {why}; not sent\r\n".encode("ascii", "replace"))
        self._record(f"not sent: {text}")

    def _send(self, text: str) -> None:
        if text:
            self.lines += 1
            self._record(text)
        if self._yes_may_move and text[:1].encode() in YES:  # a program may go on with it
            self._context.cycle.beliefs.void(VoidingEvent.GRIPPER_TYPED)
        void_gripper_belief(self._context, self._controller, text)
        self._yes_may_move |= self._controller.moves_the_arm(text)
        self._to_controller((SPOIL + text.encode() if self._keys_deleted else bytes(self._unsent)) + b"\r")
        self._unsent.clear()
        self._keys_deleted = False

    def _record(self, text: str) -> None:
        self._context.log.record("command", who=self._frontend.who, door=f"{self._frontend.name}, monitor", text=text)


def void_gripper_belief(context: CommandContext, controller: ControllerMonitor, text: str) -> None:
    """Mark the gripper's content as unknown where a line may open or close the gripper."""
    if controller.works_the_hand(text):
        context.cycle.beliefs.void(VoidingEvent.GRIPPER_TYPED)


COMMANDS = (robot,)
