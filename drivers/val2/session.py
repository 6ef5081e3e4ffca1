"""An open line to a controller: the port, the reader, silence, the ledger, whose turn it is, what is asked again.

What the commands are, and what of their answers says where the arm is, is link.py's.
"""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator, Sequence
from contextlib import asynccontextmanager, contextmanager, suppress

from drivers.ledger import Ledger
from drivers.val2 import commands
from drivers.val2.conversation import A_PROMPT, ControllerAnswer, Conversation, LinePermit
from drivers.val2.dialect import Dialect
from drivers.val2.errors import (
    Busy,
    ControllerError,
    Disturbed,
    Garbled,
    HeldBack,
    Interleaved,
    LinkError,
    NoAnswer,
    PortError,
    Preempted,
    ProcessorHalted,
)
from drivers.val2.interleaved import SHORTEST_TYPED, answers_search
from drivers.val2.pending_answers import PendingAnswers
from drivers.val2.port import OpenPort
from drivers.val2.wire import ControllerQuestion, Error, LineEvent, Reader, Text, of_a_table

QUOTED_PIECES, QUOTED_CHARACTERS = 3, 60
"""Of what was heard, at most, in a message."""
CONFIRMS = "are you sure"
"""How a controller asks whether a command is meant; found open, it was typed by somebody who is gone."""


