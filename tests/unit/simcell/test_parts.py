"""The parts: their measures, and that they rest on the table."""

from __future__ import annotations

import numpy as np
import pytest

from drivers.rigid import apply
from drivers.simcell.parts import STRANGERS, TAUGHT, part_shape


@pytest.mark.parametrize("label", [*TAUGHT, *STRANGERS])
def test_every_part_rests_on_the_table_and_nowhere_below(label: str) -> None:
    shape = part_shape(label)
    assert shape.rests
    for rest in shape.rests:
        heights = apply(rest, shape.hull.vertices)[:, 2]
        assert heights.min() == pytest.approx(0.0, abs=1e-9)
        assert np.sum(heights < 1e-6) >= 3


def test_the_parts_have_the_measures_they_are_known_by() -> None:
    def sides(label: str) -> set[float]:
        solid = part_shape(label).hull
        pairs = {tuple(sorted(p)) for face in solid.faces for p in zip(face, (*face[1:], face[0]), strict=True)}
        return {round(float(np.linalg.norm(solid.vertices[a] - solid.vertices[b])), 3) for a, b in pairs}

    assert sides("cube") == {50.0}
    assert sides("pyramid") == {50.0, round(float(np.sqrt(50**2 + 2 * 25**2)), 3)}
    assert sides("triangular_prism") == {50.0, 70.0}
    assert sides("pentagonal_prism") == {32.0, 70.0}
