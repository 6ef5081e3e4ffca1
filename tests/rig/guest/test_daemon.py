"""In the guest: the whole daemon under real systemd, with real V4L2 devices and a real serial line.

One simulated cell for all tests, in the order of a day: start, teach, pick, trouble with cameras, clock, disk and
memory, hang. test_serial.py goes on with it, test_ending.py ends it.
"""

from __future__ import annotations

import re
import shutil
import statistics
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import loopback
import pytest
from beside import FPS, Person
from installed import (
    CHECKOUT,
    PART,
    STATE,
    command,
    journal,
    looks,
    picks_it,
    processor_s,
    run,
    start_feeder,
    unit,
    until,
    write_down,
)

from daemon.frontends.client import DaemonUnreachableError
from daemon.store.runs import check_wire, list_runs, read_run
from drivers.camera.find import list_devices
from drivers.camera.node import LINUX


def test_systemd_starts_the_daemon_and_hears_when_it_is_ready(person: Person) -> None:
    person.do("clear")
    until(lambda: len(list_devices(LINUX, full=False)[0]) == 2)
    started_s = time.monotonic()
    done = run("systemctl", "start", "facetd")
    assert done.returncode == 0, done.stderr + "\n".join(str(r.get("MESSAGE")) for r in journal())
    write_down(f"READY {time.monotonic() - started_s:.1f} s after systemctl start")
    assert unit("ActiveState") == "active"
    assert unit("StatusText").startswith("idle")
    assert unit("User") == "facetd"


def test_it_runs_without_privileges_and_sees_no_other_device() -> None:
    status = Path(f"/proc/{unit('MainPID')}/status").read_text()
    assert "CapEff:\t0000000000000000" in status
    assert "NoNewPrivs:\t1" in status


def test_the_unit_as_it_is_deployed_is_exposed_to_no_more_than_it_says() -> None:
    """Judged by the systemd that runs it, without the rig's own additions."""
    shutil.copy(CHECKOUT / "deploy/facetd.service", "/run/systemd/system/exposed.service")
    run("systemctl", "daemon-reload")
    judged = run("systemd-analyze", "security", "--no-pager", "exposed.service")
    found = re.search(r"Overall exposure level for exposed.service: ([\d.]+)", judged.stdout)
    assert found, judged.stderr
    write_down(f"exposure {found[1]}")
    assert float(found[1]) <= 1.5


def test_it_looks_through_real_devices(person: Person) -> None:
    seen = command("look")
    assert seen["status"] == 0, seen
    assert "/dev/video0 `left` GREY 640x480" in command("doctor")["text"]


def test_a_part_is_taught_from_what_real_devices_show(person: Person) -> None:
    assert command("enable")["status"] == 0
    assert command("go survey")["status"] == 0  # where only the table is behind the part
    taught: dict[str, Any] = {}
    for _ in range(3):  # a view that was not seen whole is shown again
        person.do("show", label=PART, view=0)
        taught = command(f"teach {PART}")
        if taught.get("kept"):
            break
    assert taught.get("kept"), taught
    person.do("clear")
    trained = command("train")
    assert trained["status"] == 0, trained["text"]
    assert command("status")["model"]["labels"] == [PART]


def test_it_picks_a_part_over_the_serial_line(person: Person) -> None:
    took_s = picks_it(person)
    seen = [look for look in looks() if look["cycle"]]
    ways, lights = ([look["seconds"][name] for look in seen] for name in ("total", "from_light"))
    skews = [abs(look["health"]["skew_ms"]) for look in seen]
    write_down(
        f"one {PART} picked in {took_s:.0f} s with {len(ways)} looks, all emulated: from mid-exposure to the answer "
        f"median {statistics.median(lights):.2f} s, worst {max(lights):.2f} s; from the arm's rest (two pairs at "
        f"{FPS:g} frames/s must agree) median {statistics.median(ways):.2f} s, worst {max(ways):.2f} s; "
        f"skew median {statistics.median(skews):.1f} ms, worst {max(skews):.1f} ms"
    )


def test_the_journal_has_fields_to_search_by() -> None:
    records = journal()
    ends = [r for r in records if r.get("OUTCOME")]
    assert ends, [r.get("MESSAGE") for r in records]
    end = ends[-1]
    assert end["SYSLOG_IDENTIFIER"] == "facetd"
    assert end["PART"] == PART
    assert int(end["CYCLE"]) >= 1
    assert len(end["MESSAGE_ID"]) == 32
    same = run("journalctl", "-o", "json", f"MESSAGE_ID={end['MESSAGE_ID']}").stdout.splitlines()
    assert same


def test_idle_it_leaves_the_processor_alone() -> None:
    before_s, began_s = processor_s(), time.monotonic()
    time.sleep(12)
    share = (processor_s() - before_s) / (time.monotonic() - began_s)
    write_down(f"idle with cameras open: {share:.1%} of one emulated processor")


def test_cameras_that_vanish_in_mid_cycle_stop_it_while_the_console_answers(person: Person) -> None:
    person.do("lay", label=PART, rest=1)
    cursor = journal()[-1]["__CURSOR"]
    with ThreadPoolExecutor(1) as beside:
        pick = beside.submit(command, f"pick {PART}")
        until(lambda: pick.done() or person.do("tell")["moves"], every_s=0.05)
        assert not pick.done(), pick.result()  # on its way to the next look
        run("systemctl", "stop", "feeder")
        until(pick.done, every_s=0.2)
        ended = pick.result()
    assert ended["status"] != 0
    assert "no frame any more from the left and the right camera" in ended["text"], ended
    assert not person.do("tell")["moves"]
    assert command("status")["fault"]
    refused = command(f"pick {PART}")
    assert refused["status"] != 0
    assert "resume" in refused["text"], refused
    until(lambda: [r for r in journal(cursor) if "cameras: left camera" in str(r.get("MESSAGE"))])


