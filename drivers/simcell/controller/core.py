"""The simulated controller's line, sans-IO: typed bytes in, printed bytes out. Echo, prompts, questions, type-ahead.

Time is an argument. Each command is a generator (commands.py) that yields what it waits for. The controller runs one at
a time and prints the prompt after it; ABORT, control-C and mishaps end it early.

    running       event                         effect
    nothing       a line                        its command starts
    a wait        its time                      the command continues
    a wait        ABORT or control-C            the arm brakes, the command and all lines typed ahead are dropped
    a wait        another line                  typed ahead: runs later
    a question    a line                        the command continues with the answer
    anything      a mishap                      the arm stops, the command is dropped, the message is printed
"""

from collections import deque
from dataclasses import dataclass

from drivers.simcell.controller import monitor
from drivers.simcell.controller.commands import Ask, Command, Wait, come_to_rest
from drivers.simcell.controller.expressions import MonitorError
from drivers.simcell.controller.faults import Mishap
from drivers.simcell.controller.machine import Machine
from drivers.simcell.controller.terminal import ControllerTerminal, Line, LineKey
from drivers.simcell.history import CONTROL_C

TYPE_AHEAD_LINES = 16
KEPT_LINES = 1000
MESSAGES = {
    Mishap.POWER_LOST: "*Arm power off*",
    Mishap.EMERGENCY_STOP: "*Emergency stop*",
    Mishap.ENVELOPE_ERROR: "*Envelope error* Joint 2",
}


@dataclass(frozen=True)
class TypedLine:
    """A complete line: when the controller had all of it, and whether somebody other than the daemon ended it."""

    text: str
    received_s: float
    by_others: bool


