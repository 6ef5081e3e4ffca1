"""Where a part is to lie, by which ways it gets there, how far off it lies."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon import frames
from daemon.arrays import Array, Flags
from daemon.pick.place_table import PlaceTable
from daemon.pick.planning.place_goals import (
    PartPlaceError,
    deviation,
    fixture_boxes,
    flattened,
    goal_of,
    outline_of,
    set_down_of,
    ways_to,
)
from daemon.pick.pose_fusion import Estimate
from daemon.pick.set_down import combined_pose
from daemon.pick.settings import Settings
from daemon.store.library import load_facets
from daemon.store.place_file import CellPlaces, Fixture, FixtureEntry, Place, PlaceSettings, SolidBox
from daemon.store.place_status import PlaceState, PlaceStatus, PlaceStatuses
from daemon.teaching.solid_from_mesh import solid_drawn
from daemon.vision.geometry import Hole, Polyhedron
from drivers.simcell import parts
from tests.fakes.drawn import obj, prism
from tests.fakes.fake_cell import ON_HAND, shape_of


def everywhere(poses: Array) -> Flags:
    return np.ones(len(poses), bool)


ANGLES = st.floats(-180.0, 180.0)


def place(
    label: str = "cube", side: int = 1, heading_deg: float = 0.0, name: str = "nest", **place_settings: object
) -> Place:
    given = PlaceSettings(part=label, **place_settings)  # type: ignore[arg-type]
    return Place(name, given, np.eye(4), None, side, (500.0, -100.0, -300.0), heading_deg)


@pytest.mark.parametrize("label", parts.TAUGHT)
@given(heading_deg=ANGLES)
def test_a_side_that_is_down_lies_on_the_support_its_middle_at_the_point_its_edge_along_the_heading(
    label: str, heading_deg: float
) -> None:
    shape = shape_of(label)
    for side, ring in enumerate(shape.rings, start=1):
        pose = goal_of(place(label, side, heading_deg, equivalents=False), shape).poses[0]
        corners = frames.apply(pose, shape.corners_mm)
        assert corners[ring, 2] == pytest.approx(-300.0, abs=1e-6)
        assert corners[:, 2].min() == pytest.approx(-300.0, abs=1e-6)
        assert corners[ring].mean(axis=0)[:2] == pytest.approx([500.0, -100.0])
        edge = corners[ring[1]] - corners[ring[0]]
        off = np.degrees(np.arctan2(edge[1], edge[0])) - heading_deg
        assert abs((off + 180.0) % 360.0 - 180.0) < 1e-6
        assert frames.not_rigid(pose) is None


@pytest.mark.parametrize(("label", "count"), [("cube", 24), ("pyramid", 4), ("triangular_prism", 6)])
def test_the_turns_that_look_the_same_fill_the_same_room(label: str, count: int) -> None:
    shape = shape_of(label)
    goal = goal_of(place(label), shape)
    assert len(goal.poses) == count
    assert len(goal_of(place(label, equivalents=False), shape).poses) == 1
    for pose in goal.poses:
        apart = np.linalg.norm(frames.apply(pose, shape.corners_mm)[:, None] - goal.corners, axis=2)
        assert apart.min(axis=1).max() < 0.1


@pytest.mark.parametrize("lean", [[0.3, 0.2, 0.0], [0.3, 0.3, 0.0], [0.3, 0.0, 0.0]], ids=["askew", "corner", "edge"])
def test_a_side_that_the_part_has_not_and_a_pose_in_which_it_would_not_lie_flat_are_refused(lean: list[float]) -> None:
    with pytest.raises(PartPlaceError, match="cube has 6 sides, and side_down is 7"):
        goal_of(place(side=7), shape_of("cube"))
    leaning = frames.rigid(frames.rotation_from_vector(np.array(lean)), np.array([500.0, 0.0, -250.0]))
    with pytest.raises(PartPlaceError, match="would not lie flat there"):
        goal_of(Place("nest", PlaceSettings(part="cube"), np.eye(4), leaning), shape_of("cube"))


@given(x=st.floats(-5, 5), y=st.floats(-5, 5), turn=st.floats(-0.3, 0.3), which=st.integers(0, 23))
def test_how_far_off_a_part_lies_does_not_hang_on_which_of_its_likenesses_lies_there(
    x: float, y: float, turn: float, which: int
) -> None:
    goal = goal_of(place(), shape_of("cube"))
    centre = goal.centre
    spin = frames.rotation_from_vector(np.array([0.0, 0.0, turn]))
    moved = frames.rigid(np.eye(3), centre + np.array([x, y, 0.7])) @ frames.rigid(spin, -spin @ centre)
    off = deviation(goal, moved @ goal.poses[which])
    assert off.off_mm == pytest.approx(float(np.hypot(x, y)), abs=1e-6)
    assert off.off_deg == pytest.approx(abs(float(np.degrees(turn))), abs=1e-4)
    assert off.height_mm == pytest.approx(0.7)


def drawn_disc(flat_mm: float = 0.0, bore_at_mm: float | None = None) -> Polyhedron:
    """One of 20 mm radius and 12 mm height, from a drawing; with a flat so deep, or a hole so far from the middle."""
    turns = np.linspace(0, 2 * np.pi, 48, endpoint=False)
    ring = np.column_stack([20 * np.cos(turns), 20 * np.sin(turns)])
    if flat_mm:
        ring = ring[ring[:, 1] > flat_mm - 20.0]
    one = solid_drawn("disc.obj", obj(*prism([(x, y) for x, y in ring.tolist()], 12.0)), "mm", load_facets())
    if bore_at_mm is None:
        return one
    top = int(one.normals[:, 2].argmax())
    circle = np.column_stack([3 * np.cos(turns) + bore_at_mm, 3 * np.sin(turns), np.full(48, one.centres_mm[top, 2])])
    return replace(one, holes=(Hole(top, circle),))


@pytest.mark.parametrize(("flat_mm", "bore_at_mm", "free"), [
    (0.0, None, True), (0.0, 0.0, True), (0.0, 8.0, False), (4.0, None, False),
], ids=["disc", "bored in the middle", "bored beside it", "with a flat"])  # fmt: skip
@pytest.mark.parametrize("turn_deg", [7.0, -131.0])
def test_a_body_of_revolution_may_lie_in_any_turn_about_its_axis_and_no_other(
    flat_mm: float, bore_at_mm: float | None, free: bool, turn_deg: float
) -> None:
    disc = drawn_disc(flat_mm, bore_at_mm)
    side = 1 + int(disc.normals[:, 2].argmin())
    goal = goal_of(place("disc", side), disc)
    spin = frames.rotation_from_vector(np.radians([0.0, 0.0, turn_deg]))
    lean = frames.rotation_from_vector(np.radians([2.0, 0.0, 0.0]))
    lies = goal.poses[0].copy()
    lies[:3, :3] = lean @ spin @ lies[:3, :3]
    off = deviation(goal, lies)
    assert off.off_mm < 0.5
    assert (off.off_deg == pytest.approx(2.0, abs=0.01)) is free
    kept = deviation(goal_of(place("disc", side, equivalents=False), disc), lies)
    assert kept.off_deg > 6.0


@pytest.mark.parametrize("turn_deg", [31.0, -140.0])
def test_where_any_turn_will_do_a_part_is_off_by_how_it_leans_and_lies_beside_alone(turn_deg: float) -> None:
    shape = shape_of("triangular_prism")
    wanted, free = (goal_of(place("triangular_prism", any_turn=any_turn), shape) for any_turn in (False, True))
    lean, turn = (frames.rotation_from_vector(np.radians(way)) for way in ([2.0, 0.0, 0.0], [0.0, 0.0, turn_deg]))
    about = frames.rigid(lean @ turn, free.centre - lean @ turn @ free.centre)
    lies = frames.rigid(np.eye(3), np.array([0.7, 0.0, 0.0])) @ about @ free.poses[0]
    off = deviation(free, lies)
    assert off.off_mm == pytest.approx(0.7, abs=0.01)
    assert off.off_deg == pytest.approx(2.0, abs=0.01)
    assert deviation(wanted, lies).off_deg > 20.0


@pytest.mark.parametrize(("flat_mm", "sure"), [(0.0, True), (4.0, False)], ids=["disc", "with a flat"])
def test_a_turn_that_no_look_can_say_and_no_place_asks_for_leaves_no_doubt(flat_mm: float, sure: bool) -> None:
    disc = drawn_disc(flat_mm)
    goal = goal_of(place("disc", 1 + int(disc.normals[:, 2].argmin())), disc)
    about = goal.poses[0][:3, :3] @ [0.0, 0.0, 1.0]
    covariance = np.diag([0.01**2] * 3 + [0.0005**2] * 3)
    covariance[3:, 3:] += 0.06**2 * np.outer(about, about)
    finding = combined_pose(goal, Estimate(goal.poses[0], covariance, covariance))
    assert finding.status is PlaceStatus.RIGHT
    assert finding.sure is sure


def test_the_part_and_not_the_tool_is_brought_to_the_place() -> None:
    shape, settings = shape_of("cube"), Settings()
    goal = goal_of(place(release_mm=0.8, approach_mm=70.0), shape)
    held = frames.rigid(frames.rotation_from_vector(np.array([3.0, 0.1, 0.2])), np.array([1.5, -2.5, 4.0]))
    way = set_down_of(goal, goal.poses[3], held, settings, ON_HAND)
    there = frames.apply(way.at @ held, shape.corners_mm)
    assert there[:, 2].min() == pytest.approx(-299.2)
    assert there - [0, 0, 0.8] == pytest.approx(frames.apply(goal.poses[3], shape.corners_mm))
    assert way.over[:3, 3] - way.at[:3, 3] == pytest.approx([0, 0, 70])
    assert way.contact.level_mm == pytest.approx(-300.0)


def test_no_way_leads_where_the_open_fingers_would_be_in_a_part_that_lies_beside() -> None:
    shape, settings = shape_of("cube"), Settings()
    goal = goal_of(place(equivalents=False), shape)
    held = frames.inverse(frames.rigid(np.diag([1.0, -1.0, -1.0]), goal.centre)) @ goal.poses[0]
    free = [*ways_to(goal, held, settings, ON_HAND, everywhere, [])]
    assert len(free) == 1
    tool_y = free[0].at[:3, 1]
    beside = goal.corners + 70.0 * tool_y
    assert not [*ways_to(goal, held, settings, ON_HAND, everywhere, [beside])]
    assert not [*ways_to(goal, held, settings, ON_HAND, lambda poses: poses[:, 2, 3] > -250.0, [])]


def test_a_taught_pose_is_flat_and_on_the_table_where_it_nearly_is_and_as_seen_elsewhere() -> None:
    shape = shape_of("cube")
    true = goal_of(place(), shape).poses[0]
    lean = frames.rigid(frames.rotation_from_vector(np.array([0.02, -0.015, 0.0])), np.array([0.0, 0.0, 0.0]))
    seen = frames.rigid(np.eye(3), np.array([0.0, 0.0, 0.8])) @ true @ lean
    flat = frames.apply(flattened(seen, shape, -300.0), shape.corners_mm)
    assert np.sort(flat[:, 2])[:4] == pytest.approx(-300.0, abs=1e-6)
    shelf = frames.rigid(np.eye(3), np.array([0.0, 0.0, 40.0])) @ true
    assert flattened(shelf, shape, -300.0) == pytest.approx(shelf)


def test_the_solid_of_a_fixture_is_named_for_it() -> None:
    entry = FixtureEntry(
        point_mm=(1.0, 2.0, 3.0), heading_deg=30.0, solid=(SolidBox(low_mm=(0, 0, 0), high_mm=(1, 1, 1)),)
    )
    (box,) = fixture_boxes([Fixture("nest", entry)])
    assert (box.name, box.point_mm, box.heading_deg) == ("fixture nest, box 1", (1.0, 2.0, 3.0), 30.0)


def test_places_are_filled_in_order_and_a_layer_once_what_is_below_was_seen_right(tmp_path: Path) -> None:
    first = place(name="tray.1")
    second = Place("tray.2", first.settings, np.eye(4), None, 1, (560.0, -100.0, -300.0))
    above = Place("tray.3", first.settings, np.eye(4), None, 1, (500.0, -100.0, -250.0), on_top_of="tray.1")
    table = PlaceTable(CellPlaces(places=(first, second, above)), PlaceStatuses(tmp_path))
    table.know({"cube": shape_of("cube")})

    def free() -> list[str]:
        return [goal.place.name for goal in table.free("cube")]

    assert free() == ["tray.1", "tray.2"]
    for status, now in ((PlaceStatus.CLAIMED, ["tray.2"]), (PlaceStatus.SET, ["tray.2"]),
                        (PlaceStatus.OFF, ["tray.2"]), (PlaceStatus.RIGHT, ["tray.2", "tray.3"])):  # fmt: skip
        table.statuses.put("tray.1", status)
        assert free() == now
    assert [goal.place.name for goal in table.taken()] == ["tray.1"]


def test_places_that_moved_since_their_status_was_kept_are_to_be_looked_at_and_no_others(tmp_path: Path) -> None:
    table = PlaceTable(CellPlaces(places=(place(name="nest"), place(name="tray"))), PlaceStatuses(tmp_path))
    table.know({"cube": shape_of("cube")})
    assert table.moved() == {}
    states = {
        "nest": PlaceState(PlaceStatus.RIGHT),
        "tray": PlaceState(PlaceStatus.TO_LOOK_AT, why="it was moved by 12 mm"),
    }
    table.statuses = SimpleNamespace(of=states.__getitem__)  # type: ignore[assignment]
    assert table.moved() == {"tray": "it was moved by 12 mm"}


def test_a_place_of_a_part_that_nobody_taught_is_told_and_takes_none(tmp_path: Path) -> None:
    table = PlaceTable(CellPlaces(places=(place(side=9), place("bracket", name="other"))), PlaceStatuses(tmp_path))
    table.know({"cube": shape_of("cube")})
    assert (table.goals, table.has("bracket")) == ({}, True)
    assert "side_down is 9" in table.unusable["nest"]
    assert "no part bracket is taught" in table.unusable["other"]


@given(pitch_mm=st.floats(20.0, 80.0), heading_deg=ANGLES)
def test_parts_of_a_pattern_that_would_be_in_one_another_take_no_part(pitch_mm: float, heading_deg: float) -> None:
    """Cubes of 50 mm along a line that is turned as they are: they overlap as soon as the pitch is less than 50 mm."""
    along = pitch_mm * np.array([np.cos(np.radians(heading_deg)), np.sin(np.radians(heading_deg)), 0.0])
    shape, first = shape_of("cube"), np.array([500.0, -100.0, -300.0])
    places = tuple(
        Place(f"tray.{k + 1}", PlaceSettings(part="cube"), np.eye(4), None, 1, tuple(first + k * along), heading_deg)
        for k in range(3)
    )
    table = PlaceTable(CellPlaces(places=places))
    table.know({"cube": shape})
    assert sorted(table.goals) == (["tray.1"] if pitch_mm < 49.9 else ["tray.1", "tray.2", "tray.3"])
    if pitch_mm < 49.9:
        assert table.unusable["tray.2"].startswith("parts here and at tray.1 would overlap: set the corners of tray")


def test_two_places_for_one_spot_and_layers_over_one_another_are_no_mistake() -> None:
    lower = place(name="tray.1")
    upper = Place("tray.2", PlaceSettings(part="cube"), np.eye(4), None, 1, (500.0, -100.0, -250.0), on_top_of="tray.1")
    table = PlaceTable(CellPlaces(places=(place(name="a"), place(name="b"), lower, upper)))
    table.know({"cube": shape_of("cube")})
    assert not table.unusable


@given(st.lists(st.tuples(st.integers(-50, 50), st.integers(-50, 50)), min_size=3, max_size=20))
def test_an_outline_holds_all_its_points_and_turns_to_the_left(points: list[tuple[int, int]]) -> None:
    given_points = np.array(points, float)
    outline = np.array(outline_of(given_points))
    along = np.roll(outline, -1, axis=0) - outline
    for start, edge in zip(outline, along, strict=True):
        away = given_points - start
        assert (edge[0] * away[:, 1] - edge[1] * away[:, 0] >= -1e-9).all()
    assert {tuple(each) for each in outline.tolist()} <= {tuple(each) for each in given_points.tolist()}


def test_the_outline_of_a_place_is_that_of_its_part_from_above() -> None:
    outline = goal_of(place(heading_deg=0.0), shape_of("cube")).outline
    assert sorted(outline) == [[475.0, -125.0], [475.0, -75.0], [525.0, -125.0], [525.0, -75.0]]
