"""An open line to a controller: the port, the reader, silence, the ledger, whose turn it is. No commands here."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager

from drivers.val2.conversation import Conversation
from drivers.val2.dialect import Dialect
from drivers.val2.errors import ControllerError, LinkError, PortError, Preempted
from drivers.val2.ledger import Ledger
from drivers.val2.port import OpenPort
from drivers.val2.wire import Error, Event, Question, Reader


class Session:
    """Bytes become events and reach whoever has the turn; what is sent and heard goes to the ledger."""

    def __init__(
        self, path: str, dialect: Dialect, clock: Callable[[], float], ledger: Ledger, open_port: OpenPort
    ) -> None:
        """Claim the port. Raises PortError. Needs a running event loop."""
        self.path, self.dialect, self.clock = path, dialect, clock
        self.question: str | None = None
        """What the controller asks and nobody has answered yet."""
        self.line_may_hold_rest = True
        """Whether what was typed before the prompt was found may still stand in front of the next line: a controller
        that cannot cancel lines, and happened to print a prompt just then, looks as if it had."""
        self.lost = False
        """Whether the port is gone, or was closed."""
        self._ledger = ledger
        self._reader = Reader()
        self.talk = self._new_conversation()
        self._turn = asyncio.Lock()
        self._may_go_on = asyncio.Event()
        self._may_go_on.set()
        self._silence: asyncio.TimerHandle | None = None
        self._listener: Callable[[bytes], None] | None = None
        self._port = open_port(path, dialect, self._hear, self._lost)

    def close(self) -> None:
        """Let go of the port; whoever waits gets PortError."""
        self._lost(PortError(f"{self.path}: closed"))
        self._port.close()

    @asynccontextmanager
    async def turn(self, moves: bool = False, answers_question: bool = False) -> AsyncIterator[Conversation]:
        """The line for oneself. Who waited through a pre-emption gets Preempted, and so does a motion asked for in one.

        Raises ControllerError while the controller asks something else, or reported an error while nobody listened.
        """
        talk = self.talk
        if moves and not self._may_go_on.is_set():
            raise Preempted("an abort is under way")
        async with self._turn:
            await self._may_go_on.wait()
            if talk is not self.talk:
                raise Preempted("aborted")
            self._refuse_unheard(answers_question)
            yield talk

    @asynccontextmanager
    async def preemption(self) -> AsyncIterator[Conversation]:
        """The line now, whoever has it: they get Preempted, and cannot send another byte."""
        self._may_go_on.clear()
        self.talk.end(Preempted("aborted"))
        self.talk = self._new_conversation()
        try:
            yield self.talk
        finally:
            self._may_go_on.set()

    @asynccontextmanager
    async def terminal(self, on_bytes: Callable[[bytes], None]) -> AsyncIterator[Callable[[bytes], None]]:
        """The bare line, for a person: what comes goes to on_bytes as well, what is typed to the function given."""
        talk = self.talk
        async with self._turn:
            await self._may_go_on.wait()
            self._listener = on_bytes
            try:
                async with talk.typing() as typed:
                    yield typed
            finally:
                self._listener = None
                if talk is self.talk:
                    talk.unheard()  # what the person was told is no answer of ours
                    await self.find_prompt()
                    await asyncio.sleep(self.dialect.prompt_silence_s)
                    while talk.unheard():  # nor what was still on its way
                        await asyncio.sleep(self.dialect.prompt_silence_s)

    async def find_prompt(self, attempts: int = 3) -> list[Event]:
        """Get to the prompt, or to the question the controller asks (kept in `question`). Raises NoAnswer."""
        self.line_may_hold_rest = True
        events = await self.talk.resynchronise(attempts)
        last = events[-1]
        self.question = last.text if isinstance(last, Question) else None
        return events

    def send(self, data: bytes, kept: bytes) -> None:
        """Send bytes, then keep `kept` of them in the ledger. Raises PortError."""
        self._port.write(data)
        if kept:
            self._ledger.sent(kept, self.clock())

    def _refuse_unheard(self, answers_question: bool) -> None:
        """Errors and questions that came while nobody listened (an emergency stop, a power cycle) come first."""
        events = self.talk.unheard()
        questions = [event.text for event in events if isinstance(event, Question)]
        if questions:
            self.question = questions[-1]
        errors = [event.text for event in events if isinstance(event, Error)]
        if errors:
            raise ControllerError("; ".join(errors))
        if self.question is not None and not answers_question:
            raise ControllerError(f"the controller asks {self.question!r}: answer that first")

    def _new_conversation(self) -> Conversation:
        return Conversation(self.dialect, self._reader, self.send, self.clock)

    def _hear(self, data: bytes) -> None:
        self._cancel_silence()
        if self._listener is not None:
            self._listener(data)
        self._deliver(self._reader.receive(data))
        if self._reader.awaits_silence:
            self._silence = asyncio.get_running_loop().call_later(self.dialect.prompt_silence_s, self._hear_silence)

    def _hear_silence(self) -> None:
        self._deliver(self._reader.silence())

    def _deliver(self, events: list[Event]) -> None:
        for event in events:
            self.talk.hear(event)
            self._ledger.heard(event, self.clock())

    def _cancel_silence(self) -> None:
        if self._silence is not None:
            self._silence.cancel()
            self._silence = None

    def _lost(self, error: LinkError) -> None:
        self.lost = True
        self._cancel_silence()
        self.talk.end(error)
