"""A first contact with a controller nobody knows: it finds out how it speaks instead of asking. No I/O, no clock.

`introduce` is a generator: it yields what is to be done (Exchange: send, and listen; Tell; Consult: ask the person) and
is sent what came of it. Whoever runs it has the port and the time, and sends `stop_bytes` at once when a stop is
wanted, whatever is being done.

    step         what is typed                       what is found
    wake         what is an error anywhere, an end   line end, prompt, form of errors, a power-up question
    power-up     what the person says                its questions
    listen       WHERE, in pieces, in other cases    echo, form and digits of WHERE, case, abbreviations, pace
    stop words   the words that stop, at rest        which it takes
    moves        with the person's yes alone:        whether the word stops a motion; when the prompt comes; readings
                 2 degrees of one joint, slowly
    pendant      where it is wanted: WHERE alone         readings far apart, that the person brings the arm to

Nothing that could move the arm is typed before the person's yes, and each move is `_step`: one joint, STEP_DEG, held
against WHERE before the next. The first is cut short by the stop; where the arm does not come to rest short of its end,
no other follows.
"""

from __future__ import annotations

from collections.abc import Generator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise, product
from typing import Any, Literal

from drivers.val2.conversation import POISON
from drivers.val2.dialect import Dialect
from drivers.val2.location import apart
from drivers.val2.wire import NUMBER, Error, Prompt, Question, Reader, Table, Text, Where

Sure = Literal["certain", "likely", "assumed"]
STOP_WORDS = ("ABORT", "PANIC")
"""VAL's, and the one of the systems whose ABORT lets a motion finish."""
ENDS = (b"\r", b"\n", b"\r\n")
BAUDS = (9600, 4800, 19200, 2400, 1200, 300, 38400)
PACES_S = (0.0, 0.006, 0.012, 0.03)
CAREFUL_S = 0.05
"""Between characters, as long as it is not known how close they may follow."""
MARGIN = 2.0
"""A pause that was enough once, so many times: adapters and computers send characters in clusters."""
QUIET_S, PATIENCE_S, MOTION_S = 0.15, 3.0, 30.0
STEP_DEG, ROUNDS, SPEED, SHARE = 2.0, (1.0, 1.0, -1.0, -1.0), 20, 1
"""A move: so many degrees; there and back; at so many percent of the monitor speed of so many percent."""
VAL_DIGITS = 2, 3
FINE_DIGITS = 2
"""WHERE with fewer behind its points is read to the other side as well: twice as far apart, twice as often."""
FIRST_JOINT, CUT_AFTER_S = 6, 0.2
ENOUGH, APART_DEG = 12, 5.0
BY_PENDANT = (
    "Bring the arm with the pendant to another place, far from the others, each joint turned by 20 degrees or more, "
    "and say yes once it rests; no, when these are enough"
)
OFF_DEG, REST_MM, REST_DEG = 0.15, 0.15, 0.02
USUAL = Dialect()


@dataclass(frozen=True)
class Exchange:
    """Send data, pace_s between characters; then listen until something came and then nothing for quiet_s, or for
    most_s."""

    data: bytes
    quiet_s: float = QUIET_S
    most_s: float = PATIENCE_S
    pace_s: float = 0.0


@dataclass(frozen=True)
class Heard:
    """What came, each piece with the seconds since the last byte was sent; seconds: how long was listened."""

    pieces: tuple[tuple[float, bytes], ...]
    seconds: float

    @property
    def data(self) -> bytes:
        """All of it."""
        return b"".join(piece for _, piece in self.pieces)


@dataclass(frozen=True)
class Tell:
    """A line for the person."""

    text: str


@dataclass(frozen=True)
class Consult:
    """A question for the person: answered by a word. about: what for, `power-up`, `move`, `power` or `pendant`."""

    about: Literal["power-up", "move", "power", "pendant"]
    text: str


@dataclass(frozen=True)
class Speed:
    """Open the line anew at so many baud."""

    baud: int


Step = Exchange | Tell | Consult | Speed
Steps = Generator[Step, Any, Any]


class UnclearError(Exception):
    """It could not be found out; the message says what was seen and asks what the person must do. Nothing moves."""


