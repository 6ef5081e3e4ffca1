"""The robot as the rest of the house sees it: connect, ask where it is, move it, stop it. Over VAL II, on asyncio.

Commands from several tasks take turns; `abort` does not wait its turn. A command whose echo was garbled was never ended
and is typed again; a command whose *answer* was lost may have been carried out, so a motion is then not repeated: the
link finds the prompt again, asks WHERE, and raises with what it knows.
"""

import asyncio
import time
from collections.abc import Awaitable, Callable, Sequence
from contextlib import AbstractAsyncContextManager
from dataclasses import dataclass, replace
from typing import Any

from drivers.ledger import Ledger
from drivers.val2 import commands
from drivers.val2.conversation import POISON, ControllerAnswer, Conversation, LinePermit, Unconditional
from drivers.val2.dialect import Dialect
from drivers.val2.errors import (
    Busy,
    ControllerError,
    Disturbed,
    Elsewhere,
    Garbled,
    LinkError,
    NoAnswer,
    PortError,
    Preempted,
    ProcessorHalted,
    StopRefused,
    lacks_zero,
)
from drivers.val2.location import Location, apart
from drivers.val2.port import OpenPort, SerialPort
from drivers.val2.session import LineSession, confirms
from drivers.val2.wire import ControllerQuestion, LineEvent, Where

ABORT_ATTEMPTS = 5
MOST_JUDGED = 3
"""Answers to the word that stops the arm, until one of them has none of the controller's own words in it."""
TINY_DEG = 1e-9
"""Of the difference of two printed numbers."""
PREAMBLE_S = 0.05
"""How old the preamble of a move may be when its line is typed: no longer than the shortest line of a new preamble
takes, so that a motion of somebody else's has hardly more time to fall between its WHERE and the move."""
BRAKES_S = 0.5
"""Of an arm whose power went, until they hold it."""


@dataclass(frozen=True)
class MoveStart:
    """What is sent and checked in the turn in which a motion begins. agrees: called with where the arm is, right before
    the line that moves it; raises where that must not go."""

    speed_pct: float
    agrees: Callable[[Where], None]


@dataclass(frozen=True)
class NextMove:
    """A move that is to follow another at once."""

    location: Location
    straight: bool
    speed_pct: float


@dataclass(frozen=True)
class Preamble:
    """What was sent before a move: speed, the move's lines but the last; and the WHERE that ended it. traffic: the
    line's count behind it."""

    lines: tuple[str, ...]
    speed_pct: float
    where: Where
    at_s: float
    traffic: int


