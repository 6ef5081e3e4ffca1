"""The steps and findings of a first contact: an exchange with the controller, a message or question to the person, and
what was found so far. No I/O. first_contact.py has the order of the steps.
"""

import re
from collections.abc import Generator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, ClassVar, Literal

from drivers.val2.conversation import POISON
from drivers.val2.location import apart
from drivers.val2.wire import ControllerQuestion, Error, Prompt, Reader, Text, Where, WhereTable

Sure = Literal["certain", "likely", "assumed"]
STOP_WORDS = ("ABORT", "PANIC")
"""VAL's stop command, and that of systems whose ABORT lets a motion finish."""
CAREFUL_S = 0.05
"""The pause between characters as long as the shortest possible pause is unknown."""
QUIET_S, PATIENCE_S = 0.15, 3.0
REST_MM, REST_DEG = 0.15, 0.02


@dataclass(frozen=True)
class Exchange:
    """Send data with pace_s between characters; then receive until something came and quiet_s passed without more, or
    for at most most_s."""

    data: bytes
    quiet_s: float = QUIET_S
    most_s: float = PATIENCE_S
    pace_s: float = 0.0


@dataclass(frozen=True)
class Heard:
    """What was received: pieces, each with the seconds since the last byte was sent; seconds: the whole time."""

    pieces: tuple[tuple[float, bytes], ...]
    seconds: float

    @property
    def data(self) -> bytes:
        return b"".join(piece for _, piece in self.pieces)


@dataclass(frozen=True)
class Tell:
    """A message to the person."""

    way: ClassVar = "says"
    text: str


@dataclass(frozen=True)
class Consult:
    """A question to the person, answered by one word. about: its subject."""

    way: ClassVar = "asks"
    about: Literal["power-up", "move", "power", "calibrate", "pendant"]
    text: str


@dataclass(frozen=True)
class Speed:
    """Reopen the line at this speed."""

    way: ClassVar = "speed"
    baud: int

    @property
    def text(self) -> str:
        """The step as text, for a transcript."""
        return str(self.baud)


Step = Exchange | Tell | Consult | Speed
Steps = Generator[Step, Any, Any]


class UnclearError(Exception):
    """A property of the controller could not be determined; the message says what was seen and what the person must do.
    Nothing moves."""


@dataclass(frozen=True)
class ProbeFinding:
    """One finding: name is the dialect's key, if there is one. sure: certain (seen), likely, or assumed."""

    name: str
    value: Any
    found: str
    sure: Sure


@dataclass(frozen=True)
class ProbeAnswer:
    """One answer of the controller, parsed."""

    raw: bytes
    lines: tuple[str, ...]
    errors: tuple[str, ...]
    where: Where | None
    prompt: str
    question: str | None
    prompt_s: float
    """Seconds from the line's end to the prompt."""
    late_s: float
    """Seconds from the end of the output to the prompt."""


@dataclass
class ContactFindings:
    """What was found so far. findings: by name; readings: WHERE of the arm at rest, location and joints."""

    findings: dict[str, ProbeFinding] = field(default_factory=dict)
    readings: list[Where] = field(default_factory=list)
    moved: bool = False
    end: bytes = b"\r"
    pace_s: float = CAREFUL_S
    stop_word: str = STOP_WORDS[0]

    @property
    def stop_bytes(self) -> bytes:
        """The bytes that stop the arm, as far as was found; a half-typed line first becomes an error."""
        words = [self.stop_word, *(word for word in STOP_WORDS if word != self.stop_word)]
        return b"".join(part + self.end for part in (POISON, *(word.encode() for word in words)))

    def found(self, name: str, value: Any, how: str, sure: Sure = "certain") -> None:
        """Store a finding."""
        self.findings[name] = ProbeFinding(name, value, how, sure)

    def dialect(self) -> dict[str, Any]:
        """The findings that are settings of the dialect, as values by key."""
        return {name: finding.value for name, finding in self.findings.items() if name not in SEEN_ALONE}


