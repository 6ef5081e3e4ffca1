"""The two frontends for real: a unix socket with the operator's own client, and a serial terminal on a pty."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import json
import os
import pty
import select
import socket
import stat
import termios
import time
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any
from unittest.mock import AsyncMock, MagicMock, Mock

import pytest

from daemon.commands import every_command
from daemon.config import ConsoleSettings, SerialTerminalSettings
from daemon.console.interpreter import CommandResult, ConsoleCommand, Interpreter
from daemon.errors import CommandError
from daemon.frontends.client import DaemonLink, DaemonUnreachableError
from daemon.frontends.command_queue import MOST_WAITING, Interrupt
from daemon.frontends.line_editor import CLEAR_TO_END
from daemon.frontends.rights import FrontendError, Rights
from daemon.frontends.serial_terminal import SerialFrontend
from daemon.frontends.socket_server import (
    FIRST_MESSAGE_S,
    IDLE_S,
    MOST_EACH,
    MOST_TO_STOP,
    MOST_TOGETHER,
    STOP_S,
    SocketFrontend,
    SocketServer,
)
from daemon.store.folders import HOUSE
from tests.fakes.fake_context import fake_context
from tests.fakes.waiting import PATIENCE_S, until, until_so

EVERYBODY = Rights(ConsoleSettings())


def interrupter(context: Any) -> Callable[[str, bool], Awaitable[str]]:
    async def interrupt(who: str, about_to_move: bool) -> str:
        if context.cycle.doing is None and not about_to_move:
            return "Nothing moves."
        await context.cycle.supervisor.stop(f"by control-C of {who}")
        return "Stopped."

    return interrupt


def with_socket(
    path: Path, use: Callable[[Path], Any], commands: list[ConsoleCommand] | None = None
) -> tuple[Any, Any]:
    """Serve a socket while `use(path)` runs in a thread; its result and the context. Nothing may go wrong unheard."""
    context = fake_context(path.parent)
    unheard: list[dict[str, Any]] = []

    async def serve() -> Any:
        asyncio.get_running_loop().set_exception_handler(lambda _, what: unheard.append(what))
        server = SocketServer(path, EVERYBODY, Interpreter(context, commands or every_command()), interrupter(context))
        await server.open()
        try:
            return await asyncio.wait_for(asyncio.to_thread(use, path), PATIENCE_S)
        finally:
            await server.close()

    found = asyncio.run(serve())
    assert unheard == []
    return found, context


def test_a_command_over_the_socket_is_answered_and_the_kernel_says_who_it_was(tmp_path: Path) -> None:
    def use(path: Path) -> Any:
        assert stat.S_IMODE(path.stat().st_mode) == 0o660
        with DaemonLink(path) as link:
            enabled, unknown = link.do("enable", "one-shot", print), link.do("flurb", "one-shot", print)
        return enabled, speak(path, b'{"complete": "sta"}\n')[0]["options"], unknown

    (enabled, options, unknown), context = with_socket(tmp_path / "s", use)
    assert enabled["status"] == 0
    assert options == ["status"]
    assert unknown["status"] == 2
    (_, said), *_ = context.log.records
    assert f"(process {os.getpid()})" in said["who"]
    assert not (tmp_path / "s").exists(), "the path is free again"


def test_a_question_travels_to_the_operator_and_the_answer_back(tmp_path: Path) -> None:
    asked = []

    def answer(question: str) -> str:
        asked.append(question)
        return "n"

    def use(path: Path) -> Any:
        with DaemonLink(path) as link:
            return link.do("forget cube", "console", print, answer)

    done, _ = with_socket(tmp_path / "s", use)
    assert asked == ["Delete all views of cube permanently? [y/n]"]
    assert done["status"] == 1


def test_a_drawing_whose_name_is_no_utf8_is_fetched_and_taught(tmp_path: Path) -> None:
    drawing = os.fsencode(tmp_path) + b"/b\xff.obj"
    Path(os.fsdecode(drawing)).write_bytes((HOUSE / "docs" / "bracket.obj").read_bytes())

    async def show(context: Any, words: list[str], frontend: Any) -> CommandResult:
        content = await frontend.fetch(words[0])
        return CommandResult(f"{words[0]}: {len(content)} bytes")

    command = ConsoleCommand("show", "show FILE", "", show, "change", most=1)

    def use(path: Path) -> Any:
        with DaemonLink(path) as link:
            return link.do(f"show {os.fsdecode(drawing)}", "one-shot", print)

    done, _ = with_socket(tmp_path / "s", use, [command])
    assert done["status"] == 0, done
    assert f"{(HOUSE / 'docs' / 'bracket.obj').stat().st_size} bytes" in done["text"]


def speak(path: Path, *lines: bytes) -> list[dict[str, Any]]:
    with socket.socket(socket.AF_UNIX) as raw:
        raw.settimeout(10)
        raw.connect(str(path))
        raw.sendall(b"".join(lines))
        answers = []
        with raw.makefile("rb") as file:
            for _ in lines:
                line = file.readline()
                if not line:
                    break
                answers.append(json.loads(line))
        return answers


def test_an_answer_that_does_not_say_to_which_question_answers_none(tmp_path: Path) -> None:
    """It may have been typed before this one was shown."""

    def use(path: Path) -> list[dict[str, Any]]:
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as line, line.makefile("rwb") as file:
            line.connect(str(path))
            file.write(b'{"do": "forget cube", "asks": true}\n')
            file.flush()
            asked = json.loads(file.readline())
            number = json.dumps(asked["id"]).encode()
            file.write(b'{"answer": "y"}\n{"answer": "y", "id": null}\n{"answer": "n", "id": ' + number + b"}\n")
            file.flush()
            return [asked, *(json.loads(file.readline()) for _ in range(2))]

    answers, _ = with_socket(tmp_path / "s", use)
    assert [*answers[0], *answers[1], *answers[2]] == ["ask", "id", "unasked", "done"]
    assert answers[2]["done"]["status"] != 0


def test_a_command_that_leaves_a_question_is_done_there_and_the_question_put_again(tmp_path: Path) -> None:
    """With its number: what was typed before this question was shown confirms nothing either."""

    def use(path: Path) -> list[dict[str, Any]]:
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as line, line.makefile("rwb") as file:
            line.connect(str(path))
            file.write(b'{"do": "forget cube", "asks": true}\n')
            file.flush()
            heard = [json.loads(file.readline())]
            number = heard[0]["id"]
            file.write(b'{"answer": "status"}\n' + json.dumps({"answer": "status", "id": number}).encode() + b"\n")
            file.flush()
            heard += [json.loads(file.readline()) for _ in range(2)]
            file.write(json.dumps({"answer": "n", "id": heard[-1]["id"]}).encode() + b"\n")
            file.flush()
            return [*heard, *(json.loads(file.readline()) for _ in range(2))]

    heard, _ = with_socket(tmp_path / "s", use)
    assert [next(iter(message)) for message in heard] == ["ask", "say", "ask", "unasked", "done"]
    assert heard[2]["ask"] == heard[0]["ask"]
    assert "picked" in heard[1]["say"]


@pytest.mark.parametrize(
    "line",
    [b"status\n", b"[]\n", b"{}\n", b'{"do": "status"\n', b"\xff\xfe\n", b'{"do": {"a": 1}}\n', b'{"answer": "y"}\n'],
)
def test_what_is_no_message_is_answered_so_and_the_daemon_goes_on(tmp_path: Path, line: bytes) -> None:
    def use(path: Path) -> Any:
        return (
            speak(path, line, b'{"do": "status"}\n')
            if line != b'{"answer": "y"}\n'
            else speak(path, b'{"do": "status"}\n')
        )

    answers, _ = with_socket(tmp_path / "s", use)
    assert answers[-1]["done"]["status"] == 0


def test_a_message_without_end_is_refused(tmp_path: Path) -> None:
    (answer,), _ = with_socket(tmp_path / "s", lambda path: speak(path, b"x" * 200_000 + b"\n"))
    assert "too long" in answer["done"]["text"]
    assert answer["done"]["status"] == 2


@pytest.mark.parametrize("stop", ["stop", "jog z 2stop"])
def test_stop_is_heard_while_another_command_is_being_done_and_a_second_move_is_not(tmp_path: Path, stop: str) -> None:
    def use(path: Path) -> Any:
        with socket.socket(socket.AF_UNIX) as raw, raw.makefile("rwb") as file:
            raw.connect(str(path))
            answers = []
            for text in ("go home", "pick cube", stop):
                file.write(json.dumps({"do": text}).encode() + b"\n")
                file.flush()
                if text == "go home":
                    until(lambda: context.cycle.doing is not None)
                if text == "pick cube":
                    answers.append(json.loads(file.readline())["done"])
            answers += [json.loads(file.readline())["done"] for _ in range(2)]
            return answers

    context = fake_context(tmp_path)
    context.cycle.slow = True

    async def serve() -> Any:
        server = SocketServer(tmp_path / "s", EVERYBODY, Interpreter(context, every_command()), interrupter(context))
        await server.open()
        answers = await asyncio.to_thread(use, tmp_path / "s")
        await server.close()
        return answers

    refused, stopped, ended = asyncio.run(serve())
    assert "still running" in refused["text"]
    assert stopped["text"].startswith("Stopped")
    assert ended["text"] == "At home."
    assert context.cycle.told[0] == "go home"
    assert context.cycle.told[1].startswith("stop by")


def test_a_daemon_that_lives_keeps_its_socket_and_a_dead_ones_is_taken_over(tmp_path: Path) -> None:
    path = tmp_path / "s"
    with socket.socket(socket.AF_UNIX) as dead:
        dead.bind(str(path))

    async def two() -> None:
        context = fake_context(tmp_path)
        first, second = (
            SocketServer(path, EVERYBODY, Interpreter(context, []), interrupter(context)) for _ in range(2)
        )
        await first.open()
        with pytest.raises(FrontendError, match="another facetd answers there"):
            await second.open()
        await first.close()
        await second.open()
        await second.close()

    asyncio.run(two())


def test_a_socket_that_cannot_be_is_one_line(tmp_path: Path) -> None:
    async def open_at(path: Path, group: str | None = None) -> None:
        await SocketServer(
            path, Rights(ConsoleSettings(group=group)), Interpreter(fake_context(tmp_path), []), interrupter(None)
        ).open()

    with pytest.raises(FrontendError, match="too long for a socket's path"):
        asyncio.run(open_at(tmp_path / ("x" * 120)))
    with pytest.raises(FrontendError, match="no group 'nosuchgroup'"):
        asyncio.run(open_at(tmp_path / "s", "nosuchgroup"))
    (tmp_path / "file").write_text("")
    with pytest.raises(FrontendError, match="cannot listen here"):
        asyncio.run(open_at(tmp_path / "file" / "s"))


def test_without_a_daemon_the_tool_says_where_it_sought_and_what_to_do(tmp_path: Path) -> None:
    with pytest.raises(DaemonUnreachableError, match=r"no daemon answers at .*none.*; start it"):
        DaemonLink(tmp_path / "none")


class Terminals:
    """A person at a VT100 on the other end of a pty."""

    def __init__(self, settings: dict[str, Any] | None = None) -> None:
        self.person, daemon = pty.openpty()
        self.device = os.ttyname(daemon)
        self.daemon = daemon
        """Its end of the line."""
        os.set_blocking(self.person, False)
        self.settings = SerialTerminalSettings(device=self.device, **(settings or {}))
        self.shown = ""
        self.cycle: Any = None

    def hang_up(self) -> None:
        os.close(self.daemon)
        os.close(self.person)

    async def type(self, text: bytes) -> None:
        for byte in text:
            os.write(self.person, bytes([byte]))
            await asyncio.sleep(0.002)  # a key at a time: who types is slower than the line

    async def sees(self, text: str) -> str:
        """Wait until text appears; give what appeared up to its end, and forget it."""

        def appeared() -> bool:
            with contextlib.suppress(BlockingIOError):
                heard = os.read(self.person, 4096).decode()
                self.shown = (self.shown + heard).replace(CLEAR_TO_END.decode(), "")  # a screen shows none of it
            return text in self.shown

        await until_so(appeared, f"{text!r}")
        before, _, self.shown = self.shown.partition(text)
        return before + text


def at_a_terminal(
    play: Callable[[Terminals, SerialFrontend], Awaitable[None]],
    settings: dict[str, Any] | None = None,
    slow: bool = False,
) -> Any:
    """Let a person play at a serial console; gives the context."""
    context = fake_context(Path("/nonexistent"))
    context.cycle.slow = slow
    terminal = Terminals(settings)
    terminal.cycle, context.heard = context.cycle, []

    async def run() -> None:
        console = SerialFrontend(
            terminal.settings, Interpreter(context, every_command()), interrupter(context), context.heard.append
        )
        task = asyncio.create_task(console.run())
        try:
            await asyncio.wait_for(play(terminal, console), PATIENCE_S)
        finally:
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)

    try:
        asyncio.run(run())
    finally:
        terminal.hang_up()
    return context


def test_a_person_types_mistypes_and_is_answered_at_9600_baud() -> None:
    async def play(terminal: Terminals, _: SerialFrontend) -> None:
        await terminal.sees("control-C stops the arm.\r\n\rfacetd> ")
        await terminal.type(b"statsu\x7f\x7f")
        await terminal.type(b"us\r")
        answer = await terminal.sees("facetd> ")
        assert "2 of 3 picked" in answer
        assert all(len(line) < 80 for line in answer.split("\r\n"))
        await terminal.type(b"\x1b[A\r")
        assert "2 of 3 picked" in await terminal.sees("picked")
        await terminal.type(b"pick kube\r")
        await terminal.sees("kube: no such taught part; did you mean cube?\r\n")
        assert termios.tcgetattr(terminal.daemon)[4] == termios.B9600

    at_a_terminal(play)


def test_control_c_stops_the_arm_while_a_command_is_being_done() -> None:
    async def play(terminal: Terminals, _: SerialFrontend) -> None:
        await terminal.sees("facetd> ")
        await terminal.type(b"go home\r")
        # It has the line before the next is read, and is begun when it may.
        await until_so(lambda: terminal.cycle.doing == "home")
        await terminal.type(b"status\rgo bin\r")
        await terminal.sees("doing     home")
        await terminal.type(b"\x03")
        await terminal.sees("Stopped.")
        await terminal.type(b"status\r")
        assert "STOPPED by control-C of operator at" in await terminal.sees("doing     nothing")

    context = at_a_terminal(play, slow=True)
    assert [t.split(" by")[0] for t in context.cycle.told] == ["go home", "stop"], "what was typed ahead is dropped"


def test_lines_without_end_at_a_terminal_that_is_busy_are_not_kept_without_end() -> None:
    """A line that floats types for hours while a pick waits for a yes; a stop is heard all the same."""

    async def play(terminal: Terminals, console: SerialFrontend) -> None:
        await terminal.sees("facetd> ")
        await terminal.type(b"go home\r")
        await terminal.sees("go home\r\n")  # it was heard
        for _ in range(2 * MOST_WAITING):
            console._handle("go bin")
        assert len(console._queue._waiting) == MOST_WAITING
        await terminal.sees("too many commands are waiting; wait for their answers")
        console._handle("stop")
        await terminal.sees("Stopped")
        assert not console._queue._waiting

    context = at_a_terminal(play, slow=True)
    assert [t.split(" by")[0] for t in context.cycle.told] == ["go home", "stop"]


def test_questions_are_put_and_answered_on_the_terminal() -> None:
    async def play(terminal: Terminals, _: SerialFrontend) -> None:
        await terminal.sees("facetd> ")
        await terminal.type(b"forget cube\r")
        await terminal.sees("Delete all views of cube permanently? [y/n]\r\n")
        await terminal.sees("? ")
        await terminal.type(b"n\r")
        await terminal.sees("Nothing was removed.")
        await terminal.type(b"\x1b[A")
        await terminal.sees("forget cube")

    at_a_terminal(play)


def test_a_notice_does_not_spoil_the_line_being_typed() -> None:
    async def play(terminal: Terminals, console: SerialFrontend) -> None:
        await terminal.sees("facetd> ")
        await terminal.type(b"sta")
        await terminal.sees("sta")
        console.notice("TROUBLE cameras: unplugged")
        await terminal.sees("TROUBLE cameras: unplugged\r\n\rfacetd> sta")
        await terminal.type(b"tus\r")
        await terminal.sees("2 of 3 picked")

    at_a_terminal(play)


def test_a_line_that_was_typed_before_a_question_is_shown_and_read_after_it_answers_nothing() -> None:
    """The daemon had no time to read for a moment: what had been typed at something else confirmed a move."""

    async def play(terminal: Terminals, console: SerialFrontend) -> None:
        await terminal.sees("facetd> ")
        asking = asyncio.ensure_future(console.ask("Send it?"))
        os.write(terminal.person, b"\ry\r")
        select.select([terminal.daemon], [], [])
        await terminal.sees("Send it?")
        await terminal.type(b"n\r")
        assert await asking == "n"

    at_a_terminal(play)


@pytest.mark.parametrize(("begun", "ended"), [(b"st", b"op\r"), (b"stop", b"\r"), (b"go bin\rstop", b"!\r")])
def test_a_stop_that_a_question_came_amid_is_heard(begun: bytes, ended: bytes) -> None:
    """What was typed by then was taken away, as no answer; what was left of the word was none, and no stop either."""

    async def play(terminal: Terminals, console: SerialFrontend) -> None:
        await terminal.sees("facetd> ")
        await terminal.type(begun)
        await terminal.sees(begun.decode()[-4:])
        asking = asyncio.ensure_future(console.ask("Send it?"))
        await terminal.sees("Send it?")
        await terminal.type(ended)
        assert await asking == ""
        await terminal.sees("Stopped")

    assert any(told.startswith("stop") for told in at_a_terminal(play).cycle.told)


def test_a_terminal_that_may_only_look_stops_the_arm_but_does_not_move_it() -> None:
    async def play(terminal: Terminals, _: SerialFrontend) -> None:
        await terminal.sees("facetd> ")
        await terminal.type(b"go home\r")
        await terminal.sees("this terminal is read-only")
        await terminal.type(b"stop\r")
        await terminal.sees("Stopped")

    context = at_a_terminal(play, {"may": "look"})
    assert [t.split(" by")[0] for t in context.cycle.told] == ["stop"]


def test_a_port_that_is_not_there_is_told_and_tried_again(tmp_path: Path) -> None:
    heard: list[str | None] = []

    async def run() -> None:
        settings = SerialTerminalSettings(device=str(tmp_path / "none"))
        context = fake_context(tmp_path)
        console = SerialFrontend(settings, Interpreter(context, []), interrupter(context), heard.append)
        task = asyncio.create_task(console.run())
        await until_so(lambda: heard, "a word of the missing port")
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)

    asyncio.run(run())
    assert heard == [f"console.tty: {tmp_path / 'none'}: no such port; is the adapter plugged in?"]


def test_a_terminal_pulled_out_just_as_it_is_opened_is_told_and_tried_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The kernel refuses what is set then with an error that is neither pyserial's nor the system's."""
    heard: list[str | None] = []
    far, near = os.openpty()

    def gone(*_: object) -> None:
        raise termios.error(errno.EIO, os.strerror(errno.EIO))

    async def run() -> None:
        context = fake_context(tmp_path)
        settings = SerialTerminalSettings(device=os.ttyname(near))
        console = SerialFrontend(settings, Interpreter(context, []), interrupter(context), heard.append)
        task = asyncio.create_task(console.run())
        await until_so(lambda: heard, "a word of the terminal that is gone")
        assert not task.done()
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)

    monkeypatch.setattr(termios, "tcflush", gone)
    try:
        asyncio.run(run())
    finally:
        os.close(far)
        os.close(near)
    assert len(heard) == 1
    assert "Input/output error" in str(heard[0])


