"""A daemon/compute Compute without a process: in a thread, or, on simulated time, at once."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any


class ComputesHere:
    """See the module. What a Worker is asked besides, it does not do."""

    pid = None

    def __init__(self, *_: object) -> None:
        """As a Worker is made."""

    async def __call__(self, function: Callable[..., Any], /, *args: Any) -> Any:
        """See Compute."""
        return await asyncio.to_thread(function, *args)

    def prepare(self, _: object) -> None:
        """Nothing is sent anywhere."""

    def close(self) -> None:
        """There is no process to end."""
