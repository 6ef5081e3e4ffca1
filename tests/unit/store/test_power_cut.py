"""The power goes at every step that changes the disk: what is found then is the old or the new, never neither."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from daemon.calibration.file import calibration_text, load_calibration, same_geometry, save_calibration
from daemon.calibration.recorded import keep_old
from daemon.store.calibrations import Calibrations
from daemon.store.folders import HOUSE
from daemon.store.library import load_facets
from daemon.store.model_store import ModelStore
from daemon.store.named_positions import NamedPositions
from daemon.store.recovery_state import RecoveryFile, RecoveryState, read_interrupted_state
from daemon.store.runlog import RunLog
from daemon.vision.model import empty_model

STEPS = (
    "open",
    "mkdir",
    "replace",
    "rename",
    "fsync",
    "fchmod",
    "chmod",
    "unlink",
    "pwrite",
    "posix_fallocate",
    "ftruncate",
)
"""Functions of `os` that change what is on the disk, or are said to bring it there."""
IMAGE = np.zeros((8, 8), np.uint8)
OLD = load_calibration(HOUSE / "etc" / "calibration.yaml")
NEW = replace(OLD, tool_from_cyclopean=None)


class PowerCut(BaseException):
    """From here on nothing reaches the disk."""


class Supply:
    """Gives power for so many steps. What is written through a file object reaches the disk by half at the cut."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, steps: int) -> None:
        self.left = steps
        for name in STEPS:
            monkeypatch.setattr(os, name, self.drawn(getattr(os, name)))
        fdopen = os.fdopen

        def opened(handle: int, mode: str = "r", *more: Any, **named: Any) -> Any:
            file = fdopen(handle, mode, *more, **named)
            return Written(self, file) if "w" in mode else file

        monkeypatch.setattr(os, "fdopen", opened)

    def step(self) -> None:
        self.left -= 1
        if self.left < 0:
            raise PowerCut

    def drawn(self, function: Callable[..., Any]) -> Callable[..., Any]:
        def stepped(*arguments: Any, **named: Any) -> Any:
            self.step()
            return function(*arguments, **named)

        return stepped