def test_a_terminal_that_reads_nothing_does_not_hold_up_the_daemon() -> None:
    async def play(terminal: Terminals, console: SerialFrontend) -> None:
        await terminal.sees("facetd> ")
        await terminal.type(b"go home\r")
        await until_so(lambda: terminal.cycle.doing)
        for _ in range(2000):
            console.notice("x" * 70)
        await terminal.type(b"\x03")
        await until_so(lambda: terminal.cycle.stops, "the stop")

    at_a_terminal(play, slow=True)


SLOW = b'{"do": "go home"}\n'
HASTE = [
    b'{"do": "sto"}', b'{"do": "STOP!"}', b'{"do": "stop \'"}', b'{"do": "stop\xff"}', b'{"do": "st\x00op"}',
    b'{"do": "stop\\ud800", "door": "\\ud800\\u0007"}', b'{"do": "stop", "door": "' + b"x" * 1000 + b'"}',
    b'{"answer": "stop", "id": 77}', b'{"do": "halt', b"stop", b"stop\xfc", b'{"interrupt": true}',
    b'{"do": "status", "interrupt": true}', b'{"keys": "abc\\u0003"}', b'{"do": ["stop"]}', b'{"stop": true}',
]  # fmt: skip


@pytest.mark.parametrize("line", HASTE)
def test_a_stop_is_heard_over_the_socket_however_it_comes_while_something_moves(tmp_path: Path, line: bytes) -> None:
    """Also at a frontend whose name cannot be written down, and where nothing can be logged."""
    context = fake_context(tmp_path)
    context.cycle.slow = True

    async def serve() -> None:
        server = SocketServer(tmp_path / "s", EVERYBODY, Interpreter(context, every_command()), interrupter(context))
        await server.open()
        reader, writer = await asyncio.open_unix_connection(str(tmp_path / "s"))
        writer.write(b'{"do": "holding no", "door": "\\ud800\\u0007"}\n')
        await reader.readline()
        writer.write(SLOW)
        await until_so(lambda: context.cycle.doing is not None)

        def full(*_: object, **__: object) -> None:
            raise OSError(28, "No space left on device")

        context.log.record = full
        writer.write(line + b"\n")
        await until_so(lambda: context.cycle.doing is None)
        writer.close()
        await server.close()

    asyncio.run(asyncio.wait_for(serve(), PATIENCE_S))
    assert [told[:7] for told in context.cycle.told] == ["go home", "stop by"]


