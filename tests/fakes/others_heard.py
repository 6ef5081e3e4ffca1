"""Whether facetd notices each line that somebody else typed on its clean line, and reports it.

The rule: an exchange of ours that began behind such a line does not succeed before the line was noticed, and what is
noticed is reported at the sockets. A line counts for nothing here where a stop is under way (all of it is typed to find
a prompt, and what comes is no answer), where a person has the controller's terminal, where anything spoils the line, or
where facetd searches it for a prompt, as behind another such line. One that falls into an exchange of ours, and an
Enter alone, which answers as a stray prompt, are measured by tests/bench/others_typing.py.
"""

from __future__ import annotations

from collections.abc import AsyncIterator, Callable
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from typing import Any
from unittest.mock import patch

from drivers.simcell.motion_monitor import Violation
from drivers.val2.errors import Disturbed
from drivers.val2.session import LineSession

NOTICE = "another terminal or program types on the controller's line"
REPORTED_S = 15.0
"""The longest time from noticing to reporting: the arm is stopped in between."""


class OthersHeard:
    """Tracks the lines of others: which are not noticed yet, and what became of each."""

    def __init__(self, now_s: Callable[[], float], may_move: Callable[[], bool]) -> None:
        """may_move: whether somebody let the arm move; where nobody did, who asked hears of it."""
        self._now_s, self._may_move = now_s, may_move
        self._open: list[tuple[float, str]] = []
        self._stops = self._exchanges = 0
        self._noticed_s: float | None = None
        self._found: list[Violation] = []
        self.noticed: list[str] = []
        """The lines that were noticed."""
        self.unjudged: list[str] = []
        """The lines for which nothing is required."""

    def typed(self, text: str, clean: bool) -> None:
        """Another terminal typed a line; clean: nothing has spoilt the line for a while, and nobody asks anything."""
        if text and clean and not self._stops and not self._exchanges:
            self._open.append((self._now_s(), text))
        else:
            self.unjudged.append(text)

    def spoilt(self) -> None:
        """The line was disturbed: nothing is required of lines that are not noticed yet."""
        self._drop()
        self._noticed_s = None

    def _drop(self) -> None:
        self.unjudged += [text for _, text in self._open]
        self._open = []

    def told(self, text: str) -> None:
        """A message was sent at a socket."""
        if NOTICE in text:
            self._noticed_s = None

    def violations(self) -> tuple[Violation, ...]:
        """The lines that were not noticed, or not reported, so far."""
        if self._noticed_s is not None and self._now_s() > self._noticed_s + REPORTED_S:
            self._found.append(
                Violation("not reported", self._noticed_s, self.noticed[-1], "noticed, and not reported")
            )
            self._noticed_s = None
        return tuple(self._found)

    def patches(self) -> list[Any]:
        """The patches of the line's session, through which everything typed goes."""
        ask, preemption, terminal, disturb, find_prompt = (
            LineSession.ask, LineSession.preemption, LineSession.terminal, LineSession._refuse_others,
            LineSession.find_prompt)  # fmt: skip

        async def asked(session: LineSession, *about: Any, **how: Any) -> Any:
            began_s = self._now_s()
            self._exchanges += 1
            try:
                answer = await ask(session, *about, **how)
            finally:
                self._exchanges -= 1
            self._answered(began_s, str(about[1]))
            return answer

        async def found(session: LineSession, *about: Any, **how: Any) -> Any:
            self._drop()
            self._exchanges += 1
            try:
                return await find_prompt(session, *about, **how)
            finally:
                self._exchanges -= 1

        def refused(session: LineSession, heard: Any) -> None:
            try:
                disturb(session, heard)
            except Disturbed:
                self.noticed += [text for _, text in self._open]
                if self._open and self._noticed_s is None and self._may_move():
                    self._noticed_s = self._now_s()
                self._open = []
                raise

        def unjudged_in(taken: Callable[..., AbstractAsyncContextManager[Any]]) -> Any:
            @asynccontextmanager
            async def inside(session: LineSession, *about: Any) -> AsyncIterator[Any]:
                noticed_s = self._noticed_s
                self.spoilt()
                self._noticed_s, self._stops = noticed_s, self._stops + 1
                try:
                    async with taken(session, *about) as line:
                        yield line
                finally:
                    self._stops -= 1

            return inside

        return [
            patch.object(LineSession, "ask", asked),
            patch.object(LineSession, "find_prompt", found),
            patch.object(LineSession, "_refuse_others", refused),
            patch.object(LineSession, "preemption", unjudged_in(preemption)),
            patch.object(LineSession, "terminal", unjudged_in(terminal)),
        ]

    def _answered(self, began_s: float, ours: str) -> None:
        missed = [(at_s, text) for at_s, text in self._open if at_s < began_s]
        self._found += [
            Violation(
                "not noticed",
                at_s,
                text,
                f"another's line was not noticed up to {ours!r}, {began_s - at_s:.2f} s later",
            )
            for at_s, text in missed
        ]
        self._open = [one for one in self._open if one not in missed]
