"""The whole daemon with a line beside it in the simulated cell: signals down to what is typed at the controller."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from daemon.frontends.client import DaemonLink
from tests.fakes import waiting
from tests.fakes.running import Running
from tests.fakes.set_downs import drawing

pytestmark = pytest.mark.slow

SIGNALS = """signals:
  press_ready: {number: 1001, role: permit_pick}
  start: {number: 1003, role: cycle_start}
  line_reset: {number: 1004, role: reset}
  busy: {number: 1, role: busy}
  done: {number: 2, role: part_done}
  fault: {number: 3, role: fault}
"""


@pytest.fixture(scope="module")
def daemon(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    folder = tmp_path_factory.mktemp("sig")
    running = Running(folder, f"log: {{keep_free_mb: 0}}\n{SIGNALS}", 7, 20.0)
    running.start()
    (folder / "cube.stl").write_bytes(drawing("cube"))
    try:
        for text in ("enable", f"teach cube --mesh {folder}/cube.stl mm", "train"):
            assert running.do(text)["status"] == 0
        yield running
        assert running.judged() == []
    finally:
        running.kill()


def until(daemon: Running, holds: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
    def status() -> dict[str, Any] | None:
        said: dict[str, Any] = daemon.do("status")["data"]
        return said if holds(said) else None

    found = waiting.until(status, "such a status")
    assert found is not None
    return found


def typed(daemon: Running) -> str:
    lines = [json.loads(line) for file in daemon.runs.glob("*/wire.jsonl") for line in file.read_text().splitlines()]
    return "".join(line["bytes"] for line in lines if line["way"] == "out")


def test_a_line_asks_for_parts_takes_note_of_them_holds_the_arm_and_is_told_of_a_stop(daemon: Running) -> None:
    refused = daemon.do("pick cube")
    assert refused["status"] == 1
    assert "`signal find press_ready` at a console" in refused["text"], "nothing is assumed of how an input is read"

    def person(question: str) -> str:
        daemon.do(f"switch press_ready {'on' if ' on by' in question else 'off'}")
        return "y"

    with DaemonLink(daemon.folder / "facetd.sock") as link:
        found = link.do("signal find press_ready", "bench", lambda _: None, person)
    assert found["data"] == {"form": "LISTR SIG({number})", "off": "0", "on": "-1"}

    daemon.do("scatter cube")
    assert daemon.do("auto on signal")["status"] == 0
    until(daemon, lambda s: s["waits_for"] == "the permit to pick (press_ready)" and s["packml"] == "Idle")
    daemon.do("switch press_ready on")
    until(daemon, lambda s: s["waits_for"] == "the cycle start (start)")
    assert daemon.do("status")["data"]["picked"] == 0
    daemon.do("switch start on")
    until(daemon, lambda s: s["packml"] == "Execute" and s["signals"]["busy"])
    held = until(daemon, lambda s: bool(s["signals"]["done"]))
    assert (held["packml"], held["signals"]["busy"], held["picked"]) == ("Complete", False, 1), held["last"]
    daemon.do("switch start off")
    until(daemon, lambda s: s["signals"]["done"] is False and s["packml"] == "Idle")

    daemon.do("scatter cube")
    daemon.do("switch start on")
    until(daemon, lambda s: s["state"] in ("stop_n", "looking", "estimating"))
    daemon.do("switch press_ready off")
    until(daemon, lambda s: s["waits_for"] == "the permit to pick (press_ready)" and s["packml"] == "Execute")
    at_rest = daemon.do("status")["data"]["state"]
    sent = typed(daemon).count("DO MOVE")
    until(daemon, lambda s: typed(daemon).count("LISTR SIG(1001)") > 20)
    assert typed(daemon).count("DO MOVE") == sent, f"it moved in {at_rest} without a permit"
    daemon.do("stop")
    told = until(daemon, lambda s: bool(s["signals"]["fault"]))
    assert (told["packml"], told["signals"]["busy"]) == ("Aborted", False)
    daemon.do("switch line_reset on")
    until(daemon, lambda s: typed(daemon).count("LISTR SIG(1004)") > 3)
    assert daemon.do("status")["data"]["fault"] is not None, "a person stopped it: the line does not let it go on"
    assert "RESET" not in typed(daemon)
    taken_back = "\x15"  # as a stop came while it was being typed
    lines = {text.partition(taken_back)[0] for text in typed(daemon).split("\r")}
    assert {text for text in lines if "SIGNAL" in text} <= {
        "DO SIGNAL -1,-2,-3", "DO SIGNAL 1", "DO SIGNAL -1", "DO SIGNAL -1,2", "DO SIGNAL 2", "DO SIGNAL -2",
        "DO SIGNAL -1,3", "DO SIGNAL 3", "DO SIGNAL -1,-2,3", "DO SIGNAL 1,-2,-3", "DO SIGNAL -3",
    }  # fmt: skip
    daemon.do("resume")
    until(daemon, lambda s: s["signals"]["fault"] is False)
    assert daemon.end() == 0
    assert "3" in typed(daemon).split("SIGNAL")[-1], "the end of facetd leaves the fault output on"
