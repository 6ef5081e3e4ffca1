"""Numberings: facets that can be swapped are put in one order only."""

from __future__ import annotations

import numpy as np

from tests.bench.networks.rotation import numberings


def test_the_cube_needs_one_numbering_not_six():
    cube = 0.6 * (1 - np.eye(3))
    twin_before = numberings.twins(cube)
    assert twin_before == (-1, 0, 1)
    assert len(numberings.table((0, 1, 2), 3, twin_before).slots) == 1
