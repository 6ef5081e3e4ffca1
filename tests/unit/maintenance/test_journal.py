"""What the journal and the operator are told of a run, in sentences that say each thing once."""

import socket
from pathlib import Path

import pytest

from daemon.maintenance import journal


class Nowhere:
    """A run log that keeps nothing."""

    def record(self, kind: str, /, **fields: object) -> None:
        """Nothing is kept."""


@pytest.mark.parametrize(
    ("kind", "fields", "sentence"),
    [
        ("fault", {"code": "operator_stop", "text": "stopped by ann"}, "STOPPED by ann"),
        ("fault", {"code": "camera_lost", "text": "no pair"}, "FAULT no pair"),
        ("fault", {"code": "found_moving", "text": "at work: it was stopped"}, "FAULT at work: it was stopped"),
        ("cycle_end", {"cycle": 2, "outcome": "fault", "label": None, "why": "no pair"}, "cycle 2: fault: no pair"),
        ("cycle_end", {"cycle": 3, "outcome": "picked", "label": "cube", "why": ""}, "cycle 3: picked cube"),
        ("cycle_start", {"cycle": 4, "target": None}, "cycle 4: looking for any part"),
    ],
)
def test_the_journal_says_each_thing_once(
    monkeypatch: pytest.MonkeyPatch, kind: str, fields: dict[str, object], sentence: str
) -> None:
    told: list[tuple[str, str]] = []
    monkeypatch.setattr(journal, "write", lambda kind, text, priority, **more: told.append((kind, text)))
    noticed: list[str] = []
    journal.JournalledLog(Nowhere(), lambda kind, text, who: noticed.append(text)).record(kind, **fields)
    assert told == [(kind, sentence)]
    assert noticed == ([sentence] if kind == "fault" else [])


def test_a_log_that_cannot_be_written_keeps_nobody_from_hearing_of_a_fault(monkeypatch: pytest.MonkeyPatch) -> None:
    class Full:
        def record(self, kind: str, /, **fields: object) -> None:
            raise OSError(28, "No space left on device")

    told: list[str] = []
    monkeypatch.setattr(journal, "write", lambda kind, text, priority, **more: told.append(text))
    noticed: list[str] = []
    with pytest.raises(OSError, match="No space"):
        journal.JournalledLog(Full(), lambda kind, text, who: noticed.append(text)).record(
            "fault", code="a", text="a: b"
        )
    assert told == noticed == ["FAULT a: b"]


def test_a_journal_that_is_gone_loses_what_is_told_meanwhile_and_nothing_after(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    said: list[str] = []

    def say(kind: str, text: str, *_: object) -> None:
        if text == "lost":
            raise ValueError("I/O operation on closed file")
        said.append(text)

    monkeypatch.setattr(journal, "_write", say)
    monkeypatch.setattr(journal, "_JOURNAL", journal.JournalThread())
    for text in ("first", "lost", "last"):
        journal.write("trouble", text)
    journal.flush(5.0)
    assert said == ["first", "last"]


def test_a_word_to_systemd_never_raises(monkeypatch: pytest.MonkeyPatch) -> None:
    def none_left(*_: object) -> None:
        raise OSError(24, "Too many open files")

    monkeypatch.setenv("NOTIFY_SOCKET", "/nonexistent/notify")
    journal.notify("STATUS=o\ud800dd")
    monkeypatch.setattr("socket.socket", none_left)
    journal.notify("STOPPING=1")


def test_whatever_a_name_holds_the_readiness_socket_hears_one_state_a_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener:
        listener.bind(str(tmp_path / "n"))
        monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "n"))
        journal.notify("WATCHDOG=1", "STATUS=stopped by x\nSTOPPING=1\r\x1b[2J")
        assert listener.recv(4096) == b"WATCHDOG=1\nSTATUS=stopped by x STOPPING=1 ?[2J"


def test_what_is_told_on_a_terminal_does_not_steer_it(capsys: pytest.CaptureFixture[str]) -> None:
    journal.write("trouble", "first\nsecond \x1b]0;title\x07\x9b")
    journal.flush(5)
    assert capsys.readouterr().err == "facetd: first\nsecond ^[]0;title^G?\n"
