"""`facetctl console` outlives the daemon it spoke with: it says so, finds the next one, repeats nothing."""

from __future__ import annotations

import io
import json
import os
import pty
import shutil
import socket
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from queue import SimpleQueue
from typing import Any

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[3]))

from daemon.doors import prompt
from daemon.doors.client import DaemonLink, NotThereError
from daemon.doors.keyboard import Lines, answer_to
from tests.worlds.person import Person


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
    person.sees("not said: go home")
    played.live(3)
    person.sees("answers again")
    person.types("status\r")
    person.sees("well")
    person.types("quit\r")
    assert person.leaves() == 0
    assert played.heard == ["status", "pick", "status"]


def test_a_script_ends_where_its_daemon_does(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    played = Played(place)
    played.live(1)
    monkeypatch.setattr(sys, "stdin", io.StringIO("pick\npick\n"))
    link = DaemonLink(place)
    with pytest.raises(NotThereError):
        prompt.converse(link)
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
                console = threading.Thread(target=prompt.converse, args=(link,), daemon=True)
                console.start()
                while not heard:
                    time.sleep(0.001)
                program.write("where\nstop\n")
                program.close()
                console.join(5)
                daemon.join(5)
    assert heard == ["pick", "stop"]
    assert not console.is_alive()
    dropped, *done = capsys.readouterr().out.splitlines()
    assert dropped == "not done: where"
    assert sorted(done) == ["done: pick", "done: stop"], "in whichever order they are heard"


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


def typed_later(write: Callable[[str], object], text: str) -> None:
    threading.Timer(0.2, write, [text]).start()


def test_a_line_typed_before_a_question_was_shown_does_not_answer_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """`facetctl console | tee log`: a move in step mode was sent by a y that was typed ahead."""
    read, write = os.pipe()
    with open(read, encoding="utf-8") as stdin, open(write, "w", encoding="utf-8", buffering=1) as keys:
        monkeypatch.setattr(sys, "stdin", stdin)
        typed = prompt._Typed()
        reading = threading.Thread(target=typed.read, args=(None,), daemon=True)
        reading.start()
        keys.write("go bin\ny\n")
        while typed.lines.qsize() < 2:
            time.sleep(0.001)
        typed_later(keys.write, "n\n")
        assert typed.answer("Send it? [y/n]") == "n"
        keys.close()
        reading.join(5)
    assert typed.answer("Send it? [y/n]") == "", "nobody answers any more"
    assert [typed.lines.get() for _ in range(3)] == ["go bin", "y", None]


def test_a_stop_typed_at_a_terminal_is_heard_whatever_is_waited_for_there(monkeypatch: pytest.MonkeyPatch) -> None:
    """Typed as a tour of commissioning went on, it was not read until the next question, and forgotten there; and as
    the answer to that it was neither a yes nor a no."""
    master, slave = pty.openpty()
    stops: SimpleQueue[str] = SimpleQueue()
    with open(slave, encoding="utf-8") as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        lines = Lines(stops.put)
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
        os.write(master, b"y\ny\n")
        time.sleep(0.1)
        typed_later(lambda text: os.write(master, text.encode()), "n\n")
        assert answer_to("Everybody out of the arm's reach? [y/n]") == "n"
    os.close(master)