@pytest.mark.parametrize("line", [b'{"do": "disable"}', b'{"answer": "disable", "id": 77}', b'{"answer": "DISA"}'])
def test_the_leave_to_move_is_taken_also_by_what_was_to_answer_a_question(tmp_path: Path, line: bytes) -> None:
    context = fake_context(tmp_path)
    context.cycle.slow = True

    def use(path: Path) -> None:
        with socket.socket(socket.AF_UNIX) as frontend:
            frontend.settimeout(5)
            frontend.connect(str(path))
            frontend.sendall(SLOW)
            until(lambda: context.cycle.doing is not None)
            frontend.sendall(line + b"\n")
            assert b"The arm is disabled" in frontend.recv(4096)

    listening(tmp_path, use, context=context)
    assert context.cycle.told == ["go home", "disable"]


def listening(folder: Path, use: Callable[[Path], Any], rights: Rights = EVERYBODY, context: Any = None) -> Any:
    """What a client in a thread made of a server with all commands."""
    context = context or fake_context(folder)

    async def serve() -> Any:
        server = SocketServer(folder / "s", rights, Interpreter(context, every_command()), interrupter(context))
        await server.open()
        try:
            return await asyncio.to_thread(use, folder / "s")
        finally:
            await server.close()

    return asyncio.run(serve())


