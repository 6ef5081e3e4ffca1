"""The prompt of `facetctl console`: messages of the daemon appear above the line being typed, whoever caused them.

A command is sent as soon as it is typed; the daemon runs commands in order, and `stop` at once. A paste of several
lines is sent by Enter; a stop among them is sent without waiting for Enter. Built on prompt_toolkit, for a person at a
terminal only.
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
    """Tab completion: asks the daemon for the choices."""

    def __init__(self, ask: Callable[[str], Awaitable[list[str]]]) -> None:
        self._ask = ask

    def get_completions(self, document: Document, complete_event: CompleteEvent) -> Iterable[Completion]:
        """No completions: this interface cannot wait for the daemon's answer."""
        return ()

    async def get_completions_async(
        self, document: Document, complete_event: CompleteEvent
    ) -> AsyncGenerator[Completion, None]:
        """The last word of each completed line that the daemon offers."""
        typed = document.text_before_cursor
        start = typed.rfind(" ") + 1
        for option in await self._ask(typed):
            end = "" if option.endswith("/") else " "
            yield Completion(f"{option[start:]}{end}", start - len(typed), display=option[start:])


class CommandHistory(History):
    """Commands of earlier sessions, one a line, as a shell keeps them; without answers to questions."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self._path = path
        self.remember = True

    def load_history_strings(self) -> Iterable[str]:
        """Commands, newest first; a file that has grown long is cut."""
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
        """Append a command to the file; where that fails, this session still remembers it."""
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            with open(self._path, "a", encoding="utf-8", opener=open_to_append) as file:
                file.write(f"{string}\n")
        except OSError:
            return


PROMPT = "facetd> "
GREETING = "`help` lists the commands; control-C stops the arm; control-D leaves."
NO_DAEMON = "no daemon answers at present"
RECONNECTED = "Connected again. Check `status`, then repeat the commands that you still need."
RECONNECT_S = 0.5
"""Interval of attempts to reconnect to a daemon that ended."""
ANSWER_COLUMNS = 4
"""Columns kept free behind a question for its answer."""
LONGEST_MESSAGE = 16_000_000
ONE_LINE = "an answer is one line"
LONGEST_PASTE = 200
"""Lines; fewer than one operator may queue in the daemon."""


class ConsolePrompt:
    """The prompt of one operator at a terminal, from the start to control-D or `quit`."""

    def __init__(self, link: DaemonLink) -> None:
        self._link = link
        self._writer: asyncio.StreamWriter | None = None
        self._why_disconnected = ""
        self._numbers = count(1)
        self._unanswered: dict[int, str] = {}
        """Commands without an answer yet, by number."""
        self._stops: deque[asyncio.TimerHandle] = deque()
        """The time limit of each control-C without an answer yet."""
        self._stop_words: dict[int, asyncio.TimerHandle] = {}
        """The time limit of each stop command without an answer yet, by number."""
        self._asked: tuple[int, str] | None = None
        """The open question: its number and text."""
        self._saved_line = ""
        """The line that was being typed when the question came."""
        self._interrupted_input: list[str] = []
        """Parts of the line being typed that questions interrupted: they may contain a stop."""
        self._restored = ""
        """Text that was at the prompt before the question and was put back after it: not typed since."""
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
        # Otherwise Enter waits up to 1 s for the terminal to report its cursor: a stop must not wait.
        self._session.app.renderer.cpr_support = CPR_Support.NOT_SUPPORTED
        self._answering: tuple[int, str] | None = None
        """The question that was open when Enter was pressed: the line answers no later one."""
        buffer = self._session.default_buffer
        accept = buffer.accept_handler
        assert accept is not None

        def ended(of: Buffer) -> bool:
            self._answering = self._asked
            return accept(of)

        buffer.accept_handler = ended
        self._handle_unended_pastes()

    async def run(self) -> int:
        """Prompt until the operator leaves; returns the status of the last answer."""
        asyncio.get_running_loop().add_signal_handler(signal.SIGINT, self._stop)
        self._show(GREETING)
        await self._connect()
        receiving = asyncio.create_task(self._receive_always())
        receiving.add_done_callback(self._receiving_ended)
        try:
            with self._session.input.raw_mode():  # between lines, too: the terminal itself handles no key
                while True:
                    line = await self._session.prompt_async(default=self._take_saved(), handle_sigint=False)
                    if line.strip() in ("quit", "exit") and self._answering is None:
                        return self._status
                    self._typed(line)
        except EOFError:
            return self._status
        finally:
            receiving.cancel()
            self._disconnected()

    def _receiving_ended(self, receiving: asyncio.Task[None]) -> None:
        """End the prompt with the error that ended the receiving task."""
        if not receiving.cancelled() and (error := receiving.exception()) is not None:
            self._session.app.exit(exception=error)

    # Input

    def _prompt(self) -> str:
        if self._asked is not None:
            columns = max(self._session.output.get_size().columns, NARROWEST)
            return "\n".join(fold(self._asked[1], columns - ANSWER_COLUMNS)) + " "
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
        """Handle a paste. A stop in it is sent at once and the rest is dropped. Of several lines, without comments,
        each is a command of its own once Enter is pressed."""
        buffer = self._session.default_buffer
        before, after = buffer.document.text_before_cursor, buffer.document.text_after_cursor
        first, *others = LINE_END.split(before + data + after)
        if ends_in_stop(self._interrupted_input, first.removeprefix(self._restored)) or any(map(means_stop, others)):
            self._saved_line, self._restored = "", ""
            self._interrupted_input.clear()
            buffer.reset()
            self._command("stop")
            if others:
                self._show("The paste contains a stop: the arm is stopped, the rest of the paste is dropped.")
            return
        lines = [line for line in LINE_END.split(data) if line.split("#")[0].strip()]
        if len(lines) < 2:
            buffer.insert_text(lines[0] if lines else "")
        elif self._asked is not None or len(lines) > LONGEST_PASTE:
            most = f"paste {LONGEST_PASTE} at most, or use `facetctl script`" if self._asked is None else ONE_LINE
            self._show(f"The paste of {len(lines)} lines was ignored: {most}.")
        else:
            lines = [line for line in (first, *others) if line.split("#")[0].strip()]
            buffer.reset(Document("\n".join(lines)))
            self._show(
                f"{len(lines)} lines pasted. Enter runs one after the other, up to the first that fails; "
                "control-C drops them."
            )

    def _handle_unended_pastes(self) -> None:
        """End a paste whose end mark was lost: prompt_toolkit would take a control-C for more of it."""
        parser: Any = getattr(self._session.input, "vt100_parser", None)
        if parser is None:
            return
        feed = parser.feed

        def feed_checked(data: str) -> None:
            feed(data)
            begun = parser._paste_buffer if getattr(parser, "_in_bracketed_paste", False) else ""
            *lines, _ = LINE_END.split(begun)
            if "\x03" in begun:
                parser.reset()
                self._stop()
            elif any(map(means_stop, lines)):
                parser.reset()
                self._pasted(begun)

        parser.feed = feed_checked

    def _stop(self) -> None:
        """Stop the arm: control-C, at any moment."""
        self._saved_line = ""
        self._interrupted_input.clear()
        self._session.default_buffer.reset()
        if self._send({"interrupt": True}):
            self._stops.append(self._clock())
        else:
            self._emergency(f"{EMERGENCY}: {self._why_disconnected or NO_DAEMON}")

    def _clock(self) -> asyncio.TimerHandle:
        """A timer that sends the operator to the emergency stop unless it is cancelled in time."""
        return asyncio.get_running_loop().call_later(client.STOP_ANSWER_S, self._emergency, client.UNANSWERED)

    def _restart_clocks(self) -> None:
        """Restart the time limits of all stops: the daemon answers, and waits for the controller."""
        for clock in (*self._stops, *self._stop_words.values()):
            clock.cancel()
        self._stops = deque(self._clock() for _ in self._stops)
        self._stop_words = {number: self._clock() for number in self._stop_words}

    def _emergency(self, text: str) -> None:
        self._status = STOP_UNANSWERED
        self._show(text)

    def _typed(self, line: str) -> None:
        """Send a line to the daemon, as the answer to its question or as a command."""
        if ends_in_stop(self._interrupted_input, line.removeprefix(self._restored)):
            line, self._saved_line = "stop", ""
        self._interrupted_input, self._restored = [], ""
        if self._answering is not None:
            number, _ = self._answering
            if self._asked == self._answering:
                self._end_question()
            sent = self._send({"answer": line, "id": number})
            if withdraws_permission(line):
                self._stops.append(self._clock())
            if withdraws_permission(line) and not sent:
                self._emergency(f"{EMERGENCY}: {self._why_disconnected or NO_DAEMON}")
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
            self._emergency(f"{EMERGENCY}; not sent: {line.strip()}: {self._why_disconnected or NO_DAEMON}")
        else:
            self._show(f"{self._why_disconnected or NO_DAEMON}; not sent: {line.strip()}")

    async def _complete(self, typed: str) -> list[str]:
        """Completions of the line typed so far; file names are those of this machine."""
        if (files := files_begun(typed)) is not None:
            return files
        if self._asked is not None or not self._send({"complete": typed}):
            return []
        self._options.append(asyncio.get_running_loop().create_future())
        return await self._options[-1]

    def _offer(self, options: list[str]) -> None:
        asked = self._options.popleft()
        if not asked.done():  # the operator typed on
            asked.set_result(options)

    # Messages from the daemon

    async def _receive_always(self) -> None:
        while True:
            await self._receive()
            unfinished, stopping = bool(self._unanswered), bool(self._stops or self._stop_words)
            self._disconnected()
            await self._end_controller()
            if stopping:
                self._emergency(f"{EMERGENCY}: the stop was not answered")
            self._show("the daemon ended before it answered" if unfinished else "The daemon ended; waiting for it.")
            await self._reconnect()

    async def _reconnect(self) -> None:
        """Reconnect to the next daemon. Nothing that was sent to the previous one is repeated by itself."""
        self._why_disconnected = ""
        while True:
            await asyncio.sleep(RECONNECT_S)
            try:
                self._link.reconnect()
                break
            except DaemonUnreachableError as error:
                if not self._why_disconnected:
                    self._show(str(error))
                self._why_disconnected = str(error)
        await self._connect()
        self._show(RECONNECTED)

    async def _connect(self) -> None:
        self._reader, self._writer = await asyncio.open_unix_connection(sock=self._link.socket, limit=LONGEST_MESSAGE)
        self._send({"notices": True})

    async def _receive(self) -> None:
        """Handle messages of this daemon until it disconnects."""
        try:
            while line := await self._reader.readline():
                await self._handle(json.loads(line))
        except (ConnectionError, ValueError):
            return

    async def _handle(self, message: dict[str, Any]) -> None:
        if "stopping" in message:
            self._restart_clocks()
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
            self._end_question()
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
        """Show a question in place of the prompt; the line being typed comes back after it."""
        self._asked, self._history.remember = (number, question), False
        if self._session.app.is_running and not self._session.app.is_done:
            self._saved_line = self._take_line()

    def _end_question(self) -> None:
        """End the question: it was answered, the answer was a stop, or somebody else decided."""
        self._asked, self._history.remember = None, True
        if self._session.app.is_running and not self._session.app.is_done:
            self._take_line()
            self._session.default_buffer.reset(Document(self._take_saved()))

    def _take_line(self) -> str:
        """Remove the text at the prompt and return it."""
        text = self._session.default_buffer.text
        self._session.default_buffer.reset()
        self._interrupted_input += filter(None, [text.removeprefix(self._restored)])
        self._restored = ""
        return text

    def _take_saved(self) -> str:
        if self._asked is not None:
            return ""
        self._restored, self._saved_line = self._saved_line, ""
        return self._restored

    def _show(self, text: str) -> None:
        """Print lines above the line being typed and draw that again; keys still come one by one."""
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

    def _disconnected(self) -> None:
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
            self._end_question()

    def _send(self, message: dict[str, Any]) -> bool:
        if self._writer is None or self._writer.is_closing():
            return False
        self._writer.write(json.dumps(message).encode() + b"\n")
        return True

    # The controller's own terminal

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
