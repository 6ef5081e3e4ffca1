"""The live page in a browser, from its own server: shown, changing as it happens, away and back with the daemon."""

from __future__ import annotations

import asyncio
import json
import socket
import sys
import threading
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from daemon.dashboard import server
from daemon.dashboard.follow import RunFollower
from daemon.dashboard.state import DashboardState
from tests.fakes.in_time import lived
from tests.fakes.made_run import MadeRun, part
from tests.fakes.status_daemon import StatusDaemon
from tests.fakes.waiting import PATIENCE_S, until

pytestmark = pytest.mark.slow
uvicorn = pytest.importorskip("uvicorn", reason="the extra `dashboard` is not installed")
pytest.importorskip("starlette", reason="the extra `dashboard` is not installed")


@pytest.fixture
def port(tmp_path: Path) -> Iterator[int]:
    """A page served in a thread, following tmp_path/sock."""
    from daemon.dashboard.server import LOOPBACK, app

    config = uvicorn.Config(app(tmp_path / "sock"), log_level="error", timeout_graceful_shutdown=1, lifespan="on")
    server = uvicorn.Server(config)
    with socket.create_server((LOOPBACK, 0)) as listening, ThreadPoolExecutor(1) as pool:
        pool.submit(server.run, [listening])
        until(lambda: server.started)
        yield int(listening.getsockname()[1])
        server.should_exit = True


@pytest.fixture
def do() -> Iterator[Callable[[Any], None]]:
    """Does something in a loop that goes on in a thread of its own."""
    loop = asyncio.new_event_loop()
    thread = threading.Thread(target=loop.run_forever)
    thread.start()
    yield lambda work: asyncio.run_coroutine_threadsafe(work, loop).result(PATIENCE_S)
    asyncio.run_coroutine_threadsafe(_end_others(), loop).result(PATIENCE_S)
    loop.call_soon_threadsafe(loop.stop)
    thread.join()
    loop.close()


async def _end_others() -> None:
    others = asyncio.all_tasks() - {asyncio.current_task()}
    for task in others:
        task.cancel()
    await asyncio.gather(*others, return_exceptions=True)


def test_a_person_watches_a_pick_and_the_daemons_restart(
    port: int, tmp_path: Path, browser: Any, do: Callable[[Any], None]
) -> None:
    made = MadeRun(tmp_path / "20260101T000000Z")
    made.pick(label="pyramid")
    made.log.settle()

    def text() -> str:
        return str(browser.find_element("tag name", "body").text)

    daemon = StatusDaemon(tmp_path / "sock", made.folder)
    do(daemon.open())
    browser.get(f"http://127.0.0.1:{port}/")
    until(lambda: "pyramid" in text() and "2 of 3 picked" in text())
    until(lambda: browser.execute_script("return [...document.images].filter(i => i.naturalWidth).length") == 2)
    assert len(browser.find_elements("css selector", ".camera polygon.facet")) == 2
    made.cycle += 1
    made.look("approach", part("pentagonal_prism"), stop=1)
    until(lambda: "pentagonal_prism" in text())
    reasons = "return [...document.querySelectorAll('td.k-cause')].map((cell) => cell.textContent)"
    assert browser.execute_script(reasons) == [""], "a pick that went well needs none"
    made.pick(stopped="operator_no", why="gone; then the operator refused: home")
    until(lambda: browser.execute_script(reasons) == ["gone; then the operator refused: home", ""])
    made.look("approach", part("pentagonal_prism"), stop=1)
    until(lambda: "pentagonal_prism" in text())
    do(daemon.close())
    until(lambda: "No daemon answers" in text())
    assert "pentagonal_prism" in text()
    again = StatusDaemon(tmp_path / "sock", made.folder)
    do(again.open())
    until(lambda: "idle" in text())
    assert browser.get_log("browser") == []
    browser.get("about:blank")
    do(again.close())
    made.close()


