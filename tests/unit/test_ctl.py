"""The tool's own words: what is no command or option is told as such, and nobody reading on is no fault."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from daemon import ctl


def test_an_option_that_there_is_not_is_told_and_not_said_to_the_daemon(capsys: pytest.CaptureFixture[str]) -> None:
    assert ctl.main(["--config", "facetd.yaml", "runs"]) == ctl.NOT_UNDERSTOOD
    assert capsys.readouterr().err.startswith("facetctl: --config: no such option before a command;")


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
