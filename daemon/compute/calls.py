"""How a calculation is asked for beside the event loop. Pure: who carries it out is worker.py, or a test."""

from collections.abc import Callable
from typing import Any, Protocol, TypeVar

from daemon.errors import FacetdError

Result = TypeVar("Result")


class ComputeError(FacetdError):
    """A calculation has ended without an answer: its process was killed, ran out of memory, or took too long."""

    code = "computation"


class ByReference:
    """A value that is large, never changed, and part of many requests: it is sent to a worker once, then by number."""


class Compute(Protocol):
    """Carries out a calculation beside the event loop."""

    async def __call__(self, function: Callable[..., Result], /, *args: Any) -> Result:
        """What a module-level function returns, or raises, for these values; nobody may change them meanwhile. Raises
        ComputeError."""
