"""Few guesses of many: what is in plain sight does not take the place of what lies beside it."""

from __future__ import annotations

import numpy as np
import pytest

from daemon import frames
from daemon.vision.geometry import exact
from daemon.vision.geometry.polyhedron import SolidBatch
from daemon.vision.hypotheses import search
from daemon.vision.hypotheses.pose_batch import PoseBatch
from daemon.vision.hypotheses.search import ScoredPoses
from tests.fakes.solids import CUBE, pose

WHERE = pose(np.array([0.75, 0.35, 0.6]), 0.3, 330.0)


def test_a_part_in_plain_sight_leaves_one_beside_it_its_guesses(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(search, "MOST_PROMISING", 20)
    beside = frames.rigid(np.eye(3), np.array([60.0, 0.0, 0.0])) @ WHERE
    poses = np.stack([WHERE] * 30 + [beside] * 3)
    solids = SolidBatch.of((exact(CUBE.corners_mm, CUBE.facets),))
    many = ScoredPoses(
        PoseBatch(solids, np.zeros(33, np.intp), poses), np.concatenate([np.arange(30.0), [90.0, 92.0, 91.0]])
    )
    kept = search.varied_guesses(many)
    assert kept.tolist() == [*range(search.OF_A_BUNDLE), 30, 32, 31]
    monkeypatch.setattr(search, "MOST_PROMISING", 5)
    assert search.varied_guesses(many).tolist() == [*range(search.OF_A_BUNDLE), 30]


def test_where_guesses_are_few_all_are_asked_of_both_cameras() -> None:
    solids = SolidBatch.of((exact(CUBE.corners_mm, CUBE.facets),))
    few = ScoredPoses(PoseBatch(solids, np.zeros(9, np.intp), np.stack([WHERE] * 9)), -np.arange(9.0))
    assert search.varied_guesses(few).tolist() == list(range(9))