def test_a_module_that_is_removed_and_comes_back_under_other_numbers_is_found_again_by_itself() -> None:
    cursor = journal()[-1]["__CURSOR"]
    until(lambda: run("modprobe", "-r", "v4l2loopback").returncode == 0)
    until(lambda: "there is: no video device at all" in command("status")["troubles"].get("cameras", ""))
    loopback.load("6,7")
    start_feeder("/dev/video6", "/dev/video7")
    until(lambda: [r for r in journal(cursor) if "OK again" in str(r.get("MESSAGE"))])
    assert "/dev/video6 `left`" in command("doctor")["text"]
    assert unit("ActiveState") == "active"
    assert unit("NRestarts") == "0"
    assert command("resume")["status"] == 0


def test_a_clock_that_jumps_is_told_and_stops_nothing() -> None:
    for seconds, way in ((86_400, "forward"), (-86_400, "back")):
        assert run("date", "--set", f"@{time.time() + seconds:.3f}").returncode == 0, way
        seen = command("look")
        assert seen["status"] == 0, (way, seen)
        until(lambda way=way: any(_jumps()[0 if way == "forward" else 1 :]))
    assert [round(jump, -2) for jump in _jumps()] == [86_400, -86_400]
    assert unit("NRestarts") == "0"
    assert not command("status")["fault"]
    numbers = [record["seq"] for record in read_run(list_runs(STATE / "runs")[-1]).records]
    assert numbers == list(range(len(numbers)))
    write_down("clock a day forward and back: looks go on, told in the log, nothing lost")


def _jumps() -> list[float]:
    run_now = list_runs(STATE / "runs")[-1]
    return [float(record["jump_s"]) for record in read_run(run_now).records if record["kind"] == "clock"]


def test_a_disk_that_fills_up_is_told_and_the_arm_obeys_all_the_same(person: Person) -> None:
    assert command("enable")["status"] == 0
    filler = STATE / "filler"
    filled = run("dd", "if=/dev/zero", f"of={filler}", "bs=1M")
    assert "No space left" in filled.stderr, filled.stderr
    assert command("look")["status"] == 0
    told = until(lambda: next((t for t in command("status")["troubles"].values() if "space" in t), ""))
    assert command("go home")["status"] == 0
    assert command("stop")["status"] == 0
    assert not person.do("tell")["moves"]
    filler.unlink()
    until(lambda: not any("space" in text for text in command("status")["troubles"].values()))
    assert command("resume")["status"] == 0
    assert command("look")["status"] == 0
    now = read_run(list_runs(STATE / "runs")[-1])
    assert now.skipped == ()
    lost = [record["lost"] for record in now.records if record.get("lost")]
    assert lost, "what could not be written is counted where writing goes on"
    write_down(f"disk full: told ({told}), arm moved and stopped, {sum(lost)} records counted as lost, none torn")


def test_a_daemon_that_runs_into_its_memory_limit_comes_back_and_asks(person: Person) -> None:
    assert command("enable")["status"] == 0
    person.do("lay", label=PART, rest=1)
    restarts, cut = int(unit("NRestarts")), list_runs(STATE / "runs")[-1]
    known = {*read_run(cut).skipped, *check_wire(cut)}
    with ThreadPoolExecutor(1) as beside:
        pick = beside.submit(command, f"pick {PART}")
        until(lambda: pick.done() or person.do("tell")["moves"], every_s=0.05)
        assert not pick.done(), pick.result()
        limit = ["systemctl", "set-property", "--runtime", "facetd"]
        assert run(*limit, "MemoryHigh=infinity", "MemoryMax=24M", "MemorySwapMax=0").returncode == 0
        until(lambda: unit("Result") == "oom-kill" or int(unit("NRestarts")) > restarts, every_s=0.2)
        assert run(*limit, "MemoryMax=600M").returncode == 0
        with pytest.raises((OSError, DaemonUnreachableError)):
            pick.result(timeout=60)
    until(lambda: unit("ActiveState") == "active", 280.0, 2.0)
    before = person.do("tell")
    status = command("status")
    assert "restarted" in status["fault"], status
    assert not status["enabled"]
    assert command(f"pick {PART}")["status"] != 0
    time.sleep(1.0)
    later = person.do("tell")
    assert not later["moves"]
    assert later["gripper_mm"] == pytest.approx(before["gripper_mm"], abs=0.1)
    assert all("torn" in text for text in {*read_run(cut).skipped, *check_wire(cut)} - known)
    for text in ("resume", "holding no", "enable", "go home"):
        assert command(text)["status"] == 0, text
    write_down("memory limit in mid-pick: killed, started again, asks, nothing moved, no line lost but the last")


def test_a_daemon_that_hangs_is_killed_by_the_watchdog_and_started_again() -> None:
    before, restarts = unit("MainPID"), int(unit("NRestarts"))
    run("kill", "-STOP", before)
    hung_s = time.monotonic()
    until(lambda: int(unit("NRestarts")) > restarts and unit("ActiveState") == "active", 280.0, 2.0)
    write_down(
        f"a daemon that hangs is killed and READY again after {time.monotonic() - hung_s:.0f} s (WatchdogSec=30)"
    )
    assert unit("MainPID") != before
    assert (
        any("watchdog" in str(r.get("MESSAGE")).lower() for r in journal())
        or "watchdog" in run("journalctl", "-u", "facetd", "--no-pager").stdout.lower()
    )
    assert command("status")["status"] == 0
