"""What operators hear unasked: faults, refusals, troubles, how a pick or an auto ended. One place tells all doors.

Called from the main loop only; no door makes the caller wait.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from typing import Protocol

from daemon.upkeep import journal


class Listener(Protocol):
    """A door with somebody before it."""

    def notice(self, text: str) -> None:
        """Show some lines that nobody there asked for; returns at once."""


class Notices:
    """The doors that listen, and at which of them somebody waits for the end of a pick as their answer."""

    def __init__(self) -> None:
        self._doors: list[Listener] = []
        self._waiting: list[object] = []

    def listen(self, door: Listener) -> None:
        """From now on this door is told, too."""
        self._doors.append(door)

    def leave(self, door: Listener) -> None:
        """No longer; safe to call twice."""
        self._doors = [other for other in self._doors if other is not door]

    def tell(self, text: str, outcome: bool = False) -> None:
        """Tell everybody; outcome: but those who are about to be answered with it."""
        for door in list(self._doors):
            if outcome and any(door is waiting for waiting in self._waiting):
                continue
            try:
                door.notice(text)
            except Exception as error:  # one door that fails keeps none of the others from hearing it
                journal.tell("trouble", f"a notice was not shown: {type(error).__name__}: {error}", journal.WARNING)

    @contextlib.contextmanager
    def answered(self, door: object) -> Iterator[None]:
        """While somebody at this door waits for the end of a pick."""
        self._waiting.append(door)
        try:
            yield
        finally:
            self._waiting = [other for other in self._waiting if other is not door]
