"""The tool's own words: what is no command or option is told as such, and nobody reading on is no fault."""

from __future__ import annotations

import fcntl
import io
import os
import signal
import struct
import subprocess
import sys
import termios
from pathlib import Path

import pytest

from daemon import ctl
from daemon.commands import every_command
from daemon.console.interpreter import OF_THE_SHELL
from daemon.store.library import load_facets
from daemon.store.model import save
from daemon.vision.model import empty_model, learn_solid
from tests.fakes import drawn
from tests.fakes.chosen import few
from tests.fakes.made_run import MadeRun


def test_an_option_that_there_is_not_is_told_and_not_said_to_the_daemon(capsys: pytest.CaptureFixture[str]) -> None:
    assert ctl.main(["--config", "facetd.yaml", "runs"]) == ctl.NOT_UNDERSTOOD
    assert capsys.readouterr().err.startswith("facetctl: --config: no such option before a command;")


def test_an_option_that_doctor_has_not_is_told_without_a_daemon_as_well(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ctl, "_daemon_runs", lambda: False)
    assert ctl.main(["doctor", "--config", "facetd.yaml"]) == ctl.NOT_UNDERSTOOD
    assert capsys.readouterr().err == "facetctl: --config: one word too many; usage: doctor\n"


def test_an_option_that_a_job_has_not_is_told_with_how_that_job_is_used(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        ctl.main(["demo", "--tabel", "patterned"])
    told = capsys.readouterr().err
    assert "usage: facetctl demo" in told
    assert "--table {plain,patterned}" in told
    assert "facetctl demo: error: unrecognized arguments: --tabel patterned" in told


def test_a_console_says_of_every_word_of_the_shell_that_it_is_one() -> None:
    said_to_the_daemon = {name for c in every_command() for name in (c.name, *c.aliases)}
    assert set(OF_THE_SHELL) == {*ctl.OFFLINE, *ctl.OWN} - said_to_the_daemon


def test_a_reader_who_has_read_enough_of_the_help_sees_no_traceback() -> None:
    script = "import sys; sys.stdout.reconfigure(line_buffering=True); from daemon.ctl import main; main(['--help'])"
    command = f'{sys.executable} -c "{script}" | true'
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, check=False)
    assert done.stderr == ""


def test_whoever_reads_no_further_is_told_nothing_more(tmp_path: Path) -> None:
    """`facetctl runs | head`: the pipe is closed before the last line."""
    unread, closed = os.pipe()
    os.close(unread)
    command = [sys.executable, "-m", "daemon.ctl", "runs", "--runs", str(tmp_path)]
    with os.fdopen(closed, "wb") as pipe:
        env = {**os.environ, "PYTHONUNBUFFERED": "1"}
        done = subprocess.run(command, stdout=pipe, stderr=subprocess.PIPE, env=env, timeout=60, check=False)
    assert (done.returncode, done.stderr) == (ctl.NOT_DONE, b"")


def test_help_and_answers_are_no_wider_than_the_terminal(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "40")
    for words in (["--help"], ["stop", "--help"], ["teach", "--help"], ["commission", "--help"]):
        ctl.main(words)
        assert max(map(len, capsys.readouterr().out.splitlines())) <= 40, words
    seen = io.StringIO()
    monkeypatch.setattr(sys, "stdout", seen)
    answer = {"text": "what the daemon says, in a line of more than forty columns", "data": {}, "status": 0}
    ctl.show(answer, as_json=False)
    assert len(seen.getvalue().splitlines()) == 1, "another program reads it as it was said"
    seen.isatty = lambda: True
    ctl.show(answer, as_json=False)
    assert max(map(len, seen.getvalue().splitlines()[1:])) <= 40


def test_the_table_of_runs_fits_a_terminal_and_names_models_by_their_number(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = MadeRun(tmp_path / "20260102T030405Z")
    model = tmp_path / "taught.npz"
    model.write_bytes(b"taught")
    run.write("model", action="accept", version=3, labels=["cube"], file=run.log.keep(model))
    run.pick()
    run.pick("missed")
    run.close()
    assert ctl.main(["runs", "--runs", str(tmp_path)]) == ctl.DONE
    head, row = capsys.readouterr().out.splitlines()
    assert max(len(head), len(row)) <= 80
    assert row.split()[:5] == ["20260102T030405Z", "1", "of", "2", "1"]
    assert row.split()[-2:] == ["3", "yes"]


def test_what_a_model_knows_is_no_wider_than_the_terminal(tmp_path: Path) -> None:
    model = empty_model(load_facets())
    for name in ("plank_as_it_was_first_drawn", "plank_as_it_was_drawn_again"):
        model = learn_solid(model, drawn.solid("plank.stl", drawn.binary_stl(*drawn.box(25, 70, 90))), "plank", name)
    save(model, tmp_path / "model.npz")
    ours, theirs = os.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 60, 0, 0))
    command = [sys.executable, "-m", "daemon.ctl", "model", "show", str(tmp_path / "model.npz")]
    env = {name: value for name, value in os.environ.items() if name != "COLUMNS"}
    with os.fdopen(theirs, "wb") as terminal:
        subprocess.run(command, stdin=terminal, stdout=terminal, env=env, timeout=60, check=True)
        told = os.read(ours, 65536).decode().splitlines()
    assert any("plank_as_it_was_drawn_again" in line for line in told)
    assert max(map(len, told)) <= 60
    os.close(ours)


