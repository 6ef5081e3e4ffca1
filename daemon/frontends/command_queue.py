"""The command queue of one operator, the same at every frontend. Commands run one after the other; those that may run
at any time do not wait; one question is open at a time. A stop never waits in the queue."""

import asyncio
from collections import deque
from collections.abc import Awaitable, Callable, Coroutine
from math import inf
from typing import Any, TypeVar

from daemon.commands.step_mode import READ_S
from daemon.console.interpreter import CommandResult, Frontend, Interpreter
from daemon.errors import DONE, NOT_DONE

T = TypeVar("T")
Interrupt = Callable[[str, bool], Awaitable[str]]
"""Called when an operator presses control-C; stops the arm and returns a report. Arguments: who pressed it; whether
their command may be about to move an arm that does not move yet."""
Block = int | str | None
"""The number of a group of lines that were pasted together."""
Answered = Callable[[CommandResult], Awaitable[None]]
"""Called with the answer to one command."""


MOST_WAITING = 500
"""How many commands of one operator may wait, or run at the same time."""
MOST_TASKS = 1000
"""How many tasks of one operator may run. Those beyond MOST_WAITING are stops."""
CROWDED = "too many commands are waiting; wait for their answers"
STOPPED_SINCE = "the arm was stopped after you typed it"
NOT_IN_BLOCK = "an earlier line of the same paste was not done"
STOP_PENDING_EVERY_S = 0.5
"""Interval of the messages that show that facetd still waits for the confirmation of a stop: well below the time after
which a client takes the daemon for dead (client.py, STOP_ANSWER_S)."""
AWAITED = "stop sent; the controller answers; waiting up to {:.0f} s until it confirms that the arm is at rest"
TOO_SOON = "ignored, too soon for an answer"


