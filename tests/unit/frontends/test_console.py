"""`facetctl console` outlives the daemon it spoke with: it says so, finds the next one, repeats nothing."""

from __future__ import annotations

import contextlib
import json
import os
import pty
import shutil
import socket
import sys
import tempfile
import threading
import time
import tty
from collections.abc import Callable, Iterator
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
from tests.fakes.person import Person, piped
from tests.fakes.waiting import until


class Played:
    """A daemon's socket, at which each daemon in turn hears so many lines and then is killed."""

    def __init__(self, place: Path) -> None:
        self.place, self.heard = place, list[str]()

    def live(self, lines: int) -> threading.Thread:
        """One daemon; the last line it hears it does not answer."""
        listening = socket.socket(socket.AF_UNIX)
        listening.bind(str(self.place))
        listening.listen(1)

        def serve() -> None:
            with listening, listening.accept()[0] as line, line.makefile("rwb") as file:
                self.place.unlink()
                spoken = (json.loads(said) for said in iter(file.readline, b""))
                for k, said in zip(range(lines), (said for said in spoken if "do" in said), strict=False):
                    self.heard.append(said["do"])
                    if k < lines - 1:
                        done = {"done": {"text": "well", "data": {}, "status": 0}, "id": said.get("id")}
                        file.write(json.dumps(done).encode() + b"\n")
                        file.flush()

        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        return thread


@pytest.fixture
def place() -> Iterator[Path]:
    folder = Path(tempfile.mkdtemp(prefix="facetd-prompt-"))
    yield folder / "facetd.sock"
    shutil.rmtree(folder)


def test_a_daemon_killed_amid_a_command_is_told_and_the_next_one_found_without_saying_anything_twice(
    place: Path,
) -> None:
    played = Played(place)
    first = played.live(2)
    person = Person(place.parent, "console")
    person.sees("facetd>")
    person.types("status\r")
    person.sees("well")
    person.types("pick\r")
    first.join(5)
    person.sees("ended before it answered")
    person.sees("no daemon answers")
    person.types("go home\r")
    person.sees("not sent: go home")
    played.live(3)
    person.sees("Connected again")
    person.types("status\r")
    person.sees("well")
    person.types("quit\r")
    assert person.leaves() == 0
    assert played.heard == ["status", "pick", "status"]


