"""In the guest: the end of the day."""

from __future__ import annotations

import math
import subprocess
import sys
import time
from pathlib import Path

from beside import Person
from installed import ADAPTER, BIN_MM, command, configure, journal, run, unit, until, write_down


def test_sigterm_in_mid_motion_stops_the_arm_first_and_ends_in_time(person: Person) -> None:
    cursor = journal()[-1]["__CURSOR"]
    configure(4.0, ("left",), str(ADAPTER))  # so slow that the move outlasts everything here
    assert run("systemctl", "reload", "facetd").returncode == 0
    until(lambda: [r for r in journal(cursor) if "The configuration is reloaded" in str(r.get("MESSAGE"))])
    assert command("enable")["status"] == 0
    tool = str(Path(sys.executable).with_name("facetctl"))
    went = subprocess.Popen([tool, "go", "bin"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    until(lambda: person.do("tell")["moves"], every_s=0.05)
    stopping_s = time.monotonic()
    stopping = subprocess.Popen(["systemctl", "stop", "facetd"])
    until(lambda: not person.do("tell")["moves"], every_s=0.02)
    rest_s = time.monotonic()
    rest = person.do("tell")
    stopping.wait(120)
    ended_s = time.monotonic()
    time.sleep(1.0)
    later = person.do("tell")
    assert max(abs(a - b) for a, b in zip(rest["gripper_mm"], later["gripper_mm"], strict=True)) < 0.1
    assert math.dist(rest["gripper_mm"], BIN_MM) > 20.0
    assert unit("Result") == "success"
    assert went.wait(120) != 0
    write_down(
        f"SIGTERM in mid-motion: arm at rest {rest_s - stopping_s:.1f} s after `systemctl stop` was typed, "
        f"daemon ended after {ended_s - stopping_s:.1f} s"
    )
