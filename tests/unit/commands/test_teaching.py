"""What an operator reads of a part that is shown to be taught."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from daemon.commands.teaching import facets_shown, taught_line
from daemon.vision.values import Facet


def facet(x: float) -> Facet:
    px = np.array([[x, 0.0], [x + 40.0, 0.0], [x + 40.0, 40.0], [x, 40.0]])
    corners = np.column_stack([px, np.full(4, 300.0)])
    return Facet(corners, np.zeros((4, 3, 3)), px, px, np.zeros(4), 0.0, "square", 0.5)


@pytest.mark.parametrize(
    ("count", "begins", "ends"),
    [
        (1, "1 facet meets none of these sides. If it is the bracket's, this view teaches little: ", "take it away."),
        (2, "2 facets meet none of these sides. If they are the bracket's, this view", "If not, take them away."),
    ],
)  # fmt: skip
def test_a_side_that_meets_no_other_comes_with_what_to_do(count: int, begins: str, ends: str) -> None:
    apart = [facet(100.0 * (k + 1)) for k in range(count)]
    told = facets_shown("bracket", [facet(0.0), facet(40.0)], [0, None], (apart, []), 80).splitlines()
    assert told[-2] == "side 1 ?: square 40 40 40 40 mm"
    assert told[-1].startswith(begins)
    assert told[-1].endswith(ends)


def test_what_lies_elsewhere_is_something_elses_and_a_view_without_either_says_neither() -> None:
    shown = [facet(0.0), facet(40.0)]
    told = facets_shown("bracket", shown, [0, 1], ([], [facet(400.0)]), 80).splitlines()
    assert told[-1] == "and 1 facet of another object"
    assert facets_shown("bracket", shown, [0, 1], ([], []), 80).splitlines()[-1] == "side 1 2: square 40 40 40 40 mm"


@pytest.mark.parametrize("note", [{"mesh": "cube.stl"}, {"around": {}}, {"mesh": "cube.stl", "facets": []}])
def test_a_view_whose_note_says_nothing_of_its_facets_is_listed(note: dict[str, Any]) -> None:
    assert "0 facets" in taught_line(note)
