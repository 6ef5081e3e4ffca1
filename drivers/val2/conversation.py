"""One exchange with the controller: type a line, compare its echo, end it, collect the answer, answer questions.

This module handles bytes, events and timeouts; link.py handles moves and positions. It sends through a function that it
is given.
"""

import asyncio
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, replace
from typing import Protocol

from drivers.val2.dialect import Dialect
from drivers.val2.errors import Busy, Garbled, Interleaved, LineHeldBack, LinkError, NoAnswer, ProcessorHalted
from drivers.val2.interleaved import follows_search, in_carets, typed_behind, typed_beside
from drivers.val2.location import Location
from drivers.val2.pending_answers import PendingAnswer, PendingAnswers
from drivers.val2.wire import (
    LONGEST_LINE,
    ControllerQuestion,
    Echo,
    Error,
    Garble,
    LineEvent,
    Prompt,
    Reader,
    ReaderState,
    Text,
    Where,
    WhereTable,
    is_halted,
    of_a_table,
)

POISON = b"!!"
"""Makes a half-typed line an error instead of a command, where it could not be cancelled."""
A_PROMPT = "a prompt"
TWICE = (
    "the serial converter and the controller both echo, so facetd cannot see what the controller read. Switch the "
    "converter's echo off"
)


class SendPermission(Protocol):
    """Whether motion commands may be sent. The line shares this object with its owner: the line writes what concerns
    the stop, the owner everything else."""

    stop_tests: int
    """How often it was verified that the controller accepts the stop command; 0: not yet since the port was opened or
    the controller was switched on, when it may be another controller or have another configuration."""
    stop_answered: int
    """How often the controller sent something after the stop command: the command went out, and the line works."""
    heard: int
    """How often the controller sent anything."""
    stop_took_s: float
    """How long the tested stop took until the arm was proven at rest; 0: not tested since the port was opened."""

    @property
    def withheld(self) -> bool: ...


class Unconditional:
    """A permission that never withholds motion."""

    def __init__(self) -> None:
        self.stop_tests = self.stop_answered = self.heard = 0
        self.stop_took_s = 0.0

    @property
    def withheld(self) -> bool:
        """Never."""
        return False


@dataclass(frozen=True)
class ControllerAnswer:
    """The controller's output for one command, up to its prompt, or up to a question without a reply (then in
    `question`).

    where: the table, if it printed one, in mm and the angles of facetd's kinematics.
    """

    command: str
    lines: tuple[str, ...]
    errors: tuple[str, ...]
    where: Where | None
    question: str | None
    seconds: float
    of_text: tuple[str, ...] = ()
    """The lines that are neither error nor question."""


