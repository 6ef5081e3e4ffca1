"""A pick with cameras that are fixed over the table: it looks once, with the arm out of their view, and grasps."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from daemon import frames
from daemon.arm import RefusedError
from daemon.pick import pose_fusion
from daemon.pick.cycle import PickCycle
from daemon.pick.following import sighting_of
from daemon.pick.pose_fusion import Doubt
from daemon.pick.settings import Settings, StandOffs
from daemon.vision.refine import Fit
from tests.fakes.fake_cell import HEAD_DOWN, TruthRecogniser, World, cycle_of, one_part, rig

OVER = frames.rigid(np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]]), np.array([520.0, 0.0, 300.0]))
ONCE = replace(
    Settings(), views_of_doubtful=0, last_surveys=(), verify_mm=100.0, stops=StandOffs((150.0,), most_looks=1)
)
SURE = replace(ONCE, stops=replace(ONCE.stops, enough_mm=5.0, enough_deg=5.0))


def cell(settings: Settings = SURE) -> tuple[World, PickCycle]:
    world = one_part()
    world.fixed = OVER
    return world, cycle_of(world, settings)


def test_every_look_of_a_pick_is_with_the_arm_out_of_the_view() -> None:
    world, cycle = cell()
    end = asyncio.run(cycle.pick())
    looks = world.said("look")
    assert [look["purpose"] for look in looks] == ["survey 1", "approach", "verify"]
    for look in looks:
        assert np.allclose(look["where"], HEAD_DOWN, atol=0.5)
        assert np.array_equal(look["world_from_cyclopean"], OVER)
    assert end.stops == 1
    assert world.binned == ["cube"]
    assert end.outcome == "picked"


def test_the_gripper_goes_straight_to_the_grasp_and_back_from_it() -> None:
    world, cycle = cell()
    end = asyncio.run(cycle.pick())
    assert end.grasp is not None
    moves = [m["purpose"] for m in world.said("move")]
    assert moves.index("round to the approach") < moves.index("before the grasp") < moves.index("grasp")
    assert moves.index("lift") < moves.index("back off") < moves.index("where it was seen from") < moves.index("bin")


def test_where_one_look_is_not_enough_the_part_is_left_alone() -> None:
    _, cycle = cell(replace(ONCE, stops=replace(ONCE.stops, enough_mm=0.2)))
    end = asyncio.run(cycle.pick())
    assert (end.outcome, end.stops) == ("unsure", 1)
    assert "after 1 looks" in end.why


def test_a_part_that_no_look_finds_again_is_left_alone_at_once() -> None:
    world, cycle = cell()

    def before(act: str) -> None:
        if act == "see" and len(world.said("look")) == 1:
            world.lying.clear()

    world.before = before
    end = asyncio.run(cycle.pick())
    assert end.outcome == "lost"
    assert len(world.said("look")) <= 3


@pytest.mark.parametrize("job", ["look_around", "walk_round"])
def test_what_needs_looks_from_several_sides_is_refused_in_a_line(job: str) -> None:
    world, cycle = cell()
    jobs: Any = {
        "look_around": lambda: cycle.look_around(3),
        "walk_round": lambda: cycle.walk_round(cycle.recogniser, 6, print),
    }
    with pytest.raises(RefusedError, match="needs cameras on the gripper; the fixed cameras see"):
        asyncio.run(jobs[job]())
    assert not world.wire


def test_a_look_is_refused_while_the_arm_is_in_the_view() -> None:
    world, cycle = cell()
    world.at = frames.rigid(HEAD_DOWN[:3, :3], np.array([520.0, 0.0, -100.0]))
    with pytest.raises(RefusedError, match=r"the arm's [a-z ]+ is in the fixed cameras' view: `go home` first"):
        asyncio.run(cycle.look())
    assert not world.said("look")


def sighting(pivot: np.ndarray | None, doubt: Doubt) -> pose_fusion.Sighting:
    look: Any = SimpleNamespace(
        taken=SimpleNamespace(moved=None, pivot=pivot),
        reading=SimpleNamespace(world_from_tool=HEAD_DOWN),
        world_from_cyclopean=OVER,
    )
    part = frames.inverse(OVER) @ frames.rigid(np.eye(3), np.array([560.0, 30.0, -280.0]))
    return sighting_of(look, Fit(part, np.eye(6) * 1e-4, 0.1, 8), rig(), doubt)


def test_the_arm_errs_in_no_look_of_fixed_cameras_and_whole_at_the_grasp() -> None:
    pivot, well, badly = np.array([520.0, 0.0, -300.0]), Doubt(arm_mm=0.0, arm_deg=0.0), Doubt(arm_mm=0.5, arm_deg=0.1)
    assert np.array_equal(sighting(pivot, well).covariance, sighting(pivot, badly).covariance)
    assert np.trace(sighting(None, badly).covariance) > np.trace(sighting(None, well).covariance) + 0.7
    sure, unsure = (pose_fusion.fuse([sighting(pivot, doubt)], doubt).predicted_mm for doubt in (well, badly))
    assert unsure**2 - sure**2 == pytest.approx(3 * 0.5**2)


def test_the_cameras_pose_errs_about_the_middle_of_where_it_was_calibrated() -> None:
    """A turn of the cameras far from there would move the part by much more than the calibration leaves."""
    doubt = Doubt(hand_eye_mm=0.0, hand_eye_deg=0.05, pixels=1e-6, arm_mm=0.0, arm_deg=0.0)
    near = pose_fusion.fuse([sighting(np.array([560.0, 30.0, -280.0]), doubt)], replace(doubt, hand_eye_mm=1e-6))
    far = pose_fusion.fuse([sighting(OVER[:3, 3], doubt)], replace(doubt, hand_eye_mm=1e-6))
    away_mm = np.linalg.norm(OVER[:3, 3] - [560.0, 30.0, -280.0])
    lever_mm = np.sqrt(2) * np.radians(0.05) * away_mm
    own_mm = np.sqrt(3e-4)
    assert near.predicted_mm == pytest.approx(own_mm, rel=0.01)
    assert far.predicted_mm == pytest.approx(np.hypot(own_mm, lever_mm), rel=0.01)


def test_a_part_of_which_little_shows_is_left_alone_once_and_not_chosen_again() -> None:
    """The middle of the whole part is farther from that of what shows than two parts may be apart."""
    world = one_part("triangular_prism")
    world.fixed, world.most_seen = OVER, 1
    cycle = cycle_of(world, replace(ONCE, stops=replace(ONCE.stops, enough_mm=0.2)))
    end = asyncio.run(cycle.pick())
    assert end.outcome == "unsure"
    (skipped,) = cycle.skipped
    (chosen,) = [d for d in world.said("decision") if d["code"] == "chosen"]
    assert chosen["label"] == "triangular_prism"
    part, *_ = seen_parts_of(world)
    assert np.linalg.norm(skipped.centre - part) < 1.0


def seen_parts_of(world: World) -> list[np.ndarray]:
    """The middles of what a look shows."""
    scene = TruthRecogniser(world).see(None, None)
    corners = [np.concatenate([facet.corners_mm for facet in part.facets]) for part in scene.parts]
    return [frames.apply(OVER, each).mean(axis=0) for each in corners]
