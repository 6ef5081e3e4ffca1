"""Of many guesses, those at much the same pose count as one bundle; of all, the likeliest that look different."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon import frames
from daemon.vision.geometry import exact
from daemon.vision.geometry.polyhedron import SolidBatch
from daemon.vision.hypotheses.pose_batch import PoseBatch
from daemon.vision.hypotheses.search import CELL_MM, ScoredPoses, distinct, thinned
from tests.fakes.solids import KNOWN
from tests.unit.vision.hypotheses.test_corner_guesses import WHERE, images_of

NAMES = tuple(sorted(KNOWN))
SOLIDS = SolidBatch.of([exact(KNOWN[name].corners_mm, KNOWN[name].facets) for name in NAMES])


def guesses(part: list[int], aside_mm: list[float], against: list[float]) -> ScoredPoses:
    poses = np.stack([frames.rigid(np.eye(3), np.array([mm, 0.0, 0.0])) @ WHERE for mm in aside_mm])
    return ScoredPoses(PoseBatch(SOLIDS, np.array(part), poses), np.array(against))


@given(
    st.lists(st.tuples(st.integers(0, 1), st.integers(0, 3), st.floats(-9, 9)), min_size=1, max_size=40),
    st.integers(1, 5),
)
def test_so_many_of_every_bundle_are_kept_the_likeliest(drawn: list[tuple[int, int, float]], few: int) -> None:
    part, place, against = (list(each) for each in zip(*drawn, strict=True))
    kept = thinned(guesses(part, [3 * CELL_MM * one for one in place], against), few).tolist()
    for bundle in set(zip(part, place, strict=True)):
        own = [k for k in range(len(drawn)) if drawn[k][:2] == bundle]
        expected = sorted(against[k] for k in own)[:few]
        assert sorted(against[k] for k in own if k in kept) == expected
    assert len(set(kept)) == len(kept)


def test_of_what_looks_the_same_the_likeliest_comes_and_of_the_rest_the_likeliest_first() -> None:
    cube, prism = NAMES.index("cube"), NAMES.index("pentagonal_prism")
    many = guesses([cube, cube, prism, cube], [0.0, 0.5, 0.0, 25.0], [2.0, 1.0, 3.0, 0.0])
    assert [k for k, _ in distinct(many, images_of("cube"))] == [3, 1, 2]


@pytest.mark.parametrize("aside_mm", [-400.0, 400.0])
def test_what_lies_outside_an_image_does_not_come(aside_mm: float) -> None:
    assert list(distinct(guesses([0], [aside_mm], [1.0]), images_of("cube"))) == []
