"""The first moves of an unknown arm, after the person confirmed them. Only this file of a first contact moves the arm.

Each move is a `_step`: one joint, STEP_DEG, slowly, compared with WHERE before the next. The first one is interrupted
by the stop; if the arm does not come to rest before its end, no other move follows.
"""

from collections.abc import Generator
from typing import Any

from drivers.val2.contact_findings import (
    CAREFUL_S,
    ContactFindings,
    Exchange,
    Heard,
    ProbeAnswer,
    Step,
    Steps,
    Tell,
    UnclearError,
    agreed,
    ask,
    at_rest,
    errors_in,
    listen,
)
from drivers.val2.conversation import POISON
from drivers.val2.dialect import Dialect
from drivers.val2.errors import lacks_zero
from drivers.val2.wire import Where

MOTION_S, CALIBRATION_S = 30.0, 180.0
STEP_DEG, ROUNDS, SPEED, SHARE = 2.0, (1.0, 1.0, -1.0, -1.0), 20, 1
"""The degrees of a move; its directions, there and back; the monitor speed, %; the program speed, %."""
FINE_DIGITS = 2
"""If WHERE prints fewer decimals than this, each joint is also moved to the other side: twice the distance, twice as
many readings."""
FIRST_JOINT, CUT_AFTER_S = 6, 0.2
CALIBRATE = Dialect().calibrate_word
OFF_DEG = 0.15


def first_moves(known: ContactFindings) -> Steps:
    """Make the first moves; fills `known`, its readings too. Raises UnclearError."""
    yield from ask(known, f"SPEED {SPEED}")
    here = yield from at_rest(known)
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
            f"{' and '.join(words)} did not stop a moving joint: find this controller's stop word in its manual. Joint "
            f"{FIRST_JOINT} turned by {STEP_DEG:g} degrees; nothing else moved"
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


def drive_command(joint: int, degrees: float) -> str:
    """The command of one small step. Raises ValueError for a larger one."""
    if joint not in range(1, 7) or abs(degrees) > STEP_DEG:
        raise ValueError(f"joint {joint} by {degrees} degrees is no small step")
    return f"DO DRIVE {joint},{degrees:g},{SHARE}"


def _cut_short(known: ContactFindings, here: Where) -> Steps:
    """Begin a step and stop it at once. Returns whether it ended early, where, and how many seconds that took."""
    yield Tell(f"joint {FIRST_JOINT} by {STEP_DEG:g} degrees, cut short by {known.stop_word}")
    for _ in range(4):
        misread = False
        for sign in (1.0, -1.0):
            known.moved = True
            yield from _typed(known, drive_command(FIRST_JOINT, sign * STEP_DEG))
            began: Heard = yield Exchange(known.end, CUT_AFTER_S, CUT_AFTER_S)
            answer = yield from ask(known, known.stop_word, MOTION_S)
            errors = errors_in(began.data) + answer.errors
            there = yield from at_rest(known)
            turned = abs(there.joints_deg[FIRST_JOINT - 1] - here.joints_deg[FIRST_JOINT - 1])
            if not errors:
                if turned < OFF_DEG / 3:
                    continue
                return turned < STEP_DEG - OFF_DEG, there, answer.prompt_s
            if any(f"JOINT {FIRST_JOINT}" in error.upper() for error in errors):
                continue  # it is near that end of its range: try the other way
            if all("illegal command" in error.lower() for error in errors):
                # What was typed before was taken: a character was lost, on the way there or on the way to the stop.
                known.pace_s, misread, here = CAREFUL_S, True, there
                known.found("character_pause_s", CAREFUL_S, "at a quicker pace a command was spoilt", "likely")
                continue
            break
        else:
            if misread:
                raise UnclearError(
                    f"{drive_command(FIRST_JOINT, STEP_DEG)} and {known.stop_word}, typed slowly, are answered by "
                    f"{'; '.join(errors) or 'nothing'}: another system, or noise on the line: send the transcript"
                )
            raise UnclearError(f"joint {FIRST_JOINT} does not turn; is the arm held, or its brake on?")
        refusal = "; ".join(errors)
        if lacks_zero(refusal):
            here = yield from _calibrated(known, refusal)
            continue
        if not (yield from agreed("power", f"The controller says {refusal}. Put that right, then say yes")):
            break
    raise UnclearError(f"the arm does not move: the controller says {'; '.join(errors)}. What does it need?")


