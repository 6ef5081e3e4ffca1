"""In the guest: the daemon as a machine has it, from deploy/ and etc/ of the checkout, and what only a guest needs.

That is: the checkout's own Python in place of /opt/facetd (and leave for the daemon's user to read it), the loopback
cameras and the arm's port in the configuration, and patience with an emulated processor.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import beside
import yaml

from daemon.frontends.client import DaemonLink
from tests.fakes.daemon_process import write_own_calibration

CHECKOUT = Path(__file__).resolve().parents[3]
ETC = Path("/etc/facetd")
SOCKET = Path("/run/facetd/facetd.sock")
UNITS = Path("/etc/systemd/system")
STATE, STATE_MB = Path("/var/lib/facetd"), 200
"""What the daemon keeps: a disk of its own, small enough to be filled."""
PART = "triangular_prism"
"""Lies on a side, so that the approach sees two of its others."""
BIN_MM = (250.0, 410.0, -150.0)
"""As the configuration has it."""
ADAPTER = Path("/dev/serial/by-id/usb-QEMU_QEMU_USB_SERIAL_ARM-if00-port0")
"""What udev calls the adapter at the arm (tests/rig/line.py), whichever device it is."""
PATIENT = {"baud": 9600, "prompt_silence_s": 0.1, "typing_s": 20.0, "answer_s": 30.0, "resync_s": 5.0, "stall_s": 5.0}
DROP_IN = """\
[Service]
ExecStart=
ExecStart={facetd} --config /etc/facetd/facetd.yaml
Environment=PYTHONDONTWRITEBYTECODE=1 PYTHONPATH={checkout}
ProtectHome=no
PrivateTmp={private_tmp}
TimeoutStartSec=300
TimeoutStopSec=60
"""
"""PYTHONPATH: a checkout may share the virtual environment of another, whose daemon would run instead."""


def run(*words: str, timeout_s: float = 120.0) -> subprocess.CompletedProcess[str]:
    """A command; its output as text, whatever its status."""
    return subprocess.run(words, capture_output=True, text=True, timeout=timeout_s, check=False)


def install() -> None:
    """Unit, users, device rules, configuration."""
    for unit in (CHECKOUT / "deploy").glob("*.service"):
        shutil.copy(unit, UNITS)
    (UNITS / "facetd.service.d").mkdir()
    facetd = Path(sys.executable).with_name("facetd")
    (UNITS / "facetd.service.d/rig.conf").write_text(
        DROP_IN.format(facetd=facetd, checkout=CHECKOUT, private_tmp="no" if CHECKOUT.is_relative_to("/tmp") else "yes")
    )
    _let_everybody_read(Path(sys.executable).resolve(), CHECKOUT)
    run("groupadd", "--system", "facetd")
    run("useradd", "--system", "--gid", "facetd", "--home-dir", "/var/lib/facetd", "facetd")
    shutil.copytree(CHECKOUT / "etc", ETC, dirs_exist_ok=True)
    write_own_calibration(ETC)
    STATE.mkdir(exist_ok=True)
    mounted = run("mount", "-t", "tmpfs", "-o", f"size={STATE_MB}m", "tmpfs", str(STATE))
    assert mounted.returncode == 0, mounted.stderr
    configure(100.0)
    run("systemctl", "daemon-reload")


def configure(
    travel_pct: float, cameras: tuple[str, ...] = ("left", "right"), port: str = "/dev/ttyS1", slack_s: float = 20.0
) -> None:
    """Write the configuration; travel_pct: how fast the arm may go away from parts; slack_s: what a move may take more
    than it should."""
    configuration = yaml.safe_load((CHECKOUT / "etc/facetd.yaml").read_text())
    seen = {name: value for name, value in configuration["cameras"].items() if name not in ("left", "right")}
    configuration["cameras"] = {**seen, **{camera: camera for camera in cameras}, "fps": beside.FPS, "max_skew_ms": 60}
    configuration["arm"] |= {"port": port, "dialect": PATIENT}
    configuration["pick"] |= {
        "travel_pct": travel_pct,
        "settling": {"timeout_s": 30.0},
        "arrival": {"slack_s": slack_s},
    }
    configuration["vision"] = {**(configuration.get("vision") or {}), "budget_s": 60.0}
    configuration["pick"]["limits"]["max_look_age_s"] = 120
    configuration["health"] |= {"camera_silence_s": 20.0}
    configuration["log"] |= {"keep_free_mb": 5}
    (ETC / "facetd.yaml").write_text(yaml.safe_dump(configuration))


def start_feeder(*paths: str) -> None:
    """Light reaches the loopback cameras from now on, as the unit feeder."""
    done = run("systemd-run", "--unit=feeder", "--collect", f"--working-directory={Path.cwd()}",
        f"--setenv=PYTHONPATH={Path.cwd()}", sys.executable, str(Path(__file__).with_name("beside.py")),
        *paths)  # fmt: skip
    assert done.returncode == 0, done.stderr


def write_down(line: str) -> None:
    """A measured figure, for the end of the rig's output."""
    with Path("/results/measured").open("a") as lines:
        lines.write(line + "\n")


