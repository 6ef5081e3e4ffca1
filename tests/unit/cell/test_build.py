"""The cell's hardware as the daemon meets it: devices that are missing or silent are one line that says what to do."""

from __future__ import annotations

import asyncio
import os
import pty
import time
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from daemon.arm import MoveCommand
from daemon.cell import build as cell
from daemon.cell.hardware import Hardware
from daemon.cell.no_arm import CellError
from daemon.config import load_config

ETC = Path(__file__).resolve().parents[3] / "etc"
FILES = "files: {{calibration: {0}/calibration.yaml, facets: {0}/facets.yaml, parts: {0}/parts.yaml}}\n"


def hardware(folder: Path, config: str) -> Hardware:
    (folder / "facetd.yaml").write_text("version: 1\n" + FILES.format(ETC) + config)
    return cell.build(load_config(folder / "facetd.yaml"), lambda _: None)


@pytest.fixture
def silent_port() -> Iterator[str]:
    ours, theirs = pty.openpty()
    yield os.ttyname(theirs)
    os.close(ours)
    os.close(theirs)


def refusal(folder: Path, config: str) -> str:
    with pytest.raises(CellError) as caught:
        asyncio.run(hardware(folder, config).open())
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_every_device_that_is_missing_is_named(tmp_path: Path) -> None:
    told = refusal(tmp_path, "cameras: {left: /dev/none0, right: /dev/none1}\narm: {port: /dev/none-arm}\n")
    assert "/dev/none0" in told
    assert "/dev/none-arm: no such port; is the adapter plugged in and the path right?" in told


def test_a_controller_that_does_not_answer_is_told_with_what_to_check(tmp_path: Path, silent_port: str) -> None:
    told = refusal(tmp_path, f"cameras: {{left: /dev/none0, right: /dev/none1}}\narm: {{port: {silent_port}}}\n")
    assert f"{silent_port}: " in told
    assert "is the controller switched on, the cable in its terminal port, and arm.dialect.baud right?" in told


def test_recorded_pairs_hold_still_until_the_next_is_asked_for(tmp_path: Path) -> None:
    for n in range(2):
        (tmp_path / "pairs" / str(n)).mkdir(parents=True)
        for camera in ("left", "right"):
            cv2.imwrite(str(tmp_path / "pairs" / str(n) / f"{camera}.png"), np.full((48, 64), 50 + 10 * n, np.uint8))

    async def look() -> list[int]:
        built = hardware(tmp_path, "cell: recorded\n")
        await built.open()
        seen = []
        for n in range(6):
            pair = await built.cameras.grab(time.monotonic(), 1.0)
            assert pair.left.taken_s <= time.monotonic()
            seen.append(int(pair.left.pixels[20, 20]))
            if n in (1, 3):
                assert built.cameras.step()
        with pytest.raises(CellError, match="this cell is recorded: there is no arm to move"):
            await built.robot.move(MoveCommand(np.eye(4), True, 10.0, "test"), print, 1.0)
        await built.close()
        return seen

    assert asyncio.run(look()) == [50, 50, 60, 60, 50, 50]