class Controller:
    """A VAL II controller with its machine. It asks its power-up questions where that is cold."""

    def __init__(self, machine: Machine) -> None:
        self.machine, self.arm, self.faults = machine, machine.arm, machine.faults
        self.lines: deque[str] = deque(maxlen=KEPT_LINES)
        """The typed lines, the newest last, run or refused; for tests."""
        manners = machine.manners
        self._newline = manners.newline.encode("ascii")
        self._terminal = ControllerTerminal(manners)
        self._typed_s = float("-inf")
        self._second_prompts = 0
        self._ahead: deque[TypedLine] = deque(maxlen=TYPE_AHEAD_LINES)
        """Typed-ahead lines."""
        self._running: Command | None = None
        self._waits_for: Wait | Ask | None = None
        self._output: deque[tuple[float, bytes]] = deque()
        self._at_line_start = True
        self._muted = False
        self._delayed: bytearray | None = None
        """An answer delayed until the next line is answered."""
        if machine.calibrated:
            self._print_prompt()
        else:
            self._start(monitor.power_up(manners.power_up))

    @property
    def now_s(self) -> float:
        return self.machine.now_s

    # The line

    def receive(self, data: bytes, now_s: float, by_others: bool = False) -> None:
        """Receive typed bytes. by_others: somebody other than the daemon typed them, and the line that they end, even
        if noise changed it."""
        self.tick(now_s)
        if not self.machine.alive:
            return
        for byte in self.faults.harm(data, "to_controller"):
            since_s, self._typed_s = now_s - self._typed_s, now_s
            if since_s < self.machine.manners.lost_within_s:
                continue
            echo, completed = self._terminal.take(byte)
            if self.machine.manners.echo:
                self._emit(echo)
            if isinstance(completed, Line) and completed.second:
                self._take_second_end()
            elif isinstance(completed, Line):
                self._take_line(TypedLine(completed.text, self.now_s, by_others))
            elif completed is LineKey.CANCEL:
                self._again()
            elif completed is LineKey.INTERRUPT:
                self.abort(by_others=by_others)

    def output(self, now_s: float) -> bytes:
        printed = bytearray()
        while self._output and self._output[0][0] <= now_s:
            printed += self._output.popleft()[1]
        return bytes(printed)

    def tick(self, now_s: float) -> None:
        """Advance time; events due meanwhile happen in order, each at its time."""
        while True:
            due_s = self._waits_for.until_s if isinstance(self._waits_for, Wait) else None
            continues = due_s is not None and due_s <= now_s
            mishap = self.machine.advance_to(due_s if due_s is not None and continues else now_s)
            if mishap is not None:
                self._end_by_mishap(mishap)
            elif continues:
                self._step("")
            else:
                return

    def next_moment_s(self) -> float | None:
        """Time of the next event of `tick` or `output`; None: none before something is typed."""
        moments = [self.machine.next_event_s(), self._output[0][0] if self._output else None]
        moments += [self._waits_for.until_s] if isinstance(self._waits_for, Wait) else []
        return min((moment for moment in moments if moment is not None), default=None)

    @property
    def half_typed(self) -> str:
        return self._terminal.typed

    @property
    def question(self) -> str | None:
        return self._waits_for.question if isinstance(self._waits_for, Ask) else None

    # What may happen to it

    def abort(self, by: str = CONTROL_C, by_others: bool = False) -> None:
        """Brake, drop the running command and type-ahead; the prompt follows when the arm is at rest."""
        self.machine.stop(by, by_others)
        self._drop()
        self._start(come_to_rest(self.machine))

    def mishap(self, what: Mishap) -> None:
        self.machine.befall(what)
        self._end_by_mishap(what)

    # Inside

    def _end_by_mishap(self, what: Mishap) -> None:
        """End the running command and print the mishap's message, if the controller still works."""
        self._drop()
        if what is Mishap.POWER_CYCLED:
            self._terminal.clear()
            self._start(monitor.power_up(self.machine.manners.power_up))
        elif what is not Mishap.DEAD:
            self._say(MESSAGES[what])
            self._print_prompt()

    def _take_line(self, line: TypedLine) -> None:
        self.lines.append(line.text)
        self._muted = self.faults.mute_answers > 0
        self.faults.mute_answers -= self._muted
        delayed, self._delayed = self._delayed, None
        self._emit(bytes(delayed or b""))
        if self.faults.late_answers > 0:
            self.faults.late_answers -= 1
            self._delayed = bytearray()
        if isinstance(self._waits_for, Ask):
            self._answer(line)
        elif self._running is None:
            self._carry_out(line)
        elif monitor.stops(line.text, self.machine.manners):
            self.abort(line.text.strip(), line.by_others)
        elif monitor.means(line.text, "ABORT", self.machine.manners):
            self._ahead.clear()
        else:
            self._ahead.append(line)

    def _take_second_end(self) -> None:
        """The second of a pair of line ends: an empty line, answered by another prompt."""
        if self._running is None:
            self._emit(self.machine.manners.prompt.encode("ascii"))
        elif isinstance(self._waits_for, Wait):
            self._second_prompts += 1

    def _carry_out(self, line: TypedLine) -> None:
        self.machine.by, self.machine.received_s, self.machine.by_others = (
            line.text.strip(),
            line.received_s,
            line.by_others,
        )
        self._start(monitor.run(self.machine, line.text))

    def _start(self, command: Command) -> None:
        self._running, self._waits_for = command, None
        self._step(None)

    def _step(self, answer: str | None) -> None:
        """Run the command up to its next wait or question, or to its end and the prompt."""
        command = self._running
        assert command is not None
        try:
            step = next(command) if answer is None else command.send(answer)
            while isinstance(step, str):
                self._say(step)
                step = next(command)
        except StopIteration:
            self._finish()
        except MonitorError as error:
            message = str(error)
            self._say(message.upper() if self.machine.manners.capital_errors else message)
            self._finish()
        else:
            self._waits_for = step
            if isinstance(step, Ask):
                self._ask(step)

    def _finish(self) -> None:
        self._running = self._waits_for = None
        if self._ahead:
            self._carry_out(self._ahead.popleft())
        else:
            self._print_prompt()

    def _ask(self, ask: Ask) -> None:
        if self._ahead:
            self._answer(self._ahead.popleft())
            return
        self._begin_line()
        self._emit(ask.question.encode("ascii") + b" ")

    def _answer(self, line: TypedLine) -> None:
        self.machine.received_s = line.received_s
        self._step(line.text)

    def _again(self) -> None:
        """Repeat the prompt or the question after a cancelled line."""
        if isinstance(self._waits_for, Ask):
            self._ask(self._waits_for)
        elif self._running is None:
            self._print_prompt()

    def _drop(self) -> None:
        if self._running is not None:
            self._running.close()
        self._running = self._waits_for = None
        self._ahead.clear()
        self.machine.spare()

    def _say(self, line: str) -> None:
        self._begin_line()
        self._emit(line.encode("ascii", "replace") + self._newline)

    def _print_prompt(self) -> None:
        self._begin_line()
        manners = self.machine.manners
        self._emit(manners.prompt.encode("ascii"), self.now_s + self.faults.split_prompt_s + manners.prompt_late_s)
        seconds, self._second_prompts = self._second_prompts, 0
        self._emit(manners.prompt.encode("ascii") * seconds)
        self._muted = False

    def _begin_line(self) -> None:
        if not self._at_line_start:
            self._emit(self._newline)

    def _emit(self, data: bytes, not_before_s: float = 0.0) -> None:
        if not data or not self.machine.alive:
            return
        self._at_line_start = data.endswith(self._newline)
        if self._muted:
            return
        if self._delayed is not None:
            self._delayed += data
            return
        last_s = self._output[-1][0] if self._output else 0.0
        self._output.append((max(last_s, not_before_s), self.faults.harm(data, "to_host")))
