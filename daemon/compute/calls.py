"""The interface of a calculation outside the event loop. worker.py implements it; tests call functions directly."""

from collections.abc import Callable
from typing import Any, Protocol, TypeVar

from daemon.errors import FacetdError

Result = TypeVar("Result")


class ComputeError(FacetdError):
    """A calculation gave no result: its process was killed, ran out of memory, or took too long."""

    code = "computation"


class ByReference:
    """A large constant value of many requests: a worker gets it once, and then its number."""


class Compute(Protocol):
    """Runs a calculation outside the event loop."""

    async def __call__(self, function: Callable[..., Result], /, *args: Any) -> Result:
        """Return or raise what a module-level function does for these values. Raises ComputeError."""
