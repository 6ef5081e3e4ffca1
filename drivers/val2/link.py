"""The robot as the rest of the house sees it: connect, ask where it is, move it, stop it. Over VAL II, on asyncio.

Commands from several tasks take turns; `abort` does not wait its turn. A command whose echo was garbled was never ended
and is typed again; a command whose *answer* was lost may have been carried out, so a motion is then not repeated: the
link finds the prompt again, asks WHERE, and raises with what it knows.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager
from typing import Any

from drivers.val2 import commands
from drivers.val2.conversation import Answer, Conversation
from drivers.val2.dialect import Dialect
from drivers.val2.errors import (
    ControllerError,
    Elsewhere,
    Garbled,
    LinkError,
    NoAnswer,
    PortError,
    Preempted,
)
from drivers.val2.ledger import Ledger
from drivers.val2.location import Location, apart
from drivers.val2.port import SerialPort
from drivers.val2.wire import Error, Event, Prompt, Question, Reader, Where

__all__ = [
    "Answer",
    "ControllerError",
    "Dialect",
    "Elsewhere",
    "Garbled",
    "Link",
    "LinkError",
    "NoAnswer",
    "PortError",
    "Preempted",
    "Where",
]

ABORT_ATTEMPTS = 5


class Link:
    """One controller on one serial port."""

    def __init__(
        self,
        port: str,
        dialect: Dialect | None = None,
        clock: Callable[[], float] = time.monotonic,
        on_wire: Callable[[dict[str, Any]], None] | None = None,
    ) -> None:
        """on_wire: called with every record of the wire ledger."""
        self.port, self.dialect, self.clock = port, dialect or Dialect(), clock
        self._ledger = Ledger(on_wire)
        self._serial: SerialPort | None = None
        self._reader = Reader()
        self._talk = self._new_conversation()
        self._silence: asyncio.TimerHandle | None = None
        self._turn = asyncio.Lock()
        self._aborting: asyncio.Task[Where] | None = None
        self.question: str | None = None
        """What the controller asks before its first prompt (power-up); answered by power_up()."""

    # Connecting

    async def open(self) -> None:
        """Claim the port and find the controller's prompt, or the question it asks at power-up.

        Raises PortError, NoAnswer.
        """
        self._reader, self.question = Reader(), None
        self._talk = self._new_conversation()
        self._serial = SerialPort(self.port, self.dialect, self._hear, self._lost)
        try:
            await self._find_prompt()
        except BaseException:
            self.close_now()
            raise

    async def close(self) -> None:
        """Let go of the port. Does not stop the arm: abort() does."""
        if self._aborting is not None:
            await asyncio.gather(self._aborting, return_exceptions=True)
        self.close_now()

    def close_now(self) -> None:
        """As close(), from where nothing can be awaited."""
        self._cancel_silence()
        self._talk.end(PortError(f"{self.port}: closed"))
        if self._serial is not None:
            self._serial.close()
            self._serial = None

    async def power_up(self, replies: Sequence[str] = ("Y", "Y")) -> Answer:
        """Answer the power-up dialogue. Raises ControllerError with the controller's words."""
        async with self._my_turn(answers_question=True):
            if self.question is None:
                raise ControllerError("the controller asks nothing")
            asked, self.question = self.question, None
            first, *rest = replies
            answer = await self._talk.ask(first, rest, self.dialect.calibrate_s)
            return _refuse_errors(answer, asked)

    # Asking

    async def command(self, text: str, replies: Sequence[str] = (), timeout_s: float | None = None) -> Answer:
        """Type any command and give the whole answer; replies: to the questions it asks, in turn.

        Raises ControllerError with the controller's words, Garbled, NoAnswer, PortError, Preempted.
        """
        return await self._commands((text,), replies, timeout_s)

    async def where(self) -> Where:
        """One WHERE, now. A moving arm gives a place on the way; for a place to compute from, use rest()."""
        async with self._my_turn():
            return await self._where()

    async def speed(self, percent: float) -> None:
        """Monitor speed, percent of full."""
        await self.command(commands.speed(percent))

    async def calibrate(self, answer: str = "Y") -> Answer:
        """CAL, its question answered. Raises ControllerError."""
        return await self.command(self.dialect.calibrate_word, (answer,), self.dialect.calibrate_s)

    # Moving

    async def move(self, location: Location, timeout_s: float | None = None) -> None:
        """Start a joint-interpolated move; rest() waits for its end."""
        await self.command(commands.move(location), timeout_s=timeout_s or self._move_answer_s)

    async def move_straight(self, location: Location, timeout_s: float | None = None) -> None:
        """Start a straight-line move; rest() waits for its end."""
        variable = self.dialect.variable if self.dialect.straight_through_variable else None
        await self._commands(commands.straight_move(location, variable), (), timeout_s or self._move_answer_s)

    async def ready(self) -> None:
        """The ready pose; over when the arm has stopped moving."""
        await self.command("DO READY")
        await self.still(self.dialect.motion_s)

    async def open_hand(self) -> None:
        """Open the hand now."""
        await self.command("DO OPENI")

    async def close_hand(self) -> None:
        """Close the hand now."""
        await self.command("DO CLOSEI")

    async def rest(self, location: Location, timeout_s: float | None = None) -> Where:
        """Wait until the arm is at rest at location: the controller says so, and two readings agree with it.

        Raises Elsewhere when it came to rest somewhere else, NoAnswer when it is not at rest in time.
        """
        deadline_s = self.clock() + (timeout_s or self.dialect.motion_s)
        if self.dialect.break_after_move:
            await self.command("DO BREAK", timeout_s=timeout_s or self.dialect.motion_s)
        elsewhere_since_s: float | None = None
        while True:
            where = await self.still(max(0.1, deadline_s - self.clock()))
            off_mm, off_deg = apart(where.location, location)
            if off_mm <= self.dialect.arrived_mm and off_deg <= self.dialect.arrived_deg:
                return where
            now_s = self.clock()
            elsewhere_since_s = now_s if elsewhere_since_s is None else elsewhere_since_s
            if now_s - elsewhere_since_s >= self.dialect.stall_s or now_s >= deadline_s:
                raise Elsewhere(f"at rest {off_mm:.2f} mm and {off_deg:.2f} degrees from where it was sent", where)

    async def still(self, timeout_s: float) -> Where:
        """Wait until two WHERE readings agree. Raises NoAnswer when they do not in time."""
        async with self._my_turn():
            return await self._still(timeout_s)

    async def abort(self) -> Where:
        """Stop the arm now, whoever is using the link (they get Preempted), and give where it came to rest.

        Raises NoAnswer when the controller does not confirm: then only the emergency stop is left.
        """
        if self._aborting is None or self._aborting.done():
            self._talk.end(Preempted("aborted"))
            self._talk = self._new_conversation()
            self._aborting = asyncio.create_task(self._abort())
        return await asyncio.shield(self._aborting)

    # Inside

    @property
    def _move_answer_s(self) -> float:
        return self.dialect.answer_s if self.dialect.prompt_after_move == "start" else self.dialect.motion_s

    async def _commands(self, lines: Sequence[str], replies: Sequence[str], timeout_s: float | None) -> Answer:
        """Several lines in one turn, so that no abort can fall between them unnoticed; the last one's answer."""
        if self._aborting is not None and not self._aborting.done() and any(map(commands.moves_the_arm, lines)):
            raise Preempted("an abort is under way")
        async with self._my_turn():
            self._refuse_unheard()
            for line in lines:
                moves = commands.moves_the_arm(line)
                wait_s = timeout_s or (self.dialect.motion_s if moves else self.dialect.answer_s)
                answer = _refuse_errors(await self._carry_out(line, replies, wait_s, moves), line)
        return answer

    async def _carry_out(self, text: str, replies: Sequence[str], wait_s: float, moves: bool) -> Answer:
        talk = self._talk
        for attempt in range(1, self.dialect.typing_attempts + 1):
            try:
                return await talk.ask(text, replies, wait_s)
            except (Garbled, NoAnswer) as problem:
                said = await self._recover(talk, problem)
                carried_out = talk.typed_whole and moves
                if said or carried_out or attempt == self.dialect.typing_attempts:
                    await self._report(problem, said)
        raise AssertionError("the last attempt reports")

    async def _recover(self, talk: Conversation, problem: LinkError) -> list[str]:
        """Back to a prompt; the errors the controller reported on the way. Raises NoAnswer (with the first problem)."""
        try:
            events = await talk.resynchronise()
        except NoAnswer as deaf:
            raise NoAnswer(f"{problem.message}; then {deaf.message}") from problem
        return [event.text for event in events if isinstance(event, Error) and not _is_our_poison(event.text)]

    async def _report(self, problem: LinkError, said: list[str]) -> None:
        """Raise what went wrong, with where the arm is."""
        try:
            problem.where = (await self._where_once()).where
        except LinkError:
            problem.where = None
        if said:
            raise ControllerError("; ".join(said), problem.where) from problem
        raise problem

    async def _where(self) -> Where:
        for _ in range(self.dialect.typing_attempts):
            answer = await self._carry_out("WHERE", (), self.dialect.answer_s, moves=False)
            _refuse_errors(answer, "WHERE")
            if answer.where is not None:
                return answer.where
        raise Garbled("WHERE did not give its table")

    async def _where_once(self) -> Answer:
        return await self._talk.ask("WHERE", (), self.dialect.answer_s)

    async def _still(self, timeout_s: float) -> Where:
        deadline_s = self.clock() + timeout_s
        before = await self._where()
        while True:
            await asyncio.sleep(self.dialect.poll_s)
            now = await self._where()
            off_mm, off_deg = apart(before.location, now.location)
            if off_mm <= self.dialect.same_place_mm and off_deg <= self.dialect.same_place_deg:
                return now
            if self.clock() > deadline_s:
                raise NoAnswer(f"not at rest within {timeout_s:g} s", now)
            before = now

    async def _abort(self) -> Where:
        line = self.dialect.cancel_line + self.dialect.abort_word.encode("ascii") + self.dialect.line_end
        for _ in range(ABORT_ATTEMPTS):
            self._send(line)
            self._reader.line_ended(echoed=False)
            try:
                await self._prompt_after_abort()
                return await self._still(self.dialect.answer_s)
            except (NoAnswer, Garbled, ControllerError):
                continue
        raise NoAnswer(f"{self.dialect.abort_word} was not confirmed: use the emergency stop")

    async def _prompt_after_abort(self) -> None:
        while not isinstance(await self._talk.next_event(self.dialect.resync_s, "no prompt after the abort"), Prompt):
            pass
        self._talk.unheard()

    async def _find_prompt(self) -> None:
        last = (await self._talk.resynchronise(leave_questions=True))[-1]
        self.question = last.text if isinstance(last, Question) else None

    @asynccontextmanager
    async def _my_turn(self, answers_question: bool = False) -> AsyncIterator[None]:
        """Commands take turns; one that waited through an abort is not carried out after it."""
        talk = self._talk
        if self._serial is None:
            raise PortError(f"{self.port}: not open")
        async with self._turn:
            if self._aborting is not None:
                await asyncio.wait([self._aborting])
            if talk is not self._talk:
                raise Preempted("aborted")
            if self.question is not None and not answers_question:
                raise ControllerError(f"the controller asks {self.question!r}: answer that first")
            yield

    def _refuse_unheard(self) -> None:
        """Errors that came while nobody asked (an emergency stop, power lost) are raised before anything is typed."""
        errors = [event.text for event in self._talk.unheard() if isinstance(event, Error)]
        if errors:
            raise ControllerError("; ".join(errors))

    def _new_conversation(self) -> Conversation:
        return Conversation(self.dialect, self._reader, self._send, self.clock)

    def _send(self, data: bytes) -> None:
        if self._serial is None:
            raise PortError(f"{self.port}: not open")
        self._ledger.sent(data, self.clock())
        self._serial.write(data)

    def _hear(self, data: bytes) -> None:
        self._cancel_silence()
        self._deliver(self._reader.receive(data))
        if self._reader.awaits_silence:
            self._silence = asyncio.get_running_loop().call_later(self.dialect.prompt_silence_s, self._hear_silence)

    def _hear_silence(self) -> None:
        self._deliver(self._reader.silence())

    def _deliver(self, events: list[Event]) -> None:
        for event in events:
            self._ledger.heard(event, self.clock())
            self._talk.hear(event)

    def _cancel_silence(self) -> None:
        if self._silence is not None:
            self._silence.cancel()
            self._silence = None

    def _lost(self, error: PortError) -> None:
        self._cancel_silence()
        self._talk.end(error)


def _refuse_errors(answer: Answer, asked: str) -> Answer:
    if answer.errors:
        raise ControllerError("; ".join(answer.errors), answer.where)
    return answer


def _is_our_poison(text: str) -> bool:
    return "illegal command" in text.lower() or "syntax error" in text.lower()
