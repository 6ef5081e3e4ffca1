"""Calibrations made here: kept by number, one in use, the way back, and a person's own file goes before."""

from __future__ import annotations

from pathlib import Path

import pytest

from daemon.store.calibrations import CONFIGURED, Calibrations
from daemon.store.outside import FileError


@pytest.fixture
def kept(tmp_path: Path) -> Calibrations:
    (tmp_path / "calibration.yaml").write_text("configured")
    return Calibrations(tmp_path / "state", "real", tmp_path / "calibration.yaml")


def test_the_last_one_made_is_in_use_and_every_one_before_can_be_again(kept: Calibrations) -> None:
    assert (kept.in_use, kept.numbers()) == (kept.configured, [])
    assert [kept.keep(content) for content in (b"one", b"two")] == [1, 2]
    assert kept.in_use.read_bytes() == b"two"
    for number, content in ((1, b"one"), (CONFIGURED, b"configured"), (2, b"two")):
        kept.use(number)
        assert kept.in_use.read_bytes() == content
    assert kept.configured.read_bytes() == b"configured", "what a person wrote is never written over"


def test_another_file_put_there_by_a_person_goes_before_what_was_made_here(kept: Calibrations) -> None:
    kept.keep(b"one")
    kept.configured.write_text("a newer one")
    assert (kept.in_use, kept.passed_over) == (kept.configured, 1)
    kept.use(1)
    assert (kept.in_use.read_bytes(), kept.passed_over) == (b"one", None)


def test_a_simulated_cells_calibration_is_none_for_a_real_arm(kept: Calibrations, tmp_path: Path) -> None:
    Calibrations(tmp_path / "state", "simulated", kept.configured).keep(b"simulated")
    assert kept.in_use == kept.configured


def test_where_nothing_can_be_kept_is_known_before(kept: Calibrations) -> None:
    kept.check()
    kept.folder.rmdir()
    kept.folder.write_text("in the way")
    with pytest.raises(FileError, match="a calibration cannot be stored here"):
        kept.check()


def test_a_state_that_cannot_be_read_is_said_and_not_guessed(kept: Calibrations) -> None:
    kept.keep(b"one")
    state = kept.folder / "state.json"
    state.write_text("{")
    with pytest.raises(FileError, match=r"cannot be read.*remove it, and `calibrate use N`"):
        _ = kept.in_use
    state.unlink()
    state.mkdir()
    with pytest.raises(FileError, match=r"cannot be read.*remove it, and `calibrate use N`"):
        _ = kept.in_use


def test_a_state_that_is_no_text_says_so(tmp_path: Path) -> None:
    calibrations = Calibrations(tmp_path, "real", tmp_path / "c.yaml")
    calibrations.folder.mkdir(parents=True)
    (calibrations.folder / "state.json").write_bytes(b'{"instead_of":"\xff"}')
    with pytest.raises(FileError, match="cannot be read"):
        _ = calibrations.current
