"""The picture of a plan: a row for each side, every pick and set-down in it."""

import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np
import pytest

from daemon import frames
from daemon.pick.grippers.two_fingers import tool_rotation
from daemon.pick.planning.picture import CELL_PX, DOWN_RAD, HEAD_PX, plan_picture
from daemon.pick.planning.place_plan import PlannedMotion, SidePlan
from daemon.pick.settings import Settings
from tests.fakes.fake_cell import shape_of

HAND = Settings().gripper.body
NS = "{http://www.w3.org/2000/svg}"


def motion(tilt_deg: float) -> PlannedMotion:
    tool = frames.rigid(tool_rotation(np.array([1.0, 0.0, 0.0]), np.radians(tilt_deg)), np.array([520.0, 0.0, -275.0]))
    part = frames.rigid(np.eye(3), np.array([520.0, 0.0, -275.0]))
    return PlannedMotion("50 mm wide", part, tool, part, tool)


def test_each_side_has_a_row_with_each_pick_and_set_down_and_one_without_a_plan_its_reason() -> None:
    two = SidePlan(2, 3, 4, (motion(30.0), motion(-40.0)), "")
    none = SidePlan(3, 0, 4, (), "out of reach <at all>")
    drawn = ET.fromstring(plan_picture(shape_of("cube"), {"nest": [two, none]}, HAND))
    rows = drawn.findall(f"{NS}g")
    told = [[text.text for text in row.iter(f"{NS}text")] for row in rows]
    assert told[0] == ["nest, from side 2 down: 2 grasps, 3 of 4 headings", "take", "lay down", "take", "set down"]
    assert told[1] == ["nest, from side 3 down: out of reach <at all>"]
    assert [len(list(row.iter(f"{NS}polygon"))) for row in rows] == [12, 0], "three faces of a cube in each drawing"


def test_part_and_hand_are_drawn_inside_of_the_picture_and_a_hand_that_leans_leans_there() -> None:
    def leans(tilt_deg: float) -> float:
        plan = SidePlan(1, 4, 4, (motion(tilt_deg),), "")
        drawn = ET.fromstring(plan_picture(shape_of("cube"), {"nest": [plan]}, HAND))
        width, height = (float(drawn.attrib[key]) for key in ("width", "height"))
        for polygon in drawn.iter(f"{NS}polygon"):
            for point in polygon.attrib["points"].split():
                x, y = map(float, point.split(","))
                assert 0.0 < x < width
                assert 0.0 < y < height
        fingers = [line.attrib for line in drawn.iter(f"{NS}line") if line.attrib.get("class") == "hand"]
        assert len(fingers) == 2 * len(HAND.capsules)
        finger = max(fingers, key=lambda each: abs(float(each["y1"]) - float(each["y2"])))
        return float(finger["x1"]) - float(finger["x2"])

    assert leans(40.0) * leans(-40.0) < 0.0
    assert abs(leans(60.0)) > abs(leans(20.0))


def test_only_faces_towards_who_looks_are_drawn_and_they_look_down_on_it() -> None:
    shape, look = shape_of("cube"), SidePlan(1, 4, 4, (motion(10.0),), "")
    seen = list[float]()
    for facet, normal in zip(shape.facets, shape.normals, strict=True):
        drawn = ET.fromstring(plan_picture(replace(shape, facets=(facet,)), {"nest": [look]}, HAND))
        count = len(list(drawn.iter(f"{NS}polygon")))
        assert count in (0, 2)
        seen += [float(normal[2])] * (count == 2)
    assert len(seen) == 3
    assert max(seen) == pytest.approx(1.0)
    assert min(seen) > -0.1


def cells(tilt_deg: float) -> list[ET.Element]:
    """The drawings of one grasp: as it is taken and as it is set down."""
    drawn = ET.fromstring(plan_picture(shape_of("cube"), {"nest": [SidePlan(1, 4, 4, (motion(tilt_deg),), "")]}, HAND))
    return drawn.findall(f"{NS}g/{NS}g")


def corners_of(polygon: ET.Element) -> list[tuple[float, float]]:
    return [(float(x), float(y)) for x, y in (point.split(",") for point in polygon.attrib["points"].split())]


@pytest.mark.parametrize("tilt_deg", [-40.0, 0.0, 40.0])
def test_a_part_stands_upright_on_the_table_between_the_fingers(tilt_deg: float) -> None:
    size = float(np.ptp(shape_of("cube").corners_mm[:, 2]))
    for cell in cells(tilt_deg):
        shapes = [each for each in cell if each.attrib.get("class")]
        part = [k for k, each in enumerate(shapes) if each.attrib["class"] == "part"]
        assert part[0] > 0, "behind it is the far finger"
        assert part[-1] < len(shapes) - 1, "and before it the near one"
        corners = {point for polygon in cell.iter(f"{NS}polygon") for point in corners_of(polygon)}
        columns = dict[float, list[float]]()
        for x, y in sorted(corners):
            near = next((at for at in columns if abs(at - x) < 0.3), x)
            columns.setdefault(near, []).append(y)
        assert [len(each) for each in columns.values()] == [2, 1, 2, 2] or [len(each) for each in columns.values()] == [
            2,
            2,
            1,
            2,
        ], "upright edges are drawn upright"
        (table,) = (line for line in cell.iter(f"{NS}line") if "class" not in line.attrib)
        on_table = float(table.attrib["y1"])
        lowest = [max(ys) for ys in columns.values()]
        assert max(lowest) > on_table > min(lowest), "its foot is about the line"
        assert float(table.attrib["x1"]) < min(columns)
        assert max(columns) < float(table.attrib["x2"])
        high_px = max(max(ys) - min(ys) for ys in columns.values() if len(ys) == 2)
        scale = high_px / (size * np.cos(DOWN_RAD))
        widths = sorted({float(line.attrib["stroke-width"]) for line in shapes if "stroke-width" in line.attrib})
        assert widths == pytest.approx(sorted({2.0 * c.radius_mm * scale for c in HAND.capsules}), abs=0.4)


def test_the_picture_is_as_wide_as_its_longest_plan_and_as_high_as_its_rows() -> None:
    plans = [SidePlan(side, 4, 4, (motion(10.0),) * side, "") for side in (1, 3, 2)]
    drawn = ET.fromstring(plan_picture(shape_of("cube"), {"nest": plans[:2], "tray": plans[2:]}, HAND))
    assert (float(drawn.attrib["width"]), float(drawn.attrib["height"])) == (6 * CELL_PX, 3 * (CELL_PX + HEAD_PX))
    assert drawn.attrib["viewBox"] == f"0 0 {drawn.attrib['width']} {drawn.attrib['height']}"
    rows = drawn.findall(f"{NS}g")
    assert [len(row.findall(f"{NS}g")) for row in rows] == [2, 6, 4]
    for row, y in zip(rows, (0, 1, 2), strict=True):
        assert row.attrib["transform"] == f"translate(0 {y * (CELL_PX + HEAD_PX)})"
