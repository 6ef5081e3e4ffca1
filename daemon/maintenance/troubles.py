"""Active troubles of the daemon, and the part of the running daemon that maintenance watches."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

from daemon.cell.hardware import Hardware
from daemon.config import Config
from daemon.events.codes import FaultCause
from daemon.pick.cycle import PickCycle
from daemon.store.runlog import RunLog
from daemon.teaching.trainer import Trainer


@dataclass
class Troubles:
    """Active troubles and their causes, by source. on_change(source, text or None) is called at each change."""

    on_change: Callable[[str, str | None], None] = lambda _, __: None
    active: dict[str, str] = field(default_factory=dict)
    causes: dict[str, FaultCause] = field(default_factory=dict)

    def report(self, source: str, text: str | None, cause: FaultCause | None = None) -> None:
        """Report a trouble of a source, or None: the trouble is over."""
        if self.active.get(source) == text:
            return
        self.causes.pop(source, None)
        if cause is not None:
            self.causes[source] = cause
        if text is None:
            self.active.pop(source, None)
        else:
            self.active[source] = text
        self.on_change(source, text)


class WatchedDaemon(Protocol):
    """The running daemon as maintenance sees it; daemon/console/context.py implements it."""

    config: Config
    hardware: Hardware
    cycle: PickCycle
    trainer: Trainer
    run_log: RunLog
    troubles: Troubles
    started_s: float
    roll_due: bool

    def roll_if_due(self) -> None:
        """Continue in a new run folder where the current one is large."""
