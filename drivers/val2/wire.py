"""Parse a VAL II controller's output: bytes, in pieces of any length, become events. No I/O, no clock, no sending.

A dot (or several: some systems print two, and some prompt behind prompt) is a prompt only at the start of a line *and*
followed by silence, a question mark (or the choice behind it) a question only at the end of one and followed by
silence. Silence is not in the bytes: the owner of the clock calls `silence()` when it has lasted.

    state    what comes                     what happens
    LINE     bytes, CR or LF                lines -> Text, Error, WhereTable (the lines of WHERE, in either form)
    LINE     silence                        lone dots -> Prompt, also right behind the last number of WHERE;
                                            a line that ends in ? -> ControllerQuestion
    ECHO     the bytes that were typed      all of them -> Echo, state TYPED; another byte -> Garble, state LINE
    TYPED    any byte                       Garble (a doubled last character), state LINE
    ENDED    CR or LF                       state LINE; another byte -> Garble, state LINE
    any      `typed()`, `line_ended()`      state ECHO, state ENDED (with an echo) or LINE (without)
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import Enum, auto
from typing import ClassVar

from drivers.val2.location import Location

LONGEST_LINE = 256
PADDING = frozenset(b"\x00\x07\x7f")
LINE_ENDS = frozenset(b"\r\n")
LOCATION_HEADER = ["X", "Y", "Z", "O", "A", "T"]
JOINT_HEADER = ["JT1", "JT2", "JT3", "JT4", "JT5", "JT6"]
SHARED_HEADER = ["X/JT1", "Y/JT2", "Z/JT3", "O/JT4", "A/JT5", "T/JT6"]
HAND = "HAND"
QUESTION = re.compile(rb"\? *(\([^()]*\))? *$")
PROMPT_DOTS = re.compile(rb" *\.( *\.){0,9} *")
"""Of a controller that prints no line end before its prompt, the prompts to all that a stop types stand in one line:
five, of two dots each on some systems."""
NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)")
ODT_PROMPT = re.compile(rb"(^|[\r\n])@ *$")
"""The prompt of a halted LSI-11: its console (ODT) answers unknown input with `?`, and prompts with `@`."""
STOPPED = re.compile(r"program\s+(hold|stop)", re.IGNORECASE)
ROW_AND_PROMPT = re.compile(rb"(?P<row>.*(\.\d+|\d(?=\s|\.[ .]*\.)))(?P<prompt>" + PROMPT_DOTS.pattern + rb")")
"""The last row of WHERE with a prompt after it on the same line. `6.` alone may be the first half of `6.000`."""
OF_A_ROW = re.compile(r"[-+.\d\s*XYZOATJ/]+")
"""A line of WHERE's table with an asterisk in it."""


def is_halted(raw: bytes) -> bool:
    """Whether the output ends with the prompt of a halted LSI-11's console: VAL does not run."""
    return ODT_PROMPT.search(raw) is not None


@dataclass(frozen=True)
class Where:
    """The answer to WHERE: the tool's location and the six joint angles, degrees."""

    location: Location
    joints_deg: tuple[float, ...]

    def turned_deg(self, before: Where) -> float:
        """The largest rotation of a joint since another reading, degrees. With a straight wrist two joints can turn
        while the tool stays."""
        return max(abs(now - then) for now, then in zip(self.joints_deg, before.joints_deg, strict=True))


@dataclass(frozen=True)
class LineEvent:
    """A section of the controller's output. raw: its bytes; joined, the raws of all events are the whole stream. what:
    its name in the ledger, which recorded runs keep."""

    what: ClassVar[str]
    raw: bytes


@dataclass(frozen=True)
class Echo(LineEvent):
    """The typed characters came back unchanged."""

    what: ClassVar[str] = "echo"
    text: str


@dataclass(frozen=True)
class Garble(LineEvent):
    """The echo differs from the typed characters."""

    what: ClassVar[str] = "garble"
    expected: str
    got: str


@dataclass(frozen=True)
class Text(LineEvent):
    """Any other line."""

    what: ClassVar[str] = "text"
    text: str


@dataclass(frozen=True)
class Error(LineEvent):
    """A message between asterisks, known or not, or the report that the system stopped a program: a failure."""

    what: ClassVar[str] = "error"
    text: str


