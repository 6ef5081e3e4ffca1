"""First contact with an unknown controller: probe how it communicates, instead of asking the user. No I/O, no clock.

`introduce` is a generator: it yields the next step (Exchange: send and receive; Tell; Consult: ask the person) and is
sent the result. Its caller owns the port and the clock, and sends `stop_bytes` at once when a stop is requested,
whatever step is running.

    step         what is typed                       what is found
    wake         what is an error anywhere, an end   line end, prompt, form of errors, a power-up question
    power-up     what the person says                its questions
    listen       WHERE, in pieces, in other cases    echo, form and digits of WHERE, case, abbreviations, pace
    stop words   the words that stop, at rest        which it takes
    moves        with the person's yes alone:        whether the word stops a motion; when the prompt comes; readings
                 2 degrees of one joint, slowly
    pendant      where it is wanted: WHERE alone         readings far apart, that the person brings the arm to

Nothing that could move the arm is typed before the person's yes, and what moves it is first_contact_moves.py alone.
"""

from collections.abc import Generator, Sequence
from itertools import product
from typing import Any

from drivers.val2.contact_findings import (
    CAREFUL_S,
    PATIENCE_S,
    STOP_WORDS,
    Consult,
    ContactFindings,
    Exchange,
    Heard,
    Speed,
    Step,
    Steps,
    Tell,
    UnclearError,
    agreed,
    ask,
    at_rest,
    listen,
    same_place,
)
from drivers.val2.conversation import POISON, TWICE
from drivers.val2.dialect import Dialect
from drivers.val2.errors import HALTED
from drivers.val2.first_contact_moves import FINE_DIGITS, STEP_DEG, first_moves
from drivers.val2.wire import NUMBER, is_halted

ENDS = (b"\r", b"\n", b"\r\n")
BAUDS = (9600, 4800, 19200, 2400, 1200, 300, 38400)
PACES_S = (0.0, 0.006, 0.012, 0.03)
MARGIN = 2.0
"""Safety factor for a pause that was long enough once: adapters and computers send characters in clusters."""
VAL_DIGITS = 2, 3
ENOUGH, APART_DEG = 12, 5.0
STRAIGHT_DEG = 10.0
"""With a wrist this near to straight, joints 4 and 6 turn about one axis within the precision of WHERE."""
BY_PENDANT = (
    "Bring the arm with the pendant to another place, far from the others, each joint turned by 20 degrees or more, "
    "and say yes once it rests; no, when these are enough"
)
USUAL = Dialect()


def introduce(known: ContactFindings, bauds: Sequence[int] = BAUDS, pendant: bool = False) -> Steps:
    """The whole first contact; fills `known`. bauds: line speeds to try; pendant: whether the person moves the arm to
    more places. Raises UnclearError."""
    yield from _wake(known, bauds)
    yield from _line(known)
    yield from _stop_words(known)
    if (yield from _may_move()):
        yield from _bent_wrist(known)
        yield from first_moves(known)
    if pendant:
        yield from _by_pendant(known)
    _all_digits(known)


# What answers, and how its lines end


