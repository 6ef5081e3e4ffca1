"""What operators hear unasked: faults, refusals, troubles, how a pick or an auto ended, what others do. One place tells
all frontends, each as much as its operator wants.

Called from the main loop only; no frontend makes the caller wait.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from enum import IntEnum
from typing import Protocol

from daemon.maintenance import journal


class NoticeLevel(IntEnum):
    """How much is told: faults always; how picks and autos end; all that other operators do as well."""

    FAULTS = 0
    OUTCOMES = 1
    ALL = 2


class Listener(Protocol):
    """A frontend with somebody before it; asks: whether questions can be put there."""

    asks: bool

    def notice(self, text: str) -> None:
        """Show some lines that nobody there asked for; returns at once."""


class Notices:
    """The frontends that listen, how much each wants to hear, and at which of them somebody waits for an answer that
    says it anyway."""

    def __init__(self) -> None:
        self._frontends: list[Listener] = []
        self._levels: dict[int, NoticeLevel] = {}
        self._waiting: list[Listener] = []
        self._stopping: list[tuple[object, tuple[str, ...]]] = []

    def listen(self, frontend: Listener) -> None:
        """From now on this frontend is told, too."""
        self._frontends.append(frontend)

    def leave(self, frontend: Listener) -> None:
        """No longer; safe to call twice."""
        self._frontends = [other for other in self._frontends if other is not frontend]
        self._levels.pop(id(frontend), None)

    def level(self, frontend: object) -> NoticeLevel | None:
        """How much this frontend is told; None where it does not listen."""
        listens = any(frontend is other for other in self._frontends)
        return self._levels.get(id(frontend), NoticeLevel.OUTCOMES) if listens else None

    def set_level(self, frontend: object, level: NoticeLevel) -> None:
        """Tell this frontend as much from now on."""
        self._levels[id(frontend)] = level

    def tell(self, text: str, level: NoticeLevel = NoticeLevel.FAULTS, by: str | None = None) -> None:
        """Tell everybody who wants to hear as much, but whose doing it is, and who is about to be answered with it."""
        for frontend in list(self._frontends):
            wants = self._levels.get(id(frontend), NoticeLevel.OUTCOMES)
            answered = level is NoticeLevel.OUTCOMES and any(frontend is waiting for waiting in self._waiting)
            own = any(frontend is stopping and text in told for stopping, told in self._stopping)
            if level > wants or answered or own or (by is not None and by == getattr(frontend, "who", None)):
                continue
            try:
                frontend.notice(text)
            except Exception as error:  # one frontend that fails keeps none of the others from hearing it
                journal.tell("trouble", f"notice not shown: {type(error).__name__}: {error}", journal.WARNING)

    @property
    def asked(self) -> bool:
        """Whether somebody who waits for the end of a motion is asked about its moves."""
        return any(frontend.asks for frontend in self._waiting)

    @contextlib.contextmanager
    def answered(self, frontend: Listener) -> Iterator[None]:
        """While somebody at this frontend waits for the end of a motion."""
        self._waiting.append(frontend)
        try:
            yield
        finally:
            self._waiting = [other for other in self._waiting if other is not frontend]

    @contextlib.contextmanager
    def stopping(self, frontend: object, who: str) -> Iterator[None]:
        """While a stop by this operator is under way: the answer there says so, and the notice of it would again."""
        self._stopping.append((frontend, (f"STOPPED by {who}", f"STOPPED by control-C of {who}")))
        try:
            yield
        finally:
            self._stopping = [other for other in self._stopping if other[0] is not frontend]
