"""One camera at two places: the rig of that, where it may go, and the arm's errors in what comes of it."""

from __future__ import annotations

import asyncio
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon import frames
from daemon.arm import Limits, RefusedError
from daemon.pick import moved_pair
from daemon.pick.cycle import PickCycle
from daemon.pick.pose_fusion import Doubt
from daemon.pick.settings import Settings
from daemon.vision.geometry import StereoRig, baseline, moved_rig
from daemon.vision.health import Clue
from daemon.vision.values import FacetView, Group, Part, Recognition, Scene
from tests.fakes.fake_cell import TruthRecogniser, World, build, one_part, rig

ARM = Doubt(arm_mm=0.1, arm_deg=0.03).arm()
DOWN = frames.rigid(np.diag([1.0, -1.0, -1.0]), np.array([500.0, 0.0, 50.0]))


def pair_at(baseline_mm: float) -> StereoRig:
    aside = DOWN @ frames.rigid(np.eye(3), np.array([baseline_mm, 0.0, 0.0]))
    return moved_rig(rig().left, (640, 480), (DOWN, aside))[0]


@given(st.floats(-120, 120).filter(lambda mm: abs(mm) > 5), st.floats(-0.02, 0.02), st.floats(-0.02, 0.02))
def test_points_seen_from_two_places_are_met_where_they_are(mm: float, turn: float, roll: float) -> None:
    second = DOWN @ frames.rigid(frames.rotation_from_vector(np.array([turn, roll, turn])), np.array([mm, 2.0, -1.0]))
    both, world_from_cyclopean = moved_rig(rig().left, (640, 480), (DOWN, second))
    points = np.array([[500.0, 0.0, -300.0], [520.0, 30.0, -280.0], [480.0, -20.0, -290.0]])
    seen = frames.apply(frames.inverse(world_from_cyclopean), points)
    line = baseline(both)
    met = line.points(line.left.ideal(both.left.project(seen)), line.right.ideal(both.right.project(seen)))
    np.testing.assert_allclose(frames.apply(world_from_cyclopean, met), points, atol=1e-6)
    assert both.left.cyclopean_from_camera[0, 3] < both.right.cyclopean_from_camera[0, 3]


@pytest.mark.parametrize("alone", ["left", "right"])
def test_one_camera_alone_is_planned_with_as_a_pair_of_itself_60_mm_apart(alone: Any) -> None:
    both = rig()
    tool_from_cyclopean = frames.rigid(np.diag([1.0, -1.0, -1.0]), np.array([10.0, 60.0, -40.0]))
    planned, tool_from_planned = moved_pair.rig_of_one_camera(both, tool_from_cyclopean, alone)
    camera = getattr(both, alone)
    assert planned.baseline_mm == pytest.approx(60.0)
    tool_from_first = tool_from_planned @ planned.left.cyclopean_from_camera
    np.testing.assert_allclose(tool_from_first, tool_from_cyclopean @ camera.cyclopean_from_camera, atol=1e-9)
    for camera in (planned.left, planned.right):
        np.testing.assert_allclose(camera.matrix, camera.matrix)
    turned = frames.difference(planned.left.cyclopean_from_camera, planned.right.cyclopean_from_camera)[3:]
    np.testing.assert_allclose(turned, 0.0, atol=1e-9)


def test_a_camera_that_did_not_move_makes_no_pair() -> None:
    with pytest.raises(ValueError, match="did not move"):
        moved_rig(rig().left, (640, 480), (DOWN, DOWN.copy()))


@given(st.floats(50, 1500), st.booleans())
def test_the_camera_goes_40_to_120_mm_aside_and_does_not_turn(away_mm: float, known: bool) -> None:
    for place in moved_pair.second_viewpoints(DOWN, away_mm, known):
        moved = frames.difference(place, DOWN)
        assert 40.0 - 1e-9 <= np.linalg.norm(moved[:3]) <= 120.0 + 1e-9
        assert not moved[3:].any()


def test_the_farther_the_table_the_longer_the_way_aside() -> None:
    near, far, sought = (
        next(moved_pair.second_viewpoints(DOWN, mm, known))[0, 3] - DOWN[0, 3]
        for mm, known in ((200.0, True), (450.0, True), (450.0, False))
    )
    assert (near, far, sought) == (50.0, 112.5, 67.5)
    assert moved_pair.distance_mm(DOWN, -300.0) == 350.0


@given(st.floats(0.0, 1.3), st.floats(-400.0, 0.0))
def test_how_far_the_table_is_along_the_axis_of_a_camera_that_leans(lean: float, table_z_mm: float) -> None:
    camera = DOWN @ frames.rigid(frames.rotation_from_vector(np.array([lean, 0.0, 0.0])), np.zeros(3))
    away_mm = moved_pair.distance_mm(camera, table_z_mm)
    if np.cos(lean) > 0.2:
        assert (camera @ [0.0, 0.0, away_mm, 1.0])[2] == pytest.approx(table_z_mm)
    assert moved_pair.distance_mm(camera, None) == moved_pair.USUAL_DISTANCE_MM