class LineSession:
    """Bytes become events and reach whoever has the turn; what is sent and heard goes to the ledger."""

    def __init__(
        self,
        path: str,
        dialect: Dialect,
        clock: Callable[[], float],
        ledger: Ledger,
        open_port: OpenPort,
        switched_on: Callable[[], None],
        disturbed: Callable[[], None],
        permit: LinePermit,
    ) -> None:
        """Claim the port. Raises PortError. Needs a running event loop. switched_on: called as the controller asks what
        it asks at power-up, whoever has the line; disturbed: as it is found that somebody else types on it; permit:
        asked before a line that moves is ended, at each try."""
        self._permit = permit
        self.path, self.dialect, self.clock = path, dialect, clock
        self.question: str | None = None
        """What the controller asks and nobody has answered yet."""
        self.lost = False
        """Whether the port is gone, or was closed."""
        self.traffic = 0
        """How often anything was sent or heard."""
        self.stop_typed = False
        """Whether the word that stops the arm went out, and nothing was heard since."""
        self._unreported: Disturbed | None = None
        """What somebody did to the port or on the line that nobody heard of yet, for whoever has the next turn."""
        self._cut_off = False
        """Whether who had the line lost it to that: what they had half typed may still stand in it."""
        self.recoveries = 0
        """How often the prompt had to be found again: what was typed around that may not have been read as typed."""
        self._ledger, self._switched_on, self._disturbed = ledger, switched_on, disturbed
        self._reader = Reader()
        self._owed = PendingAnswers(clock, dialect.motion_s)
        self.talk = self._new_conversation()
        self._turn = asyncio.Lock()
        self._may_go_on = asyncio.Event()
        self._may_go_on.set()
        self._opened = asyncio.Event()
        self._opened.set()
        self._silence: asyncio.TimerHandle | None = None
        self._listener: Callable[[bytes], None] | None = None
        self._port = open_port(path, dialect, self._hear, self._in_trouble)

    def close(self) -> None:
        """Let go of the port; whoever waits gets PortError."""
        self._lost(
            PortError(
                f"{self.path}: facetd closed the line before the controller answered; look at the arm and at `status`, "
                "then repeat the command"
            )
        )
        self._port.close()

    @contextmanager
    def being_opened(self) -> Iterator[None]:
        """Whoever comes meanwhile waits for their turn, but for who opens: what they typed would stand amid that."""
        self._opened.clear()
        try:
            yield
        finally:
            self._opened.set()

    @asynccontextmanager
    async def turn(
        self, moves: bool = False, answers_question: bool = False, opens: bool = False
    ) -> AsyncIterator[Conversation]:
        """The line for oneself. Who waited through a pre-emption gets Preempted, and so does a motion asked for in one;
        Disturbed, who waited as somebody changed the port's settings. opens: it is the turn of who opens the line.

        Raises ControllerError while the controller asks something else, or reported an error while nobody listened.
        """
        if not opens:
            await self._opened.wait()
        talk = self.talk
        if moves and not self._may_go_on.is_set():
            raise Preempted("an abort is under way")
        async with self._turn:
            await self._may_go_on.wait()
            talk.check()
            while self._reader.awaits_silence and not self.lost:  # a question of its own, heard but for the silence
                await asyncio.sleep(self.dialect.prompt_silence_s)
            talk.check()
            try:
                self._refuse_unheard(answers_question)
            except (Disturbed, NoAnswer) as found:
                if self._reader.pending:  # half a line: it would be refused for ever, and stand before the next of ours
                    with suppress(NoAnswer), self._kept(found):
                        await self.find_prompt(talk)
                raise
            if self._cut_off:
                await self.find_prompt(talk)
                self._cut_off = False
            yield talk

    @asynccontextmanager
    async def preemption(self) -> AsyncIterator[Conversation]:
        """The line now, whoever has it: they get Preempted, and cannot send another byte."""
        self._may_go_on.clear()
        self.talk.end(Preempted("aborted"))
        self._port.overtake()
        self.talk = self._new_conversation()
        try:
            yield self.talk
        finally:
            self._may_go_on.set()

    @asynccontextmanager
    async def terminal(self, on_bytes: Callable[[bytes], None]) -> AsyncIterator[Callable[[bytes], None]]:
        """The bare line, for a person: what comes goes to on_bytes as well, what is typed to the function given. Raises
        Busy once they left, where a program prints on and on."""
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
                    await self._silence_behind_a_person(talk)

    async def _silence_behind_a_person(self, talk: Conversation) -> None:
        within_s = 3 * self.dialect.resync_s + self.dialect.table_s
        try:
            async with asyncio.timeout(within_s):
                talk.unheard()  # the answers to the person are none to us
                await self.find_prompt(talk)
                await asyncio.sleep(self.dialect.prompt_silence_s)
                while talk.unheard():  # nor what was still on its way
                    await asyncio.sleep(self.dialect.prompt_silence_s)
        except TimeoutError:
            raise Busy(f"a program printed for {within_s:.1f} s after the terminal was left") from None

    async def find_prompt(self, talk: Conversation, attempts: int = 3) -> list[LineEvent]:
        """Get to the prompt, or to the question the controller asks (kept in `question`). Raises NoAnswer. talk: whose
        line it is; where a stop has taken it meanwhile not a byte is typed into the stop."""
        events = await talk.resynchronise(attempts)
        last = events[-1]
        self.question = last.text if isinstance(last, ControllerQuestion) else None
        return events

    async def prompt_on_opening(self) -> None:
        """To the prompt or question; asked again only where that keeps no arm moving. Raises NoAnswer, Busy also where
        a program prints on and on."""
        try:
            async with asyncio.timeout(self.dialect.table_s):
                await self.find_prompt(self.talk, attempts=1)
        except TimeoutError:
            raise Busy(f"no prompt in what was printed for {self.dialect.table_s:.1f} s") from None
        except NoAnswer as problem:
            if isinstance(problem, Busy | ProcessorHalted) or not self.dialect.echo:
                raise
            await self.find_prompt(self.talk)

    async def decline(self) -> None:
        """No to what somebody before us began; typed twice where something stood in the line before it."""
        async with self.turn(answers_question=True, opens=True) as talk:
            for _ in range(2):
                answer = await talk.ask("N", (), self.dialect.resync_s)
                self.question = answer.question
                if answer.question is None:
                    return

    async def ask(
        self,
        talk: Conversation,
        text: str,
        replies: Sequence[str],
        wait_s: float,
        meant: Callable[[str], bool] = bool,
        moves: bool = False,
        first: Callable[[], Awaitable[None]] | None = None,
    ) -> ControllerAnswer:
        """Ask, and ask again as long as that is safe: the line was never ended, or it moves nothing. moves: it is ended
        only where motion is permitted then; first: what is to be done each time before it is typed."""
        for _ in range(self.dialect.typing_attempts):
            if first is not None:
                await first()
            self._refuse_others(talk.unheard_of_others())
            try:
                return await self.ask_once(talk, text, replies, wait_s, meant, moves)
            except (Garbled, NoAnswer, HeldBack) as caught:
                problem = caught
            if isinstance(problem, Interleaved):
                await self._refuse_interleaved(talk, problem)
            once_only = isinstance(problem, HeldBack) or (talk.typed_whole and commands.moves_the_arm(text))
            said = await self.recover(talk, problem)
            if said or once_only:
                break
        with suppress(Garbled, NoAnswer):
            problem.where = (await talk.ask("WHERE", (), self.dialect.answer_s)).where
        if said:
            raise ControllerError("; ".join(said), problem.where) from problem
        raise problem

    async def ask_once(
        self,
        talk: Conversation,
        text: str,
        replies: Sequence[str],
        wait_s: float,
        meant: Callable[[str], bool] = bool,
        moves: bool = False,
    ) -> ControllerAnswer:
        """Ask, and see that nothing of somebody else's came amid the answer. Raises as Conversation.ask; Disturbed,
        NoAnswer where an answer of ours came too late amid it, Garbled where a line came twice."""
        answer = await self.past_a_rest(talk, lambda: talk.ask(text, replies, wait_s, meant, moves))
        said_by_itself = answer.question is not None or answer.errors
        if not said_by_itself and (commands.answers_nothing(text) or answer.where is not None):
            lines = [line for line in answer.of_text if not of_a_table(line)]
            self._refuse_others([line for line in lines if _is_no_noise(line)])
            if len(lines) < len(answer.of_text):
                raise Garbled(f"of the answer to {text!r} a line came twice")
        return answer

    async def past_a_rest(
        self, talk: Conversation, type_it: Callable[[], Awaitable[ControllerAnswer]]
    ) -> ControllerAnswer:
        """Type it; once more where this was the first line since the prompt was found, and was refused as a command
        nobody knows: it was not carried out."""
        may_hold_rest = talk.line_may_hold_rest
        answer = await type_it()
        if may_hold_rest and answer.errors and all(map(_may_be_our_own_noise, answer.errors)):
            answer = await type_it()
        return answer

    async def recover(self, talk: Conversation, problem: LinkError) -> list[str]:
        """Back to a prompt; the errors the controller reported on the way. Raises NoAnswer, ControllerError."""
        self.recoveries += 1
        try:
            events = await self.find_prompt(talk)
        except NoAnswer as deaf:
            raise NoAnswer(f"{problem.message}; then {deaf.message}", code=problem.code) from problem
        if self.question is not None:
            raise self._unanswered() from problem
        return [event.text for event in events if isinstance(event, Error) and not _may_be_our_own_noise(event.text)]

    def accept(self, answer: ControllerAnswer) -> ControllerAnswer:
        """An answer without errors and without an open question. Raises ControllerError on any other."""
        if answer.question is not None:
            self.question = answer.question
        if answer.errors:
            raise ControllerError("; ".join(answer.errors), answer.where)
        if answer.question is not None:
            raise self._unanswered()
        return answer

    def leave_unheard(self, errors: Sequence[str]) -> None:
        """Keep errors that the controller reported by itself for whoever has the next turn, as what it reports while
        nobody listens."""
        for text in errors:
            self.talk.hear(Error(b"", text))

    @property
    def heard_unasked(self) -> bool:
        """Whether something came, or somebody changed the port's settings, while nobody has the line: the next turn
        reports it."""
        if self.lost or self._turn.locked() or not self._may_go_on.is_set():
            return False
        return self._unreported is not None or self.talk.holds_unheard

    def send(self, data: bytes, kept: bytes) -> None:
        """Send bytes, then keep `kept` of them in the ledger. Raises PortError."""
        self._port.write(data)
        self.traffic += 1
        if kept:
            self._ledger.sent(kept, self.clock())

    def _in_trouble(self, error: LinkError) -> None:
        """The port is gone; or somebody changed its settings, and nobody knows what went astray meanwhile: whoever has
        the line loses it. A stop goes on, and who talks to the controller by hand."""
        if not isinstance(error, Disturbed):
            self._lost(error)
            return
        self._disturbed()
        if self._turn.locked() and self._may_go_on.is_set() and self._listener is None:
            self.talk.end(error)
            self.talk, self._cut_off = self._new_conversation(), True
        else:
            self._unreported = error

    def _refuse_unheard(self, answers_question: bool) -> None:
        """What came while nobody listened comes first: errors and questions (an emergency stop, a power cycle), and
        what answers nothing of ours."""
        if (unreported := self._unreported) is not None:
            self._unreported = None
            raise unreported
        others = self.talk.others_of(events := self.talk.unheard())
        questions = [event.text for event in events if isinstance(event, ControllerQuestion)]
        if questions:
            self.question = questions[-1]
        errors = [event.text for event in events if isinstance(event, Error)]
        if errors:
            if _typed_at_the_prompt(events):
                self._refuse_others([*others, *errors])
            raise ControllerError("; ".join(errors))
        if self.question is not None and not answers_question:
            raise self._unanswered()
        if self.question is None:
            self._refuse_others(others)

    def _refuse_others(self, heard: Sequence[str]) -> None:
        """Raise Disturbed where something of somebody else's was heard, NoAnswer where it is an answer of ours that
        comes too late. Behind a prompt that was just found an answer of ours is none too late: it is left alone."""
        said, found = [text.replace(A_PROMPT, ".") for text in heard], self.talk.line_may_hold_rest
        if found:
            said = [text for text in said if not answers_search(text, self.dialect.cancel_line)]
        if not said:
            return
        if not self._owed.explain(said):
            self._disturbed()
            raise Disturbed(f"somebody else types on this line (heard {quoted(heard)})")
        if not found:
            raise NoAnswer(f"the controller answers too late (heard {quoted(heard)})")

    async def _refuse_interleaved(self, talk: Conversation, problem: Interleaved) -> None:
        """As _refuse_others, once the mixed line was taken back; what is believed is dropped before anything is
        typed."""
        try:
            self._refuse_others([problem.heard])
        except Disturbed as found:
            with suppress(NoAnswer, ControllerError), self._kept(found):
                await self.recover(talk, problem)
            raise

    @contextmanager
    def _kept(self, found: LinkError) -> Iterator[None]:
        """Context: the line is cleared behind what was found. A stop may cut that off, and who found it would tell
        nobody that others type on the line: the next turn does."""
        try:
            yield
        except (Preempted, asyncio.CancelledError):
            if isinstance(found, Disturbed):
                self._unreported = found
            raise

    def _unanswered(self) -> ControllerError:
        return ControllerError(f"the controller asks {self.question!r}: answer that first")

    def _new_conversation(self) -> Conversation:
        return Conversation(self.dialect, self._reader, self.send, self.clock, self._permit, self._owed)

    def _hear(self, data: bytes) -> None:
        self._cancel_silence()
        self.traffic += 1
        self._permit.heard += 1
        self._permit.stop_answered += self.stop_typed
        self.stop_typed = False
        if self._listener is not None:
            self._listener(data)
        self._deliver(self._reader.receive(data))
        if self._reader.awaits_silence:
            self._silence = asyncio.get_running_loop().call_later(self.dialect.prompt_silence_s, self._hear_silence)

    def _hear_silence(self) -> None:
        self._deliver(self._reader.silence())

    def _deliver(self, events: list[LineEvent]) -> None:
        for event in events:
            if isinstance(event, ControllerQuestion) and self.dialect.asks_after_power_up(event.text):
                self._switched_on()
            self.talk.hear(event)
            self._ledger.heard(event.what, event.raw, self.clock())

    def _cancel_silence(self) -> None:
        if self._silence is not None:
            self._silence.cancel()
            self._silence = None

    def _lost(self, error: LinkError) -> None:
        self.lost = True
        self._cancel_silence()
        self.talk.end(error)


