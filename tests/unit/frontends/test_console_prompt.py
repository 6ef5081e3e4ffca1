"""The operator's prompt on a real terminal, with a real daemon: it hears while it waits."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

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
    person.sees("Stopped. Nothing moves until `resume`.")
    person.sees("go bin: not done; the arm was stopped after you typed it")
    assert "stopped by" in daemon.do("status")["data"]["fault"]
    stopped = joints(daemon)
    assert all(joints(daemon) == stopped for _ in range(10))


def test_commands_typed_ahead_are_done_in_their_order(person: Person) -> None:
    person.types("go survey\rgo home\rstatus\r")
    person.sees("cell      simulated")
    person.sees("At survey.")
    person.sees("At home.")


def test_control_c_stops_at_any_moment_and_never_ends_the_prompt(daemon: Running, person: Person) -> None:
    person.types("go survey\r")
    person.sees("(go survey) facetd>")
    person.types("\x03")
    person.sees("Stopped. Nothing moves until `resume`.")
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
    person.sees("Stopped. Nothing moves until `resume`.")
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