def _calibrated(known: ContactFindings, refusal: str) -> Steps:
    """Type CAL if the person agrees: this terminal is the controller's only one. Returns where the arm is afterwards.
    Raises UnclearError."""
    word = known.findings["calibrate_word"].value if "calibrate_word" in known.findings else CALIBRATE
    if not (
        yield from agreed(
            "calibrate",
            f"The controller says {refusal}. May I type {word}? The arm then turns each joint by itself to find its "
            "zero, as its manual says. It must stand clear as for the small turns, your hand on the emergency stop",
        )
    ):
        raise UnclearError(
            f"the arm is not calibrated, and nothing was moved. Type {word} at this terminal yourself, or repeat the "
            "command and answer yes: facetd then types it"
        )
    known.moved = True
    answer = yield from ask(known, word, CALIBRATION_S)
    if answer.question is not None:
        answer = yield from ask(known, "Y", CALIBRATION_S)
    if answer.errors or not answer.prompt:
        raise UnclearError(
            f"{word} was answered by {'; '.join(answer.errors) or repr(answer.raw)}. What does the controller need "
            "before it calibrates?"
        )
    yield Tell(f"calibrated: {word} was carried out")
    return (yield from at_rest(known))


def _step(known: ContactFindings, here: Where, joint: int, degrees: float, early: list[bool]) -> Steps:
    """Make one step and read WHERE; check that only that joint has turned, by that angle. Raises UnclearError."""
    yield Tell(f"joint {joint} by {degrees:+g} degrees")
    answer = yield from _moved(known, drive_command(joint, degrees))
    if answer.errors:
        yield Tell(f"it says {'; '.join(answer.errors)}: the other way")
        degrees = -degrees
        answer = yield from _moved(known, drive_command(joint, degrees))
    if answer.errors:
        raise UnclearError(
            f"joint {joint} cannot be turned: the controller says {'; '.join(answer.errors)}. What does it need?"
        )
    first = yield from ask(known, "WHERE", 5.0)
    there = yield from at_rest(known)
    if first.where is not None:
        early.append(abs(first.where.joints_deg[joint - 1] - there.joints_deg[joint - 1]) > OFF_DEG / 3)
    off = [now - before - (degrees if k == joint else 0.0)
           for k, (before, now) in enumerate(zip(here.joints_deg, there.joints_deg, strict=True), 1)]  # fmt: skip
    if max(map(abs, off)) > OFF_DEG:
        turned = ", ".join(f"{now - was:.2f}" for was, now in zip(here.joints_deg, there.joints_deg, strict=True))
        raise UnclearError(
            f"joint {joint} was to turn by {degrees:+g} degrees, and the joints turned by {turned}. What blocks them?"
        )
    return there


def _typed(known: ContactFindings, text: str) -> Steps:
    """Type characters without a line end, and check their echo if the controller echoes. Raises UnclearError."""
    most_s = 0.5 + 20.0 * len(text) / float(known.findings["baud"].value)  # enough for the characters and their echo
    for _ in range(3):
        heard: Heard = yield Exchange(text.encode(), 0.1, most_s, known.pace_s)
        if not known.findings["echo"].value or heard.data.endswith(text.encode()):
            return
        yield from ask(known, POISON.decode())
    raise UnclearError(f"{text!r} came back as {heard.data!r}, three times, and was not ended: noise on the line?")


def _moved(known: ContactFindings, text: str) -> Generator[Step, Any, ProbeAnswer]:
    yield from _typed(known, text)
    return (yield from listen(known, known.end, b"", MOTION_S))
