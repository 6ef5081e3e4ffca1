"""A Compute (daemon/compute) without a process: in a thread, or at once on simulated time."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

from daemon.compute.worker import Worker


class ComputesHere(Worker):
    """See the module. The other methods of a Worker do nothing."""

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
