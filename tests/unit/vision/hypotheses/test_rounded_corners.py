"""Where two straight edges of a facet would meet that an arc joins."""

from __future__ import annotations

import numpy as np
import pytest

from daemon.vision.geometry import Polyhedron, exact
from daemon.vision.hypotheses.junctions import taught_junctions
from tests.bench.machined import drawn
from tests.fakes.drawn import box
from tests.fakes.machined import taught_from


def taught(label: str) -> Polyhedron:
    return taught_from({label: drawn(label)}).metric[label].solid


def apexes(solid: Polyhedron) -> tuple[np.ndarray, np.ndarray]:
    """(N, 3) of its junctions that are no corners, and the lengths (N, 2) of their edges."""
    junctions = taught_junctions((solid,))
    at = -(junctions.corner_from_part[:, :3, :3].transpose(0, 2, 1) @ junctions.corner_from_part[:, :3, 3:])[..., 0]
    beyond = np.linalg.norm(at[:, None] - solid.corners_mm, axis=2).min(1) > 1.0
    return at[beyond], junctions.lengths_mm[beyond]


def test_the_edges_of_a_rounded_rectangle_meet_in_its_corners() -> None:
    """70 by 50 mm with corners of 8 mm, a pad of 54 by 34 mm whose corners are cut by arcs, both turned by symmetry."""
    solid = taught("cover")
    at, lengths = apexes(solid)
    middle = (solid.corners_mm.max(0) + solid.corners_mm.min(0)) / 2
    off = {tuple(one) for one in np.sort(np.abs(at - middle)[:, :2], axis=1).round(0).tolist()}
    assert (25.0, 35.0) in off
    outer = np.abs(np.sort(lengths, axis=1) - [42.0, 62.0]).max(1) < 0.5
    assert outer.any()


def test_a_solid_without_arcs_has_corners_only() -> None:
    assert len(apexes(exact(*box()))[0]) == 0


@pytest.mark.parametrize("label", ["flange", "clevis"])
def test_edges_that_run_on_parallel_or_not_at_all_meet_nowhere(label: str) -> None:
    """A rounded end joins parallel edges; a disc has none."""
    assert len(apexes(taught(label))[0]) == 0
