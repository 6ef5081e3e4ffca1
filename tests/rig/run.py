"""`make rig`: boot this machine in a guest with real V4L2 devices, systemd and a serial line, and run the jobs there.

usage: run.py [JOB...]            cameras and daemon, or those named: cameras, daemon, package
       run.py -- COMMAND...       one command line in the guest, by hand

Exit status: 0 all passed; 1 a job failed; 2 it cannot be run here (the reason is one line).
"""

from __future__ import annotations

import compileall
import shlex
import sys
import tempfile
import time
from pathlib import Path

import guest

PYTEST = f"{shlex.quote(sys.executable)} -m pytest -c tests/rig/guest/pytest.ini --rootdir=. "


def cameras() -> guest.Outcome:
    """The camera driver on real devices: v4l2loopback fed by us, and the kernel's test cameras."""
    files = "tests/rig/guest/test_loopback.py tests/rig/guest/test_vivid.py"
    return guest.run(PYTEST + files, 600.0, guest.FOLDER / "results/cameras")


def daemon() -> guest.Outcome:
    """The whole daemon under systemd, its cameras and its arm beside the guest."""
    import otherside

    with (
        tempfile.TemporaryDirectory(prefix="ports-", dir=guest.FOLDER) as ports,
        otherside.surroundings(guest.CHECKOUT / "etc/simcell.yaml", 3, Path(ports)) as devices,
    ):
        files = " ".join(f"tests/rig/guest/test_{part}.py" for part in ("daemon", "serial", "ending"))
        return guest.run(PYTEST + files, 2400.0, guest.FOLDER / "results/daemon", extra=devices)


def package() -> guest.Outcome:
    """The Debian package's life: install, upgrade, go back, remove, purge."""
    import packages

    packages.build()
    command = f"RIG_PACKAGES={shlex.quote(str(packages.FOLDER))} {PYTEST} tests/rig/guest/test_package.py"
    return guest.run(command, 1500.0, guest.FOLDER / "results/package")


JOBS = {"cameras": cameras, "daemon": daemon, "package": package}
UNNAMED = ("cameras", "daemon")
"""Those that run where none is named."""


def compile_all() -> None:
    """Leave compiled modules beside the sources: every program in the guest would spend seconds on that, emulated."""
    for folder in ("daemon", "drivers", "tests/rig"):
        compileall.compile_dir(guest.CHECKOUT / folder, quiet=1)


def run_jobs(names: list[str]) -> int:
    """Run them one after the other; a table at the end."""
    rows = []
    for name in names:
        print(f"rig: {name}: booting the guest", flush=True)
        outcome = JOBS[name]()
        measured = guest.FOLDER / "results" / name / "measured"
        rows.append((name, outcome, measured.read_text().strip() if measured.exists() else ""))
    for name, outcome, figures in rows:
        print(f"rig: {name}: {'passed' if outcome.status == 0 else 'FAILED'} in {outcome.seconds:.0f} s")
        print("".join(f"rig:   measured: {line}\n" for line in figures.splitlines()), end="")
    return int(any(outcome.status for _, outcome, _ in rows))


def main(words: list[str]) -> int:
    """See the top of this file."""
    by_hand = words[1:] if words[:1] == ["--"] else None
    unknown = [word for word in words if word not in JOBS] if by_hand is None else []
    if unknown:
        print(f"rig: no job {', '.join(unknown)}; there are {', '.join(JOBS)}", file=sys.stderr)
        return 2
    try:
        started_s = time.monotonic()
        guest.prepare()
        compile_all()
        print(f"rig: ready after {time.monotonic() - started_s:.0f} s")
        if by_hand is not None:
            return guest.run(" ".join(by_hand), 3600.0, guest.FOLDER / "results/by-hand").status
        return run_jobs(words or list(UNNAMED))
    except guest.RigError as error:
        print(error, file=sys.stderr)
        return 2


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