def said(path: Path, line: bytes) -> dict[str, Any]:
    """One line said on a connection of its own, and the first that is answered."""
    with socket.socket(socket.AF_UNIX) as connection:
        connection.connect(str(path))
        connection.settimeout(10)
        connection.sendall(line + b"\n")
        answer: dict[str, Any] = json.loads(connection.makefile("rb").readline())
        return answer


def test_a_thousand_idle_clients_keep_nobody_from_a_stop(tmp_path: Path) -> None:
    context = fake_context(tmp_path)

    def use(path: Path) -> Any:
        crowd, before = [], len(os.listdir("/proc/self/fd"))
        for _ in range(400):
            one = socket.socket(socket.AF_UNIX)
            one.connect(str(path))
            crowd.append(one)
        told = [said(path, line) for line in (b'{"do": "status"}', b'{"do": "stop"}', b'{"interrupt": true}')]
        open_now = len(os.listdir("/proc/self/fd")) - len(crowd) - before
        for one in crowd:
            one.close()
        return told, open_now

    (refused, stopped, interrupted), open_now = listening(tmp_path, use, context=context)
    assert (refused["done"]["status"], "too many connections" in refused["done"]["text"]) == (1, True)
    assert stopped["done"]["status"] == 0
    assert interrupted["stopped"] == "Nothing moves."
    assert [what for what in context.cycle.told if what.startswith("stop")]
    assert open_now <= MOST_EACH + MOST_TO_STOP + 3, "the daemon holds no more than it has room for"


