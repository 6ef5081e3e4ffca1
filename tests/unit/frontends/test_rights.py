"""Who is let in at the socket, and what each may do: the table of rights.py, and every command held against it."""

from __future__ import annotations

import asyncio
import grp
import os
import socket
from pathlib import Path

import pytest

from daemon.commands import every_command
from daemon.config import ConsoleSettings
from daemon.console.interpreter import ConsoleCommand, Interpreter
from daemon.frontends.rights import FrontendError, Peer, Rights, peer_of
from daemon.store.folders import HOUSE
from tests.fakes.fake_context import FakeFrontend, fake_context

NOBODY = 54_321
FIRST, SECOND = sorted(grp.getgrall(), key=lambda group: group.gr_gid)[1:3]
COMMANDS = every_command()
STOPS = ("stop", "disable", "abort", "pause")


def peer(*groups: int, user: int = NOBODY) -> Peer:
    return Peer(1, user, frozenset(groups))


def test_each_kind_of_user_may_what_the_table_says() -> None:
    rights = Rights(ConsoleSettings(group=FIRST.gr_name, look_group=SECOND.gr_name))
    assert rights.mode == 0o666
    assert rights.of(peer(user=0)) == "all"
    assert rights.of(peer(user=os.geteuid())) == "all"
    assert rights.of(peer(FIRST.gr_gid)) == "all"
    assert rights.of(peer(FIRST.gr_gid, SECOND.gr_gid)) == "all"
    assert rights.of(peer(SECOND.gr_gid)) == "look"
    assert rights.of(peer(NOBODY)) is None
    assert rights.of(peer()) is None


def test_where_nobody_may_only_look_the_kernel_lets_in_none_but_the_group() -> None:
    rights = Rights(ConsoleSettings())
    assert (rights.mode, rights.group) == (0o660, os.getegid())
    assert rights.of(peer(os.getegid())) == "all"
    assert rights.of(peer(NOBODY)) is None


def test_a_group_that_is_not_there_is_named_with_its_key() -> None:
    with pytest.raises(FrontendError, match=r"console\.look_group: there is no group 'nosuchgroup'"):
        Rights(ConsoleSettings(look_group="nosuchgroup"))


def test_who_is_at_the_other_end_is_the_kernels_word() -> None:
    here, there = socket.socketpair()
    with here, there:
        found = peer_of(here)
    assert (found.process, found.user) == (os.getpid(), os.geteuid())
    assert found.groups >= {os.getegid(), *os.getgroups()}


@pytest.mark.parametrize("command", COMMANDS, ids=lambda command: command.name)
def test_who_may_only_look_moves_nothing_changes_nothing_and_stops(command: ConsoleCommand, tmp_path: Path) -> None:
    context = fake_context(tmp_path)
    ran: list[str] = []

    async def run(*_: object) -> object:
        ran.append(command.name)
        raise asyncio.CancelledError

    spied = [ConsoleCommand(c.name, c.usage, c.summary, run, c.grade, most=None) for c in COMMANDS]  # type: ignore[arg-type]
    frontend = FakeFrontend(may="look")
    try:
        answer = asyncio.run(Interpreter(context, spied).interpret(command.name, frontend))
    except asyncio.CancelledError:
        assert command.grade == "look" or command.name in STOPS
    else:
        assert command.grade != "look"
        assert (answer.status, "is read-only" in answer.text, ran) == (1, True, [])


def test_what_moves_or_changes_has_a_grade_that_says_so() -> None:
    grades = {command.name: command.grade for command in COMMANDS}
    looking = {name for name, grade in grades.items() if grade == "look"}
    known = {"doctor", "bundle", "untaught", "views", "status", "where", "try"}
    assert known <= looking
    look = next(command for command in COMMANDS if command.name == "look")
    assert (look.does([]), look.does(["around"])) == ("look", "move")
    for name in ("pick", "auto", "go", "hand", "enable", "resume", "confirm", "robot"):
        assert grades[name] == "move", name
    for name in ("teach", "forget", "train", "accept", "rollback", "reload"):
        assert grades[name] == "change", name


def test_the_guide_says_the_same() -> None:
    guide = (HOUSE / "deploy" / "README.md").read_text(encoding="utf-8")
    for word in ("console.group", "console.look_group", "may: look", "RuntimeDirectoryMode"):
        assert word in guide
