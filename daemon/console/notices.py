"""Notices to operators at every frontend, each at the level that its operator chose. Main loop only; never blocks."""

import contextlib
from collections.abc import Iterator
from enum import IntEnum
from typing import Protocol

from daemon.maintenance import journal


class NoticeLevel(IntEnum):
    """How much a frontend shows: faults; also ends of picks and autos; also other operators' commands."""

    FAULTS = 0
    OUTCOMES = 1
    ALL = 2


class Listener(Protocol):
    """A frontend with an operator; asks: whether they can answer questions."""

    @property
    def asks(self) -> bool: ...

    def notice(self, text: str) -> None:
        """Show unsolicited lines; returns at once."""


class Notices:
    """The listening frontends, the level of each, and those where an answer will say what a notice says."""

    def __init__(self) -> None:
        self._frontends: list[Listener] = []
        self._levels: dict[int, NoticeLevel] = {}
        self._waiting: list[Listener] = []
        self._stopping: list[tuple[object, tuple[str, ...]]] = []

    def listen(self, frontend: Listener) -> None:
        self._frontends.append(frontend)

    def leave(self, frontend: Listener) -> None:
        """Stop showing notices there; safe to call twice."""
        self._frontends = [other for other in self._frontends if other is not frontend]
        self._levels.pop(id(frontend), None)

    def level(self, frontend: object) -> NoticeLevel | None:
        """The level of this frontend; None where it does not listen."""
        listens = any(frontend is other for other in self._frontends)
        return self._levels.get(id(frontend), NoticeLevel.OUTCOMES) if listens else None

    def set_level(self, frontend: object, level: NoticeLevel) -> None:
        self._levels[id(frontend)] = level

    def tell(
        self, text: str, level: NoticeLevel = NoticeLevel.FAULTS, by: str | None = None, refusal: bool = False
    ) -> None:
        """Show a notice at every frontend of that level, except its originator's and those whose answer will say the
        same. refusal: a move was refused; the operator who waits for the end of a motion reads that in the answer."""
        for frontend in list(self._frontends):
            shows = self._levels.get(id(frontend), NoticeLevel.OUTCOMES)
            answered = (refusal or level is NoticeLevel.OUTCOMES) and any(frontend is one for one in self._waiting)
            own = any(frontend is stopping and text in texts for stopping, texts in self._stopping)
            if level > shows or answered or own or (by is not None and by == getattr(frontend, "who", None)):
                continue
            try:
                frontend.notice(text)
            except Exception as error:  # a frontend that fails does not keep it from the others
                journal.write("trouble", f"notice not shown: {type(error).__name__}: {error}", journal.WARNING)

    @property
    def can_ask(self) -> bool:
        """Whether an operator who waits for the end of a motion can be asked about its moves."""
        return any(frontend.asks for frontend in self._waiting)

    @contextlib.contextmanager
    def answered(self, frontend: Listener) -> Iterator[None]:
        """Context: an operator at this frontend waits for the end of a motion."""
        self._waiting.append(frontend)
        try:
            yield
        finally:
            self._waiting = [other for other in self._waiting if other is not frontend]

    @contextlib.contextmanager
    def stopping(self, frontend: object, who: str) -> Iterator[None]:
        """Context: a stop by this operator is under way; its answer, not a notice, reports it there."""
        self._stopping.append((frontend, (f"STOPPED by {who}", f"STOPPED by control-C of {who}")))
        try:
            yield
        finally:
            self._stopping = [other for other in self._stopping if other[0] is not frontend]
