"""One exchange with the controller: type, compare the echo, end the line, gather the answer, answer questions.

Knows bytes, events and time-outs; knows nothing of moves or places (link.py). Sends through the function it is given.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from drivers.val2.dialect import Dialect
from drivers.val2.errors import Garbled, LinkError, NoAnswer
from drivers.val2.wire import Echo, Error, Event, Garble, Prompt, Question, Reader, State, Table, Text, Where

POISON = b"!!"
"""Makes any half-typed line an error instead of a command, where it could not be cancelled."""


@dataclass(frozen=True)
class Answer:
    """What the controller said to one command, up to its prompt. where: the table, if it printed one."""

    command: str
    lines: tuple[str, ...]
    errors: tuple[str, ...]
    where: Where | None
    seconds: float


class Conversation:
    """The two directions of the line: what comes goes to `inbox`, what goes out is typed and checked here."""

    def __init__(self, dialect: Dialect, reader: Reader, send: Callable[[bytes], None], clock: Callable[[], float]):
        self.dialect, self.clock = dialect, clock
        self._reader, self._send = reader, send
        self._inbox: asyncio.Queue[Event | LinkError] = asyncio.Queue()
        self._over: LinkError | None = None
        self.typed_whole = False
        """Whether the present command's line end has gone out: from then on it may have been carried out."""

    def hear(self, event: Event | LinkError) -> None:
        """Take what came, or an error of the port."""
        self._inbox.put_nowait(event)

    def end(self, why: LinkError) -> None:
        """Nothing is sent or awaited any more; whoever waits gets `why`."""
        self._over = why
        self._inbox.put_nowait(why)

    def unheard(self) -> list[Event]:
        """What came while nobody was waiting. Raises the port's error, if one came."""
        events: list[Event] = []
        while not self._inbox.empty():
            event = self._inbox.get_nowait()
            if isinstance(event, LinkError):
                raise event
            events.append(event)
        return events

    async def ask(self, command: str, replies: Sequence[str], timeout_s: float) -> Answer:
        """Type a command, and the replies to what it asks, and gather everything up to the prompt.

        A question past the replies is answered with N (Y/N questions) or an empty line. Raises Garbled, NoAnswer.
        """
        began_s = self.clock()
        self.typed_whole = False
        await self.type_line(command)
        left = list(replies)
        gathered: list[Event] = []
        while True:
            event = await self.next_event(timeout_s, f"no answer to {command!r} within {timeout_s:g} s")
            gathered.append(event)
            if isinstance(event, Prompt):
                break
            if isinstance(event, Question):
                await self.type_line(left.pop(0) if left else ("N" if "Y/N" in event.text.upper() else ""))
        return answer_from(command, gathered, self.clock() - began_s)

    async def type_line(self, text: str) -> None:
        """Send the characters, compare what comes back, and only then send the line end.

        Raises Garbled (the line end was not sent), NoAnswer (no echo; likewise), ValueError on what cannot be typed.
        """
        if len(text) > self.dialect.line_limit or not (text.isascii() and (text.isprintable() or not text)):
            raise ValueError(f"{text!r} cannot be typed: at most {self.dialect.line_limit} plain characters")
        body = text.encode("ascii")
        if body and self.dialect.echo:
            self._reader.typed(body)
            await self._send_paced(body)
            await self._hear_echo(text)
        elif body:
            await self._send_paced(body)
        self._put(self.dialect.line_end)
        self._reader.line_ended(self.dialect.echo)
        self.typed_whole = True

    async def next_event(self, timeout_s: float, otherwise: str) -> Event:
        """The next event. Raises NoAnswer(otherwise), Preempted, PortError."""
        if self._over is not None:
            raise self._over
        try:
            event = await asyncio.wait_for(self._inbox.get(), timeout_s)
        except TimeoutError:
            raise NoAnswer(otherwise) from None
        if self._over is not None:
            raise self._over
        if isinstance(event, LinkError):
            raise event
        return event

    async def resynchronise(self, attempts: int = 3, leave_questions: bool = False) -> list[Event]:
        """Get the controller to an empty line and its prompt, whatever it was in the middle of; what it said meanwhile.

        First the half-typed line is cancelled. Should that not bring a prompt, characters that make any line an error
        are typed and ended. Questions are answered with N, or (leave_questions) end the search too. Raises NoAnswer.
        """
        said: list[Event] = []
        for attempt in range(attempts):
            self._put(self.dialect.cancel_line if attempt == 0 else self.dialect.cancel_line + POISON + b"\r")
            self._reader.line_ended(echoed=False)
            while True:
                try:
                    event = await self.next_event(self.dialect.resync_s, "")
                except NoAnswer:
                    break
                said.append(event)
                if isinstance(event, Prompt) or (leave_questions and isinstance(event, Question)):
                    await self._settle()
                    return [*said, *self.unheard()]
                if isinstance(event, Question):
                    self._put(b"N" + self.dialect.line_end)
                    self._reader.line_ended(echoed=False)
        raise NoAnswer(f"no prompt after {attempts} attempts; is the controller on, and its terminal line this one?")

    async def _send_paced(self, body: bytes) -> None:
        if self.dialect.character_pause_s <= 0:
            self._put(body)
            return
        for k in range(len(body)):
            self._put(body[k : k + 1])
            await asyncio.sleep(self.dialect.character_pause_s)

    async def _hear_echo(self, text: str) -> None:
        deadline_s = self.dialect.typing_s + 20.0 * len(text) / self.dialect.baud
        while True:
            event = await self.next_event(deadline_s, f"no echo of {text!r} within {deadline_s:.1f} s")
            if isinstance(event, Garble):
                raise Garbled(f"typed {event.expected!r}, echoed {event.got!r}")
            if isinstance(event, Echo):
                break
        await self._settle()
        if self._reader.state is not State.TYPED:
            raise Garbled(f"typed {text!r}, echoed with more behind it")

    async def _settle(self) -> None:
        await asyncio.sleep(self.dialect.echo_settle_s)

    def _put(self, data: bytes) -> None:
        if self._over is not None:
            raise self._over
        self._send(data)


def answer_from(command: str, events: Sequence[Event], seconds: float) -> Answer:
    """Sort what came into an Answer. Raises Garbled where noise came in between."""
    for event in events:
        if isinstance(event, Garble):
            raise Garbled(f"the answer to {command!r} did not come through whole")
    tables = [event.where for event in events if isinstance(event, Table)]
    return Answer(
        command=command,
        lines=tuple(event.text for event in events if isinstance(event, Text | Error | Question)),
        errors=tuple(event.text for event in events if isinstance(event, Error)),
        where=tables[-1] if tables else None,
        seconds=seconds,
    )