@dataclass(frozen=True)
class WhereTable(LineEvent):
    """A complete answer to WHERE."""

    what: ClassVar[str] = "table"
    where: Where


@dataclass(frozen=True)
class ControllerQuestion(LineEvent):
    """A question of the controller: it waits for an answer."""

    what: ClassVar[str] = "question"
    text: str


@dataclass(frozen=True)
class Prompt(LineEvent):
    """The controller's prompt: it waits for a command."""

    what: ClassVar[str] = "prompt"


class ReaderState(Enum):
    """The states of the reader: what the next byte belongs to."""

    LINE = auto()
    ECHO = auto()
    TYPED = auto()
    ENDED = auto()


class Reader:
    """Turns a controller's output into events."""

    def __init__(self) -> None:
        self.state = ReaderState.LINE
        """What the next byte belongs to."""
        self._raw = bytearray()
        self._line = bytearray()
        self._fresh = True
        self._asked: bytes | None = None
        self._expected = b""
        self._matched = 0
        self._table: list[tuple[bytes, str]] = []

    @property
    def pending(self) -> bytes:
        """The bytes since the last event."""
        return bytes(self._raw)

    @property
    def awaits_silence(self) -> bool:
        """Whether silence now would complete a prompt or a question."""
        return self.state is ReaderState.LINE and (
            self._dot_waits or self._question_waits or self._asked is not None or self._glued_prompt > 0
        )

    @property
    def _glued_prompt(self) -> int:
        """The number of newest bytes that are a prompt directly after WHERE's last number; 0: none."""
        found = ROW_AND_PROMPT.fullmatch(self._line) if self._table else None
        if found is None:
            return 0
        lines = [*(line for _, line in self._table), _text(found["row"])]
        return len(found["prompt"]) if _table_goes_on(lines[:-1], lines[-1]) and _where(lines) is not None else 0

    @property
    def _dot_waits(self) -> bool:
        return self._fresh and PROMPT_DOTS.fullmatch(self._line) is not None

    @property
    def _question_waits(self) -> bool:
        return QUESTION.search(self._line) is not None

    def typed(self, text: bytes) -> None:
        """Expect the echo of these bytes, which were just sent."""
        self.state, self._expected, self._matched = ReaderState.ECHO, text, 0

    def line_ended(self, echoed: bool = True) -> None:
        """Note that the line end was just sent."""
        self.state = ReaderState.ENDED if echoed else ReaderState.LINE
        self._fresh = not echoed

    def receive(self, data: bytes) -> list[LineEvent]:
        """Take bytes and return the events that they complete."""
        events: list[LineEvent] = []
        for byte in data:
            self._raw.append(byte)
            if byte not in PADDING:
                self._take(byte, events)
        return events

    def silence(self) -> list[LineEvent]:
        """Note a silence: a dot before it is a prompt, a question mark before it is a question."""
        events: list[LineEvent] = []
        if not self.awaits_silence:
            return events
        if glued := self._glued_prompt:
            row = _text(self._line[: len(self._line) - glued])
            self._line[:] = self._line[-glued:]
            self._continue_table(row, events, glued)
            self._fresh = True
        self._give_up_table(events)
        if self._dot_waits:
            events.append(Prompt(self._cut()))
            self._fresh = False
        elif self._question_waits:
            text = _text(self._line)
            events.append(ControllerQuestion(self._cut(), text))
            self._fresh = False
        elif self._asked is not None:
            events.append(ControllerQuestion(self._cut(), _text(self._asked)))
        self._asked = None
        return events

    def _take(self, byte: int, events: list[LineEvent]) -> None:
        if self.state is ReaderState.LINE:
            self._take_line(byte, events)
        elif self.state is ReaderState.ECHO:
            self._take_echo(byte, events)
        elif self.state is ReaderState.ENDED and byte in LINE_ENDS:
            self.state, self._fresh = ReaderState.LINE, True
        else:
            self._garbled(byte, events)

    def _take_echo(self, byte: int, events: list[LineEvent]) -> None:
        if byte != self._expected[self._matched]:
            self._garbled(byte, events)
            return
        self._matched += 1
        if self._matched == len(self._expected):
            events.append(Echo(self._cut(), _text(self._expected)))
            self.state = ReaderState.TYPED

    def _garbled(self, byte: int, events: list[LineEvent]) -> None:
        got = self._expected[: self._matched] + bytes([byte])
        events.append(Garble(self._cut(), _text(self._expected), _text(got)))
        self.state, self._fresh = ReaderState.LINE, byte in LINE_ENDS

    def _take_line(self, byte: int, events: list[LineEvent]) -> None:
        if byte in LINE_ENDS:
            self._end_line(events)
            return
        if self._asked is not None and byte != ord(" "):
            events.append(Text(self._cut(1), _text(self._asked)))
            self._asked = None
        self._line.append(byte)
        if len(self._line) >= LONGEST_LINE:
            self._give_up_table(events)
            text = _text(self._line)
            events.append(_plain(self._cut(), text))
            self._fresh = False

    def _end_line(self, events: list[LineEvent]) -> None:
        line, self._line, self._fresh = bytes(self._line), bytearray(), True
        if not line.strip():
            return
        text = _text(line)
        if self._continue_table(text, events):
            return
        if QUESTION.search(line) is not None:
            self._asked = line
            return
        events.append(_plain(self._cut(), text))

    def _continue_table(self, text: str, events: list[LineEvent], keep: int = 0) -> bool:
        """Whether the line belongs to WHERE's table. keep: the number of newest bytes that are not part of the line."""
        if not _table_goes_on([line for _, line in self._table], text):
            self._give_up_table(events)
            if not _table_goes_on([], text):
                return False
        self._table.append((self._cut(keep), text))
        where = _where([line for _, line in self._table])
        if where is not None:
            raw = b"".join(raw for raw, _ in self._table)
            self._table.clear()
            events.append(WhereTable(raw, where))
        return True

    def _give_up_table(self, events: list[LineEvent]) -> None:
        """Emit lines that only looked like a WHERE table as text."""
        events.extend(_plain(raw, text) for raw, text in self._table)
        self._table.clear()

    def _cut(self, keep: int = 0) -> bytes:
        """Take the bytes since the last event, without the newest `keep`."""
        split = len(self._raw) - keep
        cut = bytes(self._raw[:split])
        del self._raw[:split]
        if not keep:
            self._line.clear()
        return cut


