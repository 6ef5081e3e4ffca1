"""What is free about a view: three lengths of a brick, one of a cube, wherever it lies."""

from __future__ import annotations

import numpy as np
import pytest

from daemon.store.library import load_facets
from daemon.vision.recognition.confidence import FreeSizes, bonds
from tests.fakes.drawn import block
from tests.unit.vision.recognition.test_confidence import BRICK, CORNER, PAIR, view


@pytest.mark.parametrize("away_mm", [0.0, 2000.0])
@pytest.mark.parametrize(("part", "facets", "kind", "sizes"), [
    (BRICK, CORNER, "rectangle", (3, 3)),
    (BRICK, PAIR, "rectangle", (3, 3)),
    (block(50, 50, 50), CORNER, "square", (3, 1)),
])  # fmt: skip
def test_types_leave_so_many_sizes_free_and_all_are_measured(part, facets, kind, sizes, away_mm) -> None:
    seen = view(part, facets)
    corners = seen.corners_mm + np.array([0.0, 0.0, away_mm])
    sure, none = np.repeat(np.eye(3)[None] / 0.04, len(corners), 0), np.zeros((len(corners), 3))
    for bound, count in zip(bonds(corners, seen, [kind] * len(facets), load_facets()), sizes, strict=True):
        free = FreeSizes.of(corners, bound, sure, none, 100.0)
        assert len(free.covariance) == count
        assert np.sqrt(free.covariance.diagonal()).max() < 0.25
