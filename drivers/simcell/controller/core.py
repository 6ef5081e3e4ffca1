"""The controller itself: bytes typed go in, bytes printed come out, an arm moves. Sans-IO; time is an argument.

Each command is a generator (monitor.py) that yields what it waits for; this file runs one at a time, prints the prompt
after it, and lets ABORT, control-C and mishaps cut it short.

    what runs     what comes                    what happens
    nothing       a line                        its command starts
    a wait        its time                      the command goes on
    a wait        ABORT or control-C            the arm brakes, the command and all lines typed ahead are dropped
    a wait        another line                  typed ahead: runs later
    a question    a line                        the command goes on with the answer
    anything      a mishap                      the arm stops, the command is dropped, the message is printed
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from drivers.puma560 import Configuration
from drivers.simcell.arm import EMERGENCY_BRAKING, Arm
from drivers.simcell.controller import monitor
from drivers.simcell.controller.expressions import Memory, MonitorError
from drivers.simcell.controller.faults import Faults, Mishap
from drivers.simcell.controller.terminal import Cancelled, Interrupt, Line, Terminal
from drivers.simcell.controller.waits import Ask, Command, Wait
from drivers.simcell.controller.words import come_to_rest

TYPE_AHEAD_LINES = 16
KEPT_LINES = 1000


@dataclass(frozen=True)
class Manners:
    """What differs between systems; times in the controller's seconds."""

    echo: bool = True
    line_editing: bool = True
    """Whether control-U, rubout and control-C do what they are for, or are characters like any other."""
    prompt_after_move: Literal["start", "end"] = "start"
    hand_s: float = 0.3
    calibration_s: float = 6.0
    arm_power_after_s: float | None = None
    """How long after CAL was refused for want of it somebody switches arm power on (None: nobody does)."""


