"""What is free about a view: three lengths of a brick, one of a cube, wherever it lies."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from daemon.vision.recognition.confidence import FreeSizes, bonds
from tests.fakes.drawn import block
from tests.fakes.remembered import hypotheses, remembered
from tests.unit.vision.recognition.test_confidence import BRICK, CORNER, PAIR, view


@pytest.mark.parametrize("away_mm", [0.0, 2000.0])
@pytest.mark.parametrize(("part", "facets", "kind", "sizes"), [
    (BRICK, CORNER, "rectangle", (3, 3)),
    (BRICK, PAIR, "rectangle", (3, 3)),
    (block(50, 50, 50), CORNER, "square", (3, 1)),
])  # fmt: skip
def test_types_leave_so_many_sizes_free_and_all_are_measured(part, facets, kind, sizes, away_mm) -> None:
    far = replace(part, corners_mm=part.corners_mm + np.array([0.0, 0.0, away_mm]), types=(kind,) * len(part.facets))
    seen, model = view(part, facets), remembered({"part": far})
    (fit, *_) = (one for one in hypotheses(seen, model, 1.0) if one.explained == len(facets))
    taught = model.metric["part"].solid
    corners = taught.corners_mm[fit.corners]
    sure, none = np.repeat(np.eye(3)[None] / 0.04, len(corners), 0), np.zeros((len(corners), 3))
    for bound, count in zip(bonds(taught, fit, seen, model.library), sizes, strict=True):
        free = FreeSizes.of(corners, bound, sure, none, 100.0)
        assert len(free.covariance) == count
        assert np.sqrt(free.covariance.diagonal()).max() < 0.25