SEEN_ALONE = frozenset(
    {"prompt", "newline", "lower_case", "abbreviations", "where", "digits", "errors", "power_up",
     "two_prompts", "stop_s"}
)  # fmt: skip
"""Findings that are only reported and are no settings of the dialect: the driver works either way."""


def ask(known: ContactFindings, text: str, most_s: float = PATIENCE_S) -> Generator[Step, Any, ProbeAnswer]:
    """Type a line and read its answer, up to the prompt or a question, or for at most most_s."""
    body = text.encode("ascii")
    return (yield from listen(known, body + known.end, body, most_s))


def listen(known: ContactFindings, data: bytes, typed: bytes, most_s: float) -> Generator[Step, Any, ProbeAnswer]:
    """Type something and read the output until the line is silent, or for at most most_s."""
    pieces: list[tuple[float, bytes]] = []
    waited_s = 0.0
    step = Exchange(data, QUIET_S, most_s, known.pace_s)
    while True:
        heard: Heard = yield step
        pieces += [(waited_s + at_s, piece) for at_s, piece in heard.pieces]
        waited_s += heard.seconds
        answer = _read(pieces, typed)
        if answer.prompt or answer.question or waited_s >= most_s - 1e-6:
            return answer
        step = Exchange(b"", QUIET_S, most_s - waited_s)


def _read(pieces: Sequence[tuple[float, bytes]], typed: bytes) -> ProbeAnswer:
    raw = b"".join(piece for _, piece in pieces)
    # An echo comes first, or behind a late prompt; later, the same letters are the controller's own: `(Y/N)?`.
    received = re.sub(rb"^([\s.]*)" + re.escape(typed), rb"\1", raw, count=1)
    reader = Reader()
    reader.line_ended(echoed=False)
    events = reader.receive(received) + reader.silence()
    errors = tuple(event.text for event in events if isinstance(event, Error))
    tables = [event.where for event in events if isinstance(event, WhereTable)]
    last = events[-1] if events else None
    tail = received.decode("latin-1").rsplit("\n", 1)[-1].rsplit("\r", 1)[-1]
    at = [at_s for at_s, _ in pieces]
    late_s = max((after - before for before, after in pairwise(at)), default=0.0)
    return ProbeAnswer(
        raw=raw,
        lines=tuple(event.text for event in events if isinstance(event, Text | Error)),
        errors=errors,
        where=tables[-1] if tables else None,
        prompt=tail if isinstance(last, Prompt) else "",
        question=last.text if isinstance(last, ControllerQuestion) else None,
        prompt_s=at[-1] if at else 0.0,
        late_s=late_s,
    )


def errors_in(raw: bytes) -> tuple[str, ...]:
    """The controller's error messages (`*...*`) in what it printed."""
    return tuple(line.strip() for line in raw.decode("latin-1").replace("\r", "\n").split("\n") if "*" in line)


def at_rest(known: ContactFindings) -> Steps:
    """WHERE until two in a row agree. Raises UnclearError."""
    before: Where | None = None
    for _ in range(40):
        answer = yield from ask(known, "WHERE", 5.0)
        if answer.where is not None and before is not None and same_place(before, answer.where):
            return answer.where
        before = answer.where or before
        yield Exchange(b"", 0.2, 0.2)
    raise UnclearError("WHERE goes on changing: the arm moves. Does the controller run a program? Stop it at the panel")


def same_place(before: Where, now: Where) -> bool:
    """Whether two WHERE show an arm at rest."""
    off_mm, off_deg = apart(before.location, now.location)
    return off_mm <= REST_MM and off_deg <= 5 * REST_DEG and now.turned_deg(before) <= REST_DEG


def agreed(about: Literal["move", "power", "calibrate", "pendant"], text: str) -> Generator[Step, Any, bool]:
    """Whether the person says yes to it: any other reply is no."""
    reply = yield Consult(about, f"{text}. (yes or no)")
    return str(reply).strip().lower() in ("y", "yes")
