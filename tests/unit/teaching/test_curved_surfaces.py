"""Machined parts as drawings: bores, fillets and rounded ends are no facets, and what lies between them still is."""

from __future__ import annotations

import numpy as np
import pytest

from daemon.store.library import load_facets
from daemon.store.model import from_bytes, to_bytes
from daemon.teaching.drawing_summary import describe_drawing
from daemon.teaching.solid_from_mesh import Drawing, read_drawing
from daemon.vision.geometry import Polyhedron
from daemon.vision.model import empty_model, learn_solid
from tests.fakes import drawn

LIBRARY = load_facets()


def drawing(corners: np.ndarray, rings: list[tuple[int, ...]]) -> Drawing:
    return read_drawing("part.obj", drawn.obj(corners, rings), "mm", LIBRARY)


def arc(
    middle: tuple[float, float], radius: float, first_deg: float, last_deg: float, steps: int
) -> list[tuple[float, float]]:
    turns = np.radians(np.linspace(first_deg, last_deg, steps + 1))
    return [(middle[0] + radius * np.cos(t), middle[1] + radius * np.sin(t)) for t in turns]


FILLETED_ANGLE = [(0, 0), (60, 0), (60, 10), *arc((14, 14), 4, 270, 180, 6), (10, 45), (0, 45)]
STADIUM = [*arc((40, 0), 15, -90, 90, 18), *arc((0, 0), 15, 90, 270, 18)]
D_SHAPE = [(0, -20), *arc((0, 0), 20, -90, 90, 24)[1:-1], (0, 20)]


def test_a_fillet_is_no_facet_and_its_tangent_lines_do_not_show() -> None:
    found = drawing(*drawn.prism(FILLETED_ANGLE, 30))
    assert [str(one) for one in found.curved] == ["hollow rounding of radius 4 mm"]
    assert len(found.solid.facets) == 8
    smooth = [abs(found.solid.corners_mm[a] - found.solid.corners_mm[b]) for a, b in found.solid.smooth]
    assert np.allclose(sorted(way.max() for way in smooth), [30, 30])
    lines = {tuple(sorted(pair)) for pair in found.solid.lines[0].tolist()}
    assert lines.isdisjoint(found.solid.smooth)


@pytest.mark.parametrize("steps", [6, 12, 24, 72])
def test_a_bore_is_a_hole_however_finely_it_is_cut(steps: int) -> None:
    found = drawing(*drawn.bored_block(60, 40, 20, 8.0, steps * 2))
    assert [str(one) for one in found.curved] == ["bore of 16 mm"]
    assert sorted(found.solid.types) == ["rectangle"] * 6
    assert (found.holes, found.solid.open_edges) == (2, 0)


@pytest.mark.parametrize(("outline", "name", "area_mm2"), [
    (STADIUM, "stadium", 40 * 30 + np.pi * 15**2), (D_SHAPE, "half_disc", np.pi * 20**2 / 2)])  # fmt: skip
def test_an_end_that_is_round_is_an_arc_of_few_chords_that_keeps_the_area(
    outline: list[tuple[float, float]], name: str, area_mm2: float
) -> None:
    found = drawing(*drawn.prism(outline, 25))
    solid = found.solid
    assert solid.types.count(name) == 2
    round_ones = np.linalg.norm(solid.areas_mm2, axis=1)[[kind == name for kind in solid.types]]
    assert round_ones == pytest.approx(area_mm2, rel=0.015)
    for one in found.curved:
        assert (one.kind, one.hollow) == ("cylinder", False)
        assert np.degrees(one.sweep_rad) == pytest.approx(180, abs=8)


def test_a_cylinder_and_a_cone_are_told_apart() -> None:
    turns = 2 * np.pi * np.arange(36) / 36
    ring = np.column_stack([np.cos(turns), np.sin(turns)])
    corners = np.vstack([np.column_stack([r * ring, np.full(36, z)]) for r, z in ((25, 0), (10, 40))])
    rings = [
        tuple(range(36))[::-1],
        tuple(range(36, 72)),
        *((k, (k + 1) % 36, (k + 1) % 36 + 36, k + 36) for k in range(36)),
    ]
    cone = drawing(corners, rings)
    assert [one.kind for one in cone.curved] == ["cone"]
    boss = drawing(*drawn.prism([tuple(20 * p) for p in ring], 30))
    assert [str(one) for one in boss.curved] == ["boss of 40 mm"]
    assert set(boss.solid.types) == {"disc"}


@pytest.mark.parametrize("sides", [3, 4, 5, 6, 8, 10])
def test_a_prism_of_few_sides_has_only_facets(sides: int) -> None:
    ring = [(30 * np.cos(t), 30 * np.sin(t)) for t in 2 * np.pi * np.arange(sides) / sides]
    found = drawing(*drawn.prism(ring, 40))
    assert (found.curved, len(found.solid.facets)) == ((), sides + 2)


def test_what_does_not_show_is_stored_with_the_model() -> None:
    solid = drawing(*drawn.prism(FILLETED_ANGLE, 30)).solid
    model = learn_solid(empty_model(LIBRARY), solid, "angle")
    kept = from_bytes(to_bytes(model)).model.metric["angle"].solid
    assert kept.smooth == model.metric["angle"].solid.smooth == solid.smooth
    assert len(kept.smooth) == 2


def test_a_part_of_a_solid_keeps_the_sides_that_do_not_show() -> None:
    solid: Polyhedron = drawing(*drawn.prism(FILLETED_ANGLE, 30)).solid
    for facets in ((0, 1, 2), tuple(range(len(solid.facets)))):
        some = solid.only(facets)
        of_some = [frozenset(map(tuple, some.corners_mm[list(pair)].round(6).tolist())) for pair in some.smooth]
        of_all = [frozenset(map(tuple, solid.corners_mm[list(pair)].round(6).tolist())) for pair in solid.smooth]
        assert set(of_some) <= set(of_all)
        assert len(facets) < len(solid.facets) or set(of_some) == set(of_all)


def test_what_was_understood_is_said_with_size_frame_and_grip() -> None:
    told = describe_drawing(drawing(*drawn.bored_block(60, 40, 20, 8.0, 36)), 50.0)
    assert told[0] == "60 x 40 x 20 mm along the drawing's x, y, z. 6 facets (6 rectangles), 2 holes in them."
    assert told[1] == "Curved, so no facets: bore of 16 mm."
    assert told[2].startswith(
        "The part's frame: its origin at (30 20 10) of the drawing, its x, y, z along the drawing's "
    )
    assert told[3] == "The gripper can hold it by flat facets 20, 40 mm apart (it opens 50 mm)."
    assert describe_drawing(drawing(*drawn.box(80, 70, 60)), 50.0)[-1].startswith(
        "The gripper opens 50 mm; flat facets to"
    )


@pytest.mark.parametrize("radius", [5.0, 9.0, 22.0, 31.0])
def test_a_round_face_has_four_chords_or_a_multiple_of_four(radius: float) -> None:
    """A bore's floor of seven chords made a knob another one after half a turn."""
    turns = 2 * np.pi * np.arange(60) / 60
    disc = drawing(*drawn.prism([(radius * np.cos(a), radius * np.sin(a)) for a in turns], 12.0)).solid
    assert [len(ring) % 4 for ring in disc.facets] == [0, 0]