@dataclass(frozen=True)
class Finding:
    """One thing found: name is a key of the dialect where it has one. sure: certain (seen), likely, or assumed."""

    name: str
    value: Any
    found: str
    sure: Sure


@dataclass(frozen=True)
class Answer:
    """One answer, read."""

    raw: bytes
    lines: tuple[str, ...]
    errors: tuple[str, ...]
    where: Where | None
    prompt: str
    question: str | None
    prompt_s: float
    """When the prompt came, after the line was sent."""
    late_s: float
    """How long after what was said before it."""


@dataclass
class Acquaintance:
    """What is known so far. findings, by name; readings: WHEREs at rest, places and joints together."""

    findings: dict[str, Finding] = field(default_factory=dict)
    readings: list[Where] = field(default_factory=list)
    moved: bool = False
    end: bytes = b"\r"
    pace_s: float = CAREFUL_S
    stop_word: str = STOP_WORDS[0]

    @property
    def stop_bytes(self) -> bytes:
        """What stops the arm, as far as is known: whatever stands in the line first becomes an error."""
        words = [self.stop_word, *(word for word in STOP_WORDS if word != self.stop_word)]
        return b"".join(part + self.end for part in (POISON, *(word.encode() for word in words)))

    def found(self, name: str, value: Any, how: str, sure: Sure = "certain") -> None:
        """Keep one thing."""
        self.findings[name] = Finding(name, value, how, sure)

    def dialect(self) -> dict[str, Any]:
        """The values that are keys of the dialect."""
        return {name: finding.value for name, finding in self.findings.items() if name not in SEEN_ALONE}


SEEN_ALONE = frozenset(
    {"prompt", "newline", "lower_case", "abbreviations", "where", "digits", "errors", "power_up",
     "two_prompts", "stop_s"}
)  # fmt: skip
"""What is told, and is no key of the dialect: the driver is right either way."""


def introduce(known: Acquaintance, bauds: Sequence[int] = BAUDS, pendant: bool = False) -> Steps:
    """The whole first contact; fills `known`. bauds: speeds of the line to be tried; pendant: whether the person brings
    the arm to more places. Raises UnclearError."""
    yield from _wake(known, bauds)
    yield from _line(known)
    yield from _stop_words(known)
    if (yield from _may_move(known)):
        yield from _moves(known)
    if pendant:
        yield from _by_pendant(known)
    _all_digits(known)


# What answers, and how its lines end


def _wake(known: Acquaintance, bauds: Sequence[int]) -> Steps:
    heard = b""
    for baud, end in product(bauds, ENDS):
        known.end = end
        if end == ENDS[0]:
            yield Speed(baud)
            yield Exchange(b"", 0.5, 0.5)
        answer = yield from _ask(known, POISON.decode())
        if answer.prompt:  # one that was on its way when this was typed is no answer to it
            answer = yield from _ask(known, POISON.decode())
        if answer.prompt or answer.question:
            break
        heard = heard or answer.raw
    else:
        raise UnclearError(_silent(heard))
    known.found("baud", baud, "the speed at which it was understood")
    known.found("line_end", end.decode(), f"a line that ended in {end!r} was answered")
    asked: list[str] = []
    while answer.question is not None:
        asked.append(answer.question)
        if len(asked) > 8:
            raise UnclearError(
                f"it asks again and again: {answer.question!r}. What does its manual want to hear there?"
            )
        said = yield Consult("power-up", f"The controller asks: {answer.question}  What shall I answer?")
        answer = yield from _ask(known, said, 60.0)
    known.found("power_up", asked, "asked before the first prompt" if asked else "it asked nothing: it was on already",
                "certain" if asked else "assumed")  # fmt: skip
    if not all(map(USUAL.asks_after_power_up, asked)):
        known.found("power_up_asks", [*USUAL.power_up_asks, *asked], "asked before the first prompt")
    if asked:
        answer = yield from _ask(known, POISON.decode())
    if not answer.prompt:
        raise UnclearError(f"no prompt after a line; it said {answer.raw!r}. Is a program running, or the arm at work?")
    if not answer.errors:
        raise UnclearError(
            f"{POISON.decode()!r} is no command anywhere, and was answered by {answer.raw!r} instead of an error "
            "between asterisks. Is this a VAL controller's terminal line?"
        )
    known.found("errors", answer.errors[0], f"the answer to {POISON.decode()!r}")
    known.found("prompt", answer.prompt, "what stood behind the answer, alone on its line")
    known.found("prompt_late_s", round(answer.late_s, 2), "seconds between the answer and its prompt")
    known.found("resync_s", round(max(1.0, 2.0 * answer.late_s + 0.5), 1), "twice that, and some", "likely")
    breaks = answer.raw.replace(POISON, b"").strip(b" .")
    newline = next((end for end in (b"\r\n", b"\n\r", b"\r", b"\n") if end in breaks), b"\r\n")
    known.found("newline", newline.decode(), "between its lines")


