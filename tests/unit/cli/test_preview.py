"""The preview: a page with a moving picture, for this machine only."""

from __future__ import annotations

import http.client
import json
import threading
from collections.abc import Iterator

import pytest

from daemon.cell.hardware import EXPECTED_ERRORS
from daemon.cell.no_arm import CellError
from daemon.cli.preview import Preview, Shot


class Show:
    """A preview in a thread, its pictures counted; `broken` makes the next ones fail."""

    def __init__(self) -> None:
        self.shots, self.broken = 0, False
        self.preview = Preview(self.shoot, 0, 50.0, EXPECTED_ERRORS)
        self.thread = threading.Thread(target=self.preview.serve)
        self.thread.start()
        self.port = int(self.preview.address.rstrip("/").rpartition(":")[2])

    def shoot(self) -> Shot:
        if self.broken:
            raise CellError("left camera /dev/video0 is gone")
        self.shots += 1
        return b"\xff\xd8picture %d\xff\xd9" % self.shots, {"text": "all well", "troubles": []}

    def ask(self, path: str, host: str = "127.0.0.1") -> tuple[int, bytes]:
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=5)
        try:
            connection.request("GET", path, headers={"Host": f"{host}:{self.port}"})
            answer = connection.getresponse()
            return answer.status, answer.read(400)
        finally:
            connection.close()


@pytest.fixture
def show() -> Iterator[Show]:
    running = Show()
    yield running
    running.preview.close()
    running.thread.join(5)
    assert not running.thread.is_alive()


def test_the_preview_is_a_page_with_a_moving_picture_and_words(show: Show) -> None:
    assert b"/stream.mjpg" in show.ask("/")[1]
    status, body = show.ask("/stream.mjpg")
    assert status == 200
    assert body.count(b"--picture") >= 2
    assert b"Content-Length: " in body
    assert show.ask("/picture.jpg")[1].startswith(b"\xff\xd8picture")
    assert json.loads(show.ask("/status.json")[1])["text"] == "all well"
    assert show.ask("/elsewhere")[0] == 404


def test_the_preview_answers_this_machine_only(show: Show) -> None:
    assert show.preview.address.startswith("http://127.0.0.1:")
    assert show.ask("/", host="evil.example")[0] == 403


def test_trouble_with_the_cameras_is_said_in_the_preview_and_passes(show: Show) -> None:
    show.ask("/picture.jpg")
    show.broken = True
    for _ in range(100):
        said = json.loads(show.ask("/status.json")[1])
        if said["troubles"]:
            break
    assert said["troubles"] == ["left camera /dev/video0 is gone"]
    show.broken = False
    assert show.preview.after(show.shots, 3.0) is not None