@pytest.mark.parametrize("lean", [1.38, 1.5, np.pi])
def test_a_camera_that_hardly_looks_down_is_taken_to_be_a_usual_distance_away(lean: float) -> None:
    camera = DOWN @ frames.rigid(frames.rotation_from_vector(np.array([lean, 0.0, 0.0])), np.zeros(3))
    assert moved_pair.distance_mm(camera, -300.0) == moved_pair.USUAL_DISTANCE_MM


def test_a_corners_doubt_is_what_arms_that_err_make_of_it() -> None:
    """Monte Carlo: the right place is off as said, twice over, and the rays are met as if it were not."""
    both, rng = pair_at(80.0), np.random.default_rng(0)
    point = np.array([[15.0, -10.0, 320.0]])
    left_px, line = both.left.project(point), baseline(both)
    spread = []
    for _ in range(4000):
        off = frames.perturb(both.right.cyclopean_from_camera, rng.normal(0, np.sqrt(2 * np.diag(ARM))))
        right_px = type(both.right)(both.right.matrix, both.right.distortion, off).project(point)
        spread.append(line.points(line.left.ideal(left_px), line.right.ideal(right_px))[0] - point[0])
    part = TruthRecogniser(World(rng))._facet(np.repeat(point, 4, axis=0))
    scene = Scene((), (), FacetView((Group((part,), ((0, 1, 2, 3),)),), (), (), (), 2.0))
    part_mm = part.corners_mm[0]
    added = (
        moved_pair.with_arm_errors(scene, both, ARM).view.groups[0].facets[0].covariance_mm2[0] - part.covariance_mm2[0]
    )
    along = part_mm - both.left.cyclopean_from_camera[:3, 3]
    along /= np.linalg.norm(along)
    assert np.sqrt(along @ added @ along) == pytest.approx(np.std(spread, axis=0)[2], rel=0.1)


def test_a_parts_doubt_in_a_moved_pair_is_its_own_and_the_arms() -> None:
    """The middle of two places turns by half of what each place errs by on its own, and depth suffers most."""
    own, arm = 0.01 * np.eye(6), np.diag([0.02, 0.02, 0.02, 1e-6, 2e-6, 3e-6])
    part: Any = SimpleNamespace(
        cyclopean_from_part=frames.rigid(np.eye(3), np.array([0.0, 0.0, 350.0])), covariance=own
    )
    added = moved_pair.covariance_with_arm_errors(part, pair_at(60.0), arm) - own
    np.testing.assert_allclose(added[3:, 3:], arm[3:, 3:] / 2)
    assert (added[:3, 3:] == 0).all()
    assert added[2, 2] > 10 * added[0, 0] > 0


@given(st.floats(45.0, 115.0), st.floats(200.0, 600.0))
def test_the_arms_error_sideways_moves_what_lies_ahead_in_depth_by_distance_over_baseline(
    baseline_mm: float, ahead_mm: float
) -> None:
    """Both places err by the arm's; where the rays to a point straight ahead then meet follows from similar triangles,
    and by what turns the right camera about its own y the point moves sideways by its distance."""
    both = pair_at(baseline_mm)
    right = both.right.cyclopean_from_camera[:3, 3]
    part: Any = SimpleNamespace(
        cyclopean_from_part=frames.rigid(np.eye(3), np.array([0.0, 0.0, ahead_mm])), covariance=np.zeros((6, 6))
    )
    sideways = moved_pair.covariance_with_arm_errors(part, both, np.diag([0.1**2, 0, 0, 0, 0, 0]))
    assert sideways[2, 2] == pytest.approx(2 * (0.1 * ahead_mm / baseline_mm) ** 2)
    assert sideways[0, 0] == pytest.approx(sideways[2, 2] * (right[0] / ahead_mm) ** 2)
    turning = moved_pair.covariance_with_arm_errors(part, both, np.diag([0, 0, 0, 0, 1e-4**2, 0]))
    ray_mm2 = ahead_mm**2 + (baseline_mm / 2) ** 2
    assert turning[2, 2] == pytest.approx(2 * (1e-4 * ray_mm2 / baseline_mm) ** 2)
    assert turning[4, 4] == pytest.approx(1e-4**2 / 2)


