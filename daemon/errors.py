"""FacetdError, the base of errors that a person can act on; exit statuses; texts made safe to show or write.

The message of a FacetdError is for that person; any other exception is a fault of the program.
"""

from collections.abc import Mapping
from typing import Any

DONE, NOT_DONE, NOT_UNDERSTOOD = 0, 1, 2
"""How a command ended, at every frontend, and facetctl's exit status."""
STOP_UNANSWERED = 3
"""facetctl's exit status where the daemon did not answer a stop in time: the operator must press the emergency stop."""


def printable(text: str, names: bool = False) -> str:
    """A text on one line, with unprintable characters as question marks. names: keep bytes of file names that are not
    UTF-8, so that the name still finds the file."""
    undecoded = "".join(chr(c) for c in range(0xDC80, 0xDD00)) if names else ""
    return "".join(c if c.isprintable() or c in undecoded else " " if c.isspace() else "?" for c in text)


def visible(text: str) -> str:
    """A text for a terminal, with control characters (clear the screen, name the window) shown as ^[ is."""
    return "".join(c if c.isprintable() or c in "\n\t" else f"^{chr(ord(c) ^ 64)}" if c < "\x80" else "?" for c in text)


def spelt(text: str) -> str:
    """A text, which may hold a file name that is not UTF-8, as valid UTF-8."""
    return text.encode(errors="replace").decode()


def spelt_throughout(value: Any) -> Any:
    """Apply `spelt` to every text in a value of lists and mappings."""
    if isinstance(value, str):
        return spelt(value)
    if isinstance(value, Mapping):
        return {key: spelt_throughout(one) for key, one in value.items()}
    return [spelt_throughout(one) for one in value] if isinstance(value, list | tuple) else value


def one_line(error: BaseException) -> str:
    """An error's message on one line, or its class where it has none."""
    return " ".join(str(error).split()) or type(error).__name__


def internal_error(error: BaseException) -> str:
    """What people are told of a fault of the program."""
    return f"internal error in facetd: {type(error).__name__}: {one_line(error)}"


def error_text(error: BaseException) -> str:
    """The text of a fault that an error causes: its message, where facetd or its drivers raise it or the system reports
    it; any other is a fault of the program."""
    known = isinstance(error, FacetdError | OSError) or type(error).__module__.startswith("drivers.")
    return one_line(error) if known else internal_error(error)


class FacetdError(Exception):
    """What happened, where, and what to do: one line. Drivers have base classes of their own."""


class CommandError(FacetdError):
    """A command that cannot be run, in one line for the operator; its exit status: not done now, or not understood."""

    def __init__(self, text: str, status: int = NOT_DONE) -> None:
        super().__init__(text)
        self.status = status
