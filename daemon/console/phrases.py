"""Small phrases that several commands say the same way."""

from __future__ import annotations

import re
from collections.abc import Iterable

STOP_WORDS = ("stop", "halt")
SHORTEST_STOP = 3
"""Letters from which on the beginning of a stop word is that of no other."""
ESCAPES = re.compile(r"\x1b(\[[0-9;?]*[@-~])?")


def plural(count: int, noun: str) -> str:
    """1 view, 2 views."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def duration(seconds: float) -> str:
    """5 s, 3 min, 2 h, 4 days."""
    for unit, length in (("days", 86400.0), ("h", 3600.0), ("min", 60.0)):
        if seconds >= 2 * length:
            return f"{seconds / length:.0f} {unit}"
    return f"{seconds:.0f} s"


def millimetres(lengths: Iterable[float]) -> str:
    """50 50 49.6 mm -> `50 50 50 mm`."""
    return " ".join(f"{length:.0f}" for length in lengths) + " mm"


def cut_off(count: int | None) -> str:
    """What a stopped or restarted daemon has not picked yet; None: all that lies there."""
    if count is None:
        return "`auto on` was cut off before the table was empty"
    return f"`auto on` was cut off with {plural(count, 'part')} still to pick"


def means_stop(text: str) -> bool:
    """Whether a line, whatever it is typed for, is to stop the arm: it begins with a stop word, or a beginning of one,
    however a person in haste wrote it (case, blanks, quotes, what a bad line or another key put in between)."""
    plain = "".join(c for c in ESCAPES.sub("", text) if " " <= c <= "~").lstrip()
    word = re.sub("^[^a-zA-Z#]*", "", plain)
    letters = re.match("[a-zA-Z]*", word)
    begun = letters[0].lower() if letters else ""
    return len(begun) >= SHORTEST_STOP and any(w.startswith(begun) or begun.startswith(w) for w in STOP_WORDS)


def is_yes(answer: str) -> bool:
    """Whether an operator said yes."""
    return answer.strip().lower() in ("y", "yes", "ja", "j")


def is_no(answer: str) -> bool:
    """Whether an operator said no: where neither will do for the other, something else typed is no answer."""
    return answer.strip().lower() in ("n", "no", "nein")
