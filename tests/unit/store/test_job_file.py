"""Job files: what is read, and the one line about what is wrong."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import pytest

from daemon.events.pick_order import OrderStep, PickOrder
from daemon.store.job_file import MAX_STEPS, MAX_TIMES, job_names, load_job, unreadable
from daemon.store.outside import FileError
from daemon.store.place_file import CellPlaces, Place, PlaceSettings
from daemon.store.recovery_state import SLOT, RecoverySlot, RecoveryState
from daemon.store.yamlfile import ConfigError

KIT = """\
version: 1
steps:
- {part: cube, count: 2, place: tray}
- {part: pyramid}
order: any
if_missing: wait
look_again_s: 5
"""
TRAY = CellPlaces(places=tuple(Place(f"tray.{n}", PlaceSettings(part="cube"), np.eye(4)) for n in (1, 2)))


def written(folder: Path, text: str, name: str = "kit") -> Path:
    (folder / f"{name}.yaml").write_text(text)
    return folder


def test_a_job_is_the_order_that_its_file_says(tmp_path: Path) -> None:
    job = load_job(written(tmp_path, KIT), "kit")
    job.check(("cube", "pyramid"), TRAY)
    steps = (OrderStep("cube", 2, "tray"), OrderStep("pyramid"))
    assert job.order(4) == PickOrder(12, 5.0, "kit", steps, in_turn=False, times=4, whole=steps)


def test_what_a_job_does_not_say_is_in_turn_and_stops_at_a_missing_part(tmp_path: Path) -> None:
    order = load_job(written(tmp_path, "version: 1\nsteps: [{part: cube}]\n"), "kit").order()
    assert (order.in_turn, order.skip, order.every_s, order.count) == (True, False, None, 1)
    skips = load_job(written(tmp_path, "version: 1\nsteps: [{part: cube}]\nif_missing: skip\n"), "kit").order()
    assert (skips.skip, skips.every_s) == (True, None)


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("version: 1\nsteps: []\n", "kit.yaml:2: steps"),
        ("version: 1\nsteps:\n- {part: cube, count: 0}\n", "kit.yaml:3: steps[0].count: expected"),
        ("version: 1\nsteps:\n- {prt: cube}\n", "kit.yaml:3: steps[0].prt: unknown key"),
        ("version: 1\nsteps: [{part: cube}]\norder: random\n", "expected one of in turn, any, found"),
        ("version: 2\nsteps: [{part: cube}]\n", "version"),
        ("version: 1\nsteps: [" + ", ".join(["{part: cube}"] * (MAX_STEPS + 1)) + "]\n", "kit.yaml:2: steps"),
    ],
)
def test_what_is_wrong_is_one_line_with_its_place(tmp_path: Path, text: str, line: str) -> None:
    with pytest.raises(ConfigError) as told:
        load_job(written(tmp_path, text), "kit")
    assert line in str(told.value)
    assert "\n" not in str(told.value)


@pytest.mark.parametrize(
    ("step", "told"),
    [
        ("{part: wedge}", "steps[0].part: expected a taught part (cube, pyramid), found wedge"),
        ("{part: cube, place: nest}", "steps[0].place: expected a place of cube (tray, bin), found nest"),
        ("{part: pyramid, place: tray}", "steps[0].place: expected a place of pyramid (bin), found tray"),
    ],
)
def test_a_step_that_this_cell_cannot_do_is_refused_before_anything_moves(tmp_path: Path, step: str, told: str) -> None:
    job = load_job(written(tmp_path, f"version: 1\nsteps: [{step}]\n"), "kit")
    with pytest.raises(ConfigError, match=r"kit\.yaml:2: ") as refused:
        job.check(("cube", "pyramid"), TRAY)
    assert told in str(refused.value)


def test_one_place_of_a_pattern_and_the_bin_are_places_too(tmp_path: Path) -> None:
    text = "version: 1\nsteps: [{part: cube, place: tray.2}, {part: cube, place: bin}]\n"
    load_job(written(tmp_path, text), "kit").check(("cube",), TRAY)


def test_jobs_are_the_yaml_files_with_a_plain_name(tmp_path: Path) -> None:
    assert job_names(tmp_path / "none") == []
    for name in ("kit.yaml", "a.yaml", ".kit.yaml.swp", "kit.txt", "Kit 2.yaml"):
        (tmp_path / name).write_text("")
    assert job_names(tmp_path) == ["a", "kit"]
    with pytest.raises(FileError):
        job_names(tmp_path / "a.yaml")


def test_a_check_of_all_jobs_names_each_that_cannot_be_read(tmp_path: Path) -> None:
    written(written(written(tmp_path, KIT), "steps: 3\n", "a"), "version: 1\nsteps: 3\n", "b")
    first, second = unreadable(tmp_path)
    assert "a.yaml:1: " in first
    assert "b.yaml:2: steps: expected a list, found 3" in second
    assert unreadable(tmp_path / "none") == []
    assert len(unreadable(tmp_path / "a.yaml")) == 1


def test_the_longest_job_fits_into_a_slot_of_the_recovery_file_beside_the_longest_fault(tmp_path: Path) -> None:
    step = f"{{part: {'p' * 40}, count: 1000000, place: {'q' * 30}.1000}}"
    text = f"version: 1\nsteps: [{', '.join([step] * MAX_STEPS)}]\nif_missing: wait\n"
    order = load_job(written(tmp_path, text, "j" * 30), "j" * 30).order(MAX_TIMES)
    state = RecoveryState("r" * 20, 10**9, "look_at_place", True, "p" * 40, order, "f" * 200, True)
    assert len(msgspec.json.encode(RecoverySlot(10**12, state))) + 10 < SLOT