def _silent(raw: bytes) -> str:
    if raw:
        return (
            f"it answers {raw!r} and gives no prompt: the line's framing is another (its manual and the switches on "
            "its serial board tell), or it is at work: is the arm moving?"
        )
    return (
        "nothing answers at any speed: is the controller on, the cable in its terminal port, and are its wires 2 and 3"
        "  crossed? Nothing was sent but ends of lines and words that stop"
    )


# How it reads what is typed, and prints


def _line(known: Acquaintance) -> Steps:
    heard: Heard = yield Exchange(b"WHERE", 0.3, 1.0, CAREFUL_S)
    if b"WWHHEERREE" in heard.data:
        raise UnclearError(
            "what is typed comes back twice: the converter on the line echoes by itself, and what the controller read "
            "cannot be told from it. Where is the converter's switch for that?"
        )
    echo = b"WHERE" in heard.data
    known.found("echo", echo, "what was typed " + ("came back" if echo else "did not come back"))
    answer = yield from _listen(known, known.end, b"", 5.0)
    if answer.where is None:
        raise UnclearError(
            f"WHERE was answered by {answer.raw!r}: six numbers under X Y Z O A T and six under JT1 to JT6 were "
            "expected. Which word shows the location here?"
        )
    text = answer.raw.decode("latin-1")
    known.found("where", "one header" if "X/JT1" in text.upper() else "two headers", "WHERE")
    digits = _digits(text)
    known.found("digits", digits, "behind the points of WHERE: lengths, angles")
    if not min(digits):
        raise UnclearError(
            f"WHERE prints whole numbers ({' '.join(answer.raw.decode('latin-1').split())}): nothing can be steered to "
            "what is not shown. Is the arm where they happen to be whole? Then turn each joint a little with the "
            "pendant, and say it again. Else: can the controller be set to print decimals?"
        )
    for name, printed in zip(("same_place_mm", "same_place_deg"), digits, strict=True):
        if printed < FINE_DIGITS + (name == "same_place_deg"):
            known.found(name, 2 * 10.0**-printed, "two of the last digit of WHERE", "likely")
    before = answer.where
    answer = yield from _ask(known, "WHERE", 5.0)
    if answer.where is None or not _same(before, answer.where):
        raise UnclearError("two WHERE in a row differ: the arm moves, or the line spoils digits. Is it at rest?")
    known.readings.append(answer.where)
    for name, typed in (("lower_case", "where"), ("abbreviations", "WHER")):
        answer = yield from _ask(known, typed, 5.0)
        known.found(name, answer.where is not None, f"{typed!r} was {'taken' if answer.where else 'refused'}")
    if not known.findings["abbreviations"].value:
        known.found("calibrate_word", "CALIBRATE", "it wants words whole; nothing that moves is tried", "assumed")
    yield Exchange(POISON + b"\x15", 0.3, 1.0, CAREFUL_S)
    answer = yield from _ask(known, "WHERE", 5.0)
    cancels = answer.where is not None
    known.found(
        "cancel_line", "\x15" if cancels else "", f"control-U {'takes' if cancels else 'does not take'} a line back"
    )
    answer = yield from _listen(known, b"\r\n", b"", PATIENCE_S)
    dots = answer.raw.count(b".")
    known.found(
        "two_prompts", dots > known.findings["prompt"].value.count("."), f"CR LF was answered by {answer.raw!r}"
    )
    yield from _pace(known)
    answer = yield from _ask(known, "DO BREAK")
    known.found("break_after_move", not answer.errors, f"DO BREAK was {'refused' if answer.errors else 'taken'}")


