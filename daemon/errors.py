"""The root of the errors that a person can act on, and how texts from elsewhere are shown to people. What an error says
is for that person; anything else raised is a fault of the program.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

DONE, NOT_DONE, NOT_UNDERSTOOD = 0, 1, 2
"""How a command ended, at every frontend and as a tool's exit status."""
STOP_UNANSWERED = 3
"""A tool's exit status only: nobody answered a stop in time, and its operator was sent to the emergency stop."""


def printable(text: str, names: bool = False) -> str:
    """The same on one line, with what cannot be shown or kept as question marks; names: bytes of files' names that are
    no UTF-8 stay, so that the file is found by it."""
    kept = "".join(chr(c) for c in range(0xDC80, 0xDD00)) if names else ""
    return "".join(c if c.isprintable() or c in kept else " " if c.isspace() else "?" for c in text)


def visible(text: str) -> str:
    """Lines as a terminal may have them: what would steer it (clear it, name its window) is shown instead, as ^[ is."""
    return "".join(c if c.isprintable() or c in "\n\t" else f"^{chr(ord(c) ^ 64)}" if c < "\x80" else "?" for c in text)


def spelt(text: str) -> str:
    """A text that may hold a file's name, which need not be UTF-8, as it can be written to a file."""
    return text.encode(errors="replace").decode()


def spelt_throughout(value: Any) -> Any:
    """Every text in a value of lists and mappings, as `spelt` has it."""
    if isinstance(value, str):
        return spelt(value)
    if isinstance(value, Mapping):
        return {key: spelt_throughout(one) for key, one in value.items()}
    return [spelt_throughout(one) for one in value] if isinstance(value, list | tuple) else value


class FacetdError(Exception):
    """What happened, where, and what to do: one line. Drivers have roots of their own (they know no daemon)."""