def test_a_script_ends_where_its_daemon_does(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    played = Played(place)
    played.live(1)
    link = DaemonLink(place)
    with open(piped("pick\npick\n"), encoding="utf-8") as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        with pytest.raises(DaemonUnreachableError):
            console.converse(link)
    link.close()


def test_a_stop_through_a_pipe_is_said_while_the_line_before_it_is_being_done_and_drops_what_waits(
    place: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    heard: list[str] = []

    def live(listening: socket.socket) -> None:
        def hear(line: socket.socket, then: Callable[[], None]) -> None:
            with line, line.makefile("rwb") as file:
                text = json.loads(file.readline())["do"]
                heard.append(text)
                then()
                file.write(json.dumps({"done": {"text": f"done: {text}", "data": {}, "status": 0}}).encode() + b"\n")

        hear(listening.accept()[0], lambda: hear(listening.accept()[0], lambda: None))

    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind(str(place))
        listening.listen(2)
        daemon = threading.Thread(target=live, args=(listening,), daemon=True)
        daemon.start()
        read, write = os.pipe()
        with open(read, encoding="utf-8") as stdin, open(write, "w", encoding="utf-8") as program:
            monkeypatch.setattr(sys, "stdin", stdin)
            program.write("pick\n")
            program.flush()
            with DaemonLink(place) as link:
                talking = threading.Thread(target=console.converse, args=(link,), daemon=True)
                talking.start()
                until(lambda: heard)
                program.write("where\nstop\n")
                program.close()
                talking.join(5)
                daemon.join(5)
    assert heard == ["pick", "stop"]
    assert not talking.is_alive()
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
    assert console._piped(SimpleNamespace(interrupt=interrupt)) == 0  # type: ignore[arg-type]
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
    played = Played(place)
    first = played.live(1)
    person = Person(place.parent, "console")
    person.sees("facetd>")
    person.types("stop\r")
    person.sees("PRESS THE EMERGENCY STOP: the stop was not answered")
    first.join(5)
    person.sees("no daemon answers")
    person.types("stop\r")
    person.sees("PRESS THE EMERGENCY STOP; not sent: stop: no daemon")
    person.types("\x03")
    person.sees("PRESS THE EMERGENCY STOP: no daemon")
    person.types("quit\r")
    assert person.leaves() == ctl.STOP_UNANSWERED


def test_at_the_prompt_a_stop_that_is_answered_sends_nobody_anywhere(place: Path) -> None:
    played = Played(place)
    played.live(3)
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
    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind(str(place))
        listening.listen(1)
        person = Person(place.parent, "console")
        with listening.accept()[0] as line, line.makefile("rwb") as file:
            person.sees("facetd>")
            person.types("stop\r")
            while "do" not in json.loads(file.readline()):
                pass
            for _ in range(5):
                file.write(b'{"stopping": true}\n')
                file.flush()
                assert "EMERGENCY" not in person.sees_for(client.STOP_ANSWER_S / 4)
            person.sees("PRESS THE EMERGENCY STOP: no answer to the stop for 2 s")
            person.types("quit\r")
            assert person.leaves() == ctl.STOP_UNANSWERED


class Asking:
    """A daemon's socket, at which questions come and go."""

    def __init__(self, place: Path) -> None:
        self.heard: SimpleQueue[dict[str, Any]] = SimpleQueue()
        self._listening = socket.socket(socket.AF_UNIX)
        self._listening.bind(str(place))
        self._listening.listen(1)
        threading.Thread(target=self._serve, daemon=True).start()

    def _serve(self) -> None:
        with self._listening, self._listening.accept()[0] as line, line.makefile("rwb") as self._file:
            for said in iter(self._file.readline, b""):
                self.heard.put(json.loads(said))

    def tell(self, **message: object) -> None:
        self._file.write(json.dumps(message).encode() + b"\n")
        self._file.flush()


@pytest.mark.parametrize(
    ("first", "amid", "last"), [("st", "", "op"), ("", "st", "op"), ("s", "t", "op"), ("go home", "s", "top")]
)
def test_a_stop_that_a_question_comes_or_goes_amid_is_heard(place: Path, first: str, amid: str, last: str) -> None:
    """Somebody else said yes to the move that was asked about here: the `st` that stood there was taken away with the
    question, and what was left of the word was none."""
    daemon, person = Asking(place), Person(place.parent, "console")
    person.sees("facetd>")
    if first:
        person.types(first)
        person.sees(first.split()[-1])
    daemon.tell(ask="Send it?", id=1)
    person.sees("Send it?")
    if amid:
        person.types(amid)
        person.sees(amid)
        daemon.tell(unasked=1)
        person.sees("facetd>")
    person.types(f"{last}\r")
    assert daemon.heard.get(timeout=10.0) == {"notices": True}
    said = daemon.heard.get(timeout=10.0)
    assert said.get("do", said.get("answer")) == "stop"
    person.types("\x04")
    assert person.leaves() == 0


def commands_heard(daemon: Asking, count: int) -> list[dict[str, Any]]:
    assert daemon.heard.get(timeout=10.0) == {"notices": True}
    return [daemon.heard.get(timeout=10.0) for _ in range(count)]


def test_a_stop_waits_for_no_terminal_that_does_not_say_where_its_cursor_is(place: Path) -> None:
    """The first stop at a new prompt left a second late where the terminal gave no answer, and with a slow one's."""
    daemon, person = Asking(place), Person(place.parent, "console")
    person.sees("facetd>")
    person.types("stop\r")
    (said,) = commands_heard(daemon, 1)
    assert said["do"] == "stop"
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
def test_a_stop_in_a_paste_is_said_at_once_and_nothing_else_of_it(place: Path, typed: str, pasted: str) -> None:
    """The lines of a paste were made one: a stop in it was one word too many, or a part of a comment."""
    daemon, person = Asking(place), Person(place.parent, "console")
    person.sees("facetd>")
    if typed:
        person.types(typed)
        person.sees(typed)
    person.types(pasted)
    (said,) = commands_heard(daemon, 1)
    assert said["do"] == "stop"
    person.types("where\r")
    assert daemon.heard.get(timeout=10.0)["do"] == "where", "nothing of the paste is left"
    person.types("\x04")
    person.leaves()


def test_control_c_is_heard_amid_a_paste_whose_end_is_lost(place: Path) -> None:
    daemon, person = Asking(place), Person(place.parent, "console")
    person.sees("facetd>")
    person.types("\x1b[200~status")
    person.sees_for(0.2)
    person.types("\x03")
    assert commands_heard(daemon, 1) == [{"interrupt": True}]
    person.types("where\r")
    assert daemon.heard.get(timeout=10.0)["do"] == "where"
    person.types("\x04")
    person.leaves()


def test_each_line_of_a_paste_is_a_line_of_its_own_behind_one_enter(place: Path) -> None:
    daemon, person = Asking(place), Person(place.parent, "console")
    person.sees("facetd>")
    person.types("\x1b[200~# how it stands\rstatus # now\r\r  where\r\x1b[201~")
    person.sees("2 lines pasted. Enter runs one after the other")
    assert daemon.heard.qsize() <= 1, "nothing is said before that"
    person.types("\r")
    first, then = commands_heard(daemon, 2)
    assert (first["do"], then["do"].strip()) == ("status # now", "where")
    assert first["block"] == then["block"]
    daemon.tell(ask="Sure?", id=1)
    person.sees("Sure?")
    person.types("\x1b[200~y\rgo home\r\x1b[201~")
    person.sees("an answer is one line")
    person.types("n\r")
    assert daemon.heard.get(timeout=10.0) == {"answer": "n", "id": 1}
    person.types("\x1b[200~where\r\x1b[201~ # one line waits for Enter as well\r")
    alone = daemon.heard.get(timeout=10.0)
    assert (alone["do"], alone.get("block")) == ("where # one line waits for Enter as well", None)
    person.types("\x04")
    person.leaves()
    kept = (place.parent / ".local/state/facetctl-history").read_text().splitlines()
    assert kept[:2] == ["status # now", "where"]


def typed_later(write: Callable[[str], object], text: str) -> None:
    threading.Timer(0.2, write, [text]).start()


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
            typed_later(keys.write, "n\n")
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
        assert stops.get(timeout=10.0) == "STOP!"
        for typed, answer in (("y\n", "y"), ("halt\n", ""), ("\n", "")):
            typed_later(lambda text: os.write(master, text.encode()), typed)
            assert lines.answer("Everybody out of the arm's reach? [y/n]") == answer
        assert stops.get(timeout=10.0) == "halt"
        lines.close()
    os.close(master)


def test_keys_typed_at_a_terminal_before_a_question_was_shown_do_not_answer_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """The y to one check of commissioning, pressed twice, was the yes to the next one, which let the arm move."""
    master, slave = pty.openpty()
    with open(slave, encoding="utf-8") as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        with InputLines(nobody_stops, print) as lines:
            os.write(master, b"y\ny\n")
            time.sleep(0.1)
            typed_later(lambda text: os.write(master, text.encode()), "n\n")
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
            os.write(master, begun.encode())
            time.sleep(0.1)
            typed_later(lambda text: os.write(master, text.encode()), ended)
            assert lines.answer("Everybody out of the arm's reach? [y/n]") == ""
    assert stops.empty() is (begun == "y")
    os.close(master)


def test_keys_that_another_reads_one_by_one_or_in_front_of_us_are_left_to_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """A pager, or the controller's own terminal, would miss every second key; who reads in the background is stopped by
    the shell."""
    master, slave = pty.openpty()
    with open(slave, encoding="utf-8") as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        with InputLines(nobody_stops, print), monkeypatch.context() as shell:
            shell.setattr(keyboard.os, "tcgetpgrp", lambda _: -1)
            os.write(master, b"stop\n")
            time.sleep(0.3)
            assert os.read(slave, 9) == b"stop\n"
        tty.setcbreak(slave)
        with InputLines(nobody_stops, print):
            os.write(master, b"stop\n")
            time.sleep(0.3)
            assert os.read(slave, 9) == b"stop\n"
    os.close(master)


def test_a_key_that_another_reader_has_taken_is_not_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """Control-] at the controller's terminal: its key was gone and the terminal gave lines again before it was seen
    whose it was, and facetctl did not end."""
    master, slave = pty.openpty()
    real, taken = keyboard._may_read_lines, threading.Event()

    def gives_lines(handle: int) -> bool:
        if not taken.is_set():
            assert os.read(handle, 9) == b"]\n"
            taken.set()
        return real(handle)

    with open(slave, encoding="utf-8") as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        monkeypatch.setattr(keyboard, "_may_read_lines", gives_lines)
        lines = InputLines(nobody_stops, print)
        os.write(master, b"]\n")
        assert taken.wait(10.0)
        ending = threading.Thread(target=lines.close, daemon=True)
        ending.start()
        ending.join(5.0)
        over = not ending.is_alive()
        os.write(master, b"\n")
        ending.join()
    assert over
    os.close(master)


class Doing:
    """A daemon's socket, at which a stop is answered at once and what else is said only after one."""

    def __init__(self, place: Path) -> None:
        self.heard: SimpleQueue[str] = SimpleQueue()
        self._stopped = threading.Event()
        self._listening = socket.socket(socket.AF_UNIX)
        self._listening.bind(str(place))
        self._listening.listen(4)
        threading.Thread(target=self._serve, daemon=True).start()

    def _serve(self) -> None:
        while True:
            line, _ = self._listening.accept()
            threading.Thread(target=self._answer, args=(line,), daemon=True).start()

    def _answer(self, line: socket.socket) -> None:
        with line, line.makefile("rwb") as file:
            for said in iter(file.readline, b""):
                text = json.loads(said)["do"]
                self.heard.put(text)
                if means_stop(text):
                    self._stopped.set()
                self._stopped.wait()
                done = {"text": f"done: {text}", "data": {}, "status": int(text == "pick")}
                file.write(json.dumps({"done": done}).encode() + b"\n")
                file.flush()


@pytest.mark.parametrize("words", [("pick",), ("--json", "pick"), ("script", "SCRIPT")])
def test_a_stop_typed_while_a_command_or_a_script_is_being_done_is_said_at_once(
    place: Path, words: tuple[str, ...]
) -> None:
    """Nobody read it: control-C alone was heard. Behind what moves nothing a script went on to what does."""
    daemon, script = Doing(place), place.parent / "script"
    script.write_text("train\npick\n")
    person = Person(place.parent, *(str(script) if word == "SCRIPT" else word for word in words))
    assert daemon.heard.get(timeout=20.0) in ("pick", "train")
    person.types("ls\n")
    person.sees("ls")
    person.types("halt\n")
    person.sees("done: halt")
    person.sees("not done: ls")
    assert person.leaves() == 1
    assert daemon.heard.get(timeout=1.0) == "halt"
    assert daemon.heard.empty()


def test_a_stop_in_a_script_that_comes_through_a_pipe_waits_for_no_line_before_it(
    place: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """All of it was read before the first line was said."""
    daemon, (read, write) = Doing(place), os.pipe()

    def types() -> None:
        os.write(write, b"train\n")
        said.append(daemon.heard.get(timeout=10.0))
        os.write(write, b"where\nstop\npick\n")
        said.append(daemon.heard.get(timeout=10.0))
        os.close(write)

    said: list[str] = []
    with open(read, encoding="utf-8") as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        typing = threading.Thread(target=types)
        typing.start()
        assert ctl.main(["--socket", str(place), "script", "-"]) == ctl.NOT_DONE
        typing.join(10.0)
    assert (said, daemon.heard.empty()) == (["train", "stop"], True)
    told = capsys.readouterr()
    assert "not done: where\n" in told.out
    assert "stop; the rest was not run" in told.err
