"""Old words go on working: every row of the one table is typed, installed or sent, and does what today's name does."""

from __future__ import annotations

import asyncio
import tomllib
from pathlib import Path
from typing import Any

import msgspec
import pytest

from daemon import ctl
from daemon.commands import every_command
from daemon.console import aliases
from daemon.console.interpreter import Interpreter
from daemon.frontends.socket_server import SocketMessage
from tests.fakes.fake_context import FakeFrontend, fake_context

HOUSE = Path(__file__).resolve().parents[3]


@pytest.mark.parametrize(("old", "now"), aliases.COMMANDS.items())
def test_an_old_word_is_the_command_of_today_and_help_names_it(tmp_path: Path, old: str, now: str) -> None:
    interpreter = Interpreter(fake_context(tmp_path), every_command())

    async def said(text: str) -> str:
        return (await interpreter.interpret(text, FakeFrontend())).text

    assert asyncio.run(said(f"help {old}")) == asyncio.run(said(f"help {now}"))
    assert f"also: {old}" in asyncio.run(said(f"help {now}"))
    assert interpreter.moves(f"{old} left") == interpreter.moves(f"{now} left")


@pytest.mark.parametrize(("old", "now"), [
    *(((old,), (now,)) for old, now in aliases.JOBS.items()),
    *((old, (old[0], now)) for old, now in aliases.JOB_KINDS.items()),
])  # fmt: skip
def test_an_old_job_is_the_job_of_today(
    old: tuple[str, ...], now: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    assert aliases.job_words([*old, "--port", "old"]) == [*now, "--port", "old"]
    texts = []
    for words in (old, now):
        assert ctl.main([*words, "--help"]) == ctl.DONE
        texts.append(capsys.readouterr().out)
    assert texts[0] == texts[1]


@pytest.mark.parametrize("old", aliases.JOBS)
def test_an_old_job_typed_at_the_console_leads_to_the_shell(tmp_path: Path, old: str) -> None:
    interpreter = Interpreter(fake_context(tmp_path), every_command())
    told = asyncio.run(interpreter.interpret(old, FakeFrontend())).text
    assert f"`facetctl {aliases.JOBS[old]}`" in told


@pytest.mark.parametrize(("old", "now"), aliases.EXTRAS.items())
def test_an_old_extra_installs_what_its_name_today_does(old: str, now: str) -> None:
    extras: dict[str, Any] = tomllib.loads((HOUSE / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    assert extras[old] == [f"facetd[{now}]"]


@pytest.mark.parametrize(("old", "now"), aliases.UNITS.items())
def test_an_old_unit_s_name_is_an_alias_of_the_unit(old: str, now: str) -> None:
    assert f"Alias={old}" in (HOUSE / "deploy" / now).read_text().splitlines()


@pytest.mark.parametrize(("old", "now"), aliases.MESSAGE_KEYS.items())
def test_a_message_is_read_with_its_old_key(old: str, now: str) -> None:
    fields = {field.name for field in msgspec.structs.fields(SocketMessage)}
    assert {old, now} <= fields