class Controller:
    """A VAL II controller with an arm."""

    def __init__(
        self,
        arm: Arm,
        manners: Manners | None = None,
        on_hand: Callable[[bool], None] | None = None,
        faults: Faults | None = None,
        cold: bool = False,
    ) -> None:
        """on_hand: called with True when the hand closes. cold: as after the mains were switched on."""
        self.arm, self.manners, self.faults = arm, manners or Manners(), faults or Faults()
        self.on_hand = on_hand or (lambda closed: None)
        self.now_s = 0.0
        self.memory = Memory()
        self.speed_percent = 100.0
        self.arm_power = self.calibrated = not cold
        self.hand_closed = False
        self.wanted = Configuration()
        self.alive = True
        self.lines: deque[str] = deque(maxlen=KEPT_LINES)
        """What was typed, the newest line last, carried out or refused; for witnesses."""
        self._terminal = Terminal(self.manners.line_editing)
        self._ahead: deque[str] = deque(maxlen=TYPE_AHEAD_LINES)
        self._running: Command | None = None
        self._waits_for: Wait | Ask | None = None
        self._output: deque[tuple[float, bytes]] = deque()
        self._at_line_start = True
        self._muted = False
        self._mishaps: list[tuple[float, Mishap]] = []
        self._power_comes_s: float | None = None
        if cold:
            self._start(monitor.power_up(self))
        else:
            self._print_prompt()

    # The line

    def receive(self, data: bytes, now_s: float) -> None:
        """Bytes typed."""
        self.tick(now_s)
        if not self.alive:
            return
        for byte in self.faults.harm(data, "to_controller"):
            echo, completed = self._terminal.take(byte)
            if self.manners.echo:
                self._emit(echo)
            if isinstance(completed, Line):
                self._take_line(completed.text)
            elif isinstance(completed, Cancelled):
                self._again()
            elif isinstance(completed, Interrupt):
                self.abort()

    def output(self, now_s: float) -> bytes:
        """Bytes printed up to now."""
        printed = bytearray()
        while self._output and self._output[0][0] <= now_s:
            printed += self._output.popleft()[1]
        return bytes(printed)

    def tick(self, now_s: float) -> None:
        """Let time pass; whatever was due on the way happens at its moment, in order."""
        while (moment_s := self._next_event_s()) is not None and moment_s <= now_s:
            self.now_s = max(self.now_s, moment_s)
            if self._mishaps and self._mishaps[0][0] == moment_s:
                self.mishap(self._mishaps.pop(0)[1])
            elif self._power_comes_s == moment_s:
                self.arm_power, self._power_comes_s = True, None
            else:
                self._step("")
        self.now_s = max(self.now_s, now_s)

    def next_moment_s(self) -> float | None:
        """When `tick` or `output` next has something to do; None: not before something is typed."""
        moments = [self._next_event_s(), self._output[0][0] if self._output else None]
        return min((moment for moment in moments if moment is not None), default=None)

    @property
    def half_typed(self) -> str:
        """What stands in the line that nobody has ended yet."""
        return self._terminal.typed

    @property
    def question(self) -> str | None:
        """What it asks, and waits for an answer to."""
        return self._waits_for.question if isinstance(self._waits_for, Ask) else None

    # What may happen to it

    def abort(self) -> None:
        """Brake, forget what runs and what was typed ahead; the prompt comes when the arm is at rest."""
        self.arm.halt(self.now_s)
        self._drop()
        self._start(come_to_rest(self))

    def mishap(self, what: Mishap) -> None:
        """Something happens to the machine, now."""
        if what is Mishap.DEAD:
            self.arm.halt(self.now_s, EMERGENCY_BRAKING)
            self.alive = False
            return
        self.arm.halt(self.now_s, EMERGENCY_BRAKING)
        self.arm_power = False
        if what is Mishap.POWER_CYCLED:
            self.power_cycle()
            return
        self._drop()
        message = {
            Mishap.POWER_LOST: "*Arm power off*",
            Mishap.EMERGENCY_STOP: "*Emergency stop*",
            Mishap.ENVELOPE_ERROR: "*Envelope error* Joint 2",
        }[what]
        self.say(message)
        self._print_prompt()

    def power_cycle(self) -> None:
        """The mains go off and on: nothing is remembered, the arm is not calibrated, the power-up dialogue begins."""
        self.arm.halt(self.now_s, EMERGENCY_BRAKING)
        self._drop()
        self.memory, self.speed_percent, self.wanted = Memory(), 100.0, Configuration()
        self.arm.tool = np.eye(4)
        self.arm_power = self.calibrated = False
        self.alive = True
        self._terminal.clear()
        self._start(monitor.power_up(self))

    def switch_arm_power_on(self) -> None:
        """The button on the panel."""
        self.arm_power = True

    # For the commands

    def say(self, text: str) -> None:
        """Print a line."""
        if not self._at_line_start:
            self._emit(b"\r\n")
        self._emit(text.encode("ascii", "replace") + b"\r\n")

    def move_started(self) -> None:
        """The arm was set in motion: a mishap waiting for a move gets its moment."""
        if self.faults.in_move:
            share, what = self.faults.in_move.pop(0)
            self._mishaps = [(self.now_s + share * (self.arm.rests_s - self.now_s), what)]

    def arm_power_was_missing(self) -> None:
        """CAL was refused for want of arm power: somebody may come and switch it on."""
        if self.manners.arm_power_after_s is not None:
            self._power_comes_s = self.now_s + self.manners.arm_power_after_s

    # Inside

    def _next_event_s(self) -> float | None:
        moments = [moment for moment, _ in self._mishaps[:1]]
        moments += [self._waits_for.until_s] if isinstance(self._waits_for, Wait) else []
        moments += [self._power_comes_s] if self._power_comes_s is not None else []
        return min(moments, default=None)

    def _take_line(self, text: str) -> None:
        self.lines.append(text)
        if self.faults.mute_answers > 0:
            self.faults.mute_answers -= 1
            self._muted = True
        if isinstance(self._waits_for, Ask):
            self._step(text)
        elif self._running is None:
            self._start(monitor.run(self, text))
        elif monitor.is_abort(text):
            self.abort()
        else:
            self._ahead.append(text)

    def _start(self, command: Command) -> None:
        self._running, self._waits_for = command, None
        self._step(None)

    def _step(self, answer: str | None) -> None:
        """Let the running command go on to its next wait or question, or to its end and the prompt."""
        command = self._running
        assert command is not None
        try:
            waits_for = next(command) if answer is None else command.send(answer)
        except StopIteration:
            self._finish()
        except MonitorError as error:
            self.say(str(error))
            self._finish()
        else:
            self._waits_for = waits_for
            if isinstance(waits_for, Ask):
                self._ask(waits_for)

    def _finish(self) -> None:
        self._running = self._waits_for = None
        if self._ahead:
            self._start(monitor.run(self, self._ahead.popleft()))
        else:
            self._print_prompt()

    def _ask(self, ask: Ask) -> None:
        if self._ahead:
            self._step(self._ahead.popleft())
            return
        if not self._at_line_start:
            self._emit(b"\r\n")
        self._emit(ask.question.encode("ascii") + b" ")

    def _again(self) -> None:
        """After a line was taken back: the prompt or the question once more."""
        if isinstance(self._waits_for, Ask):
            self._ask(self._waits_for)
        elif self._running is None:
            self._print_prompt()

    def _drop(self) -> None:
        if self._running is not None:
            self._running.close()
        self._running = self._waits_for = None
        self._ahead.clear()
        self._mishaps.clear()

    def _print_prompt(self) -> None:
        if not self._at_line_start:
            self._emit(b"\r\n")
        self._emit(b".", self.now_s + self.faults.split_prompt_s)
        self._muted = False

    def _emit(self, data: bytes, not_before_s: float = 0.0) -> None:
        if not data or not self.alive:
            return
        self._at_line_start = data.endswith(b"\n")
        if self._muted:
            return
        held_s = self._output[-1][0] if self._output else 0.0
        self._output.append((max(held_s, not_before_s), self.faults.harm(data, "to_host")))
