"""The kit of the demo: its files, as the daemon and the simulated cell read them, and what is said of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from daemon import frames
from daemon.cli import demo_kit
from daemon.cli.demo import PARTS
from daemon.events.records import Record
from daemon.pick.planning.place_goals import fixture_boxes, goal_of
from daemon.store import folders
from daemon.store.place_file import load_places
from drivers.simcell.ground_truth import pose_error
from drivers.simcell.parts import part_shape
from drivers.simcell.truth import load_truth
from tests.fakes.set_downs import drawn_model


def edges_of(label: str) -> list[list[float]]:
    shape = drawn_model().metric[label].solid
    corners = [shape.corners_mm[ring] for ring in shape.rings]
    return [np.linalg.norm(np.roll(each, -1, axis=0) - each, axis=1).tolist() for each in corners]


def test_each_part_of_the_demo_has_a_nest_turned_as_it_is_drawn(tmp_path: Path) -> None:
    """Its longest edge goes along the heading of the nest, and the part is flat on the plate."""
    path = tmp_path / "places.yaml"
    path.write_text(demo_kit.places_yaml({label: edges_of(label) for label in PARTS}))
    places = load_places(path)
    assert [place.part for place in places.places] == list(PARTS)
    for place, nest in zip(places.places, demo_kit.NESTS, strict=True):
        goal = goal_of(place, drawn_model().metric[nest.part].solid)
        middle = np.add(demo_kit.PLATE_MM, (*nest.point_mm, 0.0))
        foot = goal.corners[goal.corners[:, 2] < demo_kit.PLATE_MM[2] + 1.0]
        assert len(foot) == demo_kit.CORNERS_DOWN
        assert foot.mean(axis=0) == pytest.approx(middle, abs=0.01)
        sides = (foot[:, None] - foot[None]).reshape(-1, 3)
        heading = np.array([np.cos(np.radians(nest.heading_deg)), np.sin(np.radians(nest.heading_deg)), 0.0])
        longest = max(edges_of(nest.part)[place.side_down - 1])
        along = sides[np.abs(np.linalg.norm(sides, axis=1) - longest) < 0.1] @ heading
        assert along.max() == pytest.approx(longest, abs=0.1)


def test_the_simulated_cell_and_the_daemon_have_the_same_walls(tmp_path: Path) -> None:
    demo_kit.write_truth(folders.ETC / "simcell.yaml", tmp_path / "truth.yaml")
    (tmp_path / "places.yaml").write_text(demo_kit.places_yaml({label: edges_of(label) for label in PARTS}))
    walls = fixture_boxes(load_places(tmp_path / "places.yaml").fixtures)
    truth = load_truth(tmp_path / "truth.yaml").fixture
    assert [[each.low_mm, each.high_mm] for each in truth] == [
        [list(np.add(box.low_mm, box.point_mm)), list(np.add(box.high_mm, box.point_mm))] for box in walls
    ]


@pytest.mark.parametrize("nest", demo_kit.NESTS, ids=lambda nest: nest.part)
def test_a_drawing_is_the_shape_of_the_simulated_part(nest: demo_kit.Nest) -> None:
    lines = (folders.ETC / nest.drawing).read_text().splitlines()
    drawn = np.array([line.split()[1:] for line in lines if line.startswith("v ")], float)
    solid = part_shape(nest.part).hull
    assert len([line for line in lines if line.startswith("f ")]) == len(solid.faces)
    assert pose_error(drawn, solid.vertices) == pytest.approx((0.0, 0.0), abs=0.01)


def place(name: str, status: str, cycle: int, off: tuple[float | None, float | None] = (None, None)) -> Record:
    return {"kind": "place", "place": name, "status": status, "cycle": cycle, "off_mm": off[0], "off_deg": off[1]}


def test_the_result_counts_what_is_seen_right_and_says_the_largest_true_error() -> None:
    records: list[Record] = [
        place("nest_cube", "claimed", 1),
        place("nest_cube", "set", 1),
        place("nest_cube", "seen right", 1, (0.2, 0.1)),
        {"kind": "truth", "cycle": 1, "error_mm": 0.5, "place_mm": 0.3, "place_deg": 0.2},
        place("nest_pyramid", "claimed", 2),
        place("nest_pyramid", "off", 2, (1.4, 0.2)),
        {"kind": "truth", "cycle": 2, "error_mm": 0.5, "place_mm": 1.5, "place_deg": 0.1},
        place("nest_triangular_prism", "claimed", 3),
        place("nest_triangular_prism", "free", 3),
        {"kind": "truth", "cycle": 3, "error_mm": 0.5, "place_mm": None, "place_deg": None},
        place("elsewhere", "seen right", 4, (0.0, 0.0)),
    ]
    result = demo_kit.kit_result(records)
    assert result.right == 1
    assert result.lines[1].split() == [
        "cube",
        "seen",
        "right",
        "0.20",
        "mm",
        "0.10",
        "deg",
        "0.30",
        "mm",
        "0.20",
        "deg",
    ]
    assert result.lines[3].split() == ["triangular_prism", "free", "-", "-"]
    assert result.lines[-1] == "kit: 1 of 4 parts seen right in their nests, truly off by at most 1.50 mm 0.20 deg"


def test_a_kit_of_which_nothing_came_is_told_as_well() -> None:
    assert demo_kit.kit_result([]).lines[-1] == "kit: 0 of 4 parts seen right in their nests"


def test_a_true_error_is_zero_where_the_part_lies_as_its_goal(tmp_path: Path) -> None:
    """By every pose that looks the same."""
    path = tmp_path / "places.yaml"
    path.write_text(demo_kit.places_yaml({label: edges_of(label) for label in PARTS}))
    goal = goal_of(load_places(path).places[0], drawn_model().metric["cube"].solid)
    assert len(goal.poses) == 24
    here = frames.apply(goal.poses[5], goal.shape.corners_mm)
    errors = [pose_error(frames.apply(pose, goal.shape.corners_mm), here) for pose in goal.poses]
    assert min(errors) == pytest.approx((0.0, 0.0), abs=1e-6)
