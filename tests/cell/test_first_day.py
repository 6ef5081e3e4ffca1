"""Whole first days: from a controller and an arm nobody knows to a part in the bin, by commands alone."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import yaml

from drivers.puma560 import ArmGeometry
from drivers.pumas import PUBLISHED
from drivers.simcell.controller import Manners
from tests.fakes.first_day import (
    READY_DEG,
    ROOMS,
    arm_yaml,
    commissioned,
    configuration,
    first_day,
    lay_down,
    truth,
    typed_from_the_page,
)

pytestmark = [pytest.mark.long, pytest.mark.timeout(5000)]


@pytest.fixture
def folder() -> Iterator[Path]:
    """Of a short name: a socket lies in it."""
    path = Path(tempfile.mkdtemp(prefix="facetd-"))
    yield path
    shutil.rmtree(path, ignore_errors=True)


@pytest.mark.parametrize("seed", [6])
def test_a_cell_drawn_at_random_is_introduced_and_commissioned_and_picks(folder: Path, seed: int) -> None:
    day = first_day(folder, seed)
    assert not day.wrong, day.wrong


@pytest.mark.parametrize("seed", [3])
def test_what_the_page_says_to_try_before_the_arm_is_there_is_typed_as_it_stands(folder: Path, seed: int) -> None:
    wrong = typed_from_the_page(folder, seed)
    assert not wrong, wrong


def test_an_arm_as_long_as_a_761_is_introduced_with_its_drawing_and_picks(folder: Path) -> None:
    """Some 1500 mm to the wrist; nobody published how they are shared out."""
    day = first_day(folder, 4, (650.0, 0.0, 190.0, 850.0))
    assert not day.wrong, day.wrong


@pytest.mark.parametrize("series", ["PUMA 260", "PUMA 762"])
def test_a_smaller_and_a_larger_arm_pick_as_the_560_does(folder: Path, series: str) -> None:
    a2, a3, d3, d4 = next(arm.lengths_mm for arm in PUBLISHED if arm.name.startswith(series))
    hand = np.eye(4)
    hand[2, 3] = ROOMS[series].hand_mm
    arm = ArmGeometry(a2, a3, d3, d4, flange_from_tool=hand)
    lay_down(folder, truth(arm, Manners(), np.array(READY_DEG)), configuration(arm, 7, "arm.yaml"))
    (folder / "arm.yaml").write_text(yaml.safe_dump(arm_yaml(arm)))
    day = commissioned(folder)
    assert not day.wrong, day.wrong
    again = commissioned(folder)
    assert "calibrate stereo" not in again.seen, "the second sitting began anew"
    assert again.seen.count("  done ") >= 7
