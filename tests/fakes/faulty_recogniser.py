"""A recogniser that fails amid a look as software does: its process killed, out of memory, never done."""

from __future__ import annotations

import os
import signal
from pathlib import Path
from typing import Any

from daemon.pick.recogniser import ModelRecogniser
from daemon.vision.values import Scene


class FaultyRecogniser(ModelRecogniser):
    """As a good one, but where `orders` says what the next look is to come to; each order is carried out once."""

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