def test_a_scene_of_a_moved_pair_has_the_arms_errors_in_its_parts_as_in_its_facets() -> None:
    world = World(np.random.default_rng(0))
    both = pair_at(80.0)
    facet = TruthRecogniser(world)._facet(np.array([[0.0, 0, 320], [40, 0, 320], [40, 40, 320], [0, 40, 320]]))
    pose = frames.rigid(np.eye(3), np.array([20.0, 20.0, 320.0]))
    part = Part(Recognition("cube", 0.9, 1.0, 1.0, None, False, ""), (facet,), pose, 0.01 * np.eye(6), 0.1)
    scene = Scene((part,), (), FacetView((Group((facet,), ((0, 1, 2, 3),)),), (), (), (), 2.0))
    after = moved_pair.with_arm_errors(scene, both, ARM)
    (one,), (group,) = after.parts, after.view.groups
    np.testing.assert_allclose(one.covariance, moved_pair.covariance_with_arm_errors(part, both, ARM))
    np.testing.assert_array_equal(one.facets[0].covariance_mm2, group.facets[0].covariance_mm2)
    grown = np.linalg.eigvalsh(one.facets[0].covariance_mm2 - facet.covariance_mm2)
    assert (grown[:, -1] > 0.01).all()
    np.testing.assert_array_equal(one.facets[0].corners_mm, facet.corners_mm)


def laid(motions: list[Any]) -> tuple[list[Any], list[Any], StereoRig]:
    """A pose from each picture alone, sure but in depth, and the pair."""
    truth = frames.rigid(np.eye(3), np.array([0.0, 0.0, 300.0]))
    covariance = np.diag([0.02**2] * 2 + [0.3**2] + [0.001**2] * 3)
    return [frames.perturb(truth, motion) for motion in motions], [covariance] * 2, pair_at(75.0)


def test_a_part_that_is_larger_than_taught_is_put_where_both_pictures_meet() -> None:
    """0.5 % larger it seems 1.5 mm nearer to each camera by itself, and each puts it beside the other's ray."""
    both = pair_at(75.0)
    cameras, part = (both.left, both.right), np.array([0.0, 0.0, 300.0])
    nearer = [0.005 * (camera.cyclopean_from_camera[:3, 3] - part) for camera in cameras]
    poses, covariances, _ = laid([np.concatenate([shift, np.zeros(3)]) for shift in nearer])
    pose, covariance = moved_pair.fuse_single_camera_poses(poses, covariances, cameras, 1e-4 * ARM, 0.005)
    assert abs(pose[2, 3] - 300.0) < 0.1
    arm_pose, with_arm = moved_pair.fuse_single_camera_poses(poses, covariances, cameras, ARM, 0.005)
    assert abs(arm_pose[2, 3] - 300.0) < 3 * np.sqrt(with_arm[2, 2])
    assert with_arm[2, 2] > covariance[2, 2]


def test_pictures_that_disagree_by_more_than_the_arm_may_err_are_trusted_less() -> None:
    poses, covariances, both = laid([np.zeros(6), np.array([3.0, 0, 0, 0, 0, 0])])
    agreed, _, _ = laid([np.zeros(6), np.zeros(6)])
    cameras = both.left, both.right
    apart = moved_pair.fuse_single_camera_poses(poses, covariances, cameras, ARM, 0.004)[1]
    one = moved_pair.fuse_single_camera_poses(agreed, covariances, cameras, ARM, 0.004)[1]
    assert np.trace(apart[:3, :3]) > 10 * np.trace(one[:3, :3])


@given(st.floats(0.001, 0.2))
def test_how_large_a_part_is_tells_how_far_it_is_only_as_sharply_as_its_size_is_known(size_share: float) -> None:
    """From one place twice, nothing but its size tells the distance of 300 mm."""
    poses, covariances, both = laid([np.zeros(6), np.zeros(6)])
    pose, covariance = moved_pair.fuse_single_camera_poses(
        poses, covariances, [both.left] * 2, np.zeros((6, 6)), size_share
    )
    towards = both.left.cyclopean_from_camera[:3, 3] - pose[:3, 3]
    np.testing.assert_allclose(pose, poses[0], atol=1e-9)
    expected = covariances[0] / 2
    expected[:3, :3] += size_share**2 * np.outer(towards, towards)
    np.testing.assert_allclose(covariance, expected, rtol=1e-6, atol=1e-12)


@given(st.floats(0.01, 0.2))
def test_pictures_that_turn_a_part_against_each_other_leave_its_turn_as_open_as_they_disagree(turned: float) -> None:
    """Chi-square of two pictures of six measurements each, for seven unknowns of which one is known before."""
    poses, covariances, both = laid([np.zeros(6), np.array([0, 0, 0, turned, 0, 0])])
    pose, covariance = moved_pair.fuse_single_camera_poses(
        poses, covariances, (both.left, both.right), np.zeros((6, 6)), 0.004
    )
    np.testing.assert_allclose(frames.difference(pose, poses[0])[3:], [turned / 2, 0, 0], atol=1e-6)
    assert covariance[3, 3] == pytest.approx((turned / 2) ** 2 / 6, rel=0.01)