def _pace(known: Acquaintance) -> Steps:
    for pace_s in PACES_S:
        known.pace_s, whole = pace_s, True
        for _ in range(3):
            answer = yield from _ask(known, "WHERE", 5.0)
            whole = whole and answer.where is not None and not answer.errors
            if not whole:
                break
        if whole:
            known.pace_s = min(MARGIN * pace_s, CAREFUL_S)
            how = f"WHERE was understood three times with {pace_s:g} s between its characters"
            known.found(
                "character_pause_s", known.pace_s, how + " (adapters hold some back)" * (pace_s > 0.0), "likely"
            )
            return
        known.pace_s = CAREFUL_S
        yield from _ask(known, POISON.decode())
    known.found("character_pause_s", CAREFUL_S, "at a quicker pace characters were lost", "likely")


# The stop


def _stop_words(known: Acquaintance) -> Steps:
    taken = []
    for word in STOP_WORDS:
        answer = yield from _ask(known, word)
        if not answer.errors and answer.prompt:
            taken.append(word)
    if not taken:
        raise UnclearError(
            f"it takes none of {', '.join(STOP_WORDS)}. Which word stops the arm here? Nothing was moved"
        )
    known.stop_word = taken[0]
    known.found("abort_word", taken[0], f"taken at rest: {', '.join(taken)}", "likely")
    known.found("stop_words", tuple(taken), "taken at rest")


def _may_move(known: Acquaintance) -> Steps:
    said = yield Consult(
        "move",
        f"May I turn one joint after the other by {STEP_DEG:g} degrees, there and back, slowly? It takes some minutes. "
        "The arm must stand clear of everything by 25 cm, its wrist bent, nobody within reach, your hand on "
        "the emergency stop. (yes or no)",
    )
    return str(said).strip().lower() in ("y", "yes")


# Moves


def _moves(known: Acquaintance) -> Steps:
    yield from _ask(known, f"SPEED {SPEED}")
    here = yield from _rest(known)
    words = known.findings.pop("stop_words").value
    for word in words:
        known.stop_word = word
        short, here, seconds = yield from _cut_short(known, here)
        if short:
            known.found("abort_word", word, "it brought a moving joint to rest short of its end")
            known.found("stop_s", round(seconds, 1), "seconds until two WHERE agreed")
            break
        yield Tell(f"{word} let the motion finish: that is not a stop.")
    else:
        raise UnclearError(
            f"{' and '.join(words)} let a motion finish: which word stops the arm here? Joint {FIRST_JOINT} turned by "
            f"{STEP_DEG:g} degrees; nothing else was moved"
        )
    known.readings[:] = [here]
    early: list[bool] = []
    coarse = min(known.findings["digits"].value) < FINE_DIGITS
    for sign in ROUNDS + tuple(-sign for sign in ROUNDS) * coarse:
        for joint in range(1, 7):
            here = yield from _step(known, here, joint, sign * STEP_DEG, early)
            known.readings.append(here)
    known.found("prompt_after_move", "start" if any(early) else "end",
                f"{sum(early)} of {len(early)} prompts came before the joint was there")  # fmt: skip


def _by_pendant(known: Acquaintance) -> Steps:
    """WHERE wherever the person brings the arm, until it is enough: far apart they tell lengths that small steps leave
    open."""
    taken = 0
    while True:
        said = yield Consult("pendant", f"{BY_PENDANT}: {taken} so far, {ENOUGH} are good. (yes or no)")
        if str(said).strip().lower() not in ("y", "yes"):
            return
        here = yield from _rest(known)
        near = min((here.turned_deg(there) for there in known.readings), default=APART_DEG)
        if near < APART_DEG:
            yield Tell(f"all joints are within {near:.1f} degrees of a place that is known: farther, please")
            continue
        taken += 1
        known.readings.append(here)


