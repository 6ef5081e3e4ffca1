"""Command a VAL II controller: connect, read the arm's position, move it, stop it. On asyncio.

Commands of several tasks take turns; `stop_motion` does not wait for its turn. If the echo of a command was garbled,
its line was not ended, so the command is typed again. If its *answer* was lost, it may have been carried out, so a
motion is not repeated: the link finds the prompt again, reads WHERE, and raises an error with what it knows.
"""

import asyncio
import time
from collections.abc import Callable, Sequence
from contextlib import AbstractAsyncContextManager
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from drivers.ledger import Ledger
from drivers.val2 import commands
from drivers.val2.conversation import POISON, ControllerAnswer, Conversation, SendPermission, Unconditional
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
    StopWordRefused,
    lacks_zero,
)
from drivers.val2.location import Location, apart
from drivers.val2.port import OpenPort, SerialPort
from drivers.val2.session import LineSession, confirms, unanswered
from drivers.val2.wire import ControllerQuestion, LineEvent, Where

STOP_ATTEMPTS = 5
MOST_JUDGED = 3
"""The most tries of the stop command until one is answered without an error message."""
TINY_DEG = 1e-9
"""Rounding error of the difference of two printed numbers."""
PREAMBLE_S = 0.05
"""The greatest age of a move's preamble when its line is typed. It is not longer than the shortest line of a new
preamble takes, so that somebody else's motion has hardly more time to come between its WHERE and the move."""
BRAKES_S = 0.5
"""How long the brakes need to hold an arm that lost its power."""


@dataclass(frozen=True)
class MoveStart:
    """What is sent and checked immediately before a motion. agrees: called with the arm's position before the line that
    moves it is typed; it raises where that line must not be sent."""

    speed_pct: float
    agrees: Callable[[Where], None]


@dataclass(frozen=True)
class NextMove:
    """A move that will follow another at once."""

    location: Location
    straight: bool
    speed_pct: float


