"""An open line to a controller: port, reader, silence timer, ledger, turns of the tasks that use it, repeated commands.

link.py knows the commands and interprets their answers.
"""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator, Sequence
from contextlib import asynccontextmanager, contextmanager, suppress

from drivers.ledger import Ledger
from drivers.val2 import commands
from drivers.val2.conversation import A_PROMPT, POISON, ControllerAnswer, Conversation, SendPermission
from drivers.val2.dialect import Dialect
from drivers.val2.errors import (
    Busy,
    ControllerError,
    Disturbed,
    Garbled,
    Interleaved,
    LineHeldBack,
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
"""The most received text that an error message quotes."""
CONFIRMS = "are you sure"
"""The controller's question that confirms a command; if it is open when the line is opened, an earlier user typed the
command."""
MARKER = POISON.decode() + "0"
"""A line that no controller accepts. A person may type POISON."""


class LineSession:
    """An open line: it parses bytes into events for the task whose turn it is, and writes all traffic to the ledger."""

    def __init__(
        self,
        path: str,
        dialect: Dialect,
        clock: Callable[[], float],
        ledger: Ledger,
        open_port: OpenPort,
        switched_on: Callable[[], None],
        disturbed: Callable[[], object],
        permission: SendPermission,
    ) -> None:
        """Open the port. Raises PortError. Needs a running event loop. switched_on: called when the controller asks a
        power-up question, in anybody's turn; disturbed: called when somebody else's typing is detected; permission:
        checked at each try before a line that moves is ended."""
        self._permission = permission
        self.path, self.dialect, self.clock = path, dialect, clock
        self.question: str | None = None
        """The controller's open question."""
        self.lost = False
        """Whether the port is gone, or was closed."""
        self.traffic = 0
        """How often anything was sent or received."""
        self.stop_typed = False
        """Whether the stop command was sent and nothing was received since."""
        self._unreported: Disturbed | None = None
        """A disturbance of the port or the line that was not reported yet; the next turn raises it."""
        self._cut_off = False
        """Whether a disturbance ended somebody's turn: the line may still hold what was half typed."""
        self.recoveries = 0
        """How often the prompt had to be found again: lines typed around that time may not have been read correctly."""
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
        """Close the port; a task that waits for an answer gets PortError."""
        self._lost(
            PortError(
                f"{self.path}: facetd closed the line before the controller answered; look at the arm and at `status`, "
                "then repeat the command"
            )
        )
        self._port.close()

    @contextmanager
    def being_opened(self) -> Iterator[None]:
        """Context: all tasks but the one that opens the line wait for their turn, so that nothing is typed in
        between."""
        self._opened.clear()
        try:
            yield
        finally:
            self._opened.set()

    @asynccontextmanager
    async def turn(
        self, moves: bool = False, answers_question: bool = False, opens: bool = False
    ) -> AsyncIterator[Conversation]:
        """Context: exclusive use of the line. A task that waited during a pre-emption gets Preempted, as does a motion
        that is requested in one; a task that waited while another program changed the port's settings gets Disturbed.
        opens: this is the turn of the task that opens the line.

        Raises ControllerError while the controller asks something else, or where it reported an error while no task was
        waiting.
        """
        if not opens:
            await self._opened.wait()
        talk = self.talk
        if moves and not self._may_go_on.is_set():
            raise Preempted("a stop is under way")
        async with self._turn:
            await self._may_go_on.wait()
            talk.check()
            while self._reader.awaits_silence and not self.lost:  # perhaps a question; only the silence is missing
                await asyncio.sleep(self.dialect.prompt_silence_s)
            talk.check()
            try:
                self._refuse_unheard(answers_question)
            except (Disturbed, NoAnswer) as found:
                if self._reader.pending:  # half a line: every turn would refuse it, and it would precede our next line
                    with suppress(NoAnswer), self._kept(found):
                        await self.find_prompt(talk)
                raise
            if self._cut_off:
                await self.find_prompt(talk)
                self._cut_off = False
            yield talk

    @asynccontextmanager
    async def preemption(self) -> AsyncIterator[Conversation]:
        """Context: take the line at once. The task whose turn it was gets Preempted, and cannot send another byte."""
        self._may_go_on.clear()
        self.talk.end(Preempted("stopped"))
        self._port.overtake()
        self.talk = self._new_conversation()
        try:
            yield self.talk
        finally:
            self._may_go_on.set()

    @asynccontextmanager
    async def terminal(self, on_bytes: Callable[[bytes], None]) -> AsyncIterator[Callable[[bytes], None]]:
        """Context: connect a person to the line. Output also goes to on_bytes; yields the function that types. Raises
        Busy after the person left, if a program keeps printing."""
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
                    await self._clear_after_person(talk)

    async def _clear_after_person(self, talk: Conversation) -> None:
        """Get to a prompt behind all answers to the person, however late they come. Raises Busy, NoAnswer."""
        within_s = 3 * (self.dialect.resync_s + self.dialect.table_s)
        try:
            async with asyncio.timeout(within_s):
                while not await self._refuses_marker(talk):
                    pass
        except TimeoutError:
            raise Busy(f"a program printed for {within_s:.1f} s after the terminal was left") from None

    async def _refuses_marker(self, talk: Conversation) -> bool:
        """Whether the controller refuses a line that only facetd types, so that it has answered all lines before; or
        asks a question. Raises NoAnswer."""
        talk.unheard()
        await self.find_prompt(talk)
        if self.question is not None:
            return True
        try:
            answer = await talk.ask(MARKER, (), self.dialect.table_s)
        except (Garbled, NoAnswer):
            return False
        return answer.errors != ()

    async def find_prompt(self, talk: Conversation, attempts: int = 3) -> list[LineEvent]:
        """Get to the prompt, or to the controller's question (then in `question`). Raises NoAnswer. talk: the present
        conversation; if a stop has taken over the line meanwhile, nothing is typed into the stop."""
        events = await talk.resynchronise(attempts)
        last = events[-1]
        self.question = last.text if isinstance(last, ControllerQuestion) else None
        return events

    async def prompt_on_opening(self) -> None:
        """Get to the prompt or question. It searches more than once only if the arm cannot be moving meanwhile. Raises
        NoAnswer; Busy also if a program keeps printing."""
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
        """Answer N to the confirmation of an earlier user's command; twice if the line had something in it before."""
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
        """Type a command and return its answer; repeat it as long as that is safe: its line was not ended, or it moves
        nothing. moves: end the line only if motion is permitted; first: called before each try."""
        for _ in range(self.dialect.typing_attempts):
            if first is not None:
                await first()
            self._refuse_others(talk.unheard_of_others())
            try:
                return await self.ask_once(talk, text, replies, wait_s, meant, moves)
            except (Garbled, NoAnswer, LineHeldBack) as caught:
                problem = caught
            if isinstance(problem, Interleaved):
                await self._refuse_interleaved(talk, problem)
            once_only = isinstance(problem, LineHeldBack) or (talk.typed_whole and commands.moves_the_arm(text))
            refusals = await self.recover(talk, problem)
            if refusals or once_only:
                break
        try:
            problem.where = (await talk.ask("WHERE", (), self.dialect.answer_s)).where
        except (Garbled, NoAnswer) as half_typed:  # the next turn would take what is left of it for somebody else's
            with suppress(NoAnswer, ControllerError):
                refusals += await self.recover(talk, half_typed)
        if refusals:
            raise ControllerError("; ".join(refusals), problem.where) from problem
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
        """Type a command once, and check that its answer contains nothing of somebody else's. Raises as
        Conversation.ask; Disturbed; NoAnswer where it contains a late answer to an earlier line; Garbled where a line
        came twice."""
        may_have_leftover = talk.line_may_have_leftover
        answer = await talk.ask(text, replies, wait_s, meant, moves)
        if may_have_leftover and answer.errors and all(map(_may_be_our_own_noise, answer.errors)):
            # It was appended to a leftover of an earlier line, refused as unknown, and not executed.
            answer = await talk.ask(text, replies, wait_s, meant, moves)
        if answer.question is None and (commands.answers_nothing(text) or answer.where is not None):
            lines = [line for line in answer.of_text if not of_a_table(line)]
            # A refusal may have lines of its own; what follows a prompt was typed, and the error may be its answer.
            others = [line for line in lines if line.startswith(".") and line.strip(". ")] if answer.errors else lines
            self._refuse_others([line for line in others if _is_no_noise(line)])
            if not answer.errors and len(lines) < len(answer.of_text):
                raise Garbled(f"a line of the answer to {text!r} came twice (noise?)")
        return answer

    async def recover(self, talk: Conversation, problem: LinkError) -> list[str]:
        """Get back to a prompt. Returns the errors that the controller reported on the way. Raises NoAnswer,
        ControllerError."""
        self.recoveries += 1
        try:
            events = await self.find_prompt(talk)
        except NoAnswer as deaf:
            raise NoAnswer(f"{problem.message}; then {deaf.message}", code=problem.code) from problem
        if self.question is not None:
            raise unanswered(self.question) from problem
        return [event.text for event in events if isinstance(event, Error) and not _may_be_our_own_noise(event.text)]

    def accept(self, answer: ControllerAnswer) -> ControllerAnswer:
        """Return an answer that has neither errors nor an open question. Raises ControllerError for any other."""
        if answer.question is not None:
            self.question = answer.question
        if answer.errors:
            raise ControllerError("; ".join(answer.errors), answer.where)
        if answer.question is not None:
            raise unanswered(answer.question)
        return answer

    def leave_unheard(self, errors: Sequence[str]) -> None:
        """Queue error messages that the controller sent by itself, so that the next turn raises them, like those that
        it sends while no task is waiting."""
        for text in errors:
            self.talk.hear(Error(b"", text))

    @property
    def heard_unasked(self) -> bool:
        """Whether something came, or another program changed the port's settings, during nobody's turn; the next turn
        reports it."""
        if self.lost or self._turn.locked() or not self._may_go_on.is_set():
            return False
        return self._unreported is not None or self.talk.holds_unheard

    def send(self, data: bytes, kept: bytes) -> None:
        """Send bytes, then write `kept` to the ledger. Raises PortError."""
        self._port.write(data)
        self.traffic += 1
        if kept:
            self._ledger.sent(kept, self.clock())

    def _in_trouble(self, error: LinkError) -> None:
        """The port is unplugged; or another program changed its settings, and bytes may have been lost: the task whose
        turn it is loses it. A stop continues, and so does a person's terminal."""
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
        """Report first what came while no task was waiting: errors and questions (an emergency stop, a power cycle),
        and somebody else's lines."""
        if (unreported := self._unreported) is not None:
            self._unreported = None
            raise unreported
        others = self.talk.others_of(events := self.talk.unheard())
        questions = [event.text for event in events if isinstance(event, ControllerQuestion)]
        if questions:
            self.question = questions[-1]
        errors = [event.text for event in events if isinstance(event, Error)]
        if self.talk.line_may_have_leftover:  # late answers to the search: what somebody typed comes with their line
            errors = [text for text in errors if not _may_be_our_own_noise(text)]
        if errors:
            if _typed_at_the_prompt(events):
                self._refuse_others([*others, *errors])
            raise ControllerError("; ".join(errors))
        if self.question is not None and not answers_question:
            raise unanswered(self.question)
        if self.question is None:
            self._refuse_others(others)

    def _refuse_others(self, heard: Sequence[str]) -> None:
        """Raise Disturbed where received text is somebody else's, NoAnswer where it is a late answer to a line of
        facetd's. After a search for the prompt, late answers are expected and ignored."""
        unheard, found = [text.replace(A_PROMPT, ".") for text in heard], self.talk.line_may_have_leftover
        if found:
            unheard = [text for text in unheard if not answers_search(text, self.dialect.cancel_line)]
        if not unheard:
            return
        if not self._owed.explain(unheard):
            self._disturbed()
            raise Disturbed(
                f"another terminal or program types on the controller's line (received {quoted(heard)}): stay clear of "
                "the arm and find it, then `resume`"
            )
        if not found:
            raise NoAnswer(f"the controller answered too late (received {quoted(heard)})")

    async def _refuse_interleaved(self, talk: Conversation, problem: Interleaved) -> None:
        """As _refuse_others, after the mixed line was cancelled. The beliefs about the cell are voided before anything
        is typed."""
        try:
            self._refuse_others([problem.heard])
        except Disturbed as found:
            with suppress(NoAnswer, ControllerError), self._kept(found):
                await self.recover(talk, problem)
            raise

    @contextmanager
    def _kept(self, found: LinkError) -> Iterator[None]:
        """Context: clear the line after a disturbance was found. If a stop interrupts that, the error would be lost, so
        the next turn raises it."""
        try:
            yield
        except (Preempted, asyncio.CancelledError):
            if isinstance(found, Disturbed):
                self._unreported = found
            raise

    def _new_conversation(self) -> Conversation:
        return Conversation(self.dialect, self._reader, self.send, self.clock, self._permission, self._owed)

    def _hear(self, data: bytes) -> None:
        self._cancel_silence()
        self.traffic += 1
        self._permission.heard += 1
        self._permission.stop_answered += self.stop_typed
        self.stop_typed = False
        if self._listener is not None:
            self._listener(data)
        self._deliver(self._reader.receive(data))
        if self._reader.awaits_silence:
            loop = asyncio.get_running_loop()
            self._silence = loop.call_later(
                self.dialect.prompt_silence_s, lambda: self._deliver(self._reader.silence())
            )

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
    """Whether unexpected output begins like an echo, directly after the prompt: then the rest answers somebody else's
    line. For its own reports a controller starts a new line."""
    return isinstance(events[0], Text) and events[0].raw[:1] not in (b"\r", b"\n") and _is_no_noise(events[0].text)


def _is_no_noise(text: str) -> bool:
    """Whether a line within an answer is somebody else's and not noise: it is long enough, or is another prompt."""
    return len(text) >= SHORTEST_TYPED or not text.strip(". ")


def quoted(heard: Sequence[str]) -> str:
    """Received text, shortened for a message: noise may be thousands of characters."""
    pieces = [
        repr(text[:QUOTED_CHARACTERS]) + "..." * (len(text) > QUOTED_CHARACTERS) for text in heard[:QUOTED_PIECES]
    ]
    more = len(heard) - len(pieces)
    return ", ".join(pieces) + (f" and {more} more" if more > 0 else "")


def unanswered(question: str) -> ControllerError:
    """The error of a command that finds the controller waiting for an answer."""
    return ControllerError(
        f"the controller asks {question!r}: answer it (`robot power-up`), or end the program that asks (`stop`)"
    )


def confirms(question: str) -> bool:
    """Whether a question asks to confirm a command."""
    return CONFIRMS in question.lower()


def _may_be_our_own_noise(text: str) -> bool:
    """Whether an error message may be the answer to the characters that make a half-typed line an error."""
    return "illegal command" in text.lower() or "syntax error" in text.lower()
