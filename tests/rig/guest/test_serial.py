"""In the guest: a morning of the serial line as it is in halls, its adapter a real device of the kernel's.

The cell goes on behind a USB adapter, named by udev, on a line with two stop bits: noise as a motor starts, the adapter
pulled out in mid-move and back under another name, a converter that echoes. The motion monitor is asked after each.
"""

from __future__ import annotations

import math
import os
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import loopback
import pytest
from beside import Person
from installed import (
    ADAPTER,
    BIN_MM,
    PART,
    STATE,
    command,
    configure,
    journal,
    picks_it,
    run,
    start_feeder,
    unit,
    until,
    write_down,
)

from daemon.store.runs import list_runs, read_run

SLOW, FULL = 1.0, 100.0
"""Percent: so slow that one step outlasts what befalls it."""
SLACK_S = 6.0


@pytest.fixture(scope="module")
def before(person: Person) -> dict[str, Any]:
    """What was so before this morning, of which the motion monitor was told nothing."""
    return person.do("judged") | {"sent": sent_moves()}


@pytest.fixture(autouse=True)
def judged(person: Person, before: dict[str, Any]) -> Iterator[None]:
    """Whatever befell the line, the arm did nothing that it must never do, and nothing twice."""
    yield
    told = person.do("judged")
    assert told["violations"][len(before["violations"]) :] == []
    assert told["motions"] - before["motions"] <= sent_moves() - before["sent"]


def sent_moves() -> int:
    """How many moves the daemon let go, by its own log."""
    return sum(record["kind"] == "move" for folder in list_runs(STATE / "runs") for record in read_run(folder).records)


def travel(percent: float) -> None:
    """How fast the arm goes from now on."""
    cursor = journal()[-1]["__CURSOR"]
    configure(percent, ("left",), str(ADAPTER), SLACK_S)
    assert run("systemctl", "reload", "facetd").returncode == 0
    until(lambda: [r for r in journal(cursor) if "The configuration is reloaded" in str(r.get("MESSAGE"))])


def may_move(person: Person) -> None:
    """As somebody does who looked at the cell: the arm may move again."""
    for text in ("resume", "enable"):
        done = command(text)
        assert done["status"] == 0, done
    person.do("allow", may=True)


def trouble() -> str:
    """What is told of the controller's line, or nothing."""
    return str(command("status")["troubles"].get("controller", ""))


def test_an_adapter_is_opened_by_the_name_that_udev_gives_it(person: Person) -> None:
    """The right camera has gone for good, and the configuration says so, too."""
    assert run("systemctl", "stop", "facetd", "feeder").returncode == 0
    until(lambda: run("modprobe", "-r", "v4l2loopback").returncode == 0)
    loopback.load("6")
    start_feeder("/dev/video6")
    person.do("plug", adapter="ARM")
    until(ADAPTER.exists)
    configure(FULL, ("left",), str(ADAPTER))
    assert run("systemctl", "start", "facetd").returncode == 0
    may_move(person)
    assert command("go survey")["status"] == 0


def test_one_device_alone_looks_from_two_places_and_picks(person: Person) -> None:
    write_down(f"one camera device alone, the arm behind a USB adapter: a {PART} picked in {picks_it(person):.0f} s")


def test_noise_as_a_motor_starts_costs_a_move_at_most(person: Person) -> None:
    travel(FULL)
    for kind, place in (("random", "home"), ("flips", "survey"), ("break", "home")):
        bursts = person.do("judged")["bursts"]
        person.do("noise", kind=kind)
        done = command(f"go {place}")
        write_down(f"noise as a motor starts ({kind}): {done['text']}")
        assert person.do("judged")["bursts"] == bursts + 1
        assert not person.do("tell")["moves"]
        if done["status"]:
            may_move(person)
        assert command(f"go {place}")["status"] == 0


def test_an_adapter_pulled_out_in_mid_move_comes_back_under_another_name(person: Person) -> None:
    travel(SLOW)
    was, cursor = os.readlink(ADAPTER), journal()[-1]["__CURSOR"]
    with ThreadPoolExecutor(1) as beside:
        going = beside.submit(command, "go bin")
        until(lambda: going.done() or person.do("tell")["moves"], every_s=0.05)
        assert not going.done(), going.result()
        person.do("pull")
        ended = going.result(timeout=60)
    assert ended["status"] != 0
    assert "the port is gone (unplugged" in ended["text"], ended
    assert "the port is gone (unplugged" in str(command("status")["fault"])
    person.do("plug", adapter="OTHER")
    until(lambda: any("OTHER" in path.name for path in ADAPTER.parent.glob("*")), every_s=0.1)
    assert person.do("tell")["moves"], "the step that it was told last"
    person.do("plug", adapter="ARM")
    back_s = time.monotonic()
    until(lambda: not person.do("tell")["moves"], every_s=0.1)
    write_down(f"adapter pulled out and in: arm at rest {time.monotonic() - back_s:.1f} s after it was back")
    until(lambda: not trouble())
    assert os.readlink(ADAPTER) != was
    rest = person.do("tell")
    assert math.dist(rest["gripper_mm"], BIN_MM) > 20.0
    assert [r for r in journal(cursor) if "OK again" in str(r.get("MESSAGE"))]
    refused = command("go home")
    assert refused["status"] != 0
    assert "resume" in refused["text"], refused
    assert unit("NRestarts") == "0"
    travel(FULL)
    may_move(person)
    assert command("go home")["status"] == 0


def test_a_converter_that_echoes_is_told_as_one_and_nothing_moves(person: Person) -> None:
    person.do("allow", may=False)
    person.do("echo", on=True)
    told = until(lambda: next((text for text in [trouble()] if "both echo" in text), ""))
    write_down(f"converter that echoes: {told}; {command('status')['fault']}")
    assert "\n" not in told
    motions = person.do("judged")["motions"]
    refused = [command(text) for text in ("resume", "enable", "go home")]
    write_down(f"converter that echoes: {[one['text'] for one in refused]}")
    assert refused[-1]["status"] != 0
    assert person.do("judged")["motions"] == motions
    person.do("echo", on=False)
    until(lambda: not trouble())
    may_move(person)
    for place in ("survey", "home"):
        assert command(f"go {place}")["status"] == 0