@dataclass(frozen=True)
class Preamble:
    """What was sent before a move: the speed, and the move's lines except the last; and the WHERE after them. traffic:
    the line's count of transfers after it."""

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
        open_port: OpenPort = SerialPort,
    ) -> None:
        """on_wire: called with every record of the wire ledger."""
        self.port, self.dialect, self.clock = port, dialect or Dialect(), clock
        self._ledger = Ledger(on_wire)
        self.belongs_together: Callable[[Where], bool] = lambda _: True
        """Whether the joints of a WHERE match its location, by the arm's kinematics. A reading that does not match
        (noise in a digit, another TOOL or BASE) is read again and never returned."""
        self._open_port = open_port
        self._session: LineSession | None = None
        self._stop_task: asyncio.Task[Where | None] | None = None
        self._preamble: Preamble | None = None
        """The preamble that was sent ahead, when the previous move ended."""
        self._announced_s: float | None = None
        """When the previous move ended, if another was announced to follow at once."""
        self._follows_s = 0.0
        """How long the last announced move took to follow. On a slow computer, or where it was held, this is longer
        than a preamble sent ahead is valid."""
        self.permission: SendPermission = Unconditional()
        """Checked at each try before a line that moves is ended; if motion is withheld, the line is cancelled."""
        self.disturbed: Callable[[], object] = lambda: None
        """Called when something is received that answers no line of facetd's, before anything else is typed, so that
        the owner drops its beliefs about the cell. Motion is blocked through the permission: the stop is no longer
        verified."""
        self.stopped_on_opening = False
        """Whether the arm was moving when the port was last opened, and was stopped."""
        self._times_tested = 0
        self.program_may_run = False
        """Whether a person may have started a program since the controller last accepted the stop command: then a
        question may come from that program, and two WHERE that agree may only be a pause of it."""

    # Connecting

    async def open(self) -> None:
        """Open the port and find the controller's prompt, or the question that it asks at power-up (see `question`).

        If the arm still carries out an earlier command (of a program that was killed), it is stopped.
        """
        await self.close()
        self._session = LineSession(
            self.port,
            self.dialect,
            self.clock,
            self._ledger,
            self._open_port,
            self._void_stop_test,
            self._somebody_else_types,
            self.permission,
        )
        self.stopped_on_opening = False
        try:
            with self._session.being_opened():
                await self._come_to_a_still_arm(self._session)
        except BaseException:
            await self.close()
            raise

    async def close(self) -> None:
        """Close the port; may be called twice. Does not stop the arm: stop_motion() does."""
        self._void_stop_test()
        self.permission.stop_took_s = 0.0
        self.program_may_run, self._preamble = False, None
        if self._session is not None:
            self._session.close()
            self._session = None

    def _void_stop_test(self) -> None:
        self.permission.stop_tests = 0

    def _somebody_else_types(self) -> None:
        """Void the verification of the stop: somebody else may have started a program or a motion, or redefined the
        stop command."""
        self._void_stop_test()
        self.disturbed()

    @property
    def connected(self) -> bool:
        """Whether the line is open."""
        return self._session is not None and not self._session.lost

    @property
    def heard_unasked(self) -> bool:
        """Whether the controller sent something unasked, or another program changed the port, that was not reported
        yet; the next command reports it."""
        return self._session is not None and self._session.heard_unasked

    @property
    def question(self) -> str | None:
        """The controller's open question; it accepts no commands until power_up() answers it."""
        return self._session.question if self._session is not None else None

    async def power_up(self, replies: Sequence[str] = ("Y", "Y")) -> ControllerAnswer:
        """Answer the controller's question, and its next ones of the same kind: a yes to a power-up question moves
        nothing, a yes to another may. Raises ControllerError."""
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
                await session.recover(talk, problem)  # so that no half-typed answer is in front of the next command
                raise
            return session.accept(answer)

    def terminal(self, on_bytes: Callable[[bytes], None]) -> AbstractAsyncContextManager[Callable[[bytes], None]]:
        """Context: connect a person to the controller. Commands wait until the person leaves; stop_motion() still
        works."""
        self.program_may_run = True
        return self._open_session.terminal(on_bytes)

    # Asking

    async def command(
        self,
        text: str,
        replies: Sequence[str] = (),
        timeout_s: float | None = None,
        meant: Callable[[str], bool] = bool,
    ) -> ControllerAnswer:
        """Type any command and return the whole answer. replies: to its questions, in order; meant: whether they answer
        a question.

        Raises ControllerError with the controller's message, or where it asks more questions than there are replies.
        """
        session, moves = self._open_session, commands.moves_the_arm(text)
        async with session.turn(moves) as talk:
            self.program_may_run |= text != self.dialect.calibrate_word and commands.begins_a_program(text)
            default_s = self.dialect.motion_s if moves else self.dialect.answer_s
            return session.accept(await session.ask(talk, text, replies, timeout_s or default_s, meant, moves))

    async def where(self) -> Where:
        """One WHERE, now, also while the arm moves. Use still() for a reading to compute with."""
        async with self._open_session.turn() as talk:
            return await self._where(talk)

    async def calibrate(self, answer: str = "Y") -> ControllerAnswer:
        """Calibrate the arm (CAL) and confirm it. No other question is answered: the controller may just have lost its
        power. Raises ControllerError."""
        return await self.command(self.dialect.calibrate_word, (answer,), self.dialect.calibrate_s, confirms)

    async def tool(self, flange_from_tool: Location) -> None:
        """Set the controller's tool centre point, in the flange's frame."""
        await self.command(commands.tool(flange_from_tool, self.dialect.unit_mm))

    # Moving

    async def move(
        self, location: Location, timeout_s: float | None = None, start: MoveStart | None = None, straight: bool = False
    ) -> None:
        """Start a move, joint-interpolated or straight; wait_until_at_rest() waits for its end. start: None where the
        speed and the arm's position do not matter.

        If the move's line was garbled, the whole preamble is sent again; earlier answers do not count. Raises
        ControllerError, and what start.agrees raises; then nothing has moved.
        """
        session, lines = self._open_session, self._lines(location, straight)
        if self._announced_s is not None:
            self._follows_s, self._announced_s = self.clock() - self._announced_s, None
        answered_at_once = self.dialect.prompt_after_move == "start"
        wait_s = timeout_s or (self.dialect.answer_s if answered_at_once else self.dialect.motion_s)
        async with session.turn(moves=True) as talk:
            before = partial(self._before_move, talk, lines, start)
            session.accept(await session.ask(talk, lines[-1], (), wait_s, moves=True, first=before))

    async def set_hand(self, closed: bool) -> None:
        """Close or open the gripper (CLOSEI, OPENI)."""
        await self.command(f"DO {'CLOSEI' if closed else 'OPENI'}", timeout_s=self.dialect.answer_s)

    async def set_outputs(self, numbers: Sequence[int]) -> None:
        """Switch digital outputs, n on and -n off, also while motion is not permitted, because an output may signal
        just that. Raises ControllerError."""
        await self.ask_plainly(commands.signals(numbers))

    async def work_valves(self, numbers: Sequence[int]) -> None:
        """Switch digital outputs that operate the gripper; needs the permission."""
        await self.command(commands.signals(numbers), timeout_s=self.dialect.answer_s)

    async def ask_plainly(self, text: str) -> tuple[str, ...]:
        """Type one line that moves nothing. Returns the printed lines. Raises ControllerError."""
        session = self._open_session
        async with session.turn() as talk:
            return session.accept(await session.ask(talk, text, (), self.dialect.answer_s)).of_text

    async def wait_until_at_rest(
        self, location: Location, timeout_s: float | None = None, then: NextMove | None = None
    ) -> Where:
        """Wait until the arm is at rest at location: two readings agree, near it; or, after the prompt to BREAK, one
        reading is as near to it as two readings of an arm at rest are to each other.

        then: the move that will follow at once. Its preamble is sent before that one reading. If the move's line is
        typed within PREAMBLE_S, and nothing else was on the line, that reading also serves as its start. Raises
        Elsewhere where the arm came to rest at another place, NoAnswer where it is not at rest in time.
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
                raise Elsewhere(f"at rest {off_mm:.2f} mm and {off_deg:.2f} degrees from its target", where)

    async def still(self, timeout_s: float, any_place: bool = False, before: Where | None = None) -> Where:
        """Wait until two WHERE readings agree. Raises NoAnswer where they do not in time.

        any_place: also accept readings whose location and joints do not match (another TOOL or BASE). before: a reading
        taken just now."""
        async with self._open_session.turn() as talk:
            return await self._still(talk, timeout_s, any_place, before)

    async def stop_motion(self) -> Where | None:
        """Stop the arm now, and return where it came to rest. A task that is using the link gets Preempted. None: the
        controller accepted the command and cannot report a position, because it is at its power-up questions or the
        arm is not calibrated. Then nothing moves; a CAL has ended, because the prompt comes only after it.

        Raises StopWordRefused at once where the controller does not accept the command; NoAnswer and others where it
        does not report rest after some tries. Then the arm may still move: stop it again.
        """
        if self._stop_task is None or self._stop_task.done():
            self._stop_task = asyncio.create_task(self._stop(self._open_session))
            self._stop_task.add_done_callback(mark_retrieved)
        return await asyncio.shield(self._stop_task)

    async def test_stop(self) -> None:
        """Test the stop, and measure how long it takes; the test is a real `stop_motion`. Raises as stop_motion, and
        ControllerError where the controller asks a question instead."""
        began_s = self.clock()
        await self.stop_motion()
        self.permission.stop_took_s = self.clock() - began_s
        if self.question is not None:
            raise unanswered(self.question)

    # Inside

    @property
    def _open_session(self) -> LineSession:
        if self._session is None:
            raise PortError(f"{self.port}: not open")
        return self._session

    async def _come_to_a_still_arm(self, session: LineSession) -> None:
        """Reach the prompt with the arm at rest, or a power-up question, when nothing moves. Raises NoAnswer.

        If the controller sends something but no prompt, its arm may be moving; without echo, this is possible even if
        it sends nothing. Then facetd stops the arm.
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
            await self.stop_motion()
            return
        except NoAnswer as problem:
            if isinstance(problem, ProcessorHalted) or (self.dialect.echo and not isinstance(problem, Busy)):
                raise
            silent = problem
        try:
            await self.stop_motion()
        except (NoAnswer, Garbled):
            raise silent from None
        self.stopped_on_opening = True

    async def _see_that_it_rests(self, talk: Conversation) -> None:
        """Check that the arm is at rest. Raises Busy where it moves, or where the line is too noisy to tell."""
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
        """The lines of a move; the last one starts the motion."""
        if not straight:
            return (commands.move(location, self.dialect.unit_mm),)
        variable = self.dialect.variable if self.dialect.straight_through_variable else None
        return commands.straight_move(location, variable, self.dialect.unit_mm)

    async def _preamble_ahead(self, then: NextMove) -> Where:
        """Send the preamble of the next move when the previous one has ended."""
        session, lines = self._open_session, self._lines(then.location, then.straight)
        async with session.turn() as talk:
            where = await self._send_preamble(talk, lines[:-1], then.speed_pct)
            self._preamble = Preamble(lines, then.speed_pct, where, self.clock(), session.traffic)
        return where

    async def _before_move(self, talk: Conversation, lines: Sequence[str], start: MoveStart | None) -> None:
        """Send the preamble, unless a valid one was sent ahead. Raises Garbled where noise disturbs every try, and what
        start.agrees raises."""
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
        """Whether a preamble sent ahead is for this move and recent, and nothing was sent or received since."""
        wanted = tuple(lines), start.speed_pct, self._open_session.traffic
        same = (ahead.lines, ahead.speed_pct, ahead.traffic) == wanted
        return same and self.clock() - ahead.at_s <= PREAMBLE_S

    async def _send_preamble(self, talk: Conversation, lines: Sequence[str], speed_pct: float) -> Where:
        """Send speed and location, and read WHERE last: nothing else is typed between it and the line that moves.
        Raises Garbled where noise disturbs every try."""
        session, answer_s = self._open_session, self.dialect.answer_s
        for _ in range(self.dialect.typing_attempts * (len(lines) + 3)):
            before = session.recoveries
            of_programs = await session.ask(talk, commands.PROGRAM_SPEED, (), answer_s)
            session.accept(replace(of_programs, errors=()))  # a controller that refuses it has no such factor
            session.accept(await session.ask(talk, commands.speed(speed_pct), (), answer_s))
            for line in lines:
                session.accept(await session.ask(talk, line, (), answer_s))
            where = await self._where(talk)
            if session.recoveries == before:
                return where
        raise Garbled(
            "noise on the serial line: speed and target of a move could not be sent without errors; nothing moved. "
            "Check the cable and its shield, then `resume`"
        )

    async def _where(self, talk: Conversation, any_place: bool = False) -> Where:
        """Read WHERE. any_place: also accept a reading whose location and joints do not match."""
        session, why = self._open_session, "the answer to WHERE was incomplete"
        for _ in range(self.dialect.typing_attempts):
            answer = session.accept(await session.ask(talk, "WHERE", (), self.dialect.answer_s))
            if answer.where is None:
                continue
            if any_place or self.belongs_together(answer.where):
                return answer.where
            why = (
                "position and joint angles of WHERE do not fit each other: noise on the line, or somebody set TOOL or "
                "BASE at the controller (switch it off and on)"
            )
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

    async def _stop(self, session: LineSession) -> Where | None:
        """Try to stop, each try at most as long as a prompt and two WHERE take. A half-typed line becomes an error, not
        a command. An open question is first answered with N, except a power-up question, unless a program may be
        asking it."""
        no = b"N" + self.dialect.line_end
        problem: LinkError = NoAnswer(f"no answer to {self.dialect.abort_word}")
        before, asked = b"", ""
        async with session.preemption() as talk:
            for _ in range(STOP_ATTEMPTS):
                try:
                    last = await self._type_stop(session, talk, before)
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
                except StopWordRefused:
                    raise
                except (NoAnswer, Garbled, ControllerError, Disturbed) as failed:
                    before, problem = b"", failed
        raise problem

    async def _type_stop(self, session: LineSession, talk: Conversation, before: bytes) -> LineEvent:
        """Type the stop command twice at once, on separate lines, so that a damaged byte damages only one of them.
        First cancel a half-typed line: as an answer, a Y counts whatever follows it. Before an answer of facetd's
        (before) no cancel key is sent: a controller that does not know the key would take it as part of the answer."""
        end = self.dialect.line_end
        word = self.dialect.abort_word.encode("ascii") + end
        talk.unheard()
        await talk.type_raw((before or self.dialect.cancel_line) + POISON + end + word + end + word)
        session.stop_typed = True
        return await talk.last_prompt_or_question(self.dialect.resync_s)

    async def _stopped(self, session: LineSession, talk: Conversation) -> Where | None:
        """Type the stop command again and check its answer; then read WHERE twice: the readings must agree, or both be
        refused because the arm is not calibrated. Raises StopWordRefused."""
        by_itself = await self._see_it_taken(session, talk)
        readings: list[Where | None] = []
        for _ in range(2):
            await asyncio.sleep(self.dialect.poll_s)
            answer = await talk.ask("WHERE", (), self.dialect.table_s)
            if answer.errors and answer.where is None:
                refusal = "; ".join(answer.errors)
                if not lacks_zero(refusal):
                    raise ControllerError(
                        f"WHERE is refused (`{refusal}`: remove the cause, then `systemctl restart facetd`)"
                    )
            elif answer.where is None:
                raise Garbled("the answer to WHERE was incomplete")
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

    async def _see_it_taken(self, session: LineSession, talk: Conversation) -> list[str]:
        """Verify from its answer that the controller accepts the stop command. Returns what it reported by itself
        meanwhile, such as the end of a program or a loss of arm power: unlike a refusal, that does not come at each
        try.

        Raises StopWordRefused; ControllerError where the controller asks a question instead, because it took the
        command for an answer, and where it sends a different message each time.
        """
        by_itself: list[str] = []
        for _ in range(MOST_JUDGED):
            answer = await talk.ask(self.dialect.abort_word, (), self.dialect.resync_s)
            if answer.question is not None or not answer.errors:
                session.accept(answer)
                break
            if not set(by_itself).isdisjoint(answer.errors):
                self._void_stop_test()
                word, words = self.dialect.abort_word, "; ".join(answer.errors)
                raise StopWordRefused(f"the controller does not accept {word} (it answers `{words}`)")
            by_itself += answer.errors
        else:
            raise ControllerError("; ".join(by_itself))
        self.program_may_run = False
        if not self.permission.stop_tests:
            self._times_tested += 1
            self.permission.stop_tests = self._times_tested
        return by_itself


async def _brakes_hold() -> None:
    """Wait until the brakes hold an arm whose position cannot be read."""
    await asyncio.sleep(BRAKES_S)


def mark_retrieved(stop: asyncio.Task[Where | None]) -> None:
    """Mark the error of a stop as retrieved: its caller may have been cancelled."""
    if not stop.cancelled():
        stop.exception()
