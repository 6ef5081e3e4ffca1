"""The picture of a plan: a row for each side, every pick and set-down in it."""

import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np

from daemon import frames
from daemon.pick.place_plan import PlannedMotion, SidePlan
from daemon.pick.plan_picture import plan_picture
from daemon.pick.settings import Settings
from daemon.pick.two_fingers import tool_rotation
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


def test_only_faces_towards_who_looks_are_drawn() -> None:
    shape = shape_of("cube")
    open_box = replace(shape, facets=shape.facets[:1])
    drawn = ET.fromstring(plan_picture(open_box, {"nest": [SidePlan(1, 4, 4, (motion(10.0),), "")]}, HAND))
    assert len(list(drawn.iter(f"{NS}polygon"))) in (0, 2)
