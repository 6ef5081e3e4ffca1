"""Parts as they are made, picked in the simulated cell: a bracket with bores, a slot and a fillet, and a round knob."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

AT_MOST_S = 900.0
"""How long such a demo takes on a slow and busy computer."""
pytestmark = [pytest.mark.long, pytest.mark.timeout(AT_MOST_S)]


def demo(seed: int, folder: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "daemon.ctl", "demo", "--machined", "--seed", str(seed), "--runs", str(folder)]
    return subprocess.run(command, capture_output=True, text=True, timeout=AT_MOST_S, check=False)


def test_the_demo_picks_the_machined_parts_too_and_fills_the_kit(tmp_path: Path) -> None:
    """All of both here; one may fail on another computer, whose rounding leads to other looks."""
    done = demo(24, tmp_path)
    picked, placed = re.search(r"(\d) of 6 parts picked", done.stdout), re.search(r"kit: (\d) of 4 parts", done.stdout)
    assert picked is not None, done.stdout + done.stderr
    assert placed is not None, done.stdout
    assert int(picked[1]) >= 5, done.stdout
    assert int(placed[1]) >= 3, done.stdout
    assert "the cell's motion monitor found no forbidden motion" in done.stdout
