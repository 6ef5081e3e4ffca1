"""Facets with arcs are named by their whole outline, however they lie; recall tells apart what one arc cannot."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from daemon import frames
from daemon.arrays import Array
from daemon.store.library import load_facets
from daemon.store.model import from_bytes, to_bytes
from daemon.vision.geometry import Polyhedron
from daemon.vision.model import Model, empty_model, learn_solid, relational_view, relearnt, type_facet, type_number
from tests.fakes.drawn import obj, prism
from tests.fakes.machined import drawing

LIBRARY = load_facets()
HIGH_MM = 20.0
MOTION = frames.rigid(frames.rotation_from_vector(np.array([0.4, -1.2, 0.7])), np.array([30.0, -20.0, 400.0]))

Outline = list[tuple[float, float]]


def around(x: float, y: float, radius: float, first_deg: float, last_deg: float) -> Outline:
    steps = max(int(abs(last_deg - first_deg) / 7.5), 4)
    turns = np.radians(np.linspace(first_deg, last_deg, steps + 1))
    return [(x + radius * np.cos(turn), y + radius * np.sin(turn)) for turn in turns]


def rounded_box(wide: float, high: float, radii: tuple[float, ...]) -> Outline:
    """A rectangle, anticlockwise from below left, each corner rounded by its own radius, or sharp by none."""
    found: Outline = []
    for k, radius in enumerate(radii):
        x, y = ((0, 0), (wide, 0), (wide, high), (0, high))[k]
        inner = x + radius * (1 if x == 0 else -1), y + radius * (1 if y == 0 else -1)
        found += around(*inner, radius, 180 + 90 * k, 270 + 90 * k) if radius else [(float(x), float(y))]
    return found


OUTLINES: dict[str, Outline] = {
    "rounded_square": rounded_box(40, 40, (10, 10, 10, 10)),
    "rounded_rectangle": rounded_box(40, 60, (10, 10, 10, 10)),
    "square_with_1_rounded_corner": rounded_box(40, 40, (0, 10, 0, 0)),
    "rectangle_with_2_rounded_corners": rounded_box(40, 60, (0, 10, 10, 0)),
    "rectangle_with_rounded_corners_1_and_3": rounded_box(40, 60, (0, 10, 0, 10)),
    "polygon6_with_1_rounded_corner": [(0, 0), (60, 0), (60, 10), *around(22, 22, 12, 270, 180), (10, 45), (0, 45)],
    "quarter_disc": [(0, 0), *around(0, 0, 30, 0, 90)],
    "sector_120": [(0, 0), *around(0, 0, 30, 0, 120)],
    "half_disc": around(0, 0, 20, 0, 180),
    "d_shape_300": around(0, 0, 20, 0, 300),
    "segment_120": around(0, 0, 40, 0, 120),
    "stadium": [*around(40, 0, 15, -90, 90), *around(0, 0, 15, 90, 270)],
    "rectangle_with_a_round_end": [*around(40, 0, 15, -90, 90), (0, 15), (0, -15)],
    "disc": around(0, 0, 20, 0, 360)[:-1],
}


@cache
def solid(name: str) -> Polyhedron:
    return drawing(f"{name}.obj", obj(*prism(OUTLINES[name], HIGH_MM))).solid


def faces(name: str) -> list[tuple[Array, Array, list[Array]]]:
    """Corners, covariance and arcs of its two faces with arcs, moved."""
    whole = solid(name)
    return [
        (
            frames.apply(MOTION, whole.corners_mm[whole.rings[face]]),
            whole.covariance_mm2[whole.rings[face]],
            [frames.apply(MOTION, arc.points_mm) for arc in whole.arcs if arc.facet == face],
        )
        for face in {arc.facet for arc in whole.arcs}
    ]


@pytest.mark.parametrize("name", OUTLINES)
def test_a_facet_with_arcs_is_named_by_its_whole_outline(name: str) -> None:
    assert solid(name).types.count(name) == 2


@pytest.mark.parametrize("name", OUTLINES)
def test_a_name_does_not_depend_on_where_the_ring_begins_or_lies(name: str) -> None:
    for corners, spread, arcs in faces(name):
        for by in range(len(corners)):
            turned = np.roll(corners, by, axis=0)
            assert type_facet(turned, np.roll(spread, by, axis=0), LIBRARY, arcs)[0].name == name


def test_an_arc_that_bends_inwards_is_another_element() -> None:
    bay: Outline = [(0, 0), (60, 0), (60, 30), *around(30, 30, 20, 0, -180), (0, 30)]
    kinds = drawing("bay.obj", obj(*prism(bay, HIGH_MM))).solid.types
    assert kinds.count("outline_h180.s.s.s.s.s.") == 2


def test_a_square_measured_badly_may_be_a_rectangle_with_rounded_corners_as_well() -> None:
    corners, spread, arcs = faces("rounded_square")[0]
    assert [t.name for t in type_facet(corners, spread, LIBRARY, arcs)] == ["rounded_square", "rounded_rectangle"]


@pytest.mark.parametrize(("radius_mm", "names"), [
    (2.0, ["rectangle"]), (3.5, ["rounded_rectangle", "rectangle"]), (8.0, ["rounded_rectangle"]),
])  # fmt: skip
def test_what_a_look_hardly_resolves_is_asked_both_ways(radius_mm: float, names: list[str]) -> None:
    turns, side = np.linspace(0, np.pi / 2, 12), np.array([40.0, 60.0])
    corners, arcs = list[Array](), list[Array]()
    for k, (x, y) in enumerate(((-1, -1), (1, -1), (1, 1), (-1, 1))):
        middle = np.array([x, y]) * (side / 2 - radius_mm)
        angle = np.pi + k * np.pi / 2 + turns
        arc = np.column_stack([middle + radius_mm * np.column_stack([np.cos(angle), np.sin(angle)]), 0 * angle])
        arcs.append(arc)
        corners += [arc[0], arc[-1]]
    found = type_facet(np.array(corners), np.tile(0.01 * np.eye(3), (8, 1, 1)), LIBRARY, arcs)
    assert [t.name for t in found] == names


def test_a_sweep_near_the_limit_of_a_step_is_asked_both_ways() -> None:
    around_ = np.column_stack([np.array(around(0, 0, 20, 0, 293)), np.zeros(40)])
    names = [t.name for t in type_facet(around_[::5], np.tile(0.01 * np.eye(3), (8, 1, 1)), LIBRARY, [around_])]
    assert names[:2] == ["d_shape_300", "d_shape_285"]


@cache
def taught(*names: str) -> Model:
    model = empty_model(LIBRARY)
    for name in names:
        model = learn_solid(model, solid(name), name)
    return model


def recalled(model: Model, name: str, length_mm: float) -> set[str]:
    """The parts recalled by a face with arcs and one wall of a part, of this length."""
    whole = model.metric[name].solid
    face = next(k for k, kind in enumerate(whole.types) if kind not in ("rectangle", "square"))
    beside = np.flatnonzero(whole.touching[face])
    area = np.linalg.norm(whole.areas_mm2[beside], axis=1)
    seen = whole.only([face, int(beside[np.abs(area - length_mm * HIGH_MM).argmin()])])
    answer = model.artmap.recall(relational_view(seen, [(kind,) for kind in seen.types], LIBRARY, 0.05), 1.0)
    return {model.artmap.node_labels[node] for node in answer.node}


def by_longest_arc(model: Model) -> Model:
    """The model as an earlier release had it: a facet with arcs is named by the longest alone."""

    def named(one: Polyhedron) -> Polyhedron:
        arcs = {arc.facet for arc in one.arcs}
        return replace(one, types=tuple("arc90" if k in arcs else kind for k, kind in enumerate(one.types)))

    return relearnt(
        replace(model, metric={label: replace(own, solid=named(own.solid)) for label, own in model.metric.items()})
    )


@pytest.mark.parametrize(("one", "other", "length_mm"), [
    ("rounded_square", "rounded_rectangle", 20.0), ("rectangle_with_2_rounded_corners", "rounded_rectangle", 40.0),
])  # fmt: skip
def test_recall_tells_outlines_apart_by_elements_that_no_seen_neighbour_bounds(
    one: str, other: str, length_mm: float
) -> None:
    now = taught(one, other, "square_with_1_rounded_corner", "quarter_disc")
    before = by_longest_arc(now)
    for name in (one, other):
        assert recalled(now, name, length_mm) == {name}
        assert recalled(before, name, length_mm) == {one, other}


@pytest.mark.parametrize("name", ["square_with_1_rounded_corner", "quarter_disc"])
def test_recall_tells_a_rounded_corner_from_a_quarter(name: str) -> None:
    assert recalled(taught("square_with_1_rounded_corner", "quarter_disc", "rounded_square"), name, 30.0) == {name}


def test_a_model_of_an_earlier_release_is_renamed_and_learnt_anew() -> None:
    now = taught("rounded_square", "rounded_rectangle")
    before = by_longest_arc(now)
    assert "arc90" in before.metric["rounded_square"].solid.types
    loaded, anew = from_bytes(to_bytes(before)).model, relearnt(now)
    assert loaded.metric["rounded_square"].solid.types == now.metric["rounded_square"].solid.types
    for end in ("lower", "upper", "counts"):
        np.testing.assert_allclose(getattr(loaded.artmap, end), getattr(anew.artmap, end), atol=1e-6)


def test_the_word_of_an_earlier_release_keeps_its_number() -> None:
    assert type_number("arc90", LIBRARY) == pytest.approx(0.85125)
