"""A drawing becomes a part of the simulated cell: the same room, in convex pieces, that stands on its sides."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from drivers.rigid import turn
from drivers.simcell.cell import SimulatedCell
from drivers.simcell.drawn import DrawnError, drawn_shape
from drivers.simcell.parts import volume_and_centre
from tests.fakes import drawn

BRACKET = [(0, 0), (60, 0), (60, 8), (12, 8), (8, 12), (8, 60), (0, 60)]
CHANNEL = [(0, 0), (60, 0), (60, 40), (45, 40), (45, 15), (15, 15), (15, 40), (0, 40)]


def area(outline: list[tuple[float, float]]) -> float:
    x, y = np.array(outline, float).T
    return float(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2


@pytest.mark.parametrize(
    ("outline", "pieces"), [([(0, 0), (50, 0), (50, 30), (0, 30)], 1), (drawn.L_BLOCK, 2), (CHANNEL, 3), (BRACKET, 3)]
)
@pytest.mark.parametrize("turned", [False, True])
def test_the_pieces_fill_the_drawing_and_no_more(outline: list[tuple[float, float]], pieces: int, turned: bool) -> None:
    corners, rings = drawn.prism(outline, 40.0)
    if turned:
        corners = (corners @ turn([1, 2, 3], 0.7).T).astype("f4").astype(float)
    made = drawn_shape("part", corners, rings)
    assert len(made.pieces) == pieces
    assert sum(volume_and_centre(piece)[0] for piece in made.pieces) == pytest.approx(40.0 * area(outline), rel=1e-4)
    assert len(made.rests) >= 2


def test_a_disc_whose_wall_is_no_facet_is_its_own_hull() -> None:
    ring = [(30 * np.cos(a), 30 * np.sin(a)) for a in np.arange(12) * 2 * np.pi / 12]
    corners, rings = drawn.prism(ring, 10.0)
    made = drawn_shape("disc", corners, rings[:2])
    assert sum(volume_and_centre(piece)[0] for piece in made.pieces) == pytest.approx(10.0 * area(ring), rel=1e-4)


def test_what_cannot_be_shown_is_said() -> None:
    ring = [(30 * np.cos(a), 30 * np.sin(a)) for a in np.arange(50) * 2 * np.pi / 50]
    with pytest.raises(DrawnError, match="100 corners"):
        drawn_shape("disc", *drawn.prism(ring, 10.0))


def test_a_drawn_part_is_held_before_the_cameras_and_lies_on_the_table_like_any_other(tmp_path: Path) -> None:
    with SimulatedCell(Path("etc/simcell.yaml"), seed=3) as cell:
        cell.world.draw([drawn_shape("bracket", *drawn.prism(BRACKET, 40.0))])
        held = cell.place_for_teaching("bracket", 9)
        assert held.label == "bracket"
        cell.scatter(["bracket", "cube"])
        assert sorted(part.label for part in cell.world.parts) == ["bracket", "cube"]
        lowest = min(part.world_from_part(np.eye(4))[2, 3] for part in cell.world.parts)
        assert lowest > -300.0
