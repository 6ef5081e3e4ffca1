"""What operators hear unasked: faults, refusals, troubles, how a pick or an auto ended, what others do. One place tells
all doors, each as much as its operator wants.

Called from the main loop only; no door makes the caller wait.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from enum import IntEnum
from typing import Protocol

from daemon.maintenance import journal


class Level(IntEnum):
    """How much is told: faults always; how picks and autos end; all that other operators do as well."""

    FAULTS = 0
    OUTCOMES = 1
    ALL = 2


class Listener(Protocol):
    """A door with somebody before it; asks: whether questions can be put there."""

    asks: bool

    def notice(self, text: str) -> None:
        """Show some lines that nobody there asked for; returns at once."""


class Notices:
    """The doors that listen, how much each wants to hear, and at which of them somebody waits for an answer that says
    it anyway."""

    def __init__(self) -> None:
        self._doors: list[Listener] = []
        self._levels: dict[int, Level] = {}
        self._waiting: list[Listener] = []
        self._stopping: list[tuple[object, tuple[str, ...]]] = []

    def listen(self, door: Listener) -> None:
        """From now on this door is told, too."""
        self._doors.append(door)

    def leave(self, door: Listener) -> None:
        """No longer; safe to call twice."""
        self._doors = [other for other in self._doors if other is not door]
        self._levels.pop(id(door), None)

    def level(self, door: object) -> Level | None:
        """How much this door is told; None where it does not listen."""
        listens = any(door is other for other in self._doors)
        return self._levels.get(id(door), Level.OUTCOMES) if listens else None

    def set_level(self, door: object, level: Level) -> None:
        """Tell this door as much from now on."""
        self._levels[id(door)] = level

    def tell(self, text: str, level: Level = Level.FAULTS, by: str | None = None) -> None:
        """Tell everybody who wants to hear as much, but whose doing it is, and who is about to be answered with it."""
        for door in list(self._doors):
            wants = self._levels.get(id(door), Level.OUTCOMES)
            answered = level is Level.OUTCOMES and any(door is waiting for waiting in self._waiting)
            own = any(door is stopping and text in told for stopping, told in self._stopping)
            if level > wants or answered or own or (by is not None and by == getattr(door, "who", None)):
                continue
            try:
                door.notice(text)
            except Exception as error:  # one door that fails keeps none of the others from hearing it
                journal.tell("trouble", f"a notice was not shown: {type(error).__name__}: {error}", journal.WARNING)

    @property
    def asked(self) -> bool:
        """Whether somebody who waits for the end of a motion is asked about its moves."""
        return any(door.asks for door in self._waiting)

    @contextlib.contextmanager
    def answered(self, door: Listener) -> Iterator[None]:
        """While somebody at this door waits for the end of a motion."""
        self._waiting.append(door)
        try:
            yield
        finally:
            self._waiting = [other for other in self._waiting if other is not door]

    @contextlib.contextmanager
    def stopping(self, door: object, who: str) -> Iterator[None]:
        """While a stop by this operator is under way: the answer there says so, and the notice of it would again."""
        self._stopping.append((door, (f"FAULT stopped by {who}", f"FAULT stopped by control-C of {who}")))
        try:
            yield
        finally:
            self._stopping = [other for other in self._stopping if other[0] is not door]