def picks_it(person: beside.Person) -> float:
    """A part is laid there and brought to the bin, nothing struck; the seconds that the pick took."""
    picked: dict[str, Any] = {}
    for _ in range(2):  # how often a pick succeeds is measured elsewhere
        person.do("lay", label=PART, rest=1)
        started_s = time.monotonic()
        picked = command(f"pick {PART}")
        took_s = time.monotonic() - started_s
        if picked["status"] == 0:
            break
        print(picked)
    told = person.do("tell")
    assert picked["status"] == 0, (picked, told)
    assert list(told["parts"].values()) == ["BIN"], told
    assert told["strikes"] == []
    return took_s


def _let_everybody_read(*paths: Path) -> None:
    """Open the folders above, in the guest's memory only: a developer's Python may live in a closed home."""
    for folder in {parent for path in paths for parent in path.parents}:
        folder.chmod(folder.stat().st_mode | 0o055)


def command(text: str) -> dict[str, Any]:
    """One command at the operators' socket: what the daemon answers, with `status` 0 when it was done."""
    with DaemonLink(SOCKET) as link:
        done = link.do(text, "one-shot", lambda _: None)
    answer: dict[str, Any] = {**done["data"], "text": done["text"], "status": int(done["status"])}
    return answer


def journal(since: str | None = None) -> list[dict[str, Any]]:
    """The daemon's journal records, oldest first, from a cursor on."""
    words = ["journalctl", "-u", "facetd", "-o", "json", "--no-pager", *([f"--after-cursor={since}"] if since else [])]
    return [json.loads(line) for line in run(*words).stdout.splitlines()]


def unit(what: str) -> str:
    """A property of the daemon's unit."""
    return run("systemctl", "show", "facetd", "--value", "-p", what).stdout.strip()


def until(what: Any, timeout_s: float = 150.0, every_s: float = 0.5) -> Any:
    """Wait for something to become true; gives it. AssertionError with the journal's end otherwise."""
    ends_s = time.monotonic() + timeout_s
    while time.monotonic() < ends_s:
        found = what()
        if found:
            return found
        time.sleep(every_s)
    told = "\n".join(str(record.get("MESSAGE")) for record in journal()[-15:])
    raise AssertionError(f"not within {timeout_s:g} s; the journal says:\n{told}")


def looks() -> Iterator[dict[str, Any]]:
    """The look records of every run."""
    for log in sorted((STATE / "runs").glob("*/run.jsonl")):
        yield from (record for line in log.read_text().splitlines() if (record := json.loads(line))["kind"] == "look")


def processor_s() -> float:
    """Processor time the daemon has used, s."""
    fields = Path(f"/proc/{unit('MainPID')}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
