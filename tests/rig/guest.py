"""Boot the guest for one job and bring back what it said. Host side; knows qemu, nothing of cameras or the daemon.

A job is a command line, run in the guest by systemd as the unit rig-job.service, once the machine is up; then the
guest powers off. It sees this machine's / read-only under a memory file system: what it writes is gone, except in
/results.
"""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

HERE = Path(__file__).resolve().parent
CHECKOUT = HERE.parents[1]
FOLDER = Path(os.environ.get("FACETD_RIG", "/var/tmp/facetd-rig"))

TARGET = """\
[Unit]
Requires=basic.target rig-job.service
After=basic.target rig-job.service
AllowIsolate=yes
"""
SERVICE = """\
[Unit]
Requires=sysinit.target systemd-udevd.service
After=sysinit.target basic.target systemd-udev-trigger.service
[Service]
Type=oneshot
WorkingDirectory={checkout}
Environment=OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 HOME=/root PYTHONDONTWRITEBYTECODE=1 COLUMNS=120
StandardOutput=tty
StandardError=tty
TTYPath=/dev/ttyS0
ExecStart=/bin/bash -c {command}
ExecStopPost=/bin/bash -c 'echo $EXIT_STATUS >/results/status; sync; systemctl poweroff -ff'
"""


NEEDLESS = (
    "systemd-timesyncd.service", "systemd-binfmt.service", "proc-sys-fs-binfmt_misc.automount", "timers.target",
    "modprobe@dm_mod.service", "modprobe@efi_pstore.service", "modprobe@fuse.service", "modprobe@loop.service",
    "sys-fs-fuse-connections.mount", "avahi-daemon.socket", "systemd-update-utmp.service", "systemd-sysusers.service",
    "systemd-journal-flush.service", "systemd-random-seed.service",
)  # fmt: skip
"""Of the machine's own units, those that no job needs; each costs seconds, emulated. Its generators go, too."""


class RigError(Exception):
    """The guest could not be made ready or did not come back; the message is one line for the person who ran it."""


@dataclass(frozen=True)
class Outcome:
    """What became of a job: exit status of its command, seconds from power-on to power-off, everything it printed."""

    status: int
    seconds: float
    console: str


def prepare() -> None:
    """Lay in kernel, modules and packages (cached). Raises RigError where this machine cannot."""
    done = subprocess.run([HERE / "prepare.sh", FOLDER], stderr=subprocess.PIPE, text=True, check=False)
    if done.returncode:
        raise RigError(done.stderr.strip() or f"rig: prepare.sh ended with status {done.returncode}")


def write_layer(layer: Path, command: str, files: dict[str, str]) -> None:
    """The job's own files over the machine's: its unit, an empty fstab, and what the job brings (path -> text)."""
    unit = SERVICE.format(checkout=CHECKOUT, command=shlex.quote(command.replace("%", "%%").replace("$", "$$")))
    ours = {
        "etc/systemd/system/rig-job.target": TARGET,
        "etc/systemd/system/rig-job.service": unit,
        "etc/fstab": "",
        "etc/tmpfiles.d/tmp.conf": "q /tmp 1777 root root -\n",  # Debian's would empty the host's /tmp, file by file
        "etc/machine-id": "0123456789abcdef0123456789abcdef\n",
    }
    generators = [f"system-generators/{path.name}" for path in Path("/lib/systemd/system-generators").glob("*")]
    for masked in (*generators, *(f"system/{unit}" for unit in NEEDLESS)):
        (link := layer / "etc/systemd" / masked).parent.mkdir(parents=True, exist_ok=True)
        link.symlink_to("/dev/null")
    for path, text in (ours | files).items():
        target = layer / path.lstrip("/")
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(text)


def qemu(layer: Path, results: Path, extra: Sequence[str]) -> list[str]:
    """The command line: software emulation, two processors, four shared folders; the console is standard output.

    Not KVM, which hangs the guest where this machine is a guest itself. Not `-cpu max`: qemu 7.2 has only just learnt
    AVX, and numpy's sorting crashes on it.
    """
    shares = {"host": "/", "layer": FOLDER / "layer", "modules": FOLDER / "kernel/lib/modules", "job": layer}
    line = ["qemu-system-x86_64", "-accel", "tcg,thread=multi", "-cpu", "Nehalem", "-smp", "2", "-m", "2048"]
    line += ["-nodefaults", "-display", "none", "-no-reboot"]
    line += ["-kernel", str(FOLDER / "vmlinuz"), "-initrd", str(FOLDER / "initramfs.gz")]
    line += ["-append", "console=ttyS0 quiet panic=-1 mitigations=off"]
    for tag, path in shares.items():
        line += ["-virtfs", f"local,path={path},mount_tag={tag},security_model=none,readonly=on,multidevs=remap"]
    line += ["-virtfs", f"local,path={results},mount_tag=results,security_model=none", "-serial", "stdio"]
    return line + list(extra)


def run(
    command: str, timeout_s: float, results: Path, files: dict[str, str] | None = None, extra: Sequence[str] = ()
) -> Outcome:
    """Boot, run `command` (a bash line) in the checkout, power off. `extra`: more qemu arguments (a serial line).

    The console is shown as it comes; `results` is /results in there, emptied first. Raises RigError when
    the guest has not powered off after timeout_s.
    """
    shutil.rmtree(results, ignore_errors=True)
    results.mkdir(parents=True)
    started, said = time.monotonic(), []
    with tempfile.TemporaryDirectory(prefix="rig-", dir=FOLDER) as layer:
        write_layer(Path(layer), command, files or {})
        guest = subprocess.Popen(
            ["timeout", "--signal=KILL", str(timeout_s), *qemu(Path(layer), results, extra)],
            stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, text=True, errors="replace",
        )  # fmt: skip
        assert guest.stdout
        for line in guest.stdout:
            said.append(line)
            print(line, end="", flush=True)
        guest.wait()
    seconds = time.monotonic() - started
    status = results / "status"
    if not status.exists() or not status.read_text().strip():
        raise RigError(f"rig: the guest did not finish ({seconds:.0f} s of {timeout_s:.0f} s); its console is above")
    return Outcome(int(status.read_text()), seconds, "".join(said))
