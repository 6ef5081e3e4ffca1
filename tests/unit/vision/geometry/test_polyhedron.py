"""Which way is out, along the edges of a part: known whole, by half, and hollow."""

import numpy as np
import pytest

from daemon.vision.geometry.polyhedron import Polyhedron, exact
from tests.fakes.solids import CUBE, L_BASE, prism


def middles(shape: Polyhedron) -> np.ndarray:
    return shape.corners_mm[shape.lines[0]].mean(1)


def test_out_of_a_cube_is_from_its_middle_over_each_edge():
    cube = exact(CUBE.corners_mm, CUBE.facets)
    outward = middles(cube) - cube.corners_mm.mean(0)
    np.testing.assert_allclose(cube.bisectors, outward / np.linalg.norm(outward, axis=1, keepdims=True), atol=1e-12)


@pytest.mark.parametrize("sides", [(0,), (0, 1), (0, 1, 2), (2, 4, 5)])
def test_a_side_that_is_not_known_is_taken_for_square_to_its_neighbour(sides):
    cube = exact(CUBE.corners_mm, CUBE.facets)
    known = cube.only(sides)
    outward = middles(known) - cube.corners_mm.mean(0)
    np.testing.assert_allclose(known.bisectors, outward / np.linalg.norm(outward, axis=1, keepdims=True), atol=1e-12)


def test_nothing_is_out_along_a_hollow():
    body = prism(L_BASE, 40.0)
    block = exact(body.corners_mm, body.facets)
    lengths = np.linalg.norm(block.bisectors, axis=1)
    assert sorted(np.round(lengths, 9).tolist()) == [0.0] + [1.0] * 17
