"""Following a daemon that comes, goes and comes back, and saying nothing to it that could move anything."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from daemon.commands import every_command
from daemon.config import ConsoleSettings
from daemon.console.interpreter import CommandResult, Frontend, Interpreter
from daemon.console.notices import NoticeLevel
from daemon.dashboard import follow
from daemon.dashboard.follow import RunFollower, follow_daemon
from daemon.dashboard.state import DashboardState
from daemon.frontends.rights import Rights
from daemon.frontends.socket_server import SocketServer
from tests.fakes.fake_context import fake_context
from tests.fakes.made_run import MadeRun
from tests.fakes.status_daemon import StatusDaemon
from tests.fakes.waiting import until_so


def test_it_outlives_the_daemon_and_only_ever_asks_how_things_stand(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("STATUS_S", "RECONNECT_S", "READ_S"):
        monkeypatch.setattr(follow, name, 0.02)
    first, second = (MadeRun(tmp_path / f"2026010{k}T000000Z") for k in (1, 2))
    first.pick()

    async def story() -> None:
        now = DashboardState()
        following = asyncio.create_task(follow_daemon(now, RunFollower(now), tmp_path / "sock"))
        await until_so(lambda: now.daemon is None)
        daemon = StatusDaemon(tmp_path / "sock", first.folder)
        await daemon.open()
        await until_so(lambda: now.daemon is not None and len(now.picks) == 1)
        daemon.tell("TROUBLE cameras: unplugged")
        await until_so(lambda: "TROUBLE cameras: unplugged" in now.lines)
        await daemon.close()
        await until_so(lambda: now.daemon is None)
        assert len(now.picks) == 1  # what was last seen stays
        again = StatusDaemon(tmp_path / "sock", second.folder)
        await again.open()
        await until_so(lambda: now.run == second.folder.name)
        second.pick("missed")
        await until_so(lambda: now.picks[-1]["outcome"] == "missed")
        following.cancel()
        said = [message.get("do", "notices") for message in (*daemon.heard, *again.heard)]
        assert set(said) == {"notices", "status places"}
        await again.close()

    asyncio.run(story())
    first.close()
    second.close()


def test_whoever_may_only_look_may_watch(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """All that is ever said is heard at a frontend that lets nothing move: the page asks for no more than that."""
    monkeypatch.setattr(follow, "STATUS_S", 0.02)
    context = fake_context(tmp_path)
    rights = Rights(ConsoleSettings())
    monkeypatch.setattr(rights, "of", lambda peer: "look")
    frontends: list[str] = []

    async def nothing_moves(who: str, about_to_move: bool) -> str:
        return "Nothing moves."

    async def story() -> None:
        now, console = DashboardState(), Interpreter(context, every_command())
        interpret = console.interpret

        async def heard(text: str, frontend: Frontend) -> CommandResult:
            frontends.append(frontend.may)
            return await interpret(text, frontend)

        monkeypatch.setattr(console, "interpret", heard)
        server = SocketServer(tmp_path / "sock", rights, console, nothing_moves)
        await server.open()
        following = asyncio.create_task(follow_daemon(now, RunFollower(now), tmp_path / "sock"))
        await until_so(lambda: bool(now.daemon))
        context.notices.tell("missed: cube", NoticeLevel.OUTCOMES)
        await until_so(lambda: "missed: cube" in now.lines)
        following.cancel()
        await server.close()

    asyncio.run(story())
    assert set(frontends) == {"look"}


def test_a_record_that_names_a_file_elsewhere_shows_no_file(tmp_path: Path) -> None:
    (tmp_path / "secret").write_bytes(b"x")
    now = DashboardState()
    run = RunFollower(now)
    made = MadeRun(tmp_path / "20260101T000000Z")
    run.go_to(made.folder)
    now.pictures = {7: {"left": "../secret", "right": "/etc/passwd"}}
    assert run.picture(7, "left") is None
    assert run.picture(7, "right") is None
    made.look("look")
    made.log.settle()
    run.read()
    (seq,) = [seq for seq in now.pictures if seq != 7]
    shown = run.picture(seq, "left")
    assert shown is not None
    assert shown.startswith(b"\x89PNG")
    made.close()