def test_who_is_silent_is_hung_up_and_who_waits_for_notices_is_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("daemon.frontends.socket_server.FIRST_MESSAGE_S", 0.05)
    monkeypatch.setattr("daemon.frontends.socket_server.IDLE_S", 0.05)

    def use(path: Path) -> Any:
        ends = []
        for first in (b"", b'{"do": "help stop"}\n', b'{"notices": true}\n'):
            with socket.socket(socket.AF_UNIX) as one:
                one.connect(str(path))
                one.sendall(first)
                one.settimeout(0.5)
                try:
                    while one.recv(65536):
                        pass
                    ends.append("hung up")
                except TimeoutError:
                    ends.append("stays")
        return ends

    assert listening(tmp_path, use) == ["hung up", "hung up", "stays"]


@pytest.mark.parametrize(
    "line",
    [b"[" * 60_000, b'{"x":' * 10_000, b'{"do": ' + b"[" * 50_000, b'{"do": 7}', b'{"keys": {}}', b'"x"', b"\xff\xfe"],
)
def test_whatever_a_line_holds_it_is_answered_and_the_next_one_is_heard(tmp_path: Path, line: bytes) -> None:
    def use(path: Path) -> Any:
        with socket.socket(socket.AF_UNIX) as connection:
            connection.settimeout(10)
            connection.connect(str(path))
            connection.sendall(line + b'\n{"do": "help stop"}\n')
            answers = connection.makefile("rb")
            return [json.loads(answers.readline())["done"] for _ in range(2)]

    refused, helped = listening(tmp_path, use)
    assert (refused["status"], refused["text"][:13]) == (2, "not a message")
    assert helped["status"] == 0


def test_what_would_steer_a_terminal_is_shown_and_not_obeyed(tmp_path: Path) -> None:
    evil = "\x1b]0;title\x07\x1b[2J\x9b2J\u202e"
    answer = listening(tmp_path, lambda path: said(path, json.dumps({"do": f"{evil} x", "door": evil}).encode()))
    assert not set(answer["done"]["text"]) & set(evil[0] + "\x07\x9b\u202e")


