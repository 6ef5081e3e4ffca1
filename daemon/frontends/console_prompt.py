"""A prompt that listens while it waits: what the daemon says appears above the line being typed, whoever caused it.

Commands are said as soon as they are typed; the daemon does them in their order, and `stop` at once. What is pasted is
as many lines as it has: Enter says them, and a stop among them does not wait for that. Built on prompt_toolkit, for a
person at a terminal only.
"""

import asyncio
import json
import signal
from collections import deque
from collections.abc import AsyncGenerator, Awaitable, Callable, Iterable
from itertools import count
from pathlib import Path
from typing import Any

from prompt_toolkit import PromptSession
from prompt_toolkit.application import in_terminal
from prompt_toolkit.buffer import Buffer
from prompt_toolkit.completion import CompleteEvent, Completer, Completion
from prompt_toolkit.document import Document
from prompt_toolkit.history import History
from prompt_toolkit.key_binding import KeyBindings, KeyPressEvent
from prompt_toolkit.keys import Keys
from prompt_toolkit.renderer import CPR_Support

from daemon.console.stop_words import LINE_END, ends_in_stop, means_stop, withdraws_permission
from daemon.console.text_layout import NARROWEST, fold
from daemon.errors import STOP_UNANSWERED
from daemon.frontends import client
from daemon.frontends.client import EMERGENCY, DaemonLink, DaemonUnreachableError, file_in_pieces, files_begun
from daemon.frontends.keyboard import RawKeyboard
from daemon.store.files import write_atomically
from daemon.store.folders import own_folder
from daemon.store.outside import FileError, open_to_append, read_file

HISTORY_LINES = 1000
LARGEST_HISTORY = 4_000_000


class DaemonCompleter(Completer):
    """Tab asks the daemon what the line may become."""

    def __init__(self, ask: Callable[[str], Awaitable[list[str]]]) -> None:
        self._ask = ask

    def get_completions(self, document: Document, complete_event: CompleteEvent) -> Iterable[Completion]:
        """None without waiting: the daemon must be asked."""
        return ()

    async def get_completions_async(
        self, document: Document, complete_event: CompleteEvent
    ) -> AsyncGenerator[Completion, None]:
        """The last word of each line that the daemon offers."""
        typed = document.text_before_cursor
        start = typed.rfind(" ") + 1
        for option in await self._ask(typed):
            end = "" if option.endswith("/") else " "
            yield Completion(f"{option[start:]}{end}", start - len(typed), display=option[start:])


