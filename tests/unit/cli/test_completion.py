"""`facetctl completion`: Tab, pressed in the shells themselves. What the daemon would offer is played."""

from __future__ import annotations

import os
import pty
import re
import select
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from daemon.ctl import main
from daemon.store import folders

SHELLS = {"bash": ["bash", "--norc", "--noprofile", "-i"], "zsh": ["zsh", "-f", "-i"]}
PLAYED = """#!/bin/sh
[ "$2" = of ] || exec {python} -m daemon.ctl "$@"
shift 2
echo "$#: $*|" >>asked
printf 'cube\\npyramid\\n'
"""
"""A facetctl that keeps what it was asked for words, and knows two."""
SEQUENCE = re.compile(r"\x1b(\[[0-9;?]*[ -/]*[@-~]|[^\[])")
PATIENCE_S = 30.0
Tab = Callable[[str, str], str]


@pytest.fixture(params=SHELLS)
def tab(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Tab]:
    """Type a line and Tab; gives what the shell shows up to `until`."""
    if shutil.which(request.param) is None:
        pytest.skip(f"this machine has no {request.param}")
    played = tmp_path / "facetctl"
    played.write_text(PLAYED.format(python=sys.executable))
    played.chmod(0o755)
    (tmp_path / "part.stl").touch()
    handles, shells = pty.openpty(), SHELLS[request.param]
    surroundings = {"PATH": f"{tmp_path}:{os.environ['PATH']}", "PYTHONPATH": str(folders.HOUSE), "HOME": str(tmp_path),
                    "TERM": "dumb", "PS1": "> "}  # fmt: skip
    process = subprocess.Popen(
        shells, stdin=handles[1], stdout=handles[1], stderr=handles[1], cwd=tmp_path, env=surroundings,
        start_new_session=True,
    )  # fmt: skip
    os.close(handles[1])

    def sees(until: str) -> str:
        seen, deadline = "", time.monotonic() + PATIENCE_S
        while not re.search(until, seen):
            assert time.monotonic() < deadline, f"{until!r} did not come; what came: {seen!r}"
            if select.select([handles[0]], [], [], 0.1)[0]:
                seen = SEQUENCE.sub("", seen + os.read(handles[0], 4096).decode("utf-8", "replace"))
        return seen

    def typed(line: str, until: str) -> str:
        os.write(handles[0], b"\x15" + line.encode() + b"\t\t")
        return sees(until)

    os.write(handles[0], f'eval "$(facetctl completion {request.param})"; echo rea"dy"\n'.encode())
    sees("ready")
    yield typed
    process.kill()
    process.wait()
    os.close(handles[0])


def test_a_shells_tab_offers_commands_options_files_and_what_the_daemon_knows(tab: Tab, tmp_path: Path) -> None:
    tab("facetctl recog", "facetctl recognise")
    tab("facetctl review --aga", "--against")
    tab("facetctl teach x --mesh pa", "part.stl")
    seen = tab("facetctl pick cu", "pick cube")
    assert "unrecognized" not in seen
    tab("facetctl forget cube py", "cube pyramid")
    asked = (tmp_path / "asked").read_text().split("\n")
    assert {"2: pick cu|", "3: forget cube py|"} <= set(asked)


def test_without_a_daemon_tab_offers_the_words_that_are_always_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def offered(*words: str) -> list[str]:
        assert main(["--socket", str(tmp_path / "none"), "completion", "of", *words]) == 0
        return capsys.readouterr().out.split()

    assert offered("model", "") == ["list", "use"]
    assert offered("models", "u") == ["use"]
    assert offered("pick", "") == offered("forget", "cube", "") == offered("nonsense", "") == []
