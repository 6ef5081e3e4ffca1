"""What this room looks at: as much of the running daemon as is watched and measured, and what is wrong with it now."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

from daemon.cell.build import Hardware
from daemon.config import Config
from daemon.pick.cycle import PickCycle
from daemon.store.runlog import RunLog
from daemon.teaching.trainer import Trainer


@dataclass
class Troubles:
    """What is wrong now, by source, in one line each; on_change(source, text or None) is told of every change."""

    on_change: Callable[[str, str | None], None] = lambda _, __: None
    standing: dict[str, str] = field(default_factory=dict)

    def tell(self, source: str, text: str | None) -> None:
        """Say that something is wrong, or (None) that it no longer is."""
        if self.standing.get(source) == text:
            return
        if text is None:
            self.standing.pop(source, None)
        else:
            self.standing[source] = text
        self.on_change(source, text)


class WatchedDaemon(Protocol):
    """The running daemon, from below: daemon/console/context.py has this shape."""

    config: Config
    hardware: Hardware
    cycle: PickCycle
    trainer: Trainer
    run_log: RunLog
    troubles: Troubles
    started_s: float
    roll_due: bool

    def roll_if_due(self) -> None:
        """Go on in a new run folder where the present one has become large."""
