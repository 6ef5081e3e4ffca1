"""`facetctl console` outlives the daemon it spoke with: it says so, finds the next one, repeats nothing."""

from __future__ import annotations

import contextlib
import itertools
import os
import pty
import shutil
import socket
import sys
import tempfile
import threading
import tty
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from queue import SimpleQueue
from types import SimpleNamespace
from typing import Any

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[3]))

from daemon import ctl
from daemon.console.stop_words import means_stop
from daemon.frontends import client, console, keyboard
from daemon.frontends.client import DaemonLink, DaemonUnreachableError
from daemon.frontends.keyboard import InputLines
from tests.fakes.fake_daemon import DONE, FakeDaemon, Message, Say
from tests.fakes.person import Person, piped
from tests.fakes.waiting import PATIENCE_S, until


@pytest.fixture
def place() -> Iterator[Path]:
    folder = Path(tempfile.mkdtemp(prefix="facetd-prompt-"))
    yield folder / "facetd.sock"
    shutil.rmtree(folder)


def killed_at(line: int) -> Callable[[Message, Say], None]:
    """The answers of a daemon that is killed amid this one of the commands it hears."""
    lines = itertools.count(1)

    def answer(message: Message, say: Say) -> None:
        if "do" in message:
            if next(lines) == line:
                raise ConnectionAbortedError
            say(DONE | {"id": message.get("id")})

    return answer


def busy_until_stopped() -> Callable[[Message, Say], None]:
    """The answers of a daemon that answers a stop at once, and what else it hears only after one."""
    stopped = threading.Event()

    def answer(message: Message, say: Say) -> None:
        text = message["do"]
        if means_stop(text):
            stopped.set()
        stopped.wait(PATIENCE_S)
        say({"done": {"text": f"done: {text}", "data": {}, "status": int(text == "pick")}})

    return answer


def commands(*daemons: FakeDaemon) -> list[str]:
    return [message["do"] for daemon in daemons for message in daemon.heard if "do" in message]


def test_a_daemon_killed_amid_a_command_is_told_and_the_next_one_found_without_saying_anything_twice(
    place: Path,
) -> None:
    with FakeDaemon(place, killed_at(2), most=1) as first:
        person = Person(place.parent, "console")
        person.sees("facetd>")
        person.types("status\r")
        person.sees("well")
        person.types("pick\r")
        person.sees("ended before it answered")
    person.sees("no daemon answers")
    person.types("go home\r")
    person.sees("not sent: go home")
    with FakeDaemon(place, killed_at(3), most=1) as second:
        person.sees("Connected again")
        person.types("status\r")
        person.sees("well")
        person.types("quit\r")
        assert person.leaves() == 0
    assert commands(first, second) == ["status", "pick", "status"]