def _wake(known: ContactFindings, bauds: Sequence[int]) -> Steps:
    heard = b""
    for baud, end in product(bauds, ENDS):
        known.end = end
        if end == ENDS[0]:
            yield Speed(baud)
            yield Exchange(b"", 0.5, 0.5)
        answer = yield from ask(known, POISON.decode())
        if answer.prompt:  # one that was on its way when this was typed is no answer to it
            answer = yield from ask(known, POISON.decode())
        if answer.prompt or answer.question:
            break
        if is_halted(answer.raw):
            raise UnclearError(HALTED)
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
                f"it asks again and again: {answer.question!r}. Look up the right answer in its manual, then repeat "
                "the command"
            )
        reply = yield Consult("power-up", f"The controller asks: {answer.question}  What shall I answer?")
        answer = yield from ask(known, reply, 60.0)
    known.found("power_up", asked, "asked before the first prompt" if asked else "it asked nothing: it was on already",
                "certain" if asked else "assumed")  # fmt: skip
    if not all(map(USUAL.asks_after_power_up, asked)):
        known.found("power_up_asks", [*USUAL.power_up_asks, *asked], "asked before the first prompt")
    if asked:
        answer = yield from ask(known, POISON.decode())
    if not answer.prompt:
        raise UnclearError(f"no prompt after a line; it said {answer.raw!r}. Is a program running, or the arm at work?")
    if not answer.errors:
        raise UnclearError(
            f"{POISON.decode()!r} is not a command of VAL, but was answered by {answer.raw!r} instead of an error "
            "between asterisks. Is this a VAL controller's terminal line?"
        )
    known.found("errors", answer.errors[0], f"the answer to {POISON.decode()!r}")
    known.found("prompt", answer.prompt, "what came behind the answer, alone on its line")
    known.found("prompt_late_s", round(answer.late_s, 2), "seconds between the answer and its prompt")
    known.found("resync_s", round(max(1.0, 2.0 * answer.late_s + 0.5), 1), "twice that, and some", "likely")
    breaks = answer.raw.replace(POISON, b"").strip(b" .")
    newline = next((end for end in (b"\r\n", b"\n\r", b"\r", b"\n") if end in breaks), b"\r\n")
    known.found("newline", newline.decode(), "between its lines")


def _silent(raw: bytes) -> str:
    if raw:
        return (
            f"it answers {raw!r} and gives no prompt: its data bits, parity or stop bits are not 8, none and 1 (its "
            "manual and the switches on its serial board show them), or it is at work: is the arm moving?"
        )
    return (
        "nothing answers at any speed: is the controller on, the cable in its terminal port, and are its wires 2 and 3"
        "  crossed? Only line ends and stop words were sent"
    )


# How it reads what is typed, and prints


def _line(known: ContactFindings) -> Steps:
    heard: Heard = yield Exchange(b"WHERE", 0.3, 1.0, CAREFUL_S)
    if b"WWHHEERREE" in heard.data:
        raise UnclearError(f"{TWICE}, then repeat the command")
    echo = b"WHERE" in heard.data
    known.found("echo", echo, "what was typed " + ("came back" if echo else "did not come back"))
    answer = yield from listen(known, known.end, b"", 5.0)
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
            f"WHERE prints whole numbers ({' '.join(answer.raw.decode('latin-1').split())}): facetd cannot steer to "
            "what is not shown. Is the arm where they happen to be whole? Then turn each joint a little with the "
            "pendant, and say it again. Else: can the controller be set to print decimals?"
        )
    for name, printed in zip(("same_place_mm", "same_place_deg"), digits, strict=True):
        if printed < FINE_DIGITS + (name == "same_place_deg"):
            known.found(name, 2 * 10.0**-printed, "two of the last digit of WHERE", "likely")
    before = answer.where
    answer = yield from ask(known, "WHERE", 5.0)
    if answer.where is None or not same_place(before, answer.where):
        raise UnclearError("two WHERE in a row differ: the arm moves, or the line spoils digits. Is it at rest?")
    known.readings.append(answer.where)
    for name, typed in (("lower_case", "where"), ("abbreviations", "WHER")):
        answer = yield from ask(known, typed, 5.0)
        known.found(name, answer.where is not None, f"{typed!r} was {'taken' if answer.where else 'refused'}")
    if not known.findings["abbreviations"].value:
        known.found("calibrate_word", "CALIBRATE", "it wants words whole; nothing that moves is tried", "assumed")
    yield Exchange(POISON + b"\x15", 0.3, 1.0, CAREFUL_S)
    answer = yield from ask(known, "WHERE", 5.0)
    cancels = answer.where is not None
    known.found(
        "cancel_line", "\x15" if cancels else "", f"control-U {'takes' if cancels else 'does not take'} a line back"
    )
    answer = yield from listen(known, b"\r\n", b"", PATIENCE_S)
    dots = answer.raw.count(b".")
    known.found(
        "two_prompts", dots > known.findings["prompt"].value.count("."), f"CR LF was answered by {answer.raw!r}"
    )
    yield from _pace(known)
    answer = yield from ask(known, "DO BREAK")
    known.found("break_after_move", not answer.errors, f"DO BREAK was {'refused' if answer.errors else 'taken'}")


