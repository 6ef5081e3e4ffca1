"""What an operator types that is to stop the arm, whatever it was to answer. Every frontend asks this first."""

from __future__ import annotations

import re
from collections.abc import Sequence

STOP_WORDS = ("stop", "halt")
WITHDRAW = ("disable", "abort")
"""Beside these, the words that take the arm's leave to move, or what it is moving for."""
SHORTEST_STOP = 3
"""Letters from which on the beginning of a stop word is that of no other."""
LINE_END = re.compile("\r\n|\r|\n")
"""As terminals, files and clipboards have it."""
ESCAPES = re.compile(r"\x1b(\[[0-9;?]*[@-~])?")


def means_stop(text: str) -> bool:
    """Whether a line, whatever it is typed for, is to stop the arm: it begins with a stop word, or a beginning of one,
    however a person in haste wrote it (case, blanks, quotes, what a bad line or another key put in between). Of a text
    of many lines, whether any is."""
    return any(map(_line_means_stop, {text, *LINE_END.split(text)}))


def _line_means_stop(text: str) -> bool:
    plain = "".join(c for c in ESCAPES.sub("", text) if " " <= c <= "~").lstrip()
    word = re.sub("^[^a-zA-Z#]*", "", plain)
    letters = re.match("[a-zA-Z]*", word)
    begun = letters[0].lower() if letters else ""
    return len(begun) >= SHORTEST_STOP and any(w.startswith(begun) or begun.startswith(w) for w in STOP_WORDS)


def takes_leave(text: str) -> bool:
    """Whether a line is to stop the arm, or takes its leave to move: whoever types it may hang on the answer."""
    return means_stop(text) or text.split("#")[0].lower().split() in [[word] for word in WITHDRAW]


def ends_in_stop(taken: Sequence[str], line: str) -> bool:
    """Whether a line means to stop that was begun before questions came and went: taken, what stood at the prompt each
    time, and was taken from under the hands of whoever typed it."""
    return any(means_stop("".join(taken[k:]) + line) for k in range(len(taken) + 1))
