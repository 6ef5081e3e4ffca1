"""`facetctl arm replay`, from the command line: a transcript as it was sent, and what is none."""

from __future__ import annotations

import asyncio
import io
import os
import pty
import sys
from pathlib import Path

import pytest

from daemon import ctl
from daemon.cell.identify import Consult, ContactFindings, Person
from daemon.cli import arm
from daemon.cli.arm import ask_person
from daemon.store import folders

TRANSCRIPT = folders.HOUSE / "tests" / "data" / "introductions" / "two-dots-whole-words.jsonl"


def test_a_transcript_that_was_cut_off_in_its_last_line_is_replayed_as_far_as_it_goes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    whole = TRANSCRIPT.read_text()
    (tmp_path / "sent.jsonl").write_text(whole + whole.splitlines()[-1][:9])
    assert ctl.main(["arm", "replay", str(tmp_path / "sent.jsonl")]) == 0
    said = capsys.readouterr().out
    assert "is incomplete" in said
    assert "byte for byte" in said


@pytest.mark.parametrize(
    ("sent", "told"),
    [
        ("/dev/zero", "not a regular file"),
        ("none.jsonl", "No such file"),
        (str(folders.HOUSE / "LICENSE"), "line 1"),
    ],
)
def test_what_is_no_transcript_is_told_in_one_line(sent: str, told: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert ctl.main(["arm", "replay", sent]) == 2
    said = capsys.readouterr().err
    assert told in said
    assert said.count("\n") == 1


@pytest.mark.parametrize("typed", ["1,2,3", "a,b,c,d", "0,0,0,0", "650,0,190,6000", "nan,0,190,600", ""])
def test_lengths_that_are_none_are_told_with_what_they_should_be(
    typed: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        ctl.main(["arm", "identify", "nowhere", "--lengths", typed])
    assert "expected four lengths in mm, as in 650,0,190,600" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("about", "typed", "answered"),
    [
        ("move", "yes\n", "yes"),
        ("move", "ja\n", "yes"),
        ("power", "maybe\n\nn\n", "no"),
        ("move", "", ""),
        ("power-up", "load it\n", "load it"),
    ],
)
def test_a_yes_or_no_is_asked_until_it_is_one_and_the_controllers_question_is_answered_as_typed(
    about: str, typed: str, answered: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    reading, writing = os.pipe()
    os.write(writing, typed.encode())
    os.close(writing)
    with open(reading, buffering=1) as terminal:
        monkeypatch.setattr(sys, "stdin", terminal)
        asking = ask_person(Consult(about, "May I?"), asyncio.Event())  # type: ignore[arg-type]
        assert asyncio.run(asking) == answered
    assert ("`maybe` is not an answer" in capsys.readouterr().out) is ("maybe" in typed)


@pytest.mark.parametrize(("begun", "ended"), [(b"st", b"op\n"), (b"stop\n", b"")])
def test_a_stop_that_a_question_of_a_first_contact_comes_amid_or_behind_is_heard(
    begun: bytes, ended: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What had been typed was thrown away as the question came."""
    master, slave = pty.openpty()

    async def asking() -> bool:
        wants_stop = asyncio.Event()
        os.write(master, begun)
        asyncio.get_running_loop().call_later(0.1, os.write, master, ended)
        await asyncio.wait_for(ask_person(Consult("move", "May I?"), wants_stop), 10.0)
        return wants_stop.is_set()

    with open(slave, encoding="utf-8") as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        assert asyncio.run(asking())
    os.close(master)


@pytest.mark.parametrize("asked", [False, True])
def test_a_stop_typed_at_a_first_contact_stops_the_arm_whether_anything_is_asked_or_not(
    asked: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """While a joint was on its way nobody read it; as an answer it was neither a yes nor a no."""
    master, slave = pty.openpty()

    async def meeting(port: str, open_port: object, person: Person, *_: object) -> ContactFindings:
        if asked:
            asyncio.get_running_loop().call_later(0.1, os.write, master, b"STOP!\n")
            assert await person.answer(Consult("move", "May I?")) == ""
        else:
            os.write(master, b"sto\n")
        await asyncio.wait_for(person.wants_stop.wait(), 10.0)
        return ContactFindings()

    with open(slave, encoding="utf-8") as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        monkeypatch.setattr(arm, "identify", meeting)
        asyncio.run(arm._identify_controller("/dev/none", None, False, io.StringIO()))
    os.close(master)
    assert "neither" not in capsys.readouterr().out
