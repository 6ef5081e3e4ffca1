"""Recognise lines that stop the arm, even as an answer to a question. Every frontend checks each line first."""

import re
from collections.abc import Sequence

STOP_WORDS = ("stop", "halt")
WITHDRAW = ("disable", "abort")
"""Commands that withdraw the arm's permission to move, or end the pick."""
SHORTEST_STOP = 3
"""Letters of a stop word that no other command begins with."""
STOP_MARKS = "!.,;'\""
"""Characters that may follow a stop typed in haste."""
LINE_END = re.compile("\r\n|\r|\n")
"""Line ends of terminals, files and clipboards."""
ESCAPES = re.compile(r"\x1b(\[[0-9;?]*[@-~])?")


def means_stop(text: str) -> bool:
    """Whether a text, or any of its lines, stops the arm: it begins with a stop word or a prefix of one, regardless of
    case, blanks, quotes, and stray characters from a noisy line or a key pressed before."""
    return any(map(_line_means_stop, {text, *LINE_END.split(text)}))


def _line_means_stop(text: str) -> bool:
    plain = "".join(c for c in ESCAPES.sub("", text) if " " <= c <= "~").lstrip()
    word = re.sub("^[^a-zA-Z#]*", "", plain)
    letters = re.match("[a-zA-Z]*", word)
    begun = letters[0].lower() if letters else ""
    return len(begun) >= SHORTEST_STOP and any(w.startswith(begun) or begun.startswith(w) for w in STOP_WORDS)


def ends_as_a_stop(text: str) -> bool:
    """Whether the last word of a line ends in `stop`, perhaps typed in haste behind half of another line. The caller
    must know all names, such as `doorstop`."""
    words = text.split("#")[0].split()
    return bool(words) and words[-1].rstrip(STOP_MARKS).lower().endswith(STOP_WORDS[0])


def withdraws_permission(text: str) -> bool:
    """Whether a line stops the arm or withdraws its permission to move."""
    return means_stop(text) or text.split("#")[0].lower().split() in [[word] for word in WITHDRAW]


def ends_in_stop(removed: Sequence[str], line: str) -> bool:
    """Whether a line stops the arm, with the unfinished inputs (oldest first) that questions removed before it."""
    return any(means_stop("".join(removed[k:]) + line) for k in range(len(removed) + 1))
