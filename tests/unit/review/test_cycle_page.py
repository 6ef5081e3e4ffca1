"""The page of one cycle: what it draws is what the run recorded, in the world."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from daemon import frames
from daemon.arm.collision_shapes import ARM as CAPSULES
from daemon.config import ArmSettings
from daemon.review.cycle_page import cycle_data, write_cycle_page
from daemon.review.page import read_digest
from daemon.store.runs import RunError
from drivers.puma560 import ArmGeometry
from drivers.puma560 import forward as forward_of
from tests.fakes.made_run import FACET, MadeRun, part

ARM = ArmGeometry(flange_from_tool=np.array(ArmSettings().flange_from_tool))
SURVEY, GRASP, LIFT, BIN = (
    np.radians(joints)
    for joints in (
        [10.0, 40.0, -130.0, 5.0, -60.0, 0.0],
        [20.0, 30.0, -120.0, 5.0, -70.0, 0.0],
        [20.0, 45.0, -120.0, 5.0, -70.0, 10.0],
        [60.0, 45.0, -110.0, 5.0, -70.0, 90.0],
    )
)
WORLD_FROM_CYCLOPEAN = frames.rigid(frames.rotation_from_vector(np.array([3.0, 0.1, 0.2])), np.array([400.0, 0, 0]))


def forward(joints: Any) -> Any:
    return forward_of(joints, ARM)


def moved(run: MadeRun, joints: Any, how: str, purpose: str) -> None:
    run.arrive(forward(joints), joints, how, purpose)


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A pick of a run that looks once, grasps, lifts and opens the gripper above the bin."""
    made = MadeRun(tmp_path / "20260102T030405Z", pictures=False)
    made.cycle = 1
    made.write("cycle_start", cycle=1, target=None)
    moved(made, SURVEY, "joint", "survey")
    scene = {"parts": [part("cube")]}
    made.write("look", cycle=1, purpose="survey", scene=scene, world_from_cyclopean=WORLD_FROM_CYCLOPEAN)
    moved(made, GRASP, "straight", "grasp")
    made.write("hand", cycle=1, closed=True)
    moved(made, LIFT, "straight", "lift")
    moved(made, BIN, "joint", "bin")
    made.write("hand", cycle=1, closed=False)
    made.write("cycle_end", cycle=1, outcome="picked", label="cube", why="seen in the gripper")
    return made.close()


def data_of(run: Path) -> dict[str, Any]:
    digest = read_digest(run)
    return cycle_data(run, digest, digest.cycles[0])


def test_every_arrival_look_and_gripper_command_can_be_chosen(run: Path) -> None:
    names = [moment["name"] for moment in data_of(run)["moments"]]
    assert names == ["survey", "look: survey", "grasp", "gripper closes", "lift", "bin", "gripper opens"]


def test_a_seen_part_lies_in_the_world_and_the_held_one_goes_with_the_tool(run: Path) -> None:
    drawn = {moment["name"]: moment["parts"] for moment in data_of(run)["moments"]}
    seen = frames.apply(WORLD_FROM_CYCLOPEAN, np.array(FACET["corners_mm"]))
    np.testing.assert_allclose(drawn["look: survey"][0]["facets"][0], seen, atol=0.06)
    np.testing.assert_allclose(drawn["grasp"][0]["facets"][0], seen, atol=0.06)
    carried = frames.apply(forward(BIN) @ np.linalg.inv(forward(GRASP)), seen)
    np.testing.assert_allclose(drawn["bin"][0]["facets"][0], carried, atol=0.06)
    np.testing.assert_allclose(drawn["gripper opens"][0]["facets"][0], carried, atol=0.06)


def test_the_arm_is_drawn_where_its_joints_were(run: Path) -> None:
    data = data_of(run)
    at = {moment["name"]: ends for moment, ends in zip(data["moments"], data["arm"]["ends"], strict=True)}
    left = [capsule.name for capsule in CAPSULES].index("left finger")
    for name, joints in (("look: survey", SURVEY), ("gripper closes", GRASP), ("gripper opens", BIN)):
        finger = np.array(at[name])[left, 1]  # its tip
        assert np.linalg.norm(finger - frames.apply(forward(joints), np.array([0, 49.0, 2.5]))) < 0.2
    assert len(data["arm"]["radius"]) == len(data["arm"]["ends"][0])


def test_a_straight_way_has_two_ends_and_a_joint_way_its_arc(run: Path) -> None:
    way = np.array(data_of(run)["way"])
    straight = [forward(j)[:3, 3] for j in (SURVEY, GRASP, LIFT)]
    np.testing.assert_allclose(way[:3], straight, atol=0.06)
    middle = forward((LIFT + BIN) / 2)[:3, 3]
    assert np.linalg.norm(way[3:-1] - middle, axis=1).min() < 0.2


def test_joints_and_speed_over_time_hold_between_moves(run: Path) -> None:
    motion = data_of(run)["motion"]
    assert motion["s"] == sorted(motion["s"])
    assert set(motion["speed"]) == {0.0, 40.0}
    at_rest = [k for k, speed in enumerate(motion["speed"]) if speed == 0.0]
    np.testing.assert_allclose(motion["joints"][at_rest[-1]], np.degrees(BIN), atol=0.01)
    np.testing.assert_allclose(motion["tool"][at_rest[-1]], forward(BIN)[:3, 3], atol=0.06)


def test_a_run_without_its_configuration_says_why_there_is_no_arm(run: Path) -> None:
    for kept in (run / "kept").iterdir():
        kept.unlink()
    data = data_of(run)
    assert data["arm"] is None
    assert data["trouble"].startswith("The arm is not drawn: ")
    assert len(data["way"]) == 4


def test_a_cycle_that_is_not_there_is_named_with_those_that_are(run: Path, tmp_path: Path) -> None:
    pytest.importorskip("plotly")
    with pytest.raises(RunError, match="no cycle 7; the run has cycles 1 to 1"):
        write_cycle_page(run, 7, tmp_path / "page.html")


def test_without_the_extra_a_line_says_how_to_add_it(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "plotly.offline", None)
    with pytest.raises(RunError, match="plots"):
        write_cycle_page(run, 1, tmp_path / "page.html")


def test_a_person_chooses_a_moment_and_sees_the_arm_then(browser: Any, run: Path, tmp_path: Path) -> None:
    pytest.importorskip("plotly")
    browser.get(write_cycle_page(run, 1, tmp_path / "page.html").as_uri())
    if browser.execute_script("return document.createElement('canvas').getContext('webgl') === null"):
        pytest.skip("this browser has no WebGL")
    browser.set_script_timeout(60)
    browser.execute_async_script(
        "const ask = (done) => document.documentElement.dataset.ready ? done() : setTimeout(ask, 50, done);"
        "ask(arguments[0])"
    )

    def arm() -> list[float]:
        found: list[float] = browser.execute_script(
            "return document.getElementById('space').data.find((t) => t.name === 'arm').x"
        )
        return found

    before = arm()
    browser.find_element("css selector", "#moments button:nth-child(6)").click()
    assert browser.find_element("id", "moment").text.endswith("arrived: bin, 0.02 mm from the target")
    assert arm() != before
    assert [e for e in browser.get_log("browser") if e["level"] == "SEVERE"] == []
