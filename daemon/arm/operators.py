"""Operator commands as the arm's code needs them: the command that is being carried out, interruptions, refusals."""

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from enum import StrEnum

from daemon.arm.motion import NotSentError

OPERATOR_COMMAND: ContextVar[tuple[str, int] | None] = ContextVar("operator_command", default=None)
"""The command that is being carried out, and the number of stops when the operator gave it."""


@contextmanager
def operator_command(word: str, stops: int) -> Iterator[None]:
    """Context: everything in it is done for one operator command. stops: the number of stops when the operator gave it;
    after a later stop this command can no longer start a motion."""
    before = OPERATOR_COMMAND.set((word, stops))
    try:
        yield
    finally:
        OPERATOR_COMMAND.reset(before)


class JobEvent(StrEnum):
    """An event that interrupts or ends a job from outside, or lets it continue."""

    PAUSE = "pause"
    RESUME = "resume"
    STOP = "stop"
    ABORT = "abort"
    ERROR = "error"


class RefusedError(NotSentError):
    """The command is refused for now; the message says why and what to do."""


class OperatorRefusedError(NotSentError):
    """The operator refused a move that waited for confirmation."""

    code = "operator_no"
