"""`facetctl stream` as a person has it: the program itself, on recorded pairs, watched in a real browser."""

from __future__ import annotations

import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from daemon.store import folders
from tests.fakes.waiting import PATIENCE_S, until

SCENES = folders.HOUSE / "tests/data/scenes"
PICTURE = """
const i = document.images[0], c = document.createElement('canvas');
c.width = i.naturalWidth; c.height = i.naturalHeight;
if (!c.width) return [0, 0, 0];
const p = c.getContext('2d'); p.drawImage(i, 0, 0);
const a = p.getImageData(0, 0, c.width, c.height).data;
let sum = 0, coloured = 0;
for (let k = 0; k < a.length; k += 4) {
  sum = (sum * 31 + a[k]) >>> 0;
  if (Math.max(a[k], a[k + 1], a[k + 2]) - Math.min(a[k], a[k + 1], a[k + 2]) > 60) coloured++;
}
return [c.width, sum, coloured];
"""
"""Of the picture shown now: its width, a checksum, and how many pixels have a colour (the cameras are grey)."""


@pytest.fixture
def stream(tmp_path: Path) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """`facetctl stream` on two recorded pairs, and its address."""
    shutil.copytree(folders.HOUSE / "etc", tmp_path / "etc")
    shutil.copy(SCENES / "calibration-B.yaml", tmp_path / "etc/calibration.yaml")
    for name in ("clean-B-003", "clean-B-020"):
        shutil.copytree(SCENES / name, tmp_path / "etc/pairs" / name)
    config = tmp_path / "etc/facetd.yaml"
    text = config.read_text().replace("cell: real", "cell: recorded")
    config.write_text(text + f"\nfolders: {{state: {tmp_path}/state}}\n")
    words = [sys.executable, "-m", "daemon.ctl", "stream", "--port", "0", "--config", str(config)]
    # Tests that a shell runs in the background have control-C ignored, and so would the program: give it back.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    program = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=folders.HOUSE)
    signal.signal(signal.SIGINT, before)
    assert program.stdout
    found = re.match(r"(http://127\.0\.0\.1:\d+/)  \(control-C ends it\)", program.stdout.readline())
    assert found
    yield program, found[1]
    program.kill()
    program.communicate()


def test_the_stream_moves_has_the_facets_drawn_in_and_ends_with_control_c(
    browser: Any, stream: tuple[subprocess.Popen[str], str]
) -> None:
    program, address = stream
    browser.get(address)
    assert until(lambda: browser.execute_script(PICTURE)[0]) >= 1280
    first = browser.execute_script(PICTURE)
    assert first[2] > 500
    assert until(lambda: browser.execute_script(PICTURE)[1] != first[1])
    said = browser.find_element("id", "said")
    assert until(lambda: said.text.startswith("recorded pairs from")), said.text
    assert [entry["message"] for entry in browser.get_log("browser")] == []
    program.send_signal(signal.SIGINT)
    assert program.wait(PATIENCE_S) == 0
    assert program.communicate() == ("", "")