def test_a_person_watches_a_tray_fill(port: int, tmp_path: Path, browser: Any, do: Callable[[Any], None]) -> None:
    made = MadeRun(tmp_path / "20260101T000000Z", pictures=False)
    made.log.settle()
    daemon = StatusDaemon(tmp_path / "sock", made.folder)
    tray = [
        {"name": f"tray.{k}", "part": "cube", "status": "free", "off_mm": None, "off_deg": None,
         "outline": [[90.0 * k, 0.0], [90.0 * k + 50, 0.0], [90.0 * k + 50, 50.0], [90.0 * k, 50.0]]}
        for k in range(1, 13)
    ]  # fmt: skip
    do(daemon.open())
    browser.get(f"http://127.0.0.1:{port}/")
    until(lambda: "idle" in browser.find_element("tag name", "body").text)
    assert not browser.find_element("id", "places").is_displayed(), "the cell has no places"

    def drawn() -> Any:
        return browser.execute_script(
            "return [...document.querySelectorAll('g.place')].map((g) => g.getAttribute('class'))"
        )

    daemon.status["each_place"] = tray
    until(lambda: drawn() == ["place empty"] * 12)
    daemon.status["each_place"] = [
        {**tray[0], "status": "seen right"},
        {**tray[1], "status": "off"},
        {**tray[2], "status": "to be looked at"},
        *tray[3:],
    ]
    until(lambda: drawn() == ["place right", "place wrong", "place unsure", *["place empty"] * 9])
    assert "1 seen right ✓" in browser.find_element("id", "places").text
    assert browser.execute_script("return document.documentElement.scrollWidth <= window.innerWidth")
    assert browser.get_log("browser") == [], "the page's policy lets all of it be drawn"
    browser.get("about:blank")
    do(daemon.close())
    made.close()


def test_a_person_sees_the_arm_move_in_space(
    port: int, tmp_path: Path, browser: Any, do: Callable[[Any], None]
) -> None:
    pytest.importorskip("plotly", reason="the extra `plots` is not installed")
    made = MadeRun(tmp_path / "20260101T000000Z", pictures=False)
    made.cycle = 1
    made.write("cycle_start", cycle=1, target=None)
    made.arrive(np.eye(4), [0.1, 0.7, -2.2, 0.1, -1.0, 0.0], "joint", "survey")
    made.log.settle()
    daemon = StatusDaemon(tmp_path / "sock", made.folder)
    do(daemon.open())
    browser.get(f"http://127.0.0.1:{port}/space")
    if browser.execute_script("return document.createElement('canvas').getContext('webgl') === null"):
        pytest.skip("this browser has no WebGL")

    def arm() -> Any:
        return browser.execute_script(
            "const drawn = document.getElementById('space').data || [];"
            "return (drawn.find((t) => t.name === 'arm') || {}).x"
        )

    def text() -> str:
        return str(browser.find_element("id", "moment").text)

    until(lambda: "arrived: survey" in text() and arm() is not None)
    before = arm()
    made.arrive(np.eye(4), [0.5, 0.7, -2.2, 0.1, -1.0, 0.0], "joint", "bin")
    until(lambda: "arrived: bin" in text() and arm() != before)
    do(daemon.close())
    until(lambda: "No daemon answers" in browser.find_element("tag name", "body").text)
    assert [entry for entry in browser.get_log("browser") if entry["level"] == "SEVERE"] == []
    browser.get("about:blank")
    made.close()


def test_without_the_library_the_3d_page_says_how_to_add_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "plotly.offline", None)
    assert "plots" in server.plotly_js()


def test_a_record_of_another_version_is_a_line_on_the_3d_page(tmp_path: Path) -> None:
    now = DashboardState()
    run = RunFollower(now)
    run.folder = tmp_path
    now.recorded({"kind": "look", "seq": 1, "world_from_cyclopean": "nowhere"})
    assert "another version" in asyncio.run(server.space_now(now, run))["trouble"]


def test_it_answers_this_machine_alone_and_takes_nothing(port: int) -> None:
    def ask(path: str, **how: Any) -> int:
        try:
            request = urllib.request.Request(f"http://127.0.0.1:{port}{path}", **how)
            with urllib.request.urlopen(request, timeout=5) as answer:
                return int(answer.status)
        except urllib.error.HTTPError as error:
            return error.code

    assert ask("/") == 200
    assert ask("/", headers={"Host": "evil.example"}) == 400
    assert ask("/", method="POST", data=json.dumps({"do": "enable"}).encode()) == 405
    assert ask("/picture/0/..%2f..%2fetc%2fpasswd") == 404


def test_a_picture_that_was_told_of_and_is_not_written_yet_is_waited_for(
    tmp_path: Path,
) -> None:
    now = DashboardState()
    now.pictures = {7: {"left": "left.png"}}
    run = RunFollower(now)
    run.folder = tmp_path

    async def story() -> tuple[bytes | None, bytes | None]:
        asking = asyncio.create_task(server.picture_once_written(run, 7, "left"))
        await asyncio.sleep(server.PICTURE_S - 1.0)
        assert not asking.done()
        (tmp_path / "left.png").write_bytes(b"a picture")
        return await asking, await server.picture_once_written(run, 7, "right")

    assert lived(story()) == (b"a picture", None), "what nobody told of is not waited for"