class Conversation:
    """Both directions of the line: it receives events, and types and checks lines."""

    def __init__(
        self,
        dialect: Dialect,
        reader: Reader,
        send: Callable[[bytes, bytes], None],
        clock: Callable[[], float],
        permission: SendPermission,
        owed: PendingAnswers,
    ):
        """send: takes bytes, and the part of them to write to the ledger; permission: checked before a line that moves
        is ended; owed: takes note of lines that were not answered in time."""
        self.dialect, self.clock, self._permission, self._owed = dialect, clock, permission, owed
        self._reader, self._send = reader, send
        self._inbox: asyncio.Queue[LineEvent | None] = asyncio.Queue()
        self._over: LinkError | None = None
        self._stood = reader.pending
        """The incomplete input when the conversation began, or when a prompt was searched for: it was reported before,
        or belongs to facetd's own line."""
        self.typed_whole = False
        """Whether the present command's line end was sent: from then on it may have been carried out."""
        self.line_may_have_leftover = True
        """Whether the next line may still have the rest of an earlier one in front of it. True from the search for a
        prompt until the next line is answered: a controller that cannot cancel lines may have printed a prompt just
        then, which looks as if the line had been cancelled."""

    def hear(self, event: LineEvent) -> None:
        """Take an event that was received."""
        self._inbox.put_nowait(event)

    def end(self, why: LinkError) -> None:
        """End the conversation: nothing more is sent, and tasks that wait for an event get the error `why`."""
        self._over = self._over or why
        self._inbox.put_nowait(None)

    def unheard(self) -> list[LineEvent]:
        """Take the events that came while no task was waiting. Raises the error that the conversation ended with."""
        self.check()
        events: list[LineEvent] = []
        while not self._inbox.empty():
            event = self._inbox.get_nowait()
            if event is not None:
                events.append(event)
        return events

    @property
    def holds_unheard(self) -> bool:
        """Whether something came while no task was waiting that the next turn must report. Raises as unheard."""
        events = self.unheard()
        for event in events:
            self.hear(event)
        by_itself = any(isinstance(event, Error | ControllerQuestion) for event in events)
        return by_itself or self.others_of(events) != []

    def unheard_of_others(self) -> list[str]:
        """Take what came since the last answer and answers no line of facetd's, as text; errors and questions stay for
        the next reader. Raises as unheard."""
        events = self.unheard()
        for event in events:
            if isinstance(event, Error | ControllerQuestion):
                self.hear(event)
        return self.others_of(events)

    def others_of(self, events: Sequence[LineEvent]) -> list[str]:
        """The text of those events, and of incomplete input, that answer no line of facetd's. If facetd's line end has
        two characters, the second one is answered by another prompt."""
        heard = [
            A_PROMPT if isinstance(event, Prompt) else event.raw.decode("latin-1").strip()
            for event in events
            if not isinstance(event, Error | ControllerQuestion)
        ]
        if len(self.dialect.line_end) > 1 and heard[:1] == [A_PROMPT]:
            del heard[0]
        half_come = self._reader.pending.removeprefix(self._stood).strip(b"\x00\x07\x7f\r\n .")
        typed = len(half_come) > 1 and not half_come.startswith(b"*")  # the controller's message: an Error once it ends
        return heard + ([half_come.decode("latin-1")] if typed else [])

    async def ask(
        self,
        command: str,
        replies: Sequence[str],
        timeout_s: float,
        meant: Callable[[str], bool] = bool,
        moves: bool = False,
    ) -> ControllerAnswer:
        """Type a command, reply to its questions, and collect everything up to the prompt, or up to a question without
        a reply. meant: whether the replies are meant for a question; moves: end the line only if motion is permitted.

        Raises Garbled, NoAnswer, LineHeldBack, Preempted, PortError; ValueError for text that cannot be typed.
        """
        began_s = self.clock()
        self.typed_whole = False
        await self._type_line(command, moves)
        left = list(replies)
        gathered: list[LineEvent] = []
        while True:
            otherwise = f"no answer to {command!r} within {timeout_s:g} s"
            event = await self.next_event(timeout_s, otherwise, PendingAnswer(command))
            gathered.append(event)
            if isinstance(event, ControllerQuestion) and left and meant(event.text):
                await self._type_line(left.pop(0))
            elif isinstance(event, Prompt | ControllerQuestion):
                self.line_may_have_leftover = False
                self._owed.line_answered()
                answer = answer_from(command, gathered, self.clock() - began_s, self.dialect)
                if command == "WHERE" and answer.where is not None:
                    self._owed.table_came()
                return answer

    async def next_event(self, timeout_s: float, otherwise: str, owed: PendingAnswer | None = None) -> LineEvent:
        """Wait for the next event. Raises NoAnswer(otherwise), after it notes what is owed; Preempted, PortError."""
        self.check()
        try:
            async with asyncio.timeout(timeout_s):
                event = await self._inbox.get()
        except TimeoutError:
            if owed is not None:
                self._owed.add(owed)
            raise NoAnswer(otherwise) from None
        self.check()
        assert event is not None
        return event

    async def next_prompt_or_question(self, timeout_s: float, collected: list[LineEvent] | None = None) -> LineEvent:
        """Wait until the controller waits for input; `collected` gets all events up to there. Raises as next_event."""
        while True:
            event = await self.next_event(timeout_s, f"no prompt within {timeout_s:g} s")
            if collected is not None:
                collected.append(event)
            if isinstance(event, Prompt | ControllerQuestion):
                return event

    async def last_prompt_or_question(self, timeout_s: float) -> LineEvent:
        """Wait for the prompt or question after which nothing more comes, so not one that was sent before facetd typed.
        Raises as next_event, also if the controller keeps printing."""
        last = await self._prompt_before_long(timeout_s)
        while True:
            await asyncio.sleep(max(self.dialect.prompt_silence_s, 2.0 * self.dialect.prompt_late_s))
            more = self.unheard()
            if not more:
                return last
            waits = isinstance(more[-1], Prompt | ControllerQuestion)
            last = more[-1] if waits else await self._prompt_before_long(timeout_s)

    async def _prompt_before_long(self, timeout_s: float) -> LineEvent:
        """Wait for the next prompt or question, at most as long as a table takes: a program may keep printing. Raises
        as next_event."""
        try:
            async with asyncio.timeout(self.dialect.table_s):
                return await self.next_prompt_or_question(timeout_s)
        except TimeoutError:
            raise NoAnswer(f"no prompt in what was printed for {self.dialect.table_s:.1f} s") from None

    async def resynchronise(self, attempts: int = 3) -> list[LineEvent]:
        """Bring the controller to an empty line and its prompt or question; returns its output, that one last.

        It first cancels the half-typed line. If that brings no prompt, or the controller has no key for it, it types
        characters that make any line an error, and ends the line. Raises NoAnswer; Busy where something came back, but
        neither prompt nor question; ProcessorHalted.
        """
        self.line_may_have_leftover, self._stood = True, self._reader.pending
        collected: list[LineEvent] = []
        cancel = self.dialect.cancel_line
        for attempt in range(attempts):
            poison = b"" if cancel and attempt == 0 else POISON
            self._owed.search_typed([echo for echo in (in_carets(cancel), poison) if echo])
            await self.type_raw(cancel + poison + (self.dialect.line_end if poison else b""))
            seen = len(collected)
            try:
                await self.next_prompt_or_question(self.dialect.resync_s, collected)
            except NoAnswer:
                if is_halted(b"".join(event.raw for event in collected) + self._reader.pending):
                    raise ProcessorHalted from None
                self._owed.add(PendingAnswer(""))
                continue
            finally:
                self._owed.search_heard(b"".join(event.raw for event in collected[seen:]))
            await asyncio.sleep(self.dialect.echo_settle_s)
            return collected
        error = Busy if collected else NoAnswer
        raise error(
            f"the controller gives no prompt ({attempts} attempts): is it on, and does arm.port name its terminal line?"
        )

    def send_raw(self, data: bytes) -> None:
        """Send bytes without checking their echo. Raises Preempted, PortError."""
        self._put(data)
        self._reader.line_ended(echoed=False)

    async def type_raw(self, data: bytes) -> None:
        """Type bytes without checking their echo, no faster than the controller reads; one record in the ledger.
        Raises as send_raw."""
        await self._send_paced(data, lambda: self._reader.line_ended(echoed=False))

    @asynccontextmanager
    async def typing(self) -> AsyncIterator[Callable[[bytes], None]]:
        """Context: yields a function that types bytes in order, as type_raw does; it ends when all have been sent. The
        function raises Preempted, PortError."""
        if self.dialect.character_pause_s <= 0:
            yield self.send_raw
            return
        waiting: asyncio.Queue[bytes] = asyncio.Queue()

        def typed(data: bytes) -> None:
            self.check()
            waiting.put_nowait(data)

        async def type_all() -> None:
            with suppress(LinkError):  # the next typed line reports it
                while data := await waiting.get():
                    await self.type_raw(data)

        task = asyncio.create_task(type_all(), name="type what a person types")
        try:
            yield typed
        finally:
            waiting.put_nowait(b"")
            await asyncio.wait({task})

    async def _type_line(self, text: str, moves: bool = False) -> None:
        """Send the characters, compare their echo, and only then send the line end.

        Raises Garbled, NoAnswer (no echo) and LineHeldBack; in each case the line end was not sent.
        """
        if not self.dialect.can_type(text):
            raise ValueError(f"{text!r} cannot be typed: at most {self.dialect.line_limit} plain characters")
        body = text.encode("ascii")
        if body and self.dialect.echo:
            self._reader.typed(body)
            await self._send_paced(body)
            await self._hear_echo(text)
        elif body:
            await self._send_paced(body)
        if moves and self._permission.withheld:
            raise LineHeldBack(f"{text!r} was held back")
        self._put(self.dialect.line_end)
        self._reader.line_ended(self.dialect.echo)
        self.typed_whole = True

    async def _send_paced(self, data: bytes, begun: Callable[[], None] | None = None) -> None:
        """Send bytes no faster than the controller reads. begun: called once the first is sent; the ledger then has all
        of them as one record, and otherwise one record a character."""
        pause_s = self.dialect.character_pause_s
        pieces = [data] if pause_s <= 0 else [data[k : k + 1] for k in range(len(data))]
        for k, piece in enumerate(pieces):
            self.check()
            self._send(piece, piece if begun is None else data if k == 0 else b"")
            if begun is not None and k == 0:
                begun()
            if pause_s > 0:
                await asyncio.sleep(pause_s)

    async def _hear_echo(self, text: str) -> None:
        wait_s = self.dialect.typing_s + 20.0 * len(text) / self.dialect.baud
        while True:
            otherwise = f"no echo of {text!r} within {wait_s:.1f} s"
            event = await self.next_event(wait_s, otherwise, PendingAnswer(text, is_echo=True))
            if isinstance(event, Garble):
                await self._judge_echo(text, event)
                raise Garbled(
                    f"typed {event.expected!r}, echoed {event.got!r}", code=None if event.got else "controller_silent"
                )
            if isinstance(event, Echo):
                break
        await asyncio.sleep(self.dialect.echo_settle_s)
        if self._reader.state is not ReaderState.TYPED:
            await self._judge_echo(text, event)
            raise Garbled(f"typed {text!r}, but the echo had extra characters after it")

    async def _judge_echo(self, text: str, first: LineEvent) -> None:
        """Wait until nothing more comes, then find the cause of a wrong echo. Raises Garbled where the echo came twice,
        Interleaved where it contains somebody else's line, and not only the late echo of a search for the prompt."""
        typed, back, before = text.encode("ascii"), b"", None
        while before != back and len(back) < 2 * len(text) + LONGEST_LINE:
            await asyncio.sleep(10.0 * len(text) / self.dialect.baud + self.dialect.prompt_silence_s)
            behind = self.unheard()
            for event in behind:
                self.hear(event)  # kept for the search for the prompt: it may be an emergency stop
            before, back = back, b"".join(event.raw for event in (first, *behind)) + self._reader.pending
        if is_twice(typed, back):
            raise Garbled(TWICE, code="converter_echoes")
        late = self._owed.owes_search_echo and follows_search(typed, back, self.dialect.cancel_line)
        if typed_beside(typed, back) and not late:
            raise Interleaved(back)

    def _put(self, data: bytes) -> None:
        self.check()
        self._send(data, data)

    def check(self) -> None:
        """Raise the error that the conversation ended with, if it has ended."""
        if self._over is not None:
            raise self._over


