"""Parts as they are made, picked in the simulated cell: a bracket with bores, a slot and a fillet, and a round knob."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

AT_MOST_S = 900.0
"""How long such a demo takes on a slow and busy computer."""
pytestmark = [pytest.mark.long, pytest.mark.timeout(AT_MOST_S)]


@pytest.mark.parametrize("seed", [5, 11, 23])
def test_the_demo_picks_the_machined_parts_too(seed: int, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "daemon.ctl", "demo", "--machined", "--seed", str(seed), "--runs", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=AT_MOST_S, check=False)
    assert "6 of 6 parts picked" in done.stdout, done.stdout + done.stderr
    assert done.returncode == 0, done.stdout
