"""Edges that a solid has before a facet of its own that faces the same way."""

from __future__ import annotations

import numpy as np

from daemon.arrays import Array, Flags
from daemon.vision.geometry import Polyhedron, exact, hides_parallel_facet
from tests.fakes.drawn import box, prism

STAIRS = exact(*prism([(0, 0), (60, 0), (60, 15), (40, 15), (40, 40), (0, 40)], 50))
"""Along z 50 mm; a tread at y = 15 from x = 40 on, and the top at y = 40 up to there."""


def seen_from(solid: Polyhedron, camera: Array) -> Flags:
    """(E,) which of its lines a camera sees before a facet that faces the same way, in their middles."""
    ends = solid.corners_mm[solid.lines[0]]
    return hides_parallel_facet(solid, ends.mean(1)[:, None], camera)[:, 0]


def line(*ends: tuple[float, float, float]) -> int:
    numbers = [int(np.linalg.norm(STAIRS.corners_mm - end, axis=1).argmin()) for end in ends]
    return STAIRS.line_numbers[min(numbers), max(numbers)]


def test_the_edge_of_a_step_is_before_the_tread_only_from_where_the_riser_does_not_show() -> None:
    edge = line((40, 40, 0), (40, 40, 50))
    assert seen_from(STAIRS, np.array([20.0, 400.0, 25.0])).tolist().index(True) == edge
    assert seen_from(STAIRS, np.array([20.0, 400.0, 25.0])).sum() == 1
    assert not seen_from(STAIRS, np.array([300.0, 400.0, 25.0])).any(), "the riser shows"
    assert not seen_from(STAIRS, np.array([-300.0, -400.0, 25.0])).any(), "neither top nor tread shows"


def test_a_convex_solid_has_none() -> None:
    assert not exact(*box()).parallel_behind