def _all_digits(known: Acquaintance) -> None:
    """What WHERE prints behind its points, of all readings: one may show fewer where zeros are left out."""
    shown = [[len(repr(value).rstrip("0").partition(".")[2]) for value in (*where.location.values(), *where.joints_deg)]
             for where in known.readings]  # fmt: skip
    lengths, angles = known.findings["digits"].value
    digits = max(max(row[:3]) for row in shown) or lengths, max(max(row[3:]) for row in shown) or angles
    known.found("digits", digits, "behind the points of all WHEREs: lengths, angles")


def _drive(joint: int, degrees: float) -> str:
    """The only text that moves. Raises ValueError beyond one small step."""
    if joint not in range(1, 7) or abs(degrees) > STEP_DEG:
        raise ValueError(f"joint {joint} by {degrees} degrees is no small step")
    return f"DO DRIVE {joint},{degrees:g},{SHARE}"


def _cut_short(known: Acquaintance, here: Where) -> Steps:
    """Begin a step and stop it at once: whether it ended short, where, and how many seconds that took."""
    yield Tell(f"joint {FIRST_JOINT} by {STEP_DEG:g} degrees, cut short by {known.stop_word}")
    for _ in range(3):
        misread = False
        for sign in (1.0, -1.0):
            known.moved = True
            yield from _typed(known, _drive(FIRST_JOINT, sign * STEP_DEG))
            began: Heard = yield Exchange(known.end, CUT_AFTER_S, CUT_AFTER_S)
            answer = yield from _ask(known, known.stop_word, MOTION_S)
            errors = _errors(began.data) + answer.errors
            there = yield from _rest(known)
            turned = abs(there.joints_deg[FIRST_JOINT - 1] - here.joints_deg[FIRST_JOINT - 1])
            if not errors:
                if turned < OFF_DEG / 3:
                    continue
                return turned < STEP_DEG - OFF_DEG, there, answer.prompt_s
            if any(f"JOINT {FIRST_JOINT}" in error.upper() for error in errors):
                continue  # it stands near that end of its range: the other way
            if all("illegal command" in error.lower() for error in errors):
                # What was typed before was taken: a character was lost, on the way there or on the way to the stop.
                known.pace_s, misread, here = CAREFUL_S, True, there
                known.found("character_pause_s", CAREFUL_S, "at a quicker pace a command was spoilt", "likely")
                continue
            break
        else:
            if misread:
                raise UnclearError(
                    f"{_drive(FIRST_JOINT, STEP_DEG)} and {known.stop_word}, typed slowly, are answered by "
                    f"{'; '.join(errors) or 'nothing'}: is it another system, or noise on the line?"
                )
            raise UnclearError(f"joint {FIRST_JOINT} does not turn; is the arm held, or its brake on?")
        said = yield Consult(
            "power", f"The controller says {'; '.join(errors)}. Put that right, then say yes. (yes or no)"
        )
        if str(said).strip().lower() not in ("y", "yes"):
            break
    raise UnclearError(f"the arm does not move: the controller says {'; '.join(errors)}. What does it need?")


def _step(known: Acquaintance, here: Where, joint: int, degrees: float, early: list[bool]) -> Steps:
    """One step and the WHERE after it; only that joint may have turned, by that. Raises UnclearError."""
    yield Tell(f"joint {joint} by {degrees:+g} degrees")
    answer = yield from _moved(known, _drive(joint, degrees))
    if answer.errors:
        yield Tell(f"it says {'; '.join(answer.errors)}: the other way")
        degrees = -degrees
        answer = yield from _moved(known, _drive(joint, degrees))
    if answer.errors:
        raise UnclearError(
            f"joint {joint} cannot be turned: the controller says {'; '.join(answer.errors)}. What does it need?"
        )
    first = yield from _ask(known, "WHERE", 5.0)
    there = yield from _rest(known)
    if first.where is not None:
        early.append(abs(first.where.joints_deg[joint - 1] - there.joints_deg[joint - 1]) > OFF_DEG / 3)
    off = [now - before - (degrees if k == joint else 0.0)
           for k, (before, now) in enumerate(zip(here.joints_deg, there.joints_deg, strict=True), 1)]  # fmt: skip
    if max(map(abs, off)) > OFF_DEG:
        turned = ", ".join(f"{now - was:.2f}" for was, now in zip(here.joints_deg, there.joints_deg, strict=True))
        raise UnclearError(
            f"joint {joint} was to turn by {degrees:+g} degrees, and the joints turned by {turned}. What holds them?"
        )
    return there


