"""A recogniser that fails during an observation: killed, out of memory, or endless."""

from __future__ import annotations

import os
import signal
from pathlib import Path
from typing import Any

from daemon.pick.recogniser import ModelRecogniser
from daemon.vision.values import Scene


class FaultyRecogniser(ModelRecogniser):
    """A recogniser that fails once as the file `orders` says."""

    def __init__(self, good: ModelRecogniser, orders: Path) -> None:
        super().__init__(good.model, good.rig, good.settings)
        self.orders = orders

    def __reduce__(self) -> tuple[Any, ...]:
        return FaultyRecogniser, (ModelRecogniser(self.model, self.rig, self.settings), self.orders)

    def see(self, *args: Any) -> Scene:
        """See Recogniser."""
        order = self.orders.read_text() if self.orders.exists() else ""
        self.orders.unlink(missing_ok=True)
        if order == "killed":
            os.kill(os.getpid(), signal.SIGKILL)
        if order == "exhausted":
            raise MemoryError
        while order == "endless":
            pass
        return super().see(*args)