def answer_from(command: str, events: Sequence[LineEvent], seconds: float, dialect: Dialect) -> ControllerAnswer:
    """Build a ControllerAnswer from the events. Raises Garbled where they contain noise or a second echo, Interleaved
    where they contain somebody else's line."""
    received, typed = b"".join(event.raw for event in events).lstrip(b"\r\n"), command.encode("ascii")
    garbled = any(isinstance(event, Garble) for event in events)
    again = received.translate(None, b"\r\n").startswith(typed) if garbled else received.splitlines()[:1] == [typed]
    if dialect.echo and again:
        raise Garbled(TWICE, code="converter_echoes")
    if garbled and typed_behind(received):
        raise Interleaved(received)
    starred = [event.text for event in events if isinstance(event, Error) and of_a_table(event.text)]
    if garbled or (starred and command == "WHERE"):
        raise Garbled(f"the answer to {command!r} arrived damaged (noise on the line?)")
    tables = [event.where for event in events if isinstance(event, WhereTable)]
    last = events[-1]
    return ControllerAnswer(
        command=command,
        lines=tuple(event.text for event in events if isinstance(event, Text | Error | ControllerQuestion)),
        errors=tuple(event.text for event in events if isinstance(event, Error)),
        where=_in_our_units(tables[-1], dialect) if tables else None,
        question=last.text if isinstance(last, ControllerQuestion) else None,
        seconds=seconds,
        of_text=tuple(event.text for event in events if isinstance(event, Text)),
    )


def is_twice(typed: bytes, back: bytes) -> bool:
    """Whether `back` begins with two copies of what was typed, one behind the other or each a piece at a time."""
    copies = {0}
    """How much of one copy there may be; the rest is the other's."""
    for k, byte in enumerate(back[: 2 * len(typed)]):
        grown = {have + 1 for have in copies if typed[have : have + 1] == bytes([byte])}
        copies = grown | {have for have in copies if typed[k - have : k - have + 1] == bytes([byte])}
    return len(back) >= 2 * len(typed) and len(typed) in copies


def _in_our_units(where: Where, dialect: Dialect) -> Where:
    x, y, z, *angles = where.location.values()
    lengths = (value * dialect.unit_mm for value in (x, y, z))
    return replace(where, location=Location(*lengths, *angles), joints_deg=dialect.our_angles_deg(where.joints_deg))
