"""A file of the operator's reaches the daemon whole, the named one and no other; a missing one is an answer."""

from __future__ import annotations

import asyncio
import hashlib
import os
import socket
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from daemon.config import ConsoleSettings
from daemon.console.interpreter import CommandResult, ConsoleCommand, Frontend, Interpreter
from daemon.frontends.client import LONGEST_FILE, DaemonLink
from daemon.frontends.rights import Rights
from daemon.frontends.socket_server import SocketServer
from tests.fakes.fake_context import fake_context
from tests.fakes.waiting import PATIENCE_S


async def digest(_: Any, words: list[str], frontend: Frontend) -> CommandResult:
    """Fetch a file and say what it is; with two words the second is fetched as if the first had been asked for."""
    content = await frontend.fetch(words[-1].replace("%", " "))
    return CommandResult(hashlib.sha256(content).hexdigest(), {"bytes": len(content)})


async def no_interrupt(_: str, __: bool) -> str:
    return ""


def said(folder: Path, use: Callable[[Path], Any]) -> Any:
    """What `use` gives, with a daemon that knows the command `digest` at folder/s."""

    async def serve() -> Any:
        console = Interpreter(fake_context(folder), [ConsoleCommand("digest", "digest FILE", "", digest)])
        server = SocketServer(folder / "s", Rights(ConsoleSettings()), console, no_interrupt)
        await server.open()
        try:
            return await asyncio.wait_for(asyncio.to_thread(use, folder / "s"), PATIENCE_S)
        finally:
            await server.close()

    return asyncio.run(serve())


def do(text: str) -> Callable[[Path], Any]:
    def use(path: Path) -> Any:
        with DaemonLink(path) as link:
            return link.do(text, "test", print)

    return use


@pytest.mark.parametrize("size", [0, 1, 32 * 1024, 32 * 1024 + 1, 1_000_003])
def test_a_file_of_any_size_arrives_whole(tmp_path: Path, size: int) -> None:
    content = os.urandom(size)
    (tmp_path / "part.stl").write_bytes(content)
    done = said(tmp_path, do(f"digest {tmp_path}/part.stl"))
    assert (done["text"], done["data"]["bytes"]) == (hashlib.sha256(content).hexdigest(), size)


def test_a_missing_file_is_one_line_and_the_next_command_is_heard(tmp_path: Path) -> None:
    def use(path: Path) -> Any:
        with DaemonLink(path) as link:
            return [link.do(text, "test", print) for text in (f"digest {tmp_path}/none", "help digest")]

    missing, after = said(tmp_path, use)
    assert (missing["status"], missing["text"]) == (2, f"{tmp_path}/none: cannot be read: No such file or directory")
    assert after["status"] == 0


def test_the_daemon_gets_no_file_that_the_operator_did_not_name(tmp_path: Path) -> None:
    secret = tmp_path / "a secret"
    secret.write_bytes(b"secret")
    refused = said(tmp_path, do(f"digest {str(secret).replace(' ', '%')}"))
    assert refused["status"] == 2
    assert "not sent: the command does not name this file" in refused["text"]


def test_a_file_too_large_is_not_read_and_not_taken_before_it_is_all_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with (tmp_path / "huge").open("wb") as file:
        file.truncate(LONGEST_FILE + 1)
    unread = said(tmp_path, do(f"digest {tmp_path}/huge"))
    assert (unread["status"], "huge: too large: 8 MB" in unread["text"]) == (2, True)
    with (tmp_path / "large").open("wb") as file:
        file.truncate(1_000_001)
    monkeypatch.setattr("daemon.frontends.socket_server.LONGEST_FILE", 1_000_000)
    done = said(tmp_path, do(f"digest {tmp_path}/large"))
    assert done["status"] == 1
    assert "1 MB at most" in done["text"]


def test_an_operator_who_goes_away_instead_of_sending_it_ends_the_command(tmp_path: Path) -> None:
    def use(path: Path) -> Any:
        with socket.socket(socket.AF_UNIX) as raw:
            raw.settimeout(10)
            raw.connect(str(path))
            raw.sendall(b'{"do": "digest x"}\n')
            assert b"fetch" in raw.recv(4096)
        return threading.active_count()

    said(tmp_path, use)


def test_what_is_no_base64_is_answered_and_the_daemon_goes_on(tmp_path: Path) -> None:
    def use(path: Path) -> Any:
        with socket.socket(socket.AF_UNIX) as raw:
            raw.settimeout(10)
            raw.connect(str(path))
            raw.sendall(b'{"do": "digest x"}\n')
            assert b"fetch" in raw.recv(4096)
            raw.sendall(b'{"file": "%%%"}\n')
            told = raw.recv(4096)
            raw.sendall(b'{"no_file": "x: gone"}\n')
            return told, raw.recv(4096)

    told, after = said(tmp_path, use)
    assert b"not a message" in told
    assert b"x: gone" in after


@pytest.mark.parametrize(("size", "taken"), [(10, True), (11, False)])
def test_a_file_as_large_as_it_may_be_is_taken_and_one_byte_more_is_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, size: int, taken: bool
) -> None:
    monkeypatch.setattr("daemon.frontends.socket_server.LONGEST_FILE", 10)
    (tmp_path / "file").write_bytes(bytes(size))
    assert (said(tmp_path, do(f"digest {tmp_path / 'file'}"))["status"] == 0) is taken