def _typed_at_the_prompt(events: Sequence[LineEvent]) -> bool:
    """Whether what came while nobody listened begins as an echo does, behind the prompt: what follows answers that
    line. A controller begins a line of its own for what it says by itself."""
    return isinstance(events[0], Text) and events[0].raw[:1] not in (b"\r", b"\n") and _is_no_noise(events[0].text)


def _is_no_noise(text: str) -> bool:
    """Whether a line amid an answer of ours is somebody else's: long enough, or a prompt that another ran into."""
    return len(text) >= SHORTEST_TYPED or not text.strip(". ")


def quoted(heard: Sequence[str]) -> str:
    """What was heard, as far as a message to a person has room for it: noise may be thousands of characters."""
    pieces = [
        repr(text[:QUOTED_CHARACTERS]) + "..." * (len(text) > QUOTED_CHARACTERS) for text in heard[:QUOTED_PIECES]
    ]
    more = len(heard) - len(pieces)
    return ", ".join(pieces) + (f" and {more} more" if more > 0 else "")


def confirms(question: str) -> bool:
    """Whether it asks if a command is meant."""
    return CONFIRMS in question.lower()


def _may_be_our_own_noise(text: str) -> bool:
    """Whether a message may come from the characters that make a half-typed line an error."""
    return "illegal command" in text.lower() or "syntax error" in text.lower()
