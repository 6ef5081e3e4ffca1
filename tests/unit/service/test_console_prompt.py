"""`facetctl console` outlives the daemon it spoke with: it says so, finds the next one, repeats nothing."""

from __future__ import annotations

import json
import shutil
import socket
import sys
import tempfile
import threading
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest

from daemon.doors import prompt
from daemon.doors.client import DaemonLink, NotThereError


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
                for k, said in zip(range(lines), iter(file.readline, b""), strict=False):
                    self.heard.append(json.loads(said)["do"])
                    if k < lines - 1:
                        file.write(json.dumps({"done": {"text": "well", "data": {}, "status": 0}}).encode() + b"\n")
                        file.flush()

        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        return thread


@pytest.fixture
def place() -> Iterator[Path]:
    folder = Path(tempfile.mkdtemp(prefix="facetd-prompt-"))
    yield folder / "sock"
    shutil.rmtree(folder)


def test_a_daemon_killed_amid_a_command_is_told_and_the_next_one_found_without_saying_anything_twice(
    place: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    played = Played(place)
    first = played.live(2)
    lives = [first]

    def typed(_: str) -> str:
        step = next(steps)
        if step == "look" and len(lives) == 1:
            lives.append(played.live(3))
        return step

    def script() -> Iterator[str]:
        yield "status"
        yield "pick"
        first.join(5)
        yield "go home"
        yield "look"
        yield "status"
        yield "quit"

    steps = script()
    monkeypatch.setattr("builtins.input", typed)
    monkeypatch.setattr(sys, "stdin", SimpleNamespace(isatty=lambda: True))
    monkeypatch.setattr(prompt, "_prepare", lambda _: None)
    link = DaemonLink(place)
    assert prompt.converse(link) == 0
    link.close()
    told = capsys.readouterr().out
    assert played.heard == ["status", "pick", "status"]
    assert told.index("ended before it answered") < told.index("no daemon answers") < told.index("answers again")


def test_a_script_ends_where_its_daemon_does(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    played = Played(place)
    played.live(1)
    monkeypatch.setattr("builtins.input", lambda _: "pick")
    monkeypatch.setattr(sys, "stdin", SimpleNamespace(isatty=lambda: False))
    link = DaemonLink(place)
    with pytest.raises(NotThereError):
        prompt.converse(link)
    link.close()
