"""The command queue of one operator, the same at every frontend: commands one after the other, what is for now beside
them, one question after the other. A stop never waits in it.
"""

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
"""Called when somebody presses control-C, with who it was, and whether what they asked for may be about to move the arm
where it does not move yet; stops it and says what happened."""
Block = int | str | None
"""Of what was pasted together, its number."""
Answered = Callable[[CommandResult], Awaitable[None]]
"""Called with the answer to one command."""


MOST_AHEAD = 500
"""Commands of one operator that wait, or are done beside each other."""
MOST_BESIDE = 1000
"""All that is done for one operator: beyond the commands it is stops."""
CROWDED = "too many commands are waiting; wait for their answers"
STOPPED_SINCE = "the arm was stopped after you typed it"
NOT_IN_BLOCK = "an earlier line of the same paste was not done"
SIGN_S = 0.5
"""Between two signs of life to who waits for the confirmation of a stop: a good part of a client's patience with a
daemon that says nothing (client.py, STOP_ANSWER_S)."""
AWAITED = "stop sent; the controller answers; waiting up to {:.0f} s until it confirms that the arm is at rest"
TOO_SOON = "ignored, too soon for an answer"


class CommandQueue:
    """What one operator asked for, and what they are asked."""

    def __init__(
        self,
        interpreter: Interpreter,
        frontend: Frontend,
        interrupt: Interrupt,
        show_question: Callable[[str | None], None],
        sign: Callable[[], None] = lambda: None,
    ) -> None:
        """show_question: puts a question before the operator; None takes it away again. sign: called again and again
        while a stop that the controller has answered waits to be confirmed."""
        self._interpreter, self._frontend = interpreter, frontend
        self._interrupt, self._show_question, self._sign = interrupt, show_question, sign
        self.busy = False
        """A command is being done that others wait for."""
        self.question = 0
        """The number of the question that was put last."""
        self.gone = self._mute = False
        """Whether the operator went away; whether they only hear."""
        self._doing = ""
        self._ahead: deque[tuple[str, Answered, int, Block]] = deque()
        """What was typed ahead, and how often the arm had been stopped by then: a later stop, at whatever frontend,
        voids it; and of which block it is."""
        self._ended_block: Block = None
        """The block of which a line was not done: nothing more of it is."""
        self._asked: asyncio.Future[str] | None = None
        self._words, self._read_s = "", -inf
        """What is asked, and from when on (the loop's time) an answer may be one to it."""
        self._settled_elsewhere = False
        """Whether the question before was taken away as somebody else had settled it: an answer to that one may be on
        its way still."""
        self._one_question = asyncio.Lock()
        self._tasks: set[asyncio.Task[None]] = set()

    def take(self, text: str, answered: Answered, block: Block = None) -> None:
        """Do a command: a stop, or what is for now, at once; others when those before them are done. block: of several
        lines that were pasted together, each is done after the one before, to the first that is not."""
        if self._interpreter.means_stop(text):
            self.beside(lambda: self._do(self._stop_said(text), answered))
        elif block is not None and block == self._ended_block:
            self._start(_tell_dropped([(text, answered)], NOT_IN_BLOCK))
        elif not self.busy:
            self._begin(text, answered, block)
        elif block is None and self.asking and self._interpreter.leaves_question(text):
            self.beside(lambda: self._beside_question(text, answered))
        elif block is None and self._interpreter.at_once(text):
            self.beside(lambda: self._do(self._interpreted(text), answered))
            if self._interpreter.withdraws(text):
                self._unasked()
        else:
            self._ahead.append((text, answered, self._interpreter.stops, block))

    async def _stop_said(self, text: str) -> CommandResult:
        return await self._stopping(self._interpreter.interpret(text, self._frontend), self._frontend.who)

    async def stop(self, who: str) -> str:
        """Control-C; gives what the daemon says."""
        return await self._stopping(self._interrupt(who, self.busy and self._interpreter.moves(self._doing)), who)

    def has_room_for(self, text: str) -> bool:
        """Whether a command may still be taken: a stop always, another unless too many wait."""
        return not self.crowded or self._interpreter.means_stop(text)

    @property
    def crowded(self) -> bool:
        """Whether more was asked for than anybody types."""
        return len(self._ahead) >= MOST_AHEAD or len(self._tasks) >= MOST_AHEAD

    @property
    def asking(self) -> bool:
        return self._asked is not None and not self._asked.done()

    async def ask(self, question: str) -> str:
        """Put a question and wait for the answer; empty when it was to stop, or nobody is there."""
        async with self._one_question:
            if self.gone or self._mute:
                return ""
            loop = asyncio.get_running_loop()
            self._asked, self._words = loop.create_future(), question
            self._read_s = loop.time() + READ_S if self._settled_elsewhere else -inf
            self._put(question)
            try:
                return await self._asked
            finally:
                self._settled_elsewhere = self._asked.cancelled()
                self._asked = None
                self._show_question(None)

    def _put(self, question: str) -> None:
        self.question += 1
        self._show_question(question)

    def answer(self, text: str) -> bool:
        """Take a line as the answer to what is asked. False where nothing is asked, and for what is no answer: it takes
        the arm's leave to move, or runs beside the question. Where nobody can have read the question, it was for the
        one before, and this one is put again."""
        if self._asked is None or self._asked.done() or self._interpreter.withdraws(text):
            return False
        if self._interpreter.leaves_question(text):
            return False
        if asyncio.get_running_loop().time() < self._read_s:
            self._put(f"{TOO_SOON}: {self._words}")
        else:
            self._asked.set_result(text)
        return True

    def leave(self) -> None:
        """The operator is gone: what is being done goes on, what was typed ahead is dropped, nobody answers."""
        self.gone = True
        self._ahead.clear()
        self._unasked()

    def say_no_more(self) -> None:
        """The operator hears, and says nothing more: what they asked for goes on in its turn, and answers no
        question."""
        self._mute = True
        self._unasked()

    def beside(self, work: Callable[[], Coroutine[Any, Any, None]]) -> None:
        """Do something now, whatever else is under way. Where a flood of one operator's is, this is one more stop like
        those, and left out."""
        if len(self._tasks) < MOST_BESIDE:
            self._start(work())

    def _start(self, work: Coroutine[Any, Any, None]) -> None:
        task = asyncio.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def end(self) -> None:
        """Wait for all that is being done."""
        while self._tasks:
            await asyncio.wait(self._tasks)

    def _begin(self, text: str, answered: Answered, block: Block) -> None:
        self.busy, self._doing = True, text
        self._start(self._in_turn(text, answered, block))

    async def _in_turn(self, text: str, answered: Answered, block: Block) -> None:
        answer = await self._interpreted(text)
        self.busy = False
        if block is not None and answer.status != DONE:
            self._ended_block = block
        dropped, of_block = [], []
        while self._ahead and not self.busy:
            ahead, to, stops, its = self._ahead.popleft()
            if stops != self._interpreter.stops:
                dropped.append((ahead, to))
            elif its is not None and its == self._ended_block:
                of_block.append((ahead, to))
            else:
                self._begin(ahead, to, its)
        await answered(answer)
        await _tell_dropped(dropped)
        await _tell_dropped(of_block, NOT_IN_BLOCK)

    async def _do(self, work: Awaitable[CommandResult], answered: Answered) -> None:
        await answered(await work)

    async def _beside_question(self, text: str, answered: Answered) -> None:
        """Do a command while a question is open, and put the question again below what it shows."""
        question = self._asked
        await self._do(self._interpreted(text), answered)
        if question is self._asked and self.asking:
            self._put(self._words)

    async def _stopping(self, work: Awaitable[T], who: str) -> T:
        """The arm first; then what was asked is no longer asked, and what was typed ahead is dropped, and told so."""
        dropped = [(text, answered) for text, answered, *_ in self._ahead]
        self._ahead.clear()
        try:
            with self._interpreter.context.notices.stopping(self._frontend, who):
                return await self._with_signs(work)
        finally:
            self._unasked()
            if dropped:
                self._start(_tell_dropped(dropped))

    async def _interpreted(self, text: str) -> CommandResult:
        work = self._interpreter.interpret(text, self._frontend)
        return await (self._with_signs(work) if self._interpreter.withdraws(text) else work)

    async def _with_signs(self, work: Awaitable[T]) -> T:
        """What comes of it; a stop in it that the controller has answered is told as long as it is not confirmed, and
        that it says more of whether there is anything to stop as long as it does."""
        signs = asyncio.create_task(self._give_signs())
        try:
            return await work
        finally:
            signs.cancel()

    async def _give_signs(self) -> None:
        told, heard = False, 0
        while True:
            await asyncio.sleep(SIGN_S)
            before, heard = heard, self._interpreter.heard_asking
            within_s = self._interpreter.awaits_confirmation_s
            if within_s is None and heard > before:  # a slow controller is still saying whether the arm is at rest
                self._sign()
            if within_s is None:
                continue
            self._sign()
            if not told:
                told = True
                await self._frontend.say(AWAITED.format(within_s))

    def _unasked(self) -> None:
        if self._asked is not None and not self._asked.done():
            self._asked.set_result("")


async def _tell_dropped(dropped: list[tuple[str, Answered]], why: str = STOPPED_SINCE) -> None:
    for text, answered in dropped:
        told = f"{text}: not done; {why}"
        await answered(CommandResult(told, {"error": told}, NOT_DONE))