def test_a_script_ends_where_its_daemon_does(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with (
        FakeDaemon(place, killed_at(1)),
        DaemonLink(place) as link,
        open(piped("pick\npick\n"), encoding="utf-8") as stdin,
    ):
        monkeypatch.setattr(sys, "stdin", stdin)
        with pytest.raises(DaemonUnreachableError):
            console.converse(link)


def test_a_stop_through_a_pipe_is_said_while_the_line_before_it_is_being_done_and_drops_what_waits(
    place: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    read, write = os.pipe()
    with (
        FakeDaemon(place, busy_until_stopped()) as daemon,
        open(read, encoding="utf-8") as stdin,
        open(write, "w", encoding="utf-8") as program,
        DaemonLink(place) as link,
        ThreadPoolExecutor(1) as pool,
    ):
        monkeypatch.setattr(sys, "stdin", stdin)
        program.write("pick\n")
        program.flush()
        talking = pool.submit(console.converse, link)
        daemon.hears()
        program.write("where\nstop\n")
        program.close()
        talking.result(PATIENCE_S)
    assert commands(daemon) == ["pick", "stop"]
    told = capsys.readouterr().out.splitlines()
    assert sorted(told) == ["done: pick", "done: stop", "not done: where"], "in whichever order they are heard"


def test_control_c_where_lines_wait_stops_the_arm_before_it_tells_of_them(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whoever reads what is told may be slow, or gone."""
    done: list[str] = []

    class Pressed(contextlib.nullcontext[Any]):
        waiting, come = SimpleNamespace(get=lambda: Pressed.next()), iter([KeyboardInterrupt(), None])

        def __enter__(self) -> Any:
            return self

        @classmethod
        def next(cls) -> None:
            if (pressed := next(cls.come)) is not None:
                raise pressed

        def drop(self) -> None:
            done.append("told")

    def interrupt(_: object) -> str:
        done.append("stopped")
        return ""

    monkeypatch.setattr(console, "InputLines", lambda *_: Pressed())
    assert console.send_piped(SimpleNamespace(interrupt=interrupt)) == 0  # type: ignore[arg-type]
    assert done == ["stopped", "told"]


@pytest.mark.parametrize("way", ["control-C", "a word"])
def test_at_the_prompt_a_stop_that_a_hung_daemon_does_not_answer_sends_to_the_emergency_stop(
    place: Path, way: str
) -> None:
    with socket.socket(socket.AF_UNIX) as hung:
        hung.bind(str(place))
        hung.listen(1)
        person = Person(place.parent, "console")
        person.sees("facetd>")
        person.types("\x03" if way == "control-C" else "stop\r")
        person.sees("PRESS THE EMERGENCY STOP: no answer to the stop for 2 s")
        person.types("quit\r")
        assert person.leaves() == ctl.STOP_UNANSWERED


def test_at_the_prompt_a_stop_where_no_daemon_is_any_more_sends_to_the_emergency_stop(place: Path) -> None:
    with FakeDaemon(place, killed_at(1), most=1):
        person = Person(place.parent, "console")
        person.sees("facetd>")
        person.types("stop\r")
        person.sees("PRESS THE EMERGENCY STOP: the stop was not answered")
    person.sees("no daemon answers")
    person.types("stop\r")
    person.sees("PRESS THE EMERGENCY STOP; not sent: stop: no daemon")
    person.types("\x03")
    person.sees("PRESS THE EMERGENCY STOP: no daemon")
    person.types("quit\r")
    assert person.leaves() == ctl.STOP_UNANSWERED


def test_at_the_prompt_a_stop_that_is_answered_sends_nobody_anywhere(place: Path) -> None:
    with FakeDaemon(place, killed_at(3), most=1):
        person = Person(place.parent, "console")
        person.sees("facetd>")
        person.types("stop\r")
        person.sees("well")
        assert "EMERGENCY" not in person.sees_for(client.STOP_ANSWER_S + 0.5)
        person.types("quit\r")
        assert person.leaves() == 0


def test_at_the_prompt_a_daemon_that_waits_for_the_controller_sends_nobody_anywhere_until_it_falls_silent(
    place: Path,
) -> None:
    with FakeDaemon(place, most=1) as daemon:
        person = Person(place.parent, "console")
        person.sees("facetd>")
        person.types("stop\r")
        daemon.hears(lambda message: "do" in message)
        for _ in range(5):
            daemon.says(stopping=True)
            assert "EMERGENCY" not in person.sees_for(client.STOP_ANSWER_S / 4)
        person.sees("PRESS THE EMERGENCY STOP: no answer to the stop for 2 s")
        person.types("quit\r")
        assert person.leaves() == ctl.STOP_UNANSWERED


@pytest.fixture
def daemon(place: Path) -> Iterator[FakeDaemon]:
    """A daemon that answers nothing."""
    with FakeDaemon(place, most=1) as daemon:
        yield daemon


@pytest.fixture
def person(daemon: FakeDaemon) -> Person:
    """Somebody at its prompt."""
    person = Person(daemon.path.parent, "console")
    person.sees("facetd>")
    assert daemon.hears() == {"notices": True}
    return person


@pytest.mark.parametrize(
    ("first", "amid", "last"), [("st", "", "op"), ("", "st", "op"), ("s", "t", "op"), ("go home", "s", "top")]
)
def test_a_stop_that_a_question_comes_or_goes_amid_is_heard(
    daemon: FakeDaemon, person: Person, first: str, amid: str, last: str
) -> None:
    """Somebody else said yes to the move that was asked about here: the `st` that stood there was taken away with the
    question, and what was left of the word was none."""
    if first:
        person.types(first)
        person.sees(first.split()[-1])
    daemon.says(ask="Send it?", id=1)
    person.sees("Send it?")
    if amid:
        person.types(amid)
        person.sees(amid)
        daemon.says(unasked=1)
        person.sees("facetd>")
    person.types(f"{last}\r")
    said = daemon.hears()
    assert said.get("do", said.get("answer")) == "stop"
    person.types("\x04")
    assert person.leaves() == 0


def test_a_stop_waits_for_no_terminal_that_does_not_say_where_its_cursor_is(daemon: FakeDaemon, person: Person) -> None:
    """The first stop at a new prompt left a second late where the terminal gave no answer, and with a slow one's."""
    person.types("stop\r")
    assert daemon.hears()["do"] == "stop"
    person.types("\x04")
    person.leaves()
    assert not person.asked_for_cursor


@pytest.mark.parametrize(
    ("typed", "pasted"),
    [
        ("", "\x1b[200~status\rstop\x1b[201~"),
        ("", "\x1b[200~status # x\nstop\x1b[201~"),
        ("", "\x1b[200~status\r\nstop\r\npick\r\n\x1b[201~"),
        ("st", "\x1b[200~op\x1b[201~"),
        ("", "\x1b[200~status\rstop\r"),  # the mark of its end is lost
    ],
)
def test_a_stop_in_a_paste_is_said_at_once_and_nothing_else_of_it(
    daemon: FakeDaemon, person: Person, typed: str, pasted: str
) -> None:
    """The lines of a paste were made one: a stop in it was one word too many, or a part of a comment."""
    if typed:
        person.types(typed)
        person.sees(typed)
    person.types(pasted)
    assert daemon.hears()["do"] == "stop"
    person.types("where\r")
    assert daemon.hears()["do"] == "where", "nothing of the paste is left"
    person.types("\x04")
    person.leaves()


def test_control_c_is_heard_amid_a_paste_whose_end_is_lost(daemon: FakeDaemon, person: Person) -> None:
    person.types("\x1b[200~status")
    person.sees_for(0.2)
    person.types("\x03")
    assert daemon.hears() == {"interrupt": True}
    person.types("where\r")
    assert daemon.hears()["do"] == "where"
    person.types("\x04")
    person.leaves()


def test_each_line_of_a_paste_is_a_line_of_its_own_behind_one_enter(daemon: FakeDaemon, person: Person) -> None:
    person.types("\x1b[200~# how it stands\rstatus # now\r\r  where\r\x1b[201~")
    person.sees("2 lines pasted. Enter runs one after the other")
    assert len(daemon.heard) == 1, "nothing is said before that"
    person.types("\r")
    first, then = daemon.hears(), daemon.hears()
    assert (first["do"], then["do"].strip()) == ("status # now", "where")
    assert first["block"] == then["block"]
    daemon.says(ask="Sure?", id=1)
    person.sees("Sure?")
    person.types("\x1b[200~y\rgo home\r\x1b[201~")
    person.sees("an answer is one line")
    person.types("n\r")
    assert daemon.hears() == {"answer": "n", "id": 1}
    person.types("\x1b[200~where\r\x1b[201~ # one line waits for Enter as well\r")
    alone = daemon.hears()
    assert (alone["do"], alone.get("block")) == ("where # one line waits for Enter as well", None)
    person.types("\x04")
    person.leaves()
    kept = (daemon.path.parent / ".local/state/facetctl-history").read_text().splitlines()
    assert kept[:2] == ["status # now", "where"]


def test_notices_come_while_a_question_is_put_and_what_was_typed_for_something_else_answers_nothing(
    daemon: FakeDaemon, person: Person
) -> None:
    person.types("pick cube\r")
    assert daemon.hears(lambda message: "do" in message)["do"] == "pick cube"
    person.types("statu")
    person.sees("statu")
    daemon.says(ask="Send it? [y/n]", id=7)
    person.sees("Send it? [y/n]")
    daemon.says(notice="picked: pyramid, 3 looks")
    person.sees("picked: pyramid, 3 looks")
    person.sees("Send it? [y/n]")
    person.types("y\r")
    assert daemon.hears(lambda message: "answer" in message) == {"answer": "y", "id": 7}
    person.sees("facetd> statu")
    daemon.says(ask="Again? [y/n]", id=8)
    person.sees("Again? [y/n]")
    person.types("y")
    person.sees("y")
    daemon.says(unasked=8)
    person.sees("facetd> statu")
    person.types("s\r")
    assert daemon.hears(lambda message: message.get("do") == "status")["id"] == 2
    assert [message for message in daemon.heard if "answer" in message] == [{"answer": "y", "id": 7}]
    person.types("\x04")
    assert person.leaves() == 0


def test_who_leaves_while_a_pick_goes_on_is_told_so(place: Path) -> None:
    """A console was closed, and the arm went on without a word."""

    def answer(message: Message, say: Say) -> None:
        if message.get("do") == "status":
            say({"done": {"text": "", "status": 0, "data": {"doing": "auto"}}})

    with FakeDaemon(place, answer, most=2):
        person = Person(place.parent, "console")
        person.sees("facetd>")
        person.types("quit\r")
        person.sees("auto goes on without this console. `facetctl stop` stops the arm")
        assert person.leaves() == 0


def type_at_questions(monkeypatch: pytest.MonkeyPatch, write: Callable[[str], object], *lines: str) -> None:
    """A line is typed as each question is shown, never before."""
    coming = iter(lines)
    monkeypatch.setattr(keyboard, "print", lambda *_, **how: write(next(coming)), raising=False)


def typed(terminal: int, keys: str) -> None:
    """Type, and wait until the terminal has taken the keys: it echoes them."""
    os.write(terminal, keys.encode())
    echo = ""
    while echo.replace("\r", "") != keys:
        echo += os.read(terminal, 4096).decode()


def nobody_stops(line: str) -> None:
    raise AssertionError(f"`{line}` is no stop")


def test_a_line_typed_before_a_question_was_shown_does_not_answer_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """`facetctl console | tee log`: a move in step mode was sent by a y that was typed ahead."""
    read, write = os.pipe()
    with open(read, encoding="utf-8") as stdin, open(write, "w", encoding="utf-8", buffering=1) as keys:
        monkeypatch.setattr(sys, "stdin", stdin)
        with InputLines(nobody_stops, print) as typed:
            keys.write("go bin\ny\n")
            until(lambda: typed.waiting.qsize() >= 2)
            type_at_questions(monkeypatch, keys.write, "n\n", "")
            assert typed.answer("Send it? [y/n]") == "n"
            keys.write("where")
            keys.close()
            assert [typed.waiting.get() for _ in range(4)] == ["go bin", "y", "where", None]
            assert typed.answer("Send it? [y/n]") == "", "nobody answers any more"


def test_a_stop_typed_at_a_terminal_is_heard_whatever_is_waited_for_there(monkeypatch: pytest.MonkeyPatch) -> None:
    """Typed as a tour of commissioning went on, it was not read until the next question, and forgotten there; and as
    the answer to that it was neither a yes nor a no."""
    master, slave = pty.openpty()
    stops: SimpleQueue[str] = SimpleQueue()
    with open(slave, encoding="utf-8") as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        lines = InputLines(stops.put, print)
        os.write(master, b"y\nSTOP!\n")
        assert stops.get(timeout=PATIENCE_S) == "STOP!"
        type_at_questions(monkeypatch, lambda text: os.write(master, text.encode()), "y\n", "halt\n", "\n")
        for answer in ("y", "", ""):
            assert lines.answer("Everybody out of the arm's reach? [y/n]") == answer
        assert stops.get(timeout=PATIENCE_S) == "halt"
        lines.close()
    os.close(master)


def test_keys_typed_at_a_terminal_before_a_question_was_shown_do_not_answer_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """The y to one check of commissioning, pressed twice, was the yes to the next one, which let the arm move."""
    master, slave = pty.openpty()
    with open(slave, encoding="utf-8") as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        with InputLines(nobody_stops, print) as lines:
            typed(master, "y\ny\n")
            type_at_questions(monkeypatch, lambda text: os.write(master, text.encode()), "n\n")
            assert lines.answer("Everybody out of the arm's reach? [y/n]") == "n"
    os.close(master)


@pytest.mark.parametrize(("begun", "ended"), [("st", "op\n"), ("stop\nst", "\n"), ("y", "\n")])
def test_a_line_that_a_question_comes_amid_answers_it_nothing_and_stops_where_it_is_a_stop(
    begun: str, ended: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What stood there was thrown away with the question: what was left of the word was none."""
    stops: SimpleQueue[str] = SimpleQueue()
    master, slave = pty.openpty()
    with open(slave, encoding="utf-8") as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        with InputLines(stops.put, print) as lines:
            typed(master, begun)
            type_at_questions(monkeypatch, lambda text: os.write(master, text.encode()), ended)
            assert lines.answer("Everybody out of the arm's reach? [y/n]") == ""
    assert stops.empty() is (begun == "y")
    os.close(master)


def test_keys_that_another_reads_one_by_one_or_in_front_of_us_are_left_to_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """A pager, or the controller's own terminal, would miss every second key; who reads in the background is stopped by
    the shell."""
    master, slave = pty.openpty()
    with open(slave, encoding="utf-8") as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        seen: list[bool] = []
        may_read = keyboard.may_read_lines
        monkeypatch.setattr(keyboard, "may_read_lines", lambda handle: seen.append(may_read(handle)) or seen[-1])
        with InputLines(nobody_stops, print), monkeypatch.context() as shell:
            shell.setattr(os, "tcgetpgrp", lambda _: -1)
            os.write(master, b"stop\n")
            until(lambda: len(seen) >= 3)
            assert os.read(slave, 9) == b"stop\n"
        tty.setcbreak(slave)
        with InputLines(nobody_stops, print):
            os.write(master, b"stop\n")
            until(lambda: len(seen) >= 6)
            assert os.read(slave, 9) == b"stop\n"
    os.close(master)


def test_a_key_that_another_reader_has_taken_is_not_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """Control-] at the controller's terminal: its key was gone and the terminal gave lines again before it was seen
    whose it was, and facetctl did not end."""
    master, slave = pty.openpty()
    real, taken = keyboard.may_read_lines, threading.Event()

    def gives_lines(handle: int) -> bool:
        if not taken.is_set():
            assert os.read(handle, 9) == b"]\n"
            taken.set()
        return real(handle)

    with open(slave, encoding="utf-8") as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        monkeypatch.setattr(keyboard, "may_read_lines", gives_lines)
        lines = InputLines(nobody_stops, print)
        os.write(master, b"]\n")
        assert taken.wait(PATIENCE_S)
        ending = threading.Thread(target=lines.close, daemon=True)
        ending.start()
        ending.join(5.0)
        over = not ending.is_alive()
        os.write(master, b"\n")
        ending.join()
    assert over
    os.close(master)


@pytest.mark.parametrize("words", [("pick",), ("--json", "pick"), ("script", "SCRIPT")])
def test_a_stop_typed_while_a_command_or_a_script_is_being_done_is_said_at_once(
    place: Path, words: tuple[str, ...]
) -> None:
    """Nobody read it: control-C alone was heard. Behind what moves nothing a script went on to what does."""
    script = place.parent / "script"
    script.write_text("train\npick\n")
    with FakeDaemon(place, busy_until_stopped()) as daemon:
        person = Person(place.parent, *(str(script) if word == "SCRIPT" else word for word in words))
        assert daemon.hears()["do"] in ("pick", "train")
        person.types("ls\n")
        person.sees("ls")
        person.types("halt\n")
        person.sees("done: halt")
        person.sees("not done: ls")
        assert person.leaves() == 1
    assert commands(daemon)[1:] == ["halt"]


def test_a_stop_in_a_script_that_comes_through_a_pipe_waits_for_no_line_before_it(
    place: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """All of it was read before the first line was said."""
    read, write = os.pipe()
    with FakeDaemon(place, busy_until_stopped()) as daemon, open(read, encoding="utf-8") as stdin:

        def types() -> None:
            os.write(write, b"train\n")
            daemon.hears()
            os.write(write, b"where\nstop\npick\n")
            os.close(write)

        monkeypatch.setattr(sys, "stdin", stdin)
        with ThreadPoolExecutor(1) as pool:
            typing = pool.submit(types)
            assert ctl.main(["--socket", str(place), "script", "-"]) == ctl.NOT_DONE
            typing.result(PATIENCE_S)
    assert commands(daemon) == ["train", "stop"]
    told = capsys.readouterr()
    assert "not done: where\n" in told.out
    assert "stop; the rest was not run" in told.err