def _pace(known: ContactFindings) -> Steps:
    for pace_s in PACES_S:
        known.pace_s, whole = pace_s, True
        for _ in range(3):
            answer = yield from ask(known, "WHERE", 5.0)
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
        yield from ask(known, POISON.decode())
    known.found("character_pause_s", CAREFUL_S, "at a quicker pace characters were lost", "likely")


# The stop


def _stop_words(known: ContactFindings) -> Steps:
    taken = []
    for word in STOP_WORDS:
        answer = yield from ask(known, word)
        if not answer.errors and answer.prompt:
            taken.append(word)
    if not taken:
        raise UnclearError(
            f"it takes none of {', '.join(STOP_WORDS)}. Which word stops the arm here? Nothing was moved"
        )
    known.stop_word = taken[0]
    known.found("abort_word", taken[0], f"taken at rest: {', '.join(taken)}", "likely")
    known.found("stop_words", tuple(taken), "taken at rest")


def _may_move() -> Generator[Step, Any, bool]:
    return agreed(
        "move",
        f"May I turn one joint after the other by {STEP_DEG:g} degrees, there and back, slowly? It takes some minutes. "
        "The arm must stand clear of everything by 25 cm, its wrist bent, nobody within reach, your hand on "
        "the emergency stop",
    )


def _bent_wrist(known: ContactFindings) -> Steps:
    """Ask the person to bend a straight wrist before anything moves. At READY, where people start, it is straight: then
    joints 4 and 6 turn about one axis, and the readings fit no arm. On a controller that counts joint 5 differently, 0
    may be a bent wrist, so the person decides."""
    here = known.readings[-1]
    while abs(here.joints_deg[4]) < STRAIGHT_DEG:
        if not (
            yield from agreed(
                "pendant",
                f"Joint 5 reads {here.joints_deg[4]:.1f} degrees: the wrist is straight, as at READY, and from there "
                "nobody can tell which arm this is. Bend joint 5 with the pendant by 30 degrees or more, and say yes "
                "once it rests; no, where the wrist is bent and this controller counts joint 5 otherwise",
            )
        ):
            return
        here = yield from at_rest(known)


def _by_pendant(known: ContactFindings) -> Steps:
    """Read WHERE at each place to which the person moves the arm, until there are enough: places far apart determine
    lengths that small steps cannot."""
    taken = 0
    while True:
        if not (yield from agreed("pendant", f"{BY_PENDANT}: {taken} so far, {ENOUGH} are good")):
            return
        here = yield from at_rest(known)
        near = min((here.turned_deg(there) for there in known.readings), default=APART_DEG)
        if near < APART_DEG:
            yield Tell(f"all joints are within {near:.1f} degrees of an earlier pose: move the arm farther away")
            continue
        taken += 1
        known.readings.append(here)


def _all_digits(known: ContactFindings) -> None:
    """The number of decimals that WHERE prints, from all readings: a single one may show fewer where zeros are left
    out."""
    shown = [[len(repr(value).rstrip("0").partition(".")[2]) for value in (*where.location.values(), *where.joints_deg)]
             for where in known.readings]  # fmt: skip
    lengths, angles = known.findings["digits"].value
    digits = max(max(row[:3]) for row in shown) or lengths, max(max(row[3:]) for row in shown) or angles
    known.found("digits", digits, "behind the points of all WHEREs: lengths, angles")


def _digits(text: str) -> tuple[int, int]:
    """The most decimals of WHERE's lengths, and of its angles. If only one of the two has decimals, the other has VAL's
    usual number: its values happen to be whole, and trailing zeros are left out."""
    decimals = [len(word.partition(".")[2]) for word in text.split() if NUMBER.fullmatch(word)]
    lengths, angles = max(decimals[:3]), max(decimals[3:6] + decimals[-6:])
    return (lengths or VAL_DIGITS[0], angles or VAL_DIGITS[1]) if lengths or angles else (0, 0)