class Written:
    """A file being written, as far as the writers of this house use one."""

    def __init__(self, supply: Supply, file: Any) -> None:
        self.supply, self.file = supply, file

    def write(self, content: bytes) -> None:
        self.file.write(content[: len(content) // 2])
        self.file.flush()
        self.supply.step()
        self.file.write(content[len(content) // 2 :])

    def __enter__(self) -> Written:
        return self

    def __exit__(self, *_: object) -> None:
        self.file.close()

    def __getattr__(self, name: str) -> Any:
        return getattr(self.file, name)


def cut_at_every_step(
    folder: Path, prepare: Callable[[Path], object], change: Callable[[Path], object], found: Callable[[Path], bool]
) -> int:
    """How many steps a change has; found: whether what is there after a cut is the new (True) or the old (False), and
    raises where it is neither."""
    for steps in range(200):
        here = folder / str(steps)
        here.mkdir()
        prepare(here)
        with pytest.MonkeyPatch.context() as monkeypatch:
            Supply(monkeypatch, steps)
            try:
                change(here)
            except PowerCut:
                whole = False
            else:
                whole = True
        is_new = found(here)
        if whole:
            assert is_new
            return steps
        shutil.rmtree(here)
    raise AssertionError("it never ended")


def test_a_calibration(tmp_path: Path) -> None:
    def calibrate(folder: Path) -> None:
        keep_old(folder / "c.yaml")
        save_calibration(NEW, folder / "c.yaml")

    def found(folder: Path) -> bool:
        calibration = load_calibration(folder / "c.yaml")
        assert same_geometry(calibration, OLD) or same_geometry(calibration, NEW)
        return same_geometry(calibration, NEW)

    def prepare(folder: Path) -> None:
        save_calibration(OLD, folder / "c.yaml")

    assert cut_at_every_step(tmp_path, prepare, calibrate, found) >= 4


def test_a_calibration_that_is_made_by_the_daemon(tmp_path: Path) -> None:
    def of(folder: Path) -> Calibrations:
        return Calibrations(folder / "state", "real", folder / "c.yaml")

    def prepare(folder: Path) -> None:
        save_calibration(OLD, folder / "c.yaml")
        of(folder).keep(calibration_text(OLD))

    def found(folder: Path) -> bool:
        kept = of(folder)
        assert kept.current in (1, 2)
        assert same_geometry(load_calibration(kept.in_use), NEW if kept.current == 2 else OLD)
        is_new = kept.current == 2
        assert kept.keep(calibration_text(NEW)) == kept.current, "another can be made"
        assert same_geometry(load_calibration(kept.in_use), NEW)
        return is_new

    def calibrate(folder: Path) -> None:
        of(folder).keep(calibration_text(NEW))

    assert cut_at_every_step(tmp_path, prepare, calibrate, found) >= 8


@pytest.mark.parametrize("word", ["train", "accept", "rollback", "use"])
def test_a_model(word: str, tmp_path: Path) -> None:
    model = empty_model(load_facets())

    def prepare(folder: Path) -> None:
        store = ModelStore(folder)
        for _ in range(2):
            store.put_candidate(model)
            store.accept(store.candidate)
        store.put_candidate(model)

    changes: dict[str, Callable[[ModelStore], object]] = {
        "train": lambda store: store.put_candidate(model),
        "accept": lambda store: store.accept(3),
        "rollback": ModelStore.rollback,
        "use": lambda store: store.use(1),
    }
    old = (2, 3, (1,))
    new = {"train": (2, 4, (1,)), "accept": (3, None, (1, 2)), "rollback": (1, 2, ()), "use": (1, 3, (1, 2))}[word]

    def found(folder: Path) -> bool:
        store = ModelStore(folder)
        state = (store.current, store.candidate, store.history)
        assert state in (old, new)
        for version in {store.current, store.candidate, *store.history} - {None}:
            store.load(version or 0)
        assert store.put_candidate(model) > max(v for v in (store.current, *store.history) if v)
        return state == new

    assert cut_at_every_step(tmp_path, prepare, lambda folder: changes[word](ModelStore(folder)), found) >= 4


def test_a_taught_view(tmp_path: Path) -> None:
    def found(folder: Path) -> bool:
        views = ModelStore(folder).views()
        for view in views:
            assert view.damage == ""
            view.images()
        assert [view.number for view in views] in ([1], [1, 2])
        return len(views) == 2

    def teach(folder: Path) -> None:
        ModelStore(folder).add_view("cube", IMAGE, IMAGE, {"who": "x"})

    assert cut_at_every_step(tmp_path, teach, teach, found) >= 10


def test_a_view_that_is_forgotten(tmp_path: Path) -> None:
    def prepare(folder: Path) -> None:
        for _ in range(2):
            ModelStore(folder).add_view("cube", IMAGE, IMAGE, {})

    def found(folder: Path) -> bool:
        store = ModelStore(folder)
        views = store.views()
        for view in views:
            view.images()
        assert [view.number for view in views] in ([1, 2], [2])
        if len(views) == 1:  # what is left of the one must not keep the next of its number from being forgotten
            (folder / "views/cube/2").rename(folder / "views/cube/1")
        assert store.drop_views("cube", 1) == 1
        return len(views) == 1

    assert cut_at_every_step(tmp_path, prepare, lambda folder: ModelStore(folder).drop_views("cube", 1), found) >= 3


def test_a_place_that_is_given_a_name(tmp_path: Path) -> None:
    """It is a line at the end of a file: cut off at any of its bytes the places before are known, and the next."""
    places = NamedPositions(tmp_path)
    places.keep("bench", np.eye(4), "x")
    old = places.path.read_bytes()
    places.keep("bench", None, "x")
    new = places.path.read_bytes()
    for length in range(len(old), len(new) + 1):
        places.path.write_bytes(new[:length])
        known = set(places.now())
        assert known == (set() if length >= len(new) - 1 else {"bench"})
        places.keep("tray", np.eye(4), "x")
        assert set(places.now()) == known | {"tray"}


def test_what_a_restart_must_know(tmp_path: Path) -> None:
    old, new = RecoveryState("a", cycle=3), RecoveryState("a", cycle=3, hand_closed=True)

    def prepare(folder: Path) -> None:
        file = RecoveryFile(folder / "standing")
        file.write(old)
        file.close()

    def close_the_hand(folder: Path) -> None:
        file = RecoveryFile(folder / "standing")
        file.write(new)

    def found(folder: Path) -> bool:
        left = read_interrupted_state(folder / "standing", ran_before=True)
        assert left in (old, new)
        return left == new

    assert cut_at_every_step(tmp_path, prepare, close_the_hand, found) >= 2


def test_what_a_run_is_made_with(tmp_path: Path) -> None:
    """A reload keeps the configuration in the run's folder under its hash: whole there, or not at all."""
    (tmp_path / "c.yaml").write_text("version: 1\n" * 100)
    log = RunLog(tmp_path / "run")

    def found(folder: Path) -> bool:
        kept = [path for path in (log.folder / "kept").iterdir() if not path.name.startswith(".")]
        assert all(path.read_bytes() == (tmp_path / "c.yaml").read_bytes() for path in kept)
        return bool(kept)

    assert cut_at_every_step(tmp_path, lambda _: None, lambda _: log.keep(tmp_path / "c.yaml"), found) >= 3
    log.close()
