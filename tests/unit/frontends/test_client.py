"""The operator's end of the socket, against a daemon that says what it is told to, line by line."""

from __future__ import annotations

import base64
import os
import re
import socket
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

import pytest

from daemon import ctl
from daemon.cli.commission_steps import CommissioningDialogue, CommissioningPlan, CommissioningSession, NotProvenError
from daemon.frontends import client, console
from daemon.frontends.client import PIECE, DaemonLink, DaemonUnreachableError, StopUnansweredError, file_in_pieces
from tests.fakes.fake_daemon import DONE, FakeDaemon, Message, Say
from tests.fakes.person import piped
from tests.fakes.waiting import PATIENCE_S


class Scripted(FakeDaemon):
    """A daemon that answers each message with lines it was given; None: it hangs up."""

    def __init__(self, path: Path) -> None:
        self.answers: dict[str, list[Message] | None] = {}
        self.before_answering: Callable[[], object] = lambda: None
        self.before_each: Callable[[], object] = lambda: None
        super().__init__(path, self._answer_as_given)

    def _answer_as_given(self, message: Message, say: Say) -> None:
        self.before_answering()
        key = next(iter(message))
        lines = self.answers.get(str(message[key]), self.answers.get(key, []))
        if lines is None:
            raise ConnectionAbortedError
        for line in lines:
            self.before_each()
            say(line)


@pytest.fixture
def daemon(tmp_path: Path) -> Iterator[Scripted]:
    with Scripted(tmp_path / "s") as daemon:
        yield daemon


def test_what_is_said_meanwhile_is_shown_and_the_answer_given(daemon: Scripted) -> None:
    daemon.answers["look"] = [{"say": "first"}, {"notice": "unasked"}, {"stopped": "Stopped."}, {"say": "last"}, DONE]
    said: list[str] = []
    with DaemonLink(daemon.path) as link:
        assert link.do("look", "here", said.append) == DONE["done"]
    assert said == ["first", "Stopped.", "last"]
    (heard,) = daemon.heard
    assert (heard["do"], heard["frontend"], heard["asks"], heard["size"][1]) == ("look", "here", False, None)


def test_a_question_is_answered_by_its_number_and_where_nobody_is_asked_it_is_not(daemon: Scripted) -> None:
    daemon.answers |= {
        "forget": [{"ask": "sure?", "id": 3}],
        "answer": [DONE],
        "other": [{"ask": "sure?", "id": 4}, DONE],
    }
    with DaemonLink(daemon.path) as link:
        link.do("forget", "here", print, lambda question: f"to {question}")
        link.do("other", "here", print)
    assert daemon.heard[1] == {"answer": "to sure?", "id": 3}
    assert [message.get("asks") for message in daemon.heard] == [True, None, False]


def test_a_daemon_that_goes_away_is_told(daemon: Scripted) -> None:
    daemon.answers["look"] = None
    with DaemonLink(daemon.path) as link, pytest.raises(DaemonUnreachableError, match="ended before it answered"):
        link.do("look", "here", print)


def test_control_c_stops_and_the_command_is_waited_for_and_then_the_stop(daemon: Scripted) -> None:
    pressed = iter([KeyboardInterrupt()])
    daemon.answers |= {"go": [{"say": "going"}], "True": [DONE, {"stopped": "Stopped."}]}

    def say(text: str) -> None:
        said.append(text)
        for key in pressed:
            raise key

    said: list[str] = []
    with DaemonLink(daemon.path) as link:
        assert link.do("go", "here", say) == DONE["done"] | {"interrupted": True}
        assert said == ["going", "Stopped."]
        assert link.do("True", "here", said.append) == DONE["done"]
    assert daemon.heard[1] == {"interrupt": True}