class CommandQueue:
    """The commands of one operator, and the question that waits for this operator's answer."""

    def __init__(
        self,
        interpreter: Interpreter,
        frontend: Frontend,
        interrupt: Interrupt,
        show_question: Callable[[str | None], None],
        sign: Callable[[], None] = lambda: None,
    ) -> None:
        """show_question: shows a question to the operator; None removes it. sign: called repeatedly while a stop that
        the controller has answered waits for its confirmation."""
        self._interpreter, self._frontend = interpreter, frontend
        self._interrupt, self._show_question, self._sign = interrupt, show_question, sign
        self.busy = False
        """Whether a command is running that others wait for."""
        self.question = 0
        """Number of the last question."""
        self.disconnected = self._input_ended = False
        """_input_ended: the operator still receives but sends nothing more."""
        self._running = ""
        self._waiting: deque[tuple[str, Answered, int, Block]] = deque()
        """Commands typed ahead, each with the number of stops so far (a later stop voids it) and its block."""
        self._failed_block: Block = None
        """The block in which a line failed: the rest of its lines is dropped."""
        self._awaited_answer: asyncio.Future[str] | None = None
        self._question_text, self._read_s = "", -inf
        """The text of the open question, and the loop's time from which an answer counts."""
        self._withdrawn_before = False
        """Whether somebody else decided the previous question: an answer to it may still arrive."""
        self._one_question = asyncio.Lock()
        self._tasks: set[asyncio.Task[None]] = set()

    def take(self, text: str, answered: Answered, block: Block = None) -> None:
        """Run a command: a stop, or one that may run at any time, at once; others after those before them. block: lines
        that were pasted together run one after the other, up to the first that fails."""
        if self._interpreter.means_stop(text):
            self.start_now(lambda: self._do(self._stop_by_command(text), answered))
        elif block is not None and block == self._failed_block:
            self._start(_report_dropped([(text, answered)], NOT_IN_BLOCK))
        elif not self.busy:
            self._begin(text, answered, block)
        elif block is None and self.asking and self._interpreter.keeps_question(text):
            self.start_now(lambda: self._run_during_question(text, answered))
        elif block is None and self._interpreter.at_once(text):
            self.start_now(lambda: self._do(self._interpreted(text), answered))
            if self._interpreter.withdraws(text):
                self._withdraw_question()
        else:
            self._waiting.append((text, answered, self._stops, block))

    async def _stop_by_command(self, text: str) -> CommandResult:
        return await self._stopping(self._interpreter.interpret(text, self._frontend), self._frontend.who)

    async def stop(self, who: str) -> str:
        """Stop the arm, as control-C does; returns the report."""
        return await self._stopping(self._interrupt(who, self.busy and self._interpreter.moves(self._running)), who)

    def has_room_for(self, text: str) -> bool:
        """Whether the queue takes this command: always a stop, another one unless too many wait."""
        return not self.crowded or self._interpreter.means_stop(text)

    @property
    def crowded(self) -> bool:
        """Whether more commands wait than a person types."""
        return len(self._waiting) >= MOST_WAITING or len(self._tasks) >= MOST_WAITING

    @property
    def _stops(self) -> int:
        return self._interpreter.context.cycle.supervisor.stops

    @property
    def asking(self) -> bool:
        return self._awaited_answer is not None and not self._awaited_answer.done()

    async def ask(self, question: str) -> str:
        """Ask a question and wait for the answer; empty after a stop, or when the operator disconnects."""
        async with self._one_question:
            if self.disconnected or self._input_ended:
                return ""
            loop = asyncio.get_running_loop()
            self._awaited_answer, self._question_text = loop.create_future(), question
            self._read_s = loop.time() + READ_S if self._withdrawn_before else -inf
            self._put(question)
            try:
                return await self._awaited_answer
            finally:
                self._withdrawn_before = self._awaited_answer.cancelled()
                self._awaited_answer = None
                self._show_question(None)

    def _put(self, question: str) -> None:
        self.question += 1
        self._show_question(question)

    def answer(self, text: str) -> bool:
        """Take a line as the answer to the open question. False without one, and for a line that is no answer. A line
        typed before anybody can have read the question belongs to the previous one: the question is asked again."""
        if self._awaited_answer is None or self._awaited_answer.done() or self._interpreter.withdraws(text):
            return False
        if self._interpreter.keeps_question(text):
            return False
        if asyncio.get_running_loop().time() < self._read_s:
            self._put(f"{TOO_SOON}: {self._question_text}")
        else:
            self._awaited_answer.set_result(text)
        return True

    def leave(self) -> None:
        """The operator disconnected: the running command goes on, those typed ahead are dropped."""
        self.disconnected = True
        self._waiting.clear()
        self._withdraw_question()

    def input_ended(self) -> None:
        """The operator's input ended, but they still receive: their commands run in turn, and answer no question."""
        self._input_ended = True
        self._withdraw_question()

    def start_now(self, work: Callable[[], Coroutine[Any, Any, None]]) -> None:
        """Start a task at once. Beyond MOST_TASKS it is one stop more of a flood, and left out."""
        if len(self._tasks) < MOST_TASKS:
            self._start(work())

    def _start(self, work: Coroutine[Any, Any, None]) -> None:
        task = asyncio.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def end(self) -> None:
        while self._tasks:
            await asyncio.wait(self._tasks)

    def _begin(self, text: str, answered: Answered, block: Block) -> None:
        self.busy, self._running = True, text
        self._start(self._in_turn(text, answered, block))

    async def _in_turn(self, text: str, answered: Answered, block: Block) -> None:
        answer = await self._interpreted(text)
        self.busy = False
        if block is not None and answer.status != DONE:
            self._failed_block = block
        dropped, of_block = [], []
        while self._waiting and not self.busy:
            ahead, to, stops, its = self._waiting.popleft()
            if stops != self._stops:
                dropped.append((ahead, to))
            elif its is not None and its == self._failed_block:
                of_block.append((ahead, to))
            else:
                self._begin(ahead, to, its)
        await answered(answer)
        await _report_dropped(dropped)
        await _report_dropped(of_block, NOT_IN_BLOCK)

    async def _do(self, work: Awaitable[CommandResult], answered: Answered) -> None:
        await answered(await work)

    async def _run_during_question(self, text: str, answered: Answered) -> None:
        """Run a command while a question is open, then show the question again below its output."""
        question = self._awaited_answer
        await self._do(self._interpreted(text), answered)
        if question is self._awaited_answer and self.asking:
            self._put(self._question_text)

    async def _stopping(self, work: Awaitable[T], who: str) -> T:
        """Stop the arm first; then cancel the open question, drop commands typed ahead, and report them."""
        dropped = [(text, answered) for text, answered, *_ in self._waiting]
        self._waiting.clear()
        try:
            with self._interpreter.context.notices.stopping(self._frontend, who):
                return await self._reporting_stop(work)
        finally:
            self._withdraw_question()
            if dropped:
                self._start(_report_dropped(dropped))

    async def _interpreted(self, text: str) -> CommandResult:
        work = self._interpreter.interpret(text, self._frontend)
        return await (self._reporting_stop(work) if self._interpreter.withdraws(text) else work)

    async def _reporting_stop(self, work: Awaitable[T]) -> T:
        """Await a stop; meanwhile show that the controller answers and has not confirmed it yet."""
        signs = asyncio.create_task(self._report_stop())
        try:
            return await work
        finally:
            signs.cancel()

    async def _report_stop(self) -> None:
        supervisor, reported, reports_seen = self._interpreter.context.cycle.supervisor, False, 0
        while True:
            await asyncio.sleep(STOP_PENDING_EVERY_S)
            before, reports_seen = reports_seen, supervisor.rest_reports
            within_s = supervisor.awaits_confirmation_s
            if within_s is None and reports_seen > before:  # a slow controller still reports whether the arm rests
                self._sign()
            if within_s is None:
                continue
            self._sign()
            if not reported:
                reported = True
                await self._frontend.say(AWAITED.format(within_s))

    def _withdraw_question(self) -> None:
        if self._awaited_answer is not None and not self._awaited_answer.done():
            self._awaited_answer.set_result("")


async def _report_dropped(dropped: list[tuple[str, Answered]], why: str = STOPPED_SINCE) -> None:
    for text, answered in dropped:
        reported = f"{text}: not done; {why}"
        await answered(CommandResult(reported, {"error": reported}, NOT_DONE))