ALL_CLOSED, ONE_CLOSED = "<&- >&- 2>&-", ("<&-", ">&-", "2>&-")
SAID = ("status", "stop", "console", "script -", "--help")


@pytest.mark.parametrize(
    ("words", "closed"),
    few([*((words, ALL_CLOSED) for words in SAID), *((words, one) for one in ONE_CLOSED for words in SAID)], 6),
)
def test_a_closed_standard_file_is_no_fault(tmp_path: Path, words: str, closed: str) -> None:
    """A traceback, and once a hang of 20 s."""
    command = f"exec {sys.executable} -m daemon.ctl {words} {closed}"
    env = {**os.environ, "FACETD_SOCKET": str(tmp_path / "none"), "HOME": str(tmp_path)}
    ended = subprocess.run(["bash", "-c", command], capture_output=True, text=True, timeout=60, env=env, check=False)
    assert ended.returncode == {"--help": ctl.DONE, "stop": ctl.STOP_UNANSWERED}.get(words, ctl.NOT_UNDERSTOOD)
    assert "Traceback" not in ended.stderr
    assert "Exception" not in ended.stderr


def test_a_full_disk_under_what_is_written_is_told_in_one_line() -> None:
    with open("/dev/full", "w", encoding="utf-8") as full:
        ended = subprocess.run(
            [sys.executable, "-m", "daemon.ctl", "--help"],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            timeout=60,
            check=False,
        )
    assert ended.returncode == ctl.NOT_DONE
    assert ended.stderr == "facetctl: output cannot be written: No space left on device\n"


STALLS = """
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)
class Stalls:
    def find_spec(self, name, path=None, target=None):
        if name == sys.argv[1]:
            print("imports", flush=True)
            sys.stdin.read()
sys.argv[0] = "/usr/bin/facetctl"
sys.meta_path.insert(0, Stalls())
from daemon.ctl import main
del sys.argv[1]
sys.exit(main())
"""
"""As the console script does, but that it stops at one import until its stdin ends."""


@pytest.mark.parametrize("at", ["argparse", "daemon.frontends.client", "daemon.store.outside"])
def test_control_c_while_the_tool_is_imported_ends_it_by_the_signal_without_a_word(at: str) -> None:
    tool = subprocess.Popen(
        [sys.executable, "-c", STALLS, at, "status"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert tool.stdout is not None
    assert tool.stdout.readline() == "imports\n"
    tool.send_signal(signal.SIGINT)
    assert tool.communicate(timeout=60) == ("", "")
    assert tool.returncode == -signal.SIGINT


def test_control_c_stays_ignored_by_a_tool_that_was_started_so() -> None:
    """Behind `&` or nohup."""
    ignoring = STALLS.replace("signal.default_int_handler", "signal.SIG_IGN")
    command = [sys.executable, "-c", ignoring, "argparse", "--version"]
    tool = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert tool.stdout is not None
    assert tool.stdout.readline() == "imports\n"
    tool.send_signal(signal.SIGINT)
    told, complaint = tool.communicate(timeout=60)
    assert (tool.returncode, complaint) == (ctl.DONE, "")
    assert told.startswith("facetctl ")


def test_control_c_between_two_answers_of_the_daemon_stops_the_arm(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """What was said just before may move the arm, and nobody waits for its answer at that moment."""
    said: list[str] = []

    class Link:
        def __init__(self, _: object) -> None: ...

        def __enter__(self) -> Link:
            return self

        def __exit__(self, *_: object) -> None: ...

        def do(self, text: str, *_: object) -> dict[str, object]:
            said.append(text)
            raise KeyboardInterrupt

        def interrupt(self, _: object) -> str:
            said.append("stop")
            return "stopped by control-C"

    monkeypatch.setattr(ctl, "DaemonLink", Link)
    assert ctl.main(["pick", "cube"]) == ctl.NOT_DONE
    assert said == ["pick cube", "stop"]
    assert capsys.readouterr().err == "stopped by control-C\n"
