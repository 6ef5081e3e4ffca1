"""The operator's prompt on a real terminal, with a real daemon or a played one: it hears while it waits."""

from __future__ import annotations

import json
import os
import shutil
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[3]))

from tests.fakes.person import Person
from tests.fakes.running import Running, judged_daemon
from tests.fakes.waiting import until


@pytest.fixture(scope="module")
def daemon() -> Iterator[Running]:
    with judged_daemon(seed=3, time_scale=4.0) as daemon:
        yield daemon


@pytest.fixture
def person(daemon: Running) -> Iterator[Person]:
    """Somebody at `facetctl console`, the arm enabled and at home."""
    for text in ("resume", "step off", "enable", "go home"):
        daemon.do(text)
    person = Person(daemon.folder, "console")
    person.sees("control-D leaves.")
    person.sees("facetd>")
    yield person
    person.types("\x15\x04")
    person.leaves()


def joints(daemon: Running) -> list[float]:
    found: list[float] = daemon.do("where")["data"]["joints_deg"]
    return found


def test_what_somebody_else_does_appears_above_the_line_being_typed(daemon: Running, person: Person) -> None:
    person.types("sta")
    person.sees("sta")
    daemon.do("stop")
    person.sees("STOPPED by")
    person.sees("facetd> sta")
    person.types("tus\r")
    person.sees("nothing moves until")


def test_stop_is_heard_while_a_command_is_being_done_and_what_was_typed_ahead_is_dropped(
    daemon: Running, person: Person
) -> None:
    person.types("go survey\rgo bin\r")
    until(lambda: daemon.do("status")["data"]["doing"] == "survey")
    person.types("stop\r")
    person.sees("Stopped. Nothing moves until `resume`.", within_s=2.0)
    person.sees("go bin: not done; the arm was stopped after you typed it")
    assert "stopped by" in daemon.do("status")["data"]["fault"]
    stopped = joints(daemon)
    time.sleep(0.3)
    assert joints(daemon) == stopped


def test_commands_typed_ahead_are_done_in_their_order(person: Person) -> None:
    person.types("go survey\rgo home\rstatus\r")
    person.sees("cell      simulated")
    person.sees("At survey.")
    person.sees("At home.")


def test_control_c_stops_at_any_moment_and_never_ends_the_prompt(daemon: Running, person: Person) -> None:
    person.types("go survey\r")
    person.sees("(go survey) facetd>")
    person.types("\x03")
    person.sees("Stopped. Nothing moves until `resume`.", within_s=2.0)
    person.types("what is typ\x03")
    person.sees("Nothing moves.")
    person.types("status\r")
    person.sees("STOPPED by control-C")


def test_a_question_is_answered_at_the_prompt_and_withdrawn_when_somebody_else_stops(
    daemon: Running, person: Person
) -> None:
    person.types("step on\r")
    person.sees("waits for")
    person.types("go survey\r")
    person.sees("Send it? [y/n]")
    person.types("y\r")
    person.sees("Send it? [y/n]")
    daemon.do("stop")
    person.sees("STOPPED by")
    person.sees("facetd>")
    person.types("status\r")
    person.sees("nothing moves until")


def test_stop_typed_at_a_question_is_no_answer_but_a_stop(daemon: Running, person: Person) -> None:
    person.types("step on\r")
    person.sees("waits for")
    person.types("go bin\r")
    person.sees("Send it? [y/n]")
    person.types("stop\r")
    person.sees("Stopped. Nothing moves until `resume`.", within_s=2.0)
    assert "stopped by" in daemon.do("status")["data"]["fault"]


