"""A recogniser with a stored model goes to the worker process as its file: the model there is the one in use here."""

from __future__ import annotations

import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from daemon.pick.recogniser import ModelRecogniser, of_file
from daemon.store.library import load_facets
from daemon.store.model import ModelError, load_file, save
from daemon.vision.model.model import Model, empty_model, learn_solid
from tests.fakes import drawn
from tests.fakes.observed_around import looked_at, place
from tests.fakes.rigs import rig

BLOCK_60 = drawn.prism([(-30.0, -20.0), (30, -20), (30, 20), (-30, 20)], 60.0)


def taught(label: str, height_mm: float = 30.0) -> Model:
    block = drawn.prism([(-30.0, -20.0), (30, -20), (30, 20), (-30, 20)], height_mm)
    return learn_solid(empty_model(load_facets()), drawn.solid("block.obj", drawn.obj(*block)), label)


@pytest.fixture
def stored(tmp_path: Path) -> ModelRecogniser:
    file = tmp_path / "0001.npz"
    save(taught("cube"), file)
    return of_file(file, load_file(file).sha256, rig(), None)


def test_a_worker_reads_the_model_in_use_from_its_file(stored: ModelRecogniser) -> None:
    there = pickle.loads(pickle.dumps(stored))
    assert there.labels == stored.labels == ("cube",)
    assert pickle.loads(pickle.dumps(there)).labels == ("cube",)


def test_a_worker_that_starts_anew_takes_no_other_model_that_lies_in_the_place_of_the_one_in_use(
    stored: ModelRecogniser,
) -> None:
    assert stored.file is not None
    save(taught("cube", 20.0), stored.file.path)
    with pytest.raises(ModelError, match=r"0001\.npz: replaced while it was in use: put the file back"):
        pickle.loads(pickle.dumps(stored))


def test_what_a_group_of_facets_may_be_is_each_taught_part_that_it_fits() -> None:
    """Two facets of a block of which two heights are taught, the sides that do not show its height."""
    model = learn_solid(taught("low", 30.0), drawn.solid("block.obj", drawn.obj(*BLOCK_60)), "high")
    recogniser = ModelRecogniser(model, rig())
    body = drawn.solid("block.obj", drawn.obj(*BLOCK_60))
    (top,) = looked_at(body, place(0.0, np.pi / 2 - 0.02), np.random.default_rng(0), np.zeros(9)).groups
    found = recogniser.candidate_poses(top)
    assert {one.label for one in found} == {"low", "high"}
    assert sum(one.probability for one in found) <= 1.0 + 1e-9


READY = """
import pickle, sys
assert "daemon.vision.look" not in sys.modules
pickle.load(sys.stdin.buffer)
assert "daemon.vision.look" in sys.modules
"""


def test_a_worker_that_has_the_recogniser_is_ready_to_look(stored: ModelRecogniser) -> None:
    """The first look does not wait until the program of looks is loaded."""
    subprocess.run([sys.executable, "-c", READY], input=pickle.dumps(stored), check=True)


def test_a_pair_of_one_camera_is_seen_by_its_own_rig_and_every_other_by_the_cells(
    stored: ModelRecogniser, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One camera that took both pictures has another baseline from pair to pair."""
    used = []
    monkeypatch.setattr("daemon.vision.look.look", lambda left, right, rig, *_: used.append(rig))
    own, dark = rig(), np.zeros((8, 8), np.uint8)
    stored.see(dark, dark)
    stored.see(dark, dark, None, own)
    assert used == [stored.rig, own]
    assert own is not stored.rig