def test_an_operator_who_reads_nothing_and_asks_for_ever_is_hung_up(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("daemon.frontends.socket_server.MOST_BACKLOG", 100_000)

    def use(path: Path) -> Any:
        with socket.socket(socket.AF_UNIX) as connection:
            connection.settimeout(10)
            connection.connect(str(path))
            try:
                for _ in range(20_000):
                    connection.sendall(b'{"do": "status"}\n{"complete": ""}\n')
            except (BrokenPipeError, ConnectionResetError):
                return "hung up"
        return "heard for ever"

    assert listening(tmp_path, use) == "hung up"


def test_a_socket_of_the_daemon_s_own_group_is_given_to_nobody(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The unit's filter of system calls refuses chown, whatever it would change."""

    def refused(*_: object) -> None:
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr("daemon.frontends.socket_server.os.chown", refused)
    assert listening(tmp_path, lambda path: said(path, b'{"do": "status"}'))["done"]["status"] == 0


def asked(path: Path, *messages: dict[str, Any], answers: int) -> list[dict[str, Any]]:
    """Say some things at once; so many lines of what comes back."""
    with socket.socket(socket.AF_UNIX) as raw, raw.makefile("rb") as file:
        raw.settimeout(10)
        raw.connect(str(path))
        raw.sendall(b"".join(json.dumps(message).encode() + b"\n" for message in messages))
        return [json.loads(file.readline()) for _ in range(answers)]


def test_a_frontend_s_name_is_cut_to_twenty_plain_characters_and_kept(tmp_path: Path) -> None:
    name = "a\nb" + "x" * 40
    said = ({"do": "enable", "door": name}, {"do": "disable"})
    _, context = with_socket(
        tmp_path / "s", lambda path: [asked(path, said[0], answers=1), asked(path, *said, answers=2)]
    )
    frontends = [record["door"] for kind, record in context.log.records if kind == "command"]
    assert len(frontends) == 3
    assert {frontend[-17:] for frontend in frontends} == {"x" * 17}
    assert {"\n" in frontend or len(frontend) > 20 for frontend in frontends} == {False}


def test_each_answer_has_the_number_of_its_question_and_only_where_there_was_one(tmp_path: Path) -> None:
    answers, _ = with_socket(tmp_path / "s", lambda path: [
        *asked(path, {"do": "status", "id": 7}, answers=1), *asked(path, {"do": "status", "id": None}, answers=1),
        *asked(path, {"do": "status"}, answers=1)])  # fmt: skip
    assert [answer.get("id", "none") for answer in answers] == [7, None, "none"]
    assert [set(answer["done"]) for answer in answers] == [{"text", "data", "status"}] * 3


def test_notices_go_to_those_who_listen_once_each_and_a_stop_s_answer_too(tmp_path: Path) -> None:
    context = fake_context(tmp_path)

    def use(path: Path) -> Any:
        with socket.socket(socket.AF_UNIX) as deaf, socket.socket(socket.AF_UNIX) as hears:
            for one, lines in ((deaf, b""), (hears, b'{"notices": true}\n' * 2)):
                one.connect(str(path))
                one.sendall(lines + b'{"complete": "sta"}\n')
                assert one.recv(65536).startswith(b'{"options"')
            context.loop.call_soon_threadsafe(context.notices.tell, "first")
            context.loop.call_soon_threadsafe(context.notices.tell, "second")
            heard = hears.makefile("rb")
            told = [json.loads(heard.readline()) for _ in range(2)]
            for one in (deaf, hears):
                one.sendall(b'{"interrupt": true}\n')
            return told, deaf.recv(65536), heard.readline()

    async def serve() -> Any:
        context.loop = asyncio.get_running_loop()
        server = SocketServer(tmp_path / "s", EVERYBODY, Interpreter(context, every_command()), interrupter(context))
        await server.open()
        try:
            return await asyncio.to_thread(use, tmp_path / "s")
        finally:
            await server.close()

    told, deaf, heard = asyncio.run(serve())
    assert told == [{"notice": "first"}, {"notice": "second"}]
    assert json.loads(deaf) == json.loads(heard) == {"stopped": "Nothing moves."}


def test_keys_and_what_is_shown_pass_while_a_terminal_is_open(tmp_path: Path) -> None:
    typed: list[bytes] = []

    async def monitor(_: Any, __: list[str], frontend: Any) -> CommandResult:
        def keys(data: bytes) -> None:
            typed.append(data)
            frontend.show(data.upper())

        await frontend.terminal(keys)
        return CommandResult("back")

    def use(path: Path) -> Any:
        with socket.socket(socket.AF_UNIX) as raw, raw.makefile("rwb") as file:
            raw.settimeout(10)
            raw.connect(str(path))

            def say(**message: Any) -> None:
                file.write(json.dumps(message).encode() + b"\n")
                file.flush()

            def next_of(kind: str) -> Any:
                while kind not in (message := json.loads(file.readline())):
                    continue
                return message[kind]

            say(do="monitor", asks=False)
            refused = next_of("done")["status"]
            say(keys="lost")
            say(do="monitor", asks=True)
            began = next_of("terminal")
            say(keys="xy\u0144")
            shown = next_of("show")
            say(leave=True)
            ended, done = next_of("terminal"), next_of("done")["text"]
            say(keys="late")
            say(do="monitor", asks=False)
            return refused, began, shown, ended, done, next_of("done")["status"]

    commands = [*every_command(), ConsoleCommand("monitor", "monitor", "", monitor)]
    found, _ = with_socket(tmp_path / "s", use, commands)
    assert found == (2, True, "XY?", False, "back", 2)
    assert typed == [b"xy?"]


def test_who_has_typed_too_far_ahead_is_refused_all_but_a_stop(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("daemon.frontends.command_queue.MOST_WAITING", 0)
    (refused, stopped), context = with_socket(
        tmp_path / "s", lambda path: asked(path, {"do": "enable"}, {"do": "stop"}, answers=2)
    )
    assert "too many commands are waiting; wait for their answers" in refused["done"]["text"]
    assert stopped["done"]["status"] == 0
    assert [told for told in context.cycle.told if told.startswith("stop")]


def test_who_says_all_and_then_only_hears_is_answered(tmp_path: Path) -> None:
    """`echo ... | nc -U -N`: the end of what it says is not its end."""

    def use(path: Path) -> list[Any]:
        with socket.socket(socket.AF_UNIX) as raw:
            raw.settimeout(10)
            raw.connect(str(path))
            raw.sendall(b'{"do": "enable"}\n{"do": "enable", "waits": true}\n')
            raw.shutdown(socket.SHUT_WR)
            with raw.makefile("rb") as file:
                return [json.loads(line) for line in file]

    answers, _ = with_socket(tmp_path / "s", use)
    assert [answer["done"]["status"] for answer in answers if "done" in answer] == [0, 0]


def test_a_command_of_many_lines_is_none_unless_a_stop_is_among_them(tmp_path: Path) -> None:
    """Joined, `status # x` and `stop` had dropped the stop in silence."""
    (refused, stopped), context = with_socket(
        tmp_path / "s",
        lambda path: asked(path, {"do": "enable\nwhere"}, {"do": "status # x\nstop"}, answers=2),
    )
    assert "a command is one line" in refused["done"]["text"]
    assert stopped["done"]["status"] == 0
    assert [told.split(" by")[0] for told in context.cycle.told] == ["stop"]


@pytest.mark.parametrize(("length", "opens"), [(100, True), (101, False)])
def test_a_socket_s_path_may_have_a_hundred_bytes(
    length: int, opens: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)

    async def story() -> None:
        server = SocketServer(Path("s" * length), EVERYBODY, Interpreter(fake_context(tmp_path), []), interrupter(None))
        await server.open()
        await server.close()

    if opens:
        asyncio.run(story())
    else:
        with pytest.raises(FrontendError, match=r"too long for a socket's path; set folders\.runtime"):
            asyncio.run(story())


def test_what_lies_where_the_socket_goes_and_is_none_is_somebodys(tmp_path: Path) -> None:
    path = tmp_path / "s"
    path.write_text("a person's own")

    async def come() -> None:
        await SocketServer(path, EVERYBODY, Interpreter(fake_context(tmp_path), []), interrupter(None)).open()

    with pytest.raises(FrontendError, match="no socket; move it"):
        asyncio.run(come())
    assert path.read_text() == "a person's own"


def test_a_daemon_that_hangs_with_a_full_queue_of_clients_lives_all_the_same(tmp_path: Path) -> None:
    path = tmp_path / "s"
    with socket.socket(socket.AF_UNIX) as hung, contextlib.ExitStack() as queue:
        hung.bind(str(path))
        hung.listen(0)
        for _ in range(4):
            one = queue.enter_context(socket.socket(socket.AF_UNIX))
            one.setblocking(False)
            with contextlib.suppress(BlockingIOError):
                one.connect(str(path))

        async def come() -> None:
            await SocketServer(path, EVERYBODY, Interpreter(fake_context(tmp_path), []), interrupter(None)).open()

        with pytest.raises(FrontendError, match="another facetd answers there"):
            asyncio.run(come())


def test_who_never_reads_is_let_go(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Who has said good-bye, and who is there and idle: nobody holds the daemon's descriptors by not reading."""
    monkeypatch.setattr("daemon.frontends.socket_server.STOP_S", 0.2)
    monkeypatch.setattr("daemon.frontends.socket_server.IDLE_S", 0.2)

    def use(path: Path) -> int:
        before = len(os.listdir("/proc/self/fd"))
        with contextlib.ExitStack() as stack:
            for k in range(6):
                one = stack.enter_context(socket.socket(socket.AF_UNIX))
                one.connect(str(path))
                one.sendall(b'{"complete": ""}\n' * 1500 + b'{"do": "help", "waits": true}\n' * 300)
                if k % 2:
                    one.shutdown(socket.SHUT_WR)
                one.recv(1, socket.MSG_PEEK)
            return until(lambda: (held := len(os.listdir("/proc/self/fd")) - before) <= 6 and held)

    assert listening(tmp_path, use) == 6, "their own ends"


async def told_to(
    messages: bytes, work: Callable[[SocketFrontend], Awaitable[Any]], interrupt: Interrupt | None = None
) -> Any:
    """What the work gives that a connection does whose other end sends these messages and goes away."""
    reader, writer = asyncio.StreamReader(), Mock(drain=AsyncMock())
    writer.transport.get_write_buffer_size.return_value = 0
    here, gone = socket.socketpair()
    gone.close()
    with here:
        writer.get_extra_info.return_value = here
        operator = SocketFrontend(reader, writer, MagicMock(), interrupt or Mock(), Mock(), "all")
        listens, working = asyncio.create_task(operator.listen()), asyncio.ensure_future(work(operator))
        await asyncio.sleep(0)
        reader.feed_data(messages)
        reader.feed_eof()
        await listens
        return await working


def test_a_file_may_come_in_pieces_of_nothing() -> None:
    """Each costs no more than the one before it."""
    pieces = b'{"file": "", "more": true}\n' * 20_000 + b'{"file": "QQ=="}\n'
    began_s = time.thread_time()
    assert asyncio.run(told_to(pieces, lambda operator: operator.fetch("part.stl"))) == b"A"
    assert time.thread_time() - began_s < 5.0


def test_the_guide_says_how_many_may_be_connected_and_for_how_long_in_silence() -> None:
    trouble = (HOUSE / "docs" / "operate" / "trouble.md").read_text()
    faults = (HOUSE / "deploy" / "FAULTS.md").read_text()
    assert f"one user has {MOST_EACH}, or all together {MOST_TOGETHER} |" in trouble
    silent = f"sends nothing for {FIRST_MESSAGE_S:g} s, and an idle one after {IDLE_S / 60:g} min"
    assert f"closes a new connection that {silent}" in faults
    assert f"takes a connection for a stop, and closes it after {STOP_S:g} s |" in faults


def test_beyond_the_limit_the_oldest_of_those_who_came_to_stop_goes_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("daemon.frontends.socket_server.MOST_TOGETHER", 2)
    monkeypatch.setattr("daemon.frontends.socket_server.MOST_TO_STOP", 2)

    def still_there(one: socket.socket) -> bool:
        one.settimeout(0.5)
        try:
            return one.recv(1) != b""
        except TimeoutError:
            return True

    def use(path: Path) -> Any:
        with contextlib.ExitStack() as stack:
            crowd = [stack.enter_context(socket.socket(socket.AF_UNIX)) for _ in range(5)]
            for one in crowd:
                one.connect(str(path))
            there = [still_there(one) for one in crowd]
            crowd[4].sendall(b'{"do": "stop"}\n')
            return there, json.loads(crowd[4].recv(65536))["done"]["status"]

    assert listening(tmp_path, use) == ([True, True, False, True, True], 0)


def test_who_is_connected_when_the_frontend_closes_is_hung_up(tmp_path: Path) -> None:
    async def close() -> int:
        context = fake_context(tmp_path)
        server = SocketServer(tmp_path / "s", EVERYBODY, Interpreter(context, every_command()), interrupter(context))
        await server.open()
        reader, writer = await asyncio.open_unix_connection(tmp_path / "s")
        writer.write(b'{"complete": "stat"}\n')
        assert b"status" in await reader.readline()
        await server.close()
        assert await asyncio.wait_for(reader.read(), PATIENCE_S) == b""
        writer.close()
        return len(asyncio.all_tasks())

    assert asyncio.run(close()) == 1


@pytest.mark.parametrize("refused", [False, True])
def test_the_socket_is_given_to_the_group_that_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, refused: bool
) -> None:
    given: list[tuple[object, ...]] = []

    def chown(*what: object) -> None:
        given.append(what)
        if refused:
            raise PermissionError(1, "Operation not permitted")

    rights = Rights(ConsoleSettings())
    rights.group += 1
    monkeypatch.setattr("daemon.frontends.socket_server.os.chown", chown)
    if refused:
        with pytest.raises(FrontendError, match=r"cannot be given to console\.group: Operation not permitted; make it"):
            listening(tmp_path, lambda _: None, rights)
    else:
        listening(tmp_path, lambda _: None, rights)
    assert given == [(tmp_path / "s", -1, rights.group)]
    assert not (tmp_path / "s").exists()


@pytest.mark.parametrize(
    ("messages", "why"),
    [
        ([{"do": "enable", "size": [100, 30], "door": "x"}], ""),
        ([{"answer": "y"}, {"file": "AA=="}, {"no_file": "x"}, {"keys": "a"}, {"leave": True}, {"do": "enable"}], ""),
        ([{"door": "x"}], "it has none of the keys do, answer, file, keys, leave, interrupt, complete, notices"),
    ],
)
def test_what_is_said_out_of_turn_is_passed_over_and_what_says_nothing_refused(
    tmp_path: Path, messages: list[dict[str, Any]], why: str
) -> None:
    (answer,), _ = with_socket(tmp_path / "s", lambda path: asked(path, *messages, answers=1))
    assert answer["done"]["text"] == (f"not a message: {why}" if why else answer["done"]["text"])
    assert answer["done"]["status"] == (2 if why else 0)


def test_who_goes_away_in_the_middle_of_a_file_ends_the_command_that_asked_for_it() -> None:
    def come(pieces: bytes) -> bytes:
        return bytes(asyncio.run(told_to(pieces, lambda operator: operator.fetch("part.stl"))))

    assert come(b'{"file": "QQ=="}\n') == b"A", "it was all there before"
    with pytest.raises(CommandError, match="the operator disconnected"):
        come(b'{"file": "QQ==", "more": true}\n')
    with pytest.raises(CommandError, match="the operator disconnected"):
        come(b"")


def test_a_closed_socket_has_let_go_of_everybody(tmp_path: Path) -> None:
    context = fake_context(tmp_path)

    async def serve() -> None:
        before = asyncio.all_tasks()
        server = SocketServer(tmp_path / "s", EVERYBODY, Interpreter(context, every_command()), interrupter(context))
        await server.open()
        reader, writer = await asyncio.open_unix_connection(tmp_path / "s")
        writer.write(b'{"notices": true}\n{"complete": "stat"}\n')
        assert b"status" in await reader.readline()
        await server.close()
        await server.close()
        assert asyncio.all_tasks() == before
        assert not (tmp_path / "s").exists()
        writer.close()

    asyncio.run(asyncio.wait_for(serve(), PATIENCE_S))


def test_who_hung_up_is_served_until_all_that_he_began_is_done() -> None:
    done = []

    async def stop(*_: object) -> str:
        for _turn in range(5):
            await asyncio.sleep(0)
        done.append("the stop")
        return "Stopped."

    async def nothing(_: SocketFrontend) -> None:
        """They began it by what they sent."""

    asyncio.run(told_to(b'{"interrupt": true}\n', nothing, stop))
    assert done == ["the stop"]