def test_tab_completes_and_the_arrow_brings_commands_back_but_no_answers(daemon: Running, person: Person) -> None:
    person.types("step on\r")
    person.sees("waits for")
    person.types("go ho\t")
    person.sees("me")
    person.types("\r")
    person.sees("Send it? [y/n]")
    person.types("n\r")
    person.sees("facetd>")
    person.types("\x1b[A\r")
    person.sees("go home")
    person.sees("Send it? [y/n]")
    person.types("n\r")
    person.sees("facetd>")
    kept = (daemon.folder / ".local" / "state" / "facetctl-history").read_text().splitlines()
    assert kept[-2:] == ["step on", "go home"]
    assert "n" not in kept


def piped(daemon: Running, typed: str) -> subprocess.CompletedProcess[str]:
    """`facetctl console` with a pipe for a keyboard, where prompt_toolkit cannot be imported."""
    blocker = daemon.folder / "without" / "prompt_toolkit.py"
    blocker.parent.mkdir(exist_ok=True)
    blocker.write_text("raise ImportError('not here')\n")
    path = f"{blocker.parent}{os.pathsep}{os.environ.get('PYTHONPATH', '')}"
    environment = {**os.environ, "FACETD_SOCKET": str(daemon.folder / "facetd.sock"), "PYTHONPATH": path}
    command = [sys.executable, "-m", "daemon.ctl", "console"]
    return subprocess.run(command, input=typed, env=environment, capture_output=True, text=True, timeout=60)


def test_lines_from_a_pipe_are_said_one_by_one_without_the_prompt(daemon: Running) -> None:
    done = piped(daemon, "status\nflurb\n")
    assert done.stderr == ""
    assert done.stdout.startswith("cell      simulated")
    assert done.stdout.endswith("flurb: no such command; `help all` lists every command\n")
    assert done.returncode == 2
    assert piped(daemon, "flurb\nstatus\nquit\nflurb\n").returncode == 0


class Played:
    """A daemon that says what a test lets it say, and keeps what it hears."""

    def __init__(self, folder: Path, doing: str | None = None) -> None:
        """doing: what a `status` on a second connection is answered with; None: there is none."""
        self.heard: list[dict[str, Any]] = []
        self._doing = doing
        self._listening = socket.socket(socket.AF_UNIX)
        self._listening.bind(str(folder / "facetd.sock"))
        self._listening.listen(1)
        self._came = threading.Condition()
        self._line: socket.socket | None = None
        threading.Thread(target=self._serve, daemon=True).start()

    def _serve(self) -> None:
        with self._listening:
            with self._listening.accept()[0] as self._line, self._line.makefile("rb") as file:
                for line in file:
                    with self._came:
                        self.heard.append(json.loads(line))
                        self._came.notify_all()
            if self._doing is not None:
                with self._listening.accept()[0] as beside, beside.makefile("rb") as file:
                    assert json.loads(file.readline())["do"] == "status"
                    done = {"text": "", "status": 0, "data": {"doing": self._doing}}
                    beside.sendall(json.dumps({"done": done}).encode() + b"\n")

    def says(self, **message: Any) -> None:
        assert self._line is not None
        self._line.sendall(json.dumps(message).encode() + b"\n")

    def hears(self, wanted: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        with self._came:
            assert self._came.wait_for(lambda: any(map(wanted, self.heard)), 10), self.heard
            return next(message for message in self.heard if wanted(message))


@pytest.fixture
def folder() -> Iterator[Path]:
    folder = Path(tempfile.mkdtemp(prefix="facetd-played-"))
    yield folder
    shutil.rmtree(folder, ignore_errors=True)


def test_notices_come_while_a_question_is_put_and_what_was_typed_for_something_else_answers_nothing(
    folder: Path,
) -> None:
    daemon = Played(folder)
    person = Person(folder, "console")
    person.sees("facetd>")
    daemon.hears(lambda message: "notices" in message)
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


def test_who_leaves_while_a_pick_goes_on_is_told_so(folder: Path) -> None:
    """A console was closed, and the arm went on without a word."""
    Played(folder, doing="auto")
    person = Person(folder, "console")
    person.sees("facetd>")
    person.types("quit\r")
    person.sees("auto goes on without this console. `facetctl stop` stops the arm")
