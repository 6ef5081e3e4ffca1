"""What the motion monitor of a cell in another process finds is in its file, with the moments it was so."""

from __future__ import annotations

import json
import time
from pathlib import Path

from drivers.simcell.cell import SimulatedCell
from drivers.simcell.history import GripperRecord
from tests.fakes.waiting import until

TRUTH = Path(__file__).parents[3] / "etc" / "simcell.yaml"


def test_motions_and_violations_are_written_as_they_are_found_each_once(tmp_path: Path) -> None:
    file = tmp_path / "verdict.jsonl"
    began_s = time.monotonic()
    with SimulatedCell(TRUTH, seed=1, time_scale=50.0, verdict=file) as cell:
        with cell.server.controller() as controller:
            for line in (b"DO NOFLIP\r", b"DO MOVE TRANS(520,0,-295,0,90,0)\r", b"DO BREAK\r", b"DO OPENI\r"):
                controller.receive(line, controller.now_s)
        until(lambda: any(isinstance(event, GripperRecord) for event in cell.controller.machine.history))
    ended_s = time.monotonic()
    lines = [json.loads(text) for text in file.read_text().splitlines()]
    motions = [line for line in lines if "started_s" in line]
    assert [line["by"] for line in motions] == ["DO MOVE TRANS(520,0,-295,0,90,0)", "DO OPENI"]
    assert all(began_s < line["started_s"] < ended_s for line in motions)
    assert {line["rule"] for line in lines if "rule" in line} >= {"step too long", "below the table"}
    assert len(lines) == len({json.dumps(line) for line in lines})