@given(st.floats(0.01, 1.0), st.floats(0.001, 0.1), st.floats(1e-6, 1e-2))
def test_what_a_moved_pair_hints_at_is_as_vague_as_both_of_its_places(mm: float, deg: float, own: float) -> None:
    sharp = Clue(np.zeros(3), np.array([own, own, np.inf]), "")
    sigma = moved_pair.clue_with_arm_errors(sharp, Doubt(arm_mm=mm, arm_deg=deg).arm()).sigma
    one_place = np.hypot(np.radians(deg), mm / moved_pair.USUAL_DISTANCE_MM)
    np.testing.assert_allclose(sigma, np.sqrt([own**2 + 2 * one_place**2] * 2 + [np.inf]))


def test_places_are_read_as_they_were_written() -> None:
    both = pair_at(60.0)
    places = moved_pair.Places("left", both.left.cyclopean_from_camera, both.right.cyclopean_from_camera, 0.1, 0.02)
    read = moved_pair.places_of(places.json())
    assert read is not None
    assert (read.camera, read.arm_mm, read.arm_deg) == ("left", 0.1, 0.02)
    for camera in ("left", "right"):
        again, written = (getattr(one, camera).cyclopean_from_camera for one in (read.rig(rig()), both))
        assert np.array_equal(again, written)
    assert moved_pair.places_of(None) is None


def alone(world: World, settings: Settings | None = None) -> PickCycle:
    """A cycle with one camera, enabled."""
    cell = build(world)
    object.__setattr__(cell, "alone", "left")
    cycle = PickCycle(cell, settings or Settings(), TruthRecogniser(world))
    cycle.supervisor.enable()
    return cycle


def to_the_right_mm(world: World, start: np.ndarray) -> list[float]:
    """How far to the right of where the arm stood, as the camera sees it, each move ended."""
    right = (start @ world.tool_from_cyclopean)[:3, 0]
    return [float((place[:3, 3] - start[:3, 3]) @ right) for act, place in world.wire if act == "move"]


def test_a_look_with_one_camera_is_two_pictures_and_a_bounded_move_that_is_logged_with_its_places() -> None:
    world = one_part()
    start = world.at.copy()
    look = asyncio.run(alone(world).look())
    assert [act for act, _ in world.wire] == ["move", "move"], "beside, and back"
    assert to_the_right_mm(world, start)[0] > 39.0
    assert np.allclose(world.wire[-1][1], start)
    assert look.taken.moved is not None
    assert 40.0 <= look.taken.rig.baseline_mm <= 120.0
    assert world.said("look")[0]["moved"]["eye"] == "left"
    assert look.taken_s == min(look.pictures.left.taken_s, look.pictures.right.taken_s)
    assert look.pictures.left.taken_s != look.pictures.right.taken_s


def test_with_one_camera_nothing_moves_for_a_look_before_the_arm_is_enabled() -> None:
    world = one_part()
    cycle = alone(world)
    asyncio.run(cycle.supervisor.disable())
    world.wire.clear()
    with pytest.raises(Exception, match="not_enabled"):
        asyncio.run(cycle.look())
    assert not world.wire


def test_where_the_arm_cannot_go_beside_it_is_said_and_is_no_fault() -> None:
    world = one_part()
    low, high = ([c + s for c in world.at[:3, 3]] for s in (-20.0, 20.0))
    cycle = alone(world, Settings(limits=Limits(box_low_mm=tuple(low), box_high_mm=tuple(high))))
    with pytest.raises(RefusedError, match="cannot go aside for the second picture"):
        asyncio.run(cycle.look())
    assert not world.wire
    assert cycle.supervisor.fault_text is None


def test_with_dry_on_a_look_with_one_camera_is_refused() -> None:
    cycle = alone(one_part())
    cycle.supervisor.dry(True)
    with pytest.raises(RefusedError, match="dry"):
        asyncio.run(cycle.look())


def test_a_look_taken_again_in_better_light_goes_back_and_is_of_where_the_arm_then_is() -> None:
    world = one_part()
    world.light = (0.4, 0.4)
    cycle, start = alone(world), world.at.copy()
    look = asyncio.run(cycle.look())
    assert len(world.said("look")) > 1
    places = [move for act, move in world.wire if act == "move"][:-1]
    beside, *back = to_the_right_mm(world, start)
    assert beside > 39.0
    assert back == pytest.approx([0.0, 0.0], abs=1.0)
    assert np.allclose(look.reading.world_from_tool, places[-1], atol=0.5)