def _typed(known: Acquaintance, text: str) -> Steps:
    """The characters without their end, and, of a controller that echoes, a look at the echo. Raises UnclearError."""
    for _ in range(3):
        heard: Heard = yield Exchange(text.encode(), 0.1, _typing_s(known, text), known.pace_s)
        if not known.findings["echo"].value or heard.data.endswith(text.encode()):
            return
        yield from _ask(known, POISON.decode())
    raise UnclearError(f"{text!r} came back as {heard.data!r}, three times, and was not ended: noise on the line?")


def _typing_s(known: Acquaintance, text: str) -> float:
    """Long enough for characters and their echo."""
    return 0.5 + 20.0 * len(text) / float(known.findings["baud"].value)


def _moved(known: Acquaintance, text: str) -> Generator[Step, Any, Answer]:
    yield from _typed(known, text)
    return (yield from _listen(known, known.end, b"", MOTION_S))


def _rest(known: Acquaintance) -> Steps:
    """WHERE until two in a row agree. Raises UnclearError."""
    before: Where | None = None
    for _ in range(40):
        answer = yield from _ask(known, "WHERE", 5.0)
        if answer.where is not None and before is not None and _same(before, answer.where):
            return answer.where
        before = answer.where or before
        yield Exchange(b"", 0.2, 0.2)
    raise UnclearError("the arm does not come to rest by its own WHERE. Is it at work on a program?")


# One line and its answer


def _ask(known: Acquaintance, text: str, most_s: float = PATIENCE_S) -> Generator[Step, Any, Answer]:
    """Type a line and read its answer, up to the prompt or a question; what is missing by then is missing."""
    body = text.encode("ascii")
    return (yield from _listen(known, body + known.end, body, most_s))


def _listen(known: Acquaintance, data: bytes, typed: bytes, most_s: float) -> Generator[Step, Any, Answer]:
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


def _read(pieces: Sequence[tuple[float, bytes]], typed: bytes) -> Answer:
    raw = b"".join(piece for _, piece in pieces)
    said = raw.replace(typed, b"", 1) if typed else raw
    reader = Reader()
    reader.line_ended(echoed=False)
    events = reader.receive(said) + reader.silence()
    errors = tuple(event.text for event in events if isinstance(event, Error))
    tables = [event.where for event in events if isinstance(event, Table)]
    last = events[-1] if events else None
    tail = said.decode("latin-1").rsplit("\n", 1)[-1].rsplit("\r", 1)[-1]
    at = [at_s for at_s, _ in pieces]
    late_s = max((after - before for before, after in pairwise(at)), default=0.0)
    return Answer(
        raw=raw,
        lines=tuple(event.text for event in events if isinstance(event, Text | Error)),
        errors=errors,
        where=tables[-1] if tables else None,
        prompt=tail if isinstance(last, Prompt) else "",
        question=last.text if isinstance(last, Question) else None,
        prompt_s=at[-1] if at else 0.0,
        late_s=late_s,
    )


def _errors(raw: bytes) -> tuple[str, ...]:
    return tuple(line.strip() for line in raw.decode("latin-1").replace("\r", "\n").split("\n") if "*" in line)


def _digits(text: str) -> tuple[int, int]:
    """The most behind the points of WHERE's lengths, and of its angles; VAL's own where only the others have some: the
    arm stands where they are whole, and zeros at the end are left out."""
    decimals = [len(word.partition(".")[2]) for word in text.split() if NUMBER.fullmatch(word)]
    lengths, angles = max(decimals[:3]), max(decimals[3:6] + decimals[-6:])
    return (lengths or VAL_DIGITS[0], angles or VAL_DIGITS[1]) if lengths or angles else (0, 0)


def _same(before: Where, now: Where) -> bool:
    off_mm, off_deg = apart(before.location, now.location)
    return off_mm <= REST_MM and off_deg <= 5 * REST_DEG and now.turned_deg(before) <= REST_DEG