class CommandHistory(History):
    """Commands of earlier sessions, one a line, as a shell keeps them; answers to questions are none."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self._path = path
        self.remember = True

    def load_history_strings(self) -> Iterable[str]:
        """Newest first; the file is cut where it has become long."""
        try:
            lines = read_file(self._path, LARGEST_HISTORY).decode(errors="replace").splitlines()
            if len(lines) > 2 * HISTORY_LINES:
                write_atomically(self._path, "\n".join([*lines[-HISTORY_LINES:], ""]).encode())
        except (FileError, OSError):
            return []
        return lines[: -HISTORY_LINES - 1 : -1]

    def append_string(self, string: str) -> None:
        """Keep a command, unless it is the answer to a question."""
        for line in string.splitlines() if self.remember else ():
            if line.strip():
                super().append_string(line.strip())

    def store_string(self, string: str) -> None:
        """Write it behind the others; where that cannot be, this session remembers it all the same."""
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            with open(self._path, "a", encoding="utf-8", opener=open_to_append) as file:
                file.write(f"{string}\n")
        except OSError:
            return


PROMPT = "facetd> "
GREETING = "`help` lists the commands; control-C stops the arm; control-D leaves."
NOT_THERE = "no daemon answers at present"
AGAIN = "Connected again. Check `status`, then repeat what is still wanted."
SEEK_S = 0.5
"""How often a daemon that went away is sought again."""
ROOM_TO_ANSWER = 4
"""Columns kept free behind a question."""
LONGEST_MESSAGE = 16_000_000
LONGEST_PASTE = 200
"""Lines; fewer than the daemon lets one operator wait with."""


class ConsolePrompt:
    """One operator at a terminal, from the first prompt to control-D or `quit`."""

    def __init__(self, link: DaemonLink) -> None:
        self._link = link
        self._writer: asyncio.StreamWriter | None = None
        self._why_gone = ""
        self._numbers = count(1)
        self._unanswered: dict[int, str] = {}
        """Commands that are not answered yet, by their numbers."""
        self._stops: deque[asyncio.TimerHandle] = deque()
        """The clock of each stop that is not answered yet: control-C's."""
        self._stop_words: dict[int, asyncio.TimerHandle] = {}
        """And of those in words, by their numbers."""
        self._asked: tuple[int, str] | None = None
        """The question that stands: its number and its words."""
        self._kept = ""
        """What was being typed when the question came."""
        self._taken: list[str] = []
        """What of the line being typed stood there when questions came or went: a stop may be amid it."""
        self._given_back = ""
        """What stood there before the question, and does again: it was not typed since."""
        self._options: deque[asyncio.Future[list[str]]] = deque()
        self._status = 0
        self._keyboard: RawKeyboard | None = None
        self._at_controller: asyncio.Task[None] | None = None
        self._left_controller = asyncio.Event()
        self._history = CommandHistory(own_folder().with_name("facetctl-history"))
        self._session: PromptSession[str] = PromptSession(
            self._prompt,
            history=self._history,
            completer=DaemonCompleter(self._complete),
            complete_while_typing=False,
            enable_suspend=True,
            reserve_space_for_menu=4,
            key_bindings=self._keys(),
        )
        # An ended line would wait up to 1 s for the terminal to say where its cursor is: a stop waits for nothing.
        self._session.app.renderer.cpr_support = CPR_Support.NOT_SUPPORTED
        self._answering: tuple[int, str] | None = None
        """The question that stood when the line was ended: one that came a moment later is not answered by it."""
        buffer = self._session.default_buffer
        accept = buffer.accept_handler
        assert accept is not None

        def ended(of: Buffer) -> bool:
            self._answering = self._asked
            return accept(of)

        buffer.accept_handler = ended
        self._hear_unended_pastes()

    async def run(self) -> int:
        """Prompt until the operator leaves; gives the status of what was answered last."""
        asyncio.get_running_loop().add_signal_handler(signal.SIGINT, self._stop)
        self._show(GREETING)
        await self._connect()
        hearing = asyncio.create_task(self._hear_always())
        hearing.add_done_callback(self._deaf)
        try:
            with self._session.input.raw_mode():  # from one line to the next, too: no key is taken for something else
                while True:
                    line = await self._session.prompt_async(default=self._take_kept(), handle_sigint=False)
                    if line.strip() in ("quit", "exit") and self._answering is None:
                        return self._status
                    self._typed(line)
        except EOFError:
            return self._status
        finally:
            hearing.cancel()
            self._hung_up()

    def _deaf(self, hearing: asyncio.Task[None]) -> None:
        """A prompt that no longer hears must not go on as if it did."""
        if not hearing.cancelled() and (error := hearing.exception()) is not None:
            self._session.app.exit(exception=error)

    # What is typed

    def _prompt(self) -> str:
        if self._asked is not None:
            columns = max(self._session.output.get_size().columns, NARROWEST)
            return "\n".join(fold(self._asked[1], columns - ROOM_TO_ANSWER)) + " "
        return f"({next(iter(self._unanswered.values()))}) {PROMPT}" if self._unanswered else PROMPT

    def _keys(self) -> KeyBindings:
        keys = KeyBindings()

        @keys.add("c-c")
        def _(_: object) -> None:
            self._stop()

        @keys.add(Keys.BracketedPaste)
        def _(event: KeyPressEvent) -> None:
            self._pasted(event.data)

        return keys

    def _pasted(self, data: str) -> None:
        """A stop amid a paste is said at once, and nothing else of it. Of more lines than one, comments left out, each
        is a line of its own once Enter is pressed."""
        buffer = self._session.default_buffer
        before, after = buffer.document.text_before_cursor, buffer.document.text_after_cursor
        first, *others = LINE_END.split(before + data + after)
        if ends_in_stop(self._taken, first.removeprefix(self._given_back)) or any(map(means_stop, others)):
            self._kept, self._given_back = "", ""
            self._taken.clear()
            buffer.reset()
            self._command("stop")
            if others:
                self._show("The paste contains a stop: the arm is stopped, the rest of the paste is dropped.")
            return
        lines = [line for line in LINE_END.split(data) if line.split("#")[0].strip()]
        if len(lines) < 2:
            buffer.insert_text(lines[0] if lines else "")
        elif self._asked is not None or len(lines) > LONGEST_PASTE:
            most = "an answer is one line" if self._asked is not None else f"at most {LONGEST_PASTE}; `facetctl script`"
            self._show(f"Not taken, {len(lines)} lines were pasted: {most}.")
        else:
            lines = [line for line in (first, *others) if line.split("#")[0].strip()]
            buffer.reset(Document("\n".join(lines)))
            self._show(
                f"{len(lines)} lines pasted: Enter says one after the other, to the first that is not done; "
                "control-C drops them."
            )

    def _hear_unended_pastes(self) -> None:
        """Where the mark that ends a paste is lost on the way, all that is typed later would be taken for more of it: a
        control-C or a stop as well."""
        parser: Any = getattr(self._session.input, "vt100_parser", None)
        if parser is None:
            return
        feed = parser.feed

        def heard(data: str) -> None:
            feed(data)
            begun = parser._paste_buffer if getattr(parser, "_in_bracketed_paste", False) else ""
            *lines, _ = LINE_END.split(begun)
            if "\x03" in begun:
                parser.reset()
                self._stop()
            elif any(map(means_stop, lines)):
                parser.reset()
                self._pasted(begun)

        parser.feed = heard

    def _stop(self) -> None:
        """Control-C, at any moment."""
        self._kept = ""
        self._taken.clear()
        self._session.default_buffer.reset()
        if self._send({"interrupt": True}):
            self._stops.append(self._clock())
        else:
            self._emergency(f"{EMERGENCY}: {self._why_gone or NOT_THERE}")

    def _clock(self) -> asyncio.TimerHandle:
        """Sends to the emergency stop, unless it is cancelled in time."""
        return asyncio.get_running_loop().call_later(client.STOP_ANSWER_S, self._emergency, client.UNANSWERED)

    def _wait_anew(self) -> None:
        """The daemon answers, and waits for the controller: it says by itself when that takes too long."""
        for clock in (*self._stops, *self._stop_words.values()):
            clock.cancel()
        self._stops = deque(self._clock() for _ in self._stops)
        self._stop_words = {number: self._clock() for number in self._stop_words}

    def _emergency(self, told: str) -> None:
        self._status = STOP_UNANSWERED
        self._show(told)

    def _typed(self, line: str) -> None:
        """A line to the daemon: the answer to its question, or a command."""
        if ends_in_stop(self._taken, line.removeprefix(self._given_back)):
            line, self._kept = "stop", ""
        self._taken, self._given_back = [], ""
        if self._answering is not None:
            number, _ = self._answering
            if self._asked == self._answering:
                self._unask()
            sent = self._send({"answer": line, "id": number})
            if withdraws_permission(line):
                self._stops.append(self._clock())
            if withdraws_permission(line) and not sent:
                self._emergency(f"{EMERGENCY}: {self._why_gone or NOT_THERE}")
        elif "\n" in line.strip():
            block = next(self._numbers)
            for one in line.strip().splitlines():
                self._command(one, {"block": block})
        elif line.strip():
            self._command(line)

    def _command(self, line: str, of: dict[str, Any] | None = None) -> None:
        number = next(self._numbers)
        size = self._session.output.get_size()
        message = {"do": line, "frontend": "console", "asks": True, "waits": True, "id": number, **(of or {})}
        message["size"] = [size.columns, size.rows]
        if self._send(message):
            self._unanswered[number] = line.strip()
            if withdraws_permission(line):
                self._stop_words[number] = self._clock()
        elif withdraws_permission(line):
            self._emergency(f"{EMERGENCY}; not sent: {line.strip()}: {self._why_gone or NOT_THERE}")
        else:
            self._show(f"{self._why_gone or NOT_THERE}; not sent: {line.strip()}")

    async def _complete(self, typed: str) -> list[str]:
        """Every line that the typed one may become; files are those of this machine."""
        if (files := files_begun(typed)) is not None:
            return files
        if self._asked is not None or not self._send({"complete": typed}):
            return []
        self._options.append(asyncio.get_running_loop().create_future())
        return await self._options[-1]

    def _offer(self, options: list[str]) -> None:
        asked = self._options.popleft()
        if not asked.done():  # somebody who types on no longer wants to know
            asked.set_result(options)

    # What is heard

    async def _hear_always(self) -> None:
        while True:
            await self._hear()
            amid, stopping = bool(self._unanswered), bool(self._stops or self._stop_words)
            self._hung_up()
            await self._end_controller()
            if stopping:
                self._emergency(f"{EMERGENCY}: the stop was not answered")
            self._show(
                "the daemon ended before it answered" if amid else "The daemon has ended; waiting for it to return."
            )
            await self._seek()

    async def _seek(self) -> None:
        """Find the daemon that runs next. Nothing that was said to the one before is said again by itself."""
        self._why_gone = ""
        while True:
            await asyncio.sleep(SEEK_S)
            try:
                self._link.connect_again()
                break
            except DaemonUnreachableError as gone:
                if not self._why_gone:
                    self._show(str(gone))
                self._why_gone = str(gone)
        await self._connect()
        self._show(AGAIN)

    async def _connect(self) -> None:
        self._reader, self._writer = await asyncio.open_unix_connection(sock=self._link.socket, limit=LONGEST_MESSAGE)
        self._send({"notices": True})

    async def _hear(self) -> None:
        """Everything that this daemon says, until it goes away."""
        try:
            while line := await self._reader.readline():
                await self._heard(json.loads(line))
        except (ConnectionError, ValueError):
            return

    async def _heard(self, message: dict[str, Any]) -> None:
        if "stopping" in message:
            self._wait_anew()
        if "stopped" in message and self._stops:
            self._stops.popleft().cancel()
        for key in ("say", "notice", "stopped"):
            if key in message:
                self._show(str(message[key]))
        if "done" in message:
            self._unanswered.pop(message.get("id", 0), None)
            if (clock := self._stop_words.pop(message.get("id", 0), None)) is not None:
                clock.cancel()
            self._status = int(message["done"]["status"])
            self._show(message["done"]["text"])
        elif "ask" in message:
            self._ask(int(message["id"]), str(message["ask"]))
        elif "unasked" in message and self._asked is not None and self._asked[0] == message["unasked"]:
            self._unask()
        elif "options" in message and self._options:
            self._offer([str(option) for option in message["options"]])
        elif "fetch" in message:
            for piece in file_in_pieces(str(message["fetch"]), self._unanswered.values()):
                self._send(piece)
        elif message.get("terminal") is True:
            await self._begin_controller()
        elif message.get("terminal") is False:
            await self._end_controller()
        elif "show" in message and self._keyboard is not None:
            self._keyboard.show(str(message["show"]))
        self._session.app.invalidate()

    def _ask(self, number: int, question: str) -> None:
        """Put a question in place of the prompt; what was being typed comes back after it."""
        self._asked, self._history.remember = (number, question), False
        if self._session.app.is_running and not self._session.app.is_done:
            self._kept = self._take_line()

    def _unask(self) -> None:
        """It is answered, or no longer asked: it was to stop, or somebody else decided."""
        self._asked, self._history.remember = None, True
        if self._session.app.is_running and not self._session.app.is_done:
            self._take_line()
            self._session.default_buffer.reset(Document(self._take_kept()))

    def _take_line(self) -> str:
        """Take away what stands at the prompt."""
        text = self._session.default_buffer.text
        self._session.default_buffer.reset()
        self._taken += filter(None, [text.removeprefix(self._given_back)])
        self._given_back = ""
        return text

    def _take_kept(self) -> str:
        if self._asked is not None:
            return ""
        self._given_back, self._kept = self._kept, ""
        return self._given_back

    def _show(self, text: str) -> None:
        """Lines above the one being typed, which is drawn again. Keys go on being taken one by one meanwhile."""
        app, renderer = self._session.app, self._session.app.renderer
        above = app.is_running and self._keyboard is None
        if above:
            renderer.erase()
        if text:
            columns = max(self._session.output.get_size().columns, NARROWEST)
            print("\n".join(fold(text, columns)), flush=True)
        if above:
            renderer.reset()
            renderer.request_absolute_cursor_position()
            app.invalidate()

    def _hung_up(self) -> None:
        if self._writer is not None:
            self._writer.close()
        self._writer = None
        self._unanswered.clear()
        for clock in (*self._stops, *self._stop_words.values()):
            clock.cancel()
        self._stops.clear()
        self._stop_words.clear()
        while self._options:
            self._offer([])
        if self._asked is not None:
            self._unask()

    def _send(self, message: dict[str, Any]) -> bool:
        if self._writer is None or self._writer.is_closing():
            return False
        self._writer.write(json.dumps(message).encode() + b"\n")
        return True

    # The controller's own terminal, for a while

    async def _begin_controller(self) -> None:
        shown = asyncio.Event()
        self._left_controller.clear()
        self._at_controller = asyncio.create_task(self._be_at_controller(shown))
        await shown.wait()

    async def _be_at_controller(self, shown: asyncio.Event) -> None:
        loop = asyncio.get_running_loop()

        def send(message: dict[str, Any]) -> None:
            loop.call_soon_threadsafe(self._send, message)

        def stop() -> None:
            loop.call_soon_threadsafe(self._stop)

        async with in_terminal():
            self._keyboard = RawKeyboard(send, stop)
            shown.set()
            await self._left_controller.wait()
            self._keyboard.close()
            self._keyboard = None

    async def _end_controller(self) -> None:
        self._left_controller.set()
        if self._at_controller is not None:
            await self._at_controller
        self._at_controller = None
