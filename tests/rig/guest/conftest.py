"""In the guest: the machine as installed, for the tests that need the whole daemon."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import loopback
import pytest
from beside import Person
from installed import STATE, install, run, start_feeder


@pytest.fixture(scope="session")
def person() -> Iterator[Person]:
    """The machine as installed, cameras delivering, nothing started; and someone who stands at the cell."""
    loopback.load()
    start_feeder("/dev/video0", "/dev/video1")
    install()
    follow = ["journalctl", "--follow", "-u", "facetd", "-u", "feeder", "-o", "short-monotonic"]
    with Path("/results/journal").open("w") as kept:
        following = subprocess.Popen(follow, stdout=kept)
        yield Person()
        following.kill()
        following.wait()
    run("systemctl", "kill", "-s", "KILL", "facetd")
    shutil.copytree(STATE / "runs", "/results/runs")
    print(run("journalctl", "-u", "facetd", "-u", "feeder", "--no-pager", "-o", "short-monotonic").stdout)