class Link:
    """One controller on one serial port. Every method may raise PortError, NoAnswer, Garbled and Preempted."""

    def __init__(
        self,
        port: str,
        dialect: Dialect | None = None,
        clock: Callable[[], float] = time.monotonic,
        on_wire: Callable[[dict[str, Any]], None] | None = None,
        belongs_together: Callable[[Where], bool] | None = None,
        open_port: OpenPort = SerialPort,
    ) -> None:
        """on_wire: called with every record of the wire ledger.

        belongs_together: whether a WHERE's joints put the tool at its place, by the arm's kinematics; a reading whose
        do not (a digit spoiled by noise, a TOOL or BASE that is not ours) is asked for again and never given out.
        """
        self.port, self.dialect, self.clock = port, dialect or Dialect(), clock
        self._ledger = Ledger(on_wire)
        self.belongs_together = belongs_together or (lambda where: True)
        self._open_port = open_port
        self._session: LineSession | None = None
        self._aborting: asyncio.Task[Where | None] | None = None
        self._preamble: Preamble | None = None
        """Sent ahead, as the move before came to its end."""
        self._announced_s: float | None = None
        """When a move that was to follow at once was waited for."""
        self._follows_s = 0.0
        """How long the last such move took to follow: on a slow computer, or where it was held, longer than a
        preamble sent ahead is valid."""
        self.permit: LinePermit = Unconditional()
        """Asked before a line that moves is ended, at each try; where motion is withheld, the line is taken back."""
        self.disturbed: Callable[[], None] = nothing
        """Called as something is heard that answers nothing of ours, before anything else is typed: whoever believes
        something of the cell (the driver itself believes nothing) drops it. That the arm may not move is the permit's:
        the stop is no longer seen to work."""
        self.stopped_on_opening = False
        """Whether the arm was found at work when the port was opened last, and was stopped."""
        self._times_seen = 0
        self.program_may_run = False
        """Whether a person may have begun a program since that word was taken last: what is asked may be its question,
        and two WHERE that agree a pause of it."""

    # Connecting

    async def open(self) -> None:
        """Claim the port and find the controller's prompt, or the question it asks at power-up (see `question`).

        An arm that still carries out a command of somebody before us (a program that was killed) is stopped.
        """
        self._let_go()
        self._session = LineSession(
            self.port,
            self.dialect,
            self.clock,
            self._ledger,
            self._open_port,
            self._unsee_the_stop,
            self._others_type,
            self.permit,
        )
        self.stopped_on_opening = False
        try:
            with self._session.being_opened():
                await self._come_to_a_still_arm(self._session)
        except BaseException:
            self._let_go()
            raise

    async def close(self) -> None:
        """Let go of the port; safe to call twice. Does not stop the arm: abort() does."""
        self._let_go()

    def _let_go(self) -> None:
        self._unsee_the_stop()
        self.permit.stop_took_s = 0.0
        self.program_may_run, self._preamble = False, None
        if self._session is not None:
            self._session.close()
            self._session = None

    def _unsee_the_stop(self) -> None:
        self.permit.stop_seen = 0

    def _others_type(self) -> None:
        """What they have begun nobody knows: a program, a motion, a word in place of the one that stops the arm."""
        self._unsee_the_stop()
        self.disturbed()

    @property
    def stop_seen(self) -> int:
        """Of the permit: 0 where the controller was not seen to take the word that stops the arm."""
        return self.permit.stop_seen

    @property
    def connected(self) -> bool:
        """Whether there is a line to type on."""
        return self._session is not None and not self._session.lost

    @property
    def heard_unasked(self) -> bool:
        """Whether something came on the line, or was done to its port, that nobody heard of yet and no command waits
        for: the next one reports it."""
        return self._session is not None and self._session.heard_unasked

    @property
    def question(self) -> str | None:
        """What the controller asks; until power_up() answers it, it takes no commands."""
        return self._session.question if self._session is not None else None

    async def power_up(self, replies: Sequence[str] = ("Y", "Y")) -> ControllerAnswer:
        """Answer what the controller asks, and what it asks next, where that is of the same kind: a yes to a question
        of power-up moves nothing, one to another may. Raises ControllerError."""
        session = self._open_session
        async with session.turn(answers_question=True) as talk:
            asked, session.question = session.question, None
            if asked is None:
                raise ControllerError("the controller asks nothing")
            usual = self.dialect.asks_after_power_up
            kind = usual(asked)
            self.program_may_run |= not (kind or confirms(asked))
            try:
                answer = await talk.ask(
                    replies[0], replies[1:], self.dialect.calibrate_s, lambda text: usual(text) is kind
                )
            except (Garbled, NoAnswer) as problem:
                session.question = asked
                await session.recover(talk, problem)  # a half-typed answer is no beginning of the next command
                raise
            return session.accept(answer)

    def terminal(self, on_bytes: Callable[[bytes], None]) -> AbstractAsyncContextManager[Callable[[bytes], None]]:
        """A person talks to the controller: commands wait until they are done; abort() still works."""
        self.program_may_run = True
        return self._open_session.terminal(on_bytes)

    # Asking

    async def command(self, text: str, replies: Sequence[str] = (), timeout_s: float | None = None) -> ControllerAnswer:
        """Type any command and give the whole answer; replies: to the questions it asks, in turn.

        Raises ControllerError with the controller's words, or where it asks more than there are replies.
        """
        return await self._carry_out((text,), replies, timeout_s)

    async def where(self) -> Where:
        """One WHERE, now. On a moving arm a place on the way; rest() and still() give one to compute from."""
        async with self._open_session.turn() as talk:
            return await self._where(talk)

    async def speed(self, percent: float) -> None:
        """Monitor speed, percent of full."""
        await self.command(commands.speed(percent))

    async def calibrate(self, answer: str = "Y") -> ControllerAnswer:
        """CAL, its question answered, and none that another asks: a controller whose power went just then. Raises
        ControllerError."""
        return await self._carry_out((self.dialect.calibrate_word,), (answer,), self.dialect.calibrate_s, confirms)

    async def tool(self, flange_from_tool: Location) -> None:
        """Tell the controller where the tool point is, seen from the flange."""
        await self.command(commands.tool(flange_from_tool, self.dialect.unit_mm))

    # Moving

    async def move(self, location: Location, timeout_s: float | None = None, start: MoveStart | None = None) -> None:
        """Start a joint-interpolated move; rest() waits for its end. start: None where speed and place of the arm do
        not matter. Raises ControllerError, and what start's agrees raises: nothing has moved then."""
        await self._begin(self._lines(location, straight=False), timeout_s, start)

    async def move_straight(
        self, location: Location, timeout_s: float | None = None, start: MoveStart | None = None
    ) -> None:
        """Start a straight-line move; otherwise as move."""
        await self._begin(self._lines(location, straight=True), timeout_s, start)

    async def ready(self) -> Where:
        """Go to the ready pose; over when the arm is at rest."""
        await self.command("DO READY")
        await self._break(self.dialect.motion_s)
        return await self.still(self.dialect.motion_s)

    async def open_hand(self) -> None:
        """Open the hand now."""
        await self.command("DO OPENI", timeout_s=self.dialect.answer_s)

    async def close_hand(self) -> None:
        """Close the hand now."""
        await self.command("DO CLOSEI", timeout_s=self.dialect.answer_s)

    async def set_outputs(self, numbers: Sequence[int]) -> None:
        """Switch digital outputs, n on and -n off, also where nothing may move: an output says that. Raises
        ControllerError."""
        await self.ask_plainly(commands.signals(numbers))

    async def work_valves(self, numbers: Sequence[int]) -> None:
        """The same of outputs that work the hand: refused where nothing may move."""
        await self.command(commands.signals(numbers), timeout_s=self.dialect.answer_s)

    async def ask_plainly(self, text: str) -> tuple[str, ...]:
        """One line that moves nothing, in a turn of its own; the lines printed. Raises ControllerError."""
        session = self._open_session
        async with session.turn() as talk:
            return session.accept(await session.ask(talk, text, (), self.dialect.answer_s)).of_text

    async def rest(self, location: Location, timeout_s: float | None = None, then: NextMove | None = None) -> Where:
        """Wait until the arm is at rest at location: the controller says so, and two readings agree with it; or it says
        so by the prompt to BREAK, and one reading is the very place, to what two may differ by.

        then: the move that is to follow at once. Its preamble is sent before that one reading, which is then also the
        one that it begins with, where its line is typed within PREAMBLE_S and nothing else was on the line. Raises
        Elsewhere when it came to rest somewhere else, NoAnswer when it is not at rest in time.
        """
        wait_s = timeout_s or self.dialect.motion_s
        deadline_s = self.clock() + wait_s
        ahead = then if self._follows_s <= PREAMBLE_S else None
        await self._break(wait_s)
        before: Where | None = None
        if self.dialect.break_after_move:
            before = await (self.where() if ahead is None else self._preamble_ahead(ahead))
            off_mm, off_deg = apart(before.location, location)
            if off_mm <= self.dialect.same_place_mm and off_deg <= self.dialect.same_place_deg:
                self._announced_s = None if then is None else self.clock()
                return before
        self._preamble = None
        elsewhere_since_s: float | None = None
        while True:
            where = await self.still(max(0.1, deadline_s - self.clock()), before=before)
            before = None
            off_mm, off_deg = apart(where.location, location)
            if off_mm <= self.dialect.arrived_mm and off_deg <= self.dialect.arrived_deg:
                return where
            now_s = self.clock()
            elsewhere_since_s = now_s if elsewhere_since_s is None else elsewhere_since_s
            if now_s - elsewhere_since_s >= self.dialect.stall_s or now_s >= deadline_s:
                raise Elsewhere(f"at rest {off_mm:.2f} mm and {off_deg:.2f} degrees from where it was sent", where)

    async def still(self, timeout_s: float, any_place: bool = False, before: Where | None = None) -> Where:
        """Wait until two WHERE readings agree. Raises NoAnswer when they do not in time.

        any_place: also where place and joints do not belong together (a TOOL or BASE other than ours). before: the
        reading of just now."""
        async with self._open_session.turn() as talk:
            return await self._still(talk, timeout_s, any_place, before)

    async def abort(self) -> Where | None:
        """Stop the arm now, whoever is using the link (they get Preempted), and give where it came to rest; None where
        the controller took the word and cannot say where the arm is: it is at its power-up questions, or has no zero.
        Nothing moves then; a CAL that was under way has ended, for its prompt comes behind it.

        Raises StopRefused at once where the controller does not take the word, NoAnswer and others where rest was not
        seen after some tries: the arm may move then: abort again.
        """
        if self._aborting is None or self._aborting.done():
            self._aborting = asyncio.create_task(self._abort(self._open_session))
            self._aborting.add_done_callback(_heard_of)
        return await asyncio.shield(self._aborting)

    async def prove_stop(self) -> None:
        """See that the stop works, and how long that takes: by the very bytes and the very rule of `abort`, for that is
        what it is. Raises as abort, and ControllerError where the controller asks instead."""
        began_s = self.clock()
        await self.abort()
        self.permit.stop_took_s = self.clock() - began_s
        if self.question is not None:
            raise ControllerError(f"the controller asks {self.question!r}: answer that first")

    # Inside

    @property
    def _open_session(self) -> LineSession:
        if self._session is None:
            raise PortError(f"{self.port}: not open")
        return self._session

    @property
    def _move_answer_s(self) -> float:
        return self.dialect.answer_s if self.dialect.prompt_after_move == "start" else self.dialect.motion_s

    async def _come_to_a_still_arm(self, session: LineSession) -> None:
        """To the prompt, with the arm at rest, or to a power-up question: nothing moves then. Raises NoAnswer.

        A controller that says something and gives no prompt may have an arm at work; where nothing is echoed, one that
        says nothing may as well: facetd stops it before it asks again.
        """
        try:
            await session.prompt_on_opening()
            if confirms(session.question or ""):
                await session.decline()
            if session.question is None:
                async with session.turn(opens=True) as talk:
                    await self._see_that_it_rests(talk)
            return
        except Preempted:  # a stop that waited for the line comes first, and sees the arm at rest
            await self.abort()
            return
        except NoAnswer as problem:
            if isinstance(problem, ProcessorHalted) or (self.dialect.echo and not isinstance(problem, Busy)):
                raise
            silent = problem
        try:
            await self.abort()
        except (NoAnswer, Garbled):
            raise silent from None
        self.stopped_on_opening = True

    async def _see_that_it_rests(self, talk: Conversation) -> None:
        """Raises Busy where the arm moves, or the line is not clear enough to tell."""
        try:
            if not self.dialect.break_after_move:
                await self._still(talk, 0.0, any_place=True)
            else:
                await self._open_session.ask_once(talk, "DO BREAK", (), self.dialect.resync_s)
        except (NoAnswer, Garbled) as problem:
            raise Busy(problem.message) from problem
        except ControllerError as refused:
            if not lacks_zero(refused.message):
                raise

    def _lines(self, location: Location, straight: bool) -> tuple[str, ...]:
        """Of a move; the last one moves."""
        if not straight:
            return (commands.move(location, self.dialect.unit_mm),)
        variable = self.dialect.variable if self.dialect.straight_through_variable else None
        return commands.straight_move(location, variable, self.dialect.unit_mm)

    async def _preamble_ahead(self, then: NextMove) -> Where:
        """Send the preamble of a move as the one before it has ended."""
        session, lines = self._open_session, self._lines(then.location, then.straight)
        async with session.turn() as talk:
            where = await self._send_preamble(talk, lines[:-1], then.speed_pct)
            self._preamble = Preamble(lines, then.speed_pct, where, self.clock(), session.traffic)
        return where

    async def _begin(self, lines: Sequence[str], timeout_s: float | None, start: MoveStart | None) -> None:
        """One motion, in one turn of the line. Where its line was spoiled as it was typed, the whole preamble is sent
        again: no answer from before counts."""
        session = self._open_session
        if self._announced_s is not None:
            self._follows_s, self._announced_s = self.clock() - self._announced_s, None
        async with session.turn(moves=True) as talk:
            answer = await session.ask(
                talk,
                lines[-1],
                (),
                timeout_s or self._move_answer_s,
                moves=True,
                first=lambda: self._before_move(talk, lines, start),
            )
            session.accept(answer)

    async def _before_move(self, talk: Conversation, lines: Sequence[str], start: MoveStart | None) -> None:
        """Send the preamble, unless it was sent ahead and is valid. Raises Garbled, where noise falls in each time, and
        what start.agrees raises."""
        session, ahead, self._preamble = self._open_session, self._preamble, None
        if start is None:
            for line in lines[:-1]:
                session.accept(await session.ask(talk, line, (), self.dialect.answer_s))
            return
        if ahead is not None and self._is_valid(ahead, lines, start):
            where = ahead.where
        else:
            where = await self._send_preamble(talk, lines[:-1], start.speed_pct)
        start.agrees(where)

    def _is_valid(self, ahead: Preamble, lines: Sequence[str], start: MoveStart) -> bool:
        """Whether a preamble sent ahead is the one of this move, is recent, and nothing was sent or heard since."""
        wanted = tuple(lines), start.speed_pct, self._open_session.traffic
        same = (ahead.lines, ahead.speed_pct, ahead.traffic) == wanted
        return same and self.clock() - ahead.at_s <= PREAMBLE_S

    async def _send_preamble(self, talk: Conversation, lines: Sequence[str], speed_pct: float) -> Where:
        """Speed, location, and last where the arm is: between that and the line which moves nothing else is typed.
        Raises Garbled, where noise falls in each time."""
        session, answer_s = self._open_session, self.dialect.answer_s
        for _ in range(self.dialect.typing_attempts * (len(lines) + 3)):
            before = session.recoveries
            of_programs = await session.ask(talk, commands.PROGRAM_SPEED, (), answer_s)
            session.accept(replace(of_programs, errors=()))  # refused, in whatever words: there is none
            session.accept(await session.ask(talk, commands.speed(speed_pct), (), answer_s))
            for line in lines:
                session.accept(await session.ask(talk, line, (), answer_s))
            where = await self._where(talk)
            if session.recoveries == before:
                return where
        raise Garbled("noise on the line: speed and location before a move did not get through in one piece")

    async def _carry_out(
        self,
        lines: Sequence[str],
        replies: Sequence[str],
        timeout_s: float | None,
        meant: Callable[[str], bool] = bool,
    ) -> ControllerAnswer:
        """Several lines in one turn, so that no abort can fall between them unnoticed; the last one's answer."""
        session = self._open_session
        async with session.turn(moves=any(map(commands.moves_the_arm, lines))) as talk:
            for line in lines:
                self.program_may_run |= line != self.dialect.calibrate_word and commands.begins_a_program(line)
                moves = commands.moves_the_arm(line)
                default_s = self.dialect.motion_s if moves else self.dialect.answer_s
                answer = session.accept(await session.ask(talk, line, replies, timeout_s or default_s, meant, moves))
        return answer

    async def _where(self, talk: Conversation, any_place: bool = False) -> Where:
        """any_place: take the reading even when its place and joints do not belong together."""
        session, why = self._open_session, "WHERE did not give its table"
        for _ in range(self.dialect.typing_attempts):
            answer = session.accept(await session.ask(talk, "WHERE", (), self.dialect.answer_s))
            if answer.where is None:
                continue
            if any_place or self.belongs_together(answer.where):
                return answer.where
            why = "WHERE's place and joints do not belong together: noise, or a TOOL or BASE other than ours"
        raise Garbled(why)

    async def _still(
        self, talk: Conversation, timeout_s: float, any_place: bool = False, before: Where | None = None
    ) -> Where:
        deadline_s = self.clock() + timeout_s
        before = before or await self._where(talk, any_place)
        while True:
            await asyncio.sleep(self.dialect.poll_s)
            now = await self._where(talk, any_place)
            if self._same_place(before, now):
                return now
            if self.clock() > deadline_s:
                raise NoAnswer(f"not at rest within {timeout_s:g} s", now, "arm_not_there")
            before = now

    def _same_place(self, before: Where, now: Where) -> bool:
        off_mm, off_deg = apart(before.location, now.location)
        turned_deg = max(off_deg, now.turned_deg(before) - TINY_DEG)
        return off_mm <= self.dialect.same_place_mm and turned_deg <= self.dialect.same_place_deg

    async def _break(self, timeout_s: float) -> None:
        if self.dialect.break_after_move:
            await self.command("DO BREAK", timeout_s=timeout_s)

    async def _abort(self, session: LineSession) -> Where | None:
        """Try after try, each no longer than a prompt and two WHERE take. Whatever is half typed becomes an error, not
        a command; a question in the way is answered with N first, but for one of power-up, where no program may ask."""
        no = b"N" + self.dialect.line_end
        problem: LinkError = NoAnswer(f"no answer to {self.dialect.abort_word}")
        before, asked = b"", ""
        async with session.preemption() as talk:
            for _ in range(ABORT_ATTEMPTS):
                try:
                    last = await self._type_abort(session, talk, before)
                    if isinstance(last, ControllerQuestion):
                        switched_on = self.dialect.asks_after_power_up(last.text) and not self.program_may_run
                        if switched_on and last.text == asked:
                            session.question = asked
                            await _brakes_hold()
                            return None
                        before, asked = b"" if switched_on else no, last.text
                        continue
                    before, session.question = b"", None
                    return await self._stopped(session, talk)
                except StopRefused:
                    raise
                except (NoAnswer, Garbled, ControllerError, Disturbed) as failed:
                    before, problem = b"", failed
        raise problem

    async def _type_abort(self, session: LineSession, talk: Conversation, before: bytes) -> LineEvent:
        """The word at once, and once more at once, apart: one spoiled byte spoils one of them only. What is half typed
        is taken back first: a Y, as an answer, is one whatever follows it. Nothing is before an answer of ours: where
        the controller takes nothing back, that key would spoil it."""
        end = self.dialect.line_end
        word = self.dialect.abort_word.encode("ascii") + end
        talk.unheard()
        await talk.type_raw((before or self.dialect.cancel_line) + POISON + end + word + end + word)
        session.stop_typed = True
        return await talk.last_prompt_or_question(self.dialect.resync_s)

    async def _stopped(self, session: LineSession, talk: Conversation) -> Where | None:
        """The word once more where its answer can be judged, then two WHERE that agree, or are both refused for want of
        a zero. Raises StopRefused."""
        by_itself = await self._see_it_taken(
            session, lambda: talk.ask(self.dialect.abort_word, (), self.dialect.resync_s)
        )
        readings: list[Where | None] = []
        for _ in range(2):
            await asyncio.sleep(self.dialect.poll_s)
            answer = await talk.ask("WHERE", (), self.dialect.table_s)
            if answer.errors and answer.where is None:
                said = "; ".join(answer.errors)
                if not lacks_zero(said):
                    raise ControllerError(f"WHERE is refused (`{said}`: mend that, then restart facetd)")
            elif answer.where is None:
                raise Garbled("WHERE did not give its table")
            else:
                by_itself += answer.errors
            readings.append(answer.where)
        before, now = readings
        if before is None and now is None:
            await _brakes_hold()
        elif before is None or now is None or not self._same_place(before, now):
            raise NoAnswer(f"the arm still moves after {self.dialect.abort_word}", now, "arm_not_there")
        session.leave_unheard(by_itself)
        return now

    async def _see_it_taken(
        self, session: LineSession, type_word: Callable[[], Awaitable[ControllerAnswer]]
    ) -> list[str]:
        """See by its answer that the controller accepts the word that stops the arm. Returns what it reported by itself
        meanwhile: a refusal comes at each try, the end of a program or of its power does not.

        Raises StopRefused; ControllerError where it asks instead, as it has taken the word for an answer, and where it
        says something else each time.
        """
        by_itself: list[str] = []
        for _ in range(MOST_JUDGED):
            answer = await type_word()
            if answer.question is not None or not answer.errors:
                session.accept(answer)
                break
            if not set(by_itself).isdisjoint(answer.errors):
                self._unsee_the_stop()
                word, words = self.dialect.abort_word, "; ".join(answer.errors)
                raise StopRefused(f"the controller does not take the word {word} (it says `{words}`)")
            by_itself += answer.errors
        else:
            raise ControllerError("; ".join(by_itself))
        self.program_may_run = False
        if not self.stop_seen:
            self._times_seen += 1
            self.permit.stop_seen = self._times_seen
        return by_itself


async def _brakes_hold() -> None:
    """Wait until the brakes hold an arm that cannot be seen at rest."""
    await asyncio.sleep(BRAKES_S)


def nothing() -> None:
    """Do nothing."""


def _heard_of(aborting: asyncio.Task[Where | None]) -> None:
    """Whoever asked may have gone away before the controller did not confirm; that is nobody's unhandled error."""
    if not aborting.cancelled():
        aborting.exception()
