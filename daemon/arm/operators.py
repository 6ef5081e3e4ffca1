"""What operators say of the arm: what they let it do, the word that is being done, how one is refused. Values only."""

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from enum import StrEnum

from daemon.arm.motion import NotSentError

SAID: ContextVar[tuple[str, int] | None] = ContextVar("said", default=None)
"""The word that is being done, and how often the arm had been stopped when it was said."""


@contextmanager
def said(word: str, stops: int) -> Iterator[None]:
    """What is done herein is done for an operator's word, said when the arm had been stopped so often: once it was
    stopped again, however much later, that word begins nothing that moves."""
    before = SAID.set((word, stops))
    try:
        yield
    finally:
        SAID.reset(before)


class Interruption(StrEnum):
    """What comes over a job from outside."""

    PAUSE = "pause"
    RESUME = "resume"
    STOP = "stop"
    ABORT = "abort"
    ERROR = "error"


class RefusedError(NotSentError):
    """Not done now; the message says why and what to do."""


class OperatorRefusedError(NotSentError):
    """In step mode the operator said no to a move."""

    code = "operator_no"