def of_a_table(text: str) -> bool:
    """Whether a line is part of a WHERE table, possibly with an asterisk that noise put there."""
    if "*" in text:
        return OF_A_ROW.fullmatch(text.upper()) is not None
    words = text.upper().split()
    heads = (LOCATION_HEADER, JOINT_HEADER, SHARED_HEADER, [*SHARED_HEADER, HAND])
    return words in heads or any(_numbers(text, count) is not None for count in (6, 7))


def _plain(raw: bytes, text: str) -> LineEvent:
    return Error(raw, text) if "*" in text or STOPPED.search(text) else Text(raw, text)


def _text(line: bytes | bytearray) -> str:
    return line.decode("latin-1").strip()


def _numbers(text: str, count: int = 6) -> tuple[float, ...] | None:
    """Parse exactly `count` numbers, or return None."""
    words = text.split()
    if len(words) != count or not all(NUMBER.fullmatch(word) for word in words):
        return None
    return tuple(float(word) for word in words)


def _table_goes_on(lines: list[str], text: str) -> bool:
    """Whether a line may follow those of an answer to WHERE: twice a header and numbers, or one header for both."""
    words = text.upper().split()
    if not lines:
        return words == LOCATION_HEADER or words in (SHARED_HEADER, [*SHARED_HEADER, HAND])
    head = lines[0].upper().split()
    if len(lines) == 1:
        return _numbers(text, len(head)) is not None
    if head == LOCATION_HEADER and len(lines) == 2:
        return words == JOINT_HEADER
    return _numbers(text) is not None


def _where(lines: list[str]) -> Where | None:
    """The answer to WHERE, once all of its lines are there. The hand's opening is left out."""
    if len(lines) < (4 if lines[0].upper().split() == LOCATION_HEADER else 3):
        return None
    location, joints = (tuple(float(word) for word in line.split()[:6]) for line in (lines[1], lines[-1]))
    return Where(Location(*location), joints)