@pytest.mark.parametrize("way", ["script", "console", "commission"])
def test_control_c_at_what_moves_nothing_keeps_back_what_was_to_follow_and_may_move(
    daemon: Scripted, way: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Pressed as a script trained, it was answered that nothing moves; then the script went on to its pick."""
    typed = open(piped("train\npick\n"), encoding="utf-8")  # noqa: SIM115
    monkeypatch.setattr("sys.stdin", typed)
    pressed = iter([KeyboardInterrupt()])

    def say(text: str, *_: object) -> None:
        print(text)
        if "learning" in text:
            for key in pressed:
                raise key

    daemon.answers |= {"train": [{"say": "learning"}], "True": [DONE, {"stopped": "Nothing moves."}]}
    daemon.answers |= {"pick": [DONE]}
    if way == "commission":
        with DaemonLink(daemon.path) as link, pytest.raises(NotProvenError, match="control-C was pressed at `train`"):
            CommissioningSession(
                link, CommissioningDialogue(say, lambda _: "y"), CommissioningPlan("9x6", 16.0, 4.0, "cube")
            ).do("train")
    else:
        monkeypatch.setattr(ctl, "_tell", say)
        monkeypatch.setattr(console, "_say", say)
        words = ["script", "-"] if way == "script" else ["console"]
        assert ctl.main(["--socket", str(daemon.path), *words]) == (ctl.NOT_DONE if way == "script" else ctl.DONE)
    assert [message.get("do") for message in daemon.heard] == ["train", None]
    assert "Nothing moves." in capsys.readouterr().out
    typed.close()


def test_what_a_pipe_brings_after_control_c_is_not_done_either(
    daemon: Scripted, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """It was written before anybody pressed that, and stood in the pipe, or came from another process."""
    read, write = os.pipe()
    os.write(write, b"train\n")
    pressed = iter([KeyboardInterrupt()])

    def say(text: str) -> None:
        print(text)
        if "learning" in text:
            for key in pressed:
                raise key
        if text == DONE["done"]["text"]:
            os.write(write, b"pick\n")
            os.close(write)

    daemon.answers |= {"train": [{"say": "learning"}], "True": [DONE, {"stopped": "Nothing moves."}], "pick": [DONE]}
    with open(read, encoding="utf-8") as typed:
        monkeypatch.setattr("sys.stdin", typed)
        monkeypatch.setattr(console, "_say", say)
        assert ctl.main(["--socket", str(daemon.path), "console"]) == ctl.DONE
    assert [message.get("do") for message in daemon.heard] == ["train", None]
    assert capsys.readouterr().out.endswith("not done: pick\n")


def test_options_and_an_interrupt_are_the_next_answers_of_their_kind(daemon: Scripted) -> None:
    daemon.answers |= {"complete": [{"notice": "x"}, {"options": ["stop", "status"]}],
                       "interrupt": [{"say": "x"}, {"stopped": "Nothing moves."}]}  # fmt: skip
    with DaemonLink(daemon.path) as link:
        assert link.options("st") == ["stop", "status"]
        assert link.interrupt(print) == "Nothing moves."


def test_hanging_up_is_heard_at_once_though_the_link_is_kept(daemon: Scripted) -> None:
    link = DaemonLink(daemon.path)
    link.close()
    assert daemon.hung_up.wait(PATIENCE_S)
    link.close()
    link.reconnect()
    daemon.answers["look"] = [DONE]
    assert link.do("look", "here", print) == DONE["done"]
    link.close()
    with pytest.raises(DaemonUnreachableError, match="closed the connection"):
        link.do("look", "here", print)


def test_a_stop_is_said_beside_whatever_is_waited_for_and_that_no_daemon_hears_it_is_told(daemon: Scripted) -> None:
    daemon.answers["stop"] = [DONE]
    link = DaemonLink(daemon.path)
    link.close()
    assert link.stop_separately("stop", "here", print) == DONE["done"]
    daemon.path.unlink()
    unheard = link.stop_separately("stop", "here", print)
    assert re.match("PRESS THE EMERGENCY STOP: the stop was not answered; no daemon answers", unheard["text"])
    assert unheard["status"] == ctl.STOP_UNANSWERED


def test_a_file_that_the_command_names_is_sent_in_pieces_and_no_other(daemon: Scripted, tmp_path: Path) -> None:
    mine = tmp_path / "mine.stl"
    mine.write_bytes(bytes(range(256)) * (PIECE // 128))
    daemon.answers |= {f"teach x --mesh {mine}": [{"fetch": str(mine)}], "file": []}
    pieces = list(file_in_pieces(str(mine), [f"teach x --mesh {mine}"]))
    assert [piece["more"] for piece in pieces] == [True, False]
    assert b"".join(base64.b64decode(piece["file"]) for piece in pieces) == mine.read_bytes()
    assert [set(piece) for piece in pieces] == [{"file", "more"}] * 2
    for commands in ([], ["teach x"], ["teach 'x"], [f"teach x # {mine}"]):
        ((refused),) = file_in_pieces(str(mine), commands)
        assert refused == {"no_file": f"{mine}: not sent: the command does not name this file"}
    (missing,) = file_in_pieces(str(tmp_path / "none"), [f"x {tmp_path / 'none'}"])
    assert "cannot be read" in missing["no_file"]
    (tmp_path / "empty").touch()
    assert list(file_in_pieces(str(tmp_path / "empty"), [f"x {tmp_path / 'empty'}"])) == [{"file": "", "more": False}]


def test_where_it_was_sought_is_said(tmp_path: Path) -> None:
    with pytest.raises(DaemonUnreachableError, match=rf"no daemon answers at {tmp_path}/none; start it"):
        DaemonLink(tmp_path / "none")
    with patch("daemon.frontends.client.socket_candidates", lambda: [tmp_path / "a", tmp_path / "b"]), \
            pytest.raises(DaemonUnreachableError, match=f"at {tmp_path}/a nor {tmp_path}/b;"):  # fmt: skip
        DaemonLink()


def test_the_first_that_answers_is_spoken_to(daemon: Scripted, tmp_path: Path) -> None:
    daemon.answers["look"] = [DONE]
    with (
        patch("daemon.frontends.client.socket_candidates", lambda: [tmp_path / "none", daemon.path]),
        DaemonLink() as link,
    ):
        assert link.do("look", "here", print) == DONE["done"]


class Keyboard:
    """In place of the real one: what is typed and shown."""

    def __init__(self, send: Callable[[dict[str, Any]], None], stop: Callable[[], None]) -> None:
        self.events = EVENTS
        self.events.clear()
        self.events.append("open")

    def show(self, text: str) -> None:
        self.events.append(text)

    def close(self) -> None:
        self.events.append("closed")


EVENTS: list[str] = []


@pytest.mark.parametrize("ends", [True, False])
def test_a_terminal_is_shown_between_its_beginning_and_its_end(daemon: Scripted, ends: bool) -> None:
    end = [{"terminal": False}] if ends else []
    daemon.answers["monitor"] = [{"show": "early"}, {"terminal": True}, {"show": "inside"}, *end, {"show": "x"}, DONE]
    with patch("daemon.frontends.keyboard.RawKeyboard", Keyboard), DaemonLink(daemon.path) as link:
        link.do("monitor", "here", print, lambda _: "")
    later = [] if ends else ["x"]
    assert ["open", "inside", *later, "closed"] == EVENTS


@pytest.fixture
def hung(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Scripted]:
    """A daemon that takes people in and says nothing, and people who do not wait so long for it."""
    monkeypatch.setattr(client, "STOP_ANSWER_S", 0.2)
    monkeypatch.setattr(client, "ALIVE_S", 0.3)
    with Scripted(tmp_path / "hung") as daemon:
        yield daemon


@pytest.mark.parametrize("word", ["stop", "HALT!", "disable", "abort"])
def test_a_stop_at_a_daemon_that_hangs_sends_to_the_emergency_stop_and_ends(
    hung: Scripted, word: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """facetctl stop said nothing for as long as the daemon hung."""
    assert ctl.main(["--socket", str(hung.path), word]) == ctl.STOP_UNANSWERED
    told = capsys.readouterr()
    assert "no answer to the stop" in told.out
    assert "PRESS THE EMERGENCY STOP" in told.out
    assert "PRESS THE EMERGENCY STOP" in told.err


def test_control_c_at_a_daemon_that_hangs_sends_to_the_emergency_stop_and_ends(
    hung: Scripted, capsys: pytest.CaptureFixture[str]
) -> None:
    hung.answers["pick"] = [{"say": "on my way"}]
    pressed = iter([KeyboardInterrupt()])

    def say(text: str) -> None:
        said.append(text)
        for key in pressed:
            raise key

    said: list[str] = []
    with DaemonLink(hung.path) as link, pytest.raises(StopUnansweredError, match="PRESS THE EMERGENCY STOP"):
        link.do("pick", "here", say)
    assert said == ["on my way", client.UNANSWERED]
    with DaemonLink(hung.path) as link, pytest.raises(StopUnansweredError, match="PRESS THE EMERGENCY STOP"):
        link.interrupt(print)
    assert client.UNANSWERED in capsys.readouterr().out


def test_a_stop_that_is_answered_late_is_shown_and_its_status_says_that_it_was_late(
    hung: Scripted, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(client, "ALIVE_S", 20.0)
    monkeypatch.setattr(client, "LATE_ANSWER_S", 20.0)
    hung.answers["stop"] = [DONE]
    told = threading.Event()
    hung.before_answering = lambda: told.wait(PATIENCE_S)
    said: list[str] = []

    def say(text: str) -> None:
        said.append(text)
        told.set()

    with DaemonLink(hung.path) as link:
        assert link.do("stop", "here", say) == {"text": "well", "data": {}, "status": ctl.STOP_UNANSWERED}
        assert link.do("stop", "here", say) == DONE["done"]
    assert said == [client.UNANSWERED]


def test_a_daemon_that_hangs_is_not_waited_for_as_long_as_one_that_works_on_the_stop(
    hung: Scripted, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It was waited for 5 s after the operator had been sent to the emergency stop."""
    with DaemonLink(hung.path) as link, pytest.raises(StopUnansweredError, match=r"for 0\.5 s; facetd hangs"):
        link.do("stop", "here", lambda _: None)
    monkeypatch.setattr(client, "ALIVE_S", 20.0)
    monkeypatch.setattr(client, "LATE_ANSWER_S", 20.0)
    hung.answers["complete"] = [{"options": []}, {"say": "it works"}, DONE]
    said: list[str] = []
    with DaemonLink(hung.path) as link:
        assert link.do("stop", "here", said.append)["status"] == ctl.STOP_UNANSWERED
    assert said == [client.UNANSWERED, "it works"]


@pytest.mark.parametrize("by", ["a word", "control-C"])
def test_a_daemon_that_waits_for_the_controller_is_waited_for_and_one_that_then_falls_silent_is_not(
    hung: Scripted, by: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The clock is about the daemon's silence: controllers whose prompts come late need longer than that."""

    def stop(link: DaemonLink) -> Any:
        return link.do("stop", "here", said.append) if by == "a word" else link.interrupt(said.append)

    said, asked = list[str](), "stop" if by == "a word" else "interrupt"
    signs: list[Any] = [{"stopping": True}, {"say": "waiting"}, *[{"stopping": True}] * 4]
    hung.answers[asked] = [*signs, {"stopped": "at rest"} if by == "control-C" else DONE]
    passed: list[float] = []  # the client's clock: a quarter of its patience before each sign
    hung.before_each = lambda: passed.append(client.STOP_ANSWER_S / 4)
    with monkeypatch.context() as simulated, DaemonLink(hung.path) as link:
        simulated.setattr(client, "time", SimpleNamespace(monotonic=lambda: sum(passed)))
        assert stop(link) == ("at rest" if by == "control-C" else DONE["done"])
    assert said == ["waiting"]
    hung.answers[asked], hung.before_each = signs, lambda: None
    with DaemonLink(hung.path) as link, pytest.raises(StopUnansweredError, match="PRESS THE EMERGENCY STOP"):
        stop(link)
    assert said == ["waiting", "waiting", client.UNANSWERED]


def test_a_command_that_is_no_stop_may_take_its_time(hung: Scripted) -> None:
    hung.answers["train"] = [DONE]
    waited = threading.Event()
    hung.before_answering = lambda: waited.wait(3 * client.STOP_ANSWER_S)
    said: list[str] = []
    with DaemonLink(hung.path) as link:
        assert link.do("train", "here", said.append) == DONE["done"]
    assert not said


def test_a_daemon_that_takes_nobody_in_is_not_waited_for_and_where_it_was_to_stop_the_arm_that_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its queue is full: connecting waited for ever."""
    monkeypatch.setattr(client, "CONNECT_S", 0.2)
    with socket.socket(socket.AF_UNIX) as full, socket.socket(socket.AF_UNIX) as first:
        full.bind(str(tmp_path / "full"))
        full.listen(0)
        first.connect(str(tmp_path / "full"))
        assert ctl.main(["--socket", str(tmp_path / "full"), "status"]) == ctl.NOT_UNDERSTOOD
        assert "it hangs" in capsys.readouterr().err
        assert ctl.main(["--socket", str(tmp_path / "full"), "stop"]) == ctl.STOP_UNANSWERED
    assert "PRESS THE EMERGENCY STOP" in capsys.readouterr().err


@pytest.mark.parametrize("word", ["stop", "disable"])
def test_without_a_daemon_a_stop_sends_to_the_emergency_stop(
    tmp_path: Path, word: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert ctl.main(["--socket", str(tmp_path / "none"), word]) == ctl.STOP_UNANSWERED
    assert "PRESS THE EMERGENCY STOP: the stop was not answered; no daemon answers" in capsys.readouterr().err


def test_a_stop_whose_daemon_ends_before_it_answers_sends_to_the_emergency_stop(daemon: Scripted) -> None:
    daemon.answers |= {"stop": None, "interrupt": None}
    with DaemonLink(daemon.path) as link, pytest.raises(StopUnansweredError, match="PRESS THE EMERGENCY STOP"):
        link.do("stop", "here", print)
    with DaemonLink(daemon.path) as link, pytest.raises(StopUnansweredError, match="PRESS THE EMERGENCY STOP"):
        link.interrupt(print)


def test_control_c_amid_a_message_is_a_line_of_its_own(daemon: Scripted) -> None:
    daemon.answers["interrupt"] = [{"stopped": "Nothing moves."}]
    with DaemonLink(daemon.path) as link:
        link.socket.sendall(b'{"file": "AAAA')
        link._partly_sent = True
        assert link.interrupt(print) == "Nothing moves."
