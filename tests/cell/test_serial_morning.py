"""A morning of the serial line as it is in cells, lived through by the daemon: noise as a motor starts, an adapter that
is pulled out in mid-pick and comes back under another name, a converter that echoes by itself.

Two stop bits no pty has: to whoever reads, the second one is a pause (tests/fakes/strange_controllers.py draws
controllers that lose what follows too closely).
"""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import yaml

from tests.fakes.adapter import BY_ID
from tests.fakes.running import Running
from tests.fakes.waiting import until

pytestmark = [pytest.mark.long, pytest.mark.timeout(1200)]


def status(daemon: Running) -> dict[str, object]:
    return daemon.do("status")["data"]


def befalls(daemon: Running, what: str) -> None:
    orders = daemon.folder / "adapter"
    with orders.open("a") as file:
        file.write(f"{what}\n")
    if daemon.process is not None:
        count, done = len(orders.read_text().split()), orders.with_suffix(".done")
        until(lambda: done.exists() and done.read_text() == str(count))


def may_move(daemon: Running) -> None:
    """As somebody does who reads what it says: again, until the arm may move."""

    def so() -> bool:
        daemon.do("resume")
        if status(daemon)["holding"] is None:
            daemon.do("holding no")
        return daemon.do("enable")["status"] == 0

    until(so)


def pick(daemon: Running) -> str:
    daemon.do("scatter cube")
    for _ in range(4):
        done = daemon.do("pick cube")
        if done["text"].startswith("picked"):
            return "picked"
        may_move(daemon)
        daemon.do("scatter cube")
    return str(done["text"])


@pytest.fixture
def begun() -> Iterator[Callable[[bool], Running]]:
    folder = Path(tempfile.mkdtemp(prefix="facetd-"))
    daemon = Running(folder, "", seed=7, time_scale=10.0)
    daemon.program = "tests.fakes.adapter"

    def begin(converter: bool) -> Running:
        if converter:
            truth = yaml.safe_load((folder / "simcell.yaml").read_text())
            truth["arm"]["manners"] = {"echo": False}
            (folder / "simcell.yaml").write_text(yaml.safe_dump(truth, sort_keys=False))
            befalls(daemon, "echo")
        daemon.start()
        daemon.teach((("cube", 3),))
        may_move(daemon)
        return daemon

    yield begin
    found = daemon.judged()
    daemon.kill()
    shutil.rmtree(folder, ignore_errors=True)
    assert found == [], "\n".join(found)


def test_a_noisy_line_and_an_adapter_that_comes_back_under_another_name(begun: Callable[[bool], Running]) -> None:
    daemon = begun(False)
    assert pick(daemon) == "picked"
    befalls(daemon, "noise")
    spoiled = daemon.do("go home")
    assert "arrived damaged" in spoiled["text"]
    may_move(daemon)
    assert pick(daemon) == "picked"
    before = os.readlink(daemon.folder / BY_ID)
    daemon.do("scatter cube cube")
    daemon.do("auto on 2")
    until(lambda: status(daemon)["state"] not in ("idle", "survey"))
    befalls(daemon, "pull")
    until(lambda: status(daemon)["fault"])
    assert not (daemon.folder / BY_ID).is_symlink()
    befalls(daemon, "plug")
    until(lambda: (daemon.folder / BY_ID).is_symlink())
    assert os.readlink(daemon.folder / BY_ID) != before
    may_move(daemon)
    assert pick(daemon) == "picked"


def test_a_converter_that_echoes_stands_in_for_a_controller_that_does_not(begun: Callable[[bool], Running]) -> None:
    assert pick(begun(True)) == "picked"
