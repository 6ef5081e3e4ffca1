"""A part from look to look, and what a look back says of the hand: the fingers met, or a part between them."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon import frames
from daemon.arm import HeldPart, OnHand, Reading
from daemon.arm.workcell import CameraName
from daemon.arrays import Array
from daemon.calibration.file import load_calibration
from daemon.config import load_config
from daemon.pick import following, moved_pair
from daemon.pick.following import (
    CameraMount,
    chi_squares_of_others,
    expected_at,
    fit_target,
    held_by_edges,
    held_pose,
    largest_deviation_mm,
    least_error,
    shows_empty_gripper,
    shows_in_gripper,
    shows_release,
)
from daemon.pick.grippers.suction import SuctionCup
from daemon.pick.grippers.two_fingers import tool_rotation
from daemon.pick.looks import CapturedPair
from daemon.pick.pose_fusion import CHI_SQUARE_6, Doubt, Estimate
from daemon.pick.seen import ObservedPart
from daemon.store import folders
from daemon.vision.geometry import Polyhedron, StereoRig, exact, moved_rig
from daemon.vision.model import symmetries
from daemon.vision.refine import Fit
from daemon.vision.settings import TOLERANCE_MM
from daemon.vision.values import UNKNOWN, Part, Recognition
from drivers.rigid import rigid, turn
from drivers.simcell.cell import SimulatedCell
from drivers.simcell.parts import part_shape
from drivers.simcell.world import PartPlace
from tests.bench.machined import drawn
from tests.fakes.chosen import few
from tests.fakes.fake_cell import shape_of
from tests.fakes.machined import shape_from_drawing, shown_shape
from tests.fakes.painted import paint_pair
from tests.fakes.solids import CUBE, measured, pose

ETC = folders.HOUSE / "etc"
CONFIG = load_config(ETC / "facetd.yaml", simulated=True)
DOUBT = CONFIG.values.pick.doubt


def taken(pair: Any, rig: StereoRig) -> CapturedPair:
    """A pair of both cameras, the arm at the world's origin."""
    return CapturedPair(pair, pair, Reading(np.eye(4), np.zeros(6)), 0.0, rig, np.eye(4))


DOWN = rigid(np.diag([1.0, -1.0, -1.0]), [500.0, 0.0, 50.0])
ASIDE = rigid(np.eye(3), [70.0, 0.0, 0.0])
IN_THE_HAND = rigid(turn([0, 0, 1], np.pi / 2), [0.0, 0.0, 10.0])


def over_a_table(
    holds_cube: bool, gap_mm: float, turned_deg: float = 0.0, height_mm: float = 0.0, **looks: Any
) -> tuple[Any, CameraMount]:
    """A pair from over a table, the hand upright and turned, and how the cameras sit on it."""
    believed = load_calibration(CONFIG.calibration)
    upright = rigid(turn([0, 0, 1], np.radians(turned_deg)) @ turn([1, 0, 0], np.pi), [470.0, 0.0, height_mm])
    with SimulatedCell(ETC / "simcell.yaml", **looks) as cell:
        cell.world_from_tool = lambda real_s=None: upright
        if holds_cube:
            cell.world.scatter(["pyramid"], np.random.default_rng(0))
            cell.world.put("cube", IN_THE_HAND, PartPlace.HAND)
        cell.world.gap_mm = gap_mm
        cell.camera.open()
        pair = cell.camera.grab(0.0, 1.0)
    return taken(pair, believed.rig), CameraMount(believed.rig, OnHand(believed.tool_from_cyclopean))


def look_back(seed: int, holds_cube: bool) -> tuple[Any, CameraMount]:
    """A pair from over a patterned table; the seed prints the cube. A hand without it has met fingers."""
    return over_a_table(holds_cube, 50.0 if holds_cube else 0.0, seed=seed, table="patterned", parts="printed")


def grasped() -> Any:
    """The cube as it was thought to be held: a little askew."""
    askew = frames.perturb(IN_THE_HAND, np.array([2.0, -1.0, 1.5, *np.radians([1.5, -1.0, 2.0])]))
    cube = part_shape("cube").hull
    return SimpleNamespace(shape=exact(cube.vertices, cube.faces), tool_from_part=askew, estimate=None)


def seems_empty(seed: int, holds_cube: bool) -> bool:
    return shows_empty_gripper(*look_back(seed, holds_cube), CONFIG.values.pick.gripper)


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("held", [True, False])
def test_a_part_is_seen_in_the_hand_that_holds_it_and_in_no_other(seed: int, held: bool) -> None:
    assert shows_in_gripper(grasped(), *look_back(seed, held), DOUBT) is held


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("held", [True, False])
def test_a_part_left_the_hand_where_its_edges_are_gone_once_it_opened(seed: int, held: bool) -> None:
    before, mount = look_back(seed, held)
    after, _ = over_a_table(False, 50.0, seed=seed, table="patterned", parts="printed")
    assert shows_release(grasped(), before, after, mount, DOUBT) is held
    assert not shows_release(grasped(), before, before, mount, DOUBT), "nothing is gone"


def test_a_part_of_which_two_faces_melt_in_the_light_above_the_bin_is_seen_to_leave_the_hand() -> None:
    """Seven tenths of its edges showed there, and a part that was in the bin counted as released only."""
    before, mount = over_a_table(True, 50.0, 210.0, 200.0, seed=1)
    after, _ = over_a_table(False, 50.0, 210.0, 200.0, seed=1)
    assert not shows_in_gripper(grasped(), before, mount, DOUBT)
    assert shows_release(grasped(), before, after, mount, DOUBT)


def test_edges_in_the_gripper_are_sought_near_the_grasp_first_and_then_as_far_as_jaws_push(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A small part whose edges the fingers' drew to themselves 6 mm off counted as missed."""
    mount: Any = CameraMount(None, OnHand(np.eye(4)))
    look: Any = SimpleNamespace(reading=SimpleNamespace(world_from_tool=np.eye(4)), stereo=None)
    target: Any = SimpleNamespace(
        label="cube", shape=shape_of("cube"), tool_from_part=np.eye(4),
        estimate=SimpleNamespace(covariance=np.diag([0.01] * 3 + [1e-6] * 3)),
        plan=SimpleNamespace(grasp=SimpleNamespace(world_from_tool=np.eye(4))),
    )  # fmt: skip
    sought: list[float] = []
    shows = {"near": lambda mm: mm < 3.0, "far": lambda mm: mm > 3.0, "none": lambda mm: False}
    for where, shown in shows.items():

        def share(*args: Any, shown: Any = shown) -> float:
            sought.append(args[-1])
            return float(shown(args[-1]))

        monkeypatch.setattr(following, "clear_edge_fraction", share)
        monkeypatch.setattr(following, "vanished_edge_fraction", share)
        for asked in (
            lambda: shows_in_gripper(target, look, mount, DOUBT),
            lambda: shows_release(target, look, look, mount, DOUBT),
        ):
            sought.clear()
            assert asked() is (where != "none")
            assert sought[0] < 3.0
            assert sought[1:] == ([] if where == "near" else [following.REACH_MM])
    target.estimate = None
    sought.clear()
    assert not shows_in_gripper(target, look, mount, DOUBT)
    assert sought == [following.REACH_MM], "nothing says how far off it may be"


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_fingers_that_met_are_seen_over_any_table(seed: int) -> None:
    assert seems_empty(seed, holds_cube=False)


@pytest.mark.parametrize("seed", [1, 10])
def test_print_on_the_held_part_is_not_taken_for_fingers_that_met(seed: int) -> None:
    """Of the print of seed 10 more than three quarters lies where the met fingers' outline would."""
    assert not seems_empty(seed, holds_cube=True)


def test_a_part_named_by_its_edges_is_followed_as_it_was_named_though_facets_of_it_were_measured_askew() -> None:
    believed = load_calibration(CONFIG.calibration)
    shape = exact(CUBE.corners_mm, CUBE.facets)
    truth = pose(np.array([0.75, 0.25, 0.6]), 0.3, 320.0)
    askew = frames.perturb(truth, np.array([0.0, 0.0, 2.0, *np.radians([-8.0, 1.0, 0.0])]))
    corners = frames.apply(askew, shape.corners_mm)
    facets = tuple(measured(corners[shape.rings[k]], None, 3.0) for k in np.flatnonzero(shape.facing(askew) > 0))
    quarter = frames.rigid(turn([0, 0, 1], np.pi / 2), np.zeros(3))
    middle = frames.rigid(np.eye(3), shape.corners_mm.mean(0))
    turned = truth @ middle @ quarter @ frames.inverse(middle)
    name = Recognition("cube", 0.9, 0.0, 0.0, None, False, "its edges")
    part = Part(name, facets, turned, np.diag([0.04] * 3 + [1e-5] * 3), 0.2, (), np.stack([turned, truth]))
    grey = SimpleNamespace(pixels=np.full((480, 640), 90, np.uint8))
    pair: Any = SimpleNamespace(left=grey, right=grey)
    look: Any = SimpleNamespace(
        world_from_cyclopean=np.eye(4), scene=SimpleNamespace(parts=(part,)), taken=taken(pair, believed.rig)
    )
    target: Any = SimpleNamespace(
        label="cube",
        shape=shape,
        world_from_part=frames.perturb(truth, np.full(6, 0.01)),
        centre=corners.mean(0),
        estimate=None,
    )
    fit = fit_target(target, look)
    assert fit is not None
    assert np.allclose(fit.cyclopean_from_part, truth, atol=1e-6)


def test_the_facets_of_a_named_part_do_not_outweigh_its_pose(monkeypatch: pytest.MonkeyPatch) -> None:
    """A pick blamed the hand-eye: a gusset's facets gave a pose 7.8 mm off, sure to .5 mm. A V-block went to the bin:
    the corners of its sides that did not show were where a pose 1.9 degrees off had them, which they confirmed."""
    believed = load_calibration(CONFIG.calibration)
    shape = exact(CUBE.corners_mm, CUBE.facets)
    truth = pose(np.array([0.75, 0.25, 0.6]), 0.3, 320.0)
    left, right = paint_pair([(CUBE, truth)], np.random.default_rng(5), believed.rig)
    pair: Any = SimpleNamespace(left=SimpleNamespace(pixels=left), right=SimpleNamespace(pixels=right))
    askew = frames.perturb(truth, np.array([0.0, 3.0, 4.0, *np.radians([-9.0, 3.0, 0.0])]))
    corners = frames.apply(askew, shape.corners_mm)
    facets = tuple(measured(corners[shape.rings[k]], None, 0.1) for k in np.flatnonzero(shape.facing(askew) > 0))
    named = frames.perturb(truth, np.array([0.4, -0.3, 0.8, *np.radians([0.5, 0.4, -0.3])]))
    name = Recognition("cube", 0.9, 0.0, 0.0, None, False, "its edges")
    part = Part(name, facets, named, np.diag([1.0] * 3 + [1e-4] * 3), 0.2, (), named[None])
    look: Any = SimpleNamespace(
        world_from_cyclopean=np.eye(4), scene=SimpleNamespace(parts=(part,)), taken=taken(pair, believed.rig)
    )
    target: Any = SimpleNamespace(
        label="cube", shape=shape, world_from_part=named, centre=corners.mean(0), estimate=None
    )
    monkeypatch.setattr(following, "fit_pair_by_edges", lambda *_: None)
    fit = fit_target(target, look)
    assert fit is not None
    np.testing.assert_allclose(fit.cyclopean_from_part, named)


def test_what_moved_between_two_looks_is_told_by_the_poses_that_they_name() -> None:
    """A look that does not name it measures it by its facets; one that shows too little of it says nothing."""
    shape = exact(CUBE.corners_mm, CUBE.facets)
    there = pose(np.array([0.75, 0.25, 0.6]), 0.3, 320.0)
    name = Recognition("cube", 0.9, 0.0, 0.0, None, False, "its edges")
    look: Any = SimpleNamespace(
        world_from_cyclopean=np.eye(4),
        reading=SimpleNamespace(world_from_tool=np.eye(4)),
        taken=SimpleNamespace(pivot=None, moved=None),
    )

    def part(
        moved_mm: float, recognition: Recognition = name, sigma_mm: float = 0.1, facets_off_mm: float = 0.0
    ) -> ObservedPart:
        where = frames.rigid(np.eye(3), np.array([moved_mm, 0.0, 0.0])) @ there
        corners = frames.apply(where, shape.corners_mm) + np.array([facets_off_mm, 0.0, 0.0])
        shown = np.flatnonzero(shape.facing(where) > 0)
        facets = tuple(measured(corners[shape.rings[k]], None, sigma_mm) for k in shown)
        sure = np.diag([0.04] * 3 + [1e-6] * 3)
        return ObservedPart(Part(recognition, facets, where, sure, 0.2, (), where[None]), look)

    def chi_squares(now: ObservedPart) -> list[float]:
        rig = load_calibration(CONFIG.calibration).rig
        return chi_squares_of_others([part(0.0)], [now], lambda _: shape, rig, DOUBT)

    unknown = Recognition(UNKNOWN, 0.0, 0.0, 0.0, None, False, "a shadow")
    for now in (part(0.0), part(0.0, unknown), part(0.0, facets_off_mm=3.0)):
        assert chi_squares(now)[0] < 0.5
    for now in (part(3.0), part(3.0, unknown)):
        assert chi_squares(now)[0] > CHI_SQUARE_6
    assert chi_squares(part(0.0, unknown, sigma_mm=20.0)) == chi_squares(part(40.0)) == chi_squares(part(500.0)) == []


@pytest.mark.parametrize(("mm", "deg"), [(0.0, 0.0), (2.0, 1.0)])
def test_how_a_part_is_held_is_the_grasp_and_its_edges_weighed_by_their_errors(
    monkeypatch: pytest.MonkeyPatch, mm: float, deg: float
) -> None:
    tool_from_cyclopean = frames.rigid(np.eye(3), np.array([0.0, 0.0, -100.0]))
    grasped_at = frames.rigid(np.eye(3), np.array([0.0, 0.0, 10.0]))
    seen = frames.perturb(grasped_at, np.array([mm, 0, 0, 0, 0, np.radians(deg)]))
    tight, loose = np.diag([0.01] * 3 + [1e-6] * 3), np.diag([1.0] * 3 + [1e-4] * 3)
    doubt = Doubt(0.0, 0.0, 0.0, 0.0, 0.0)
    fit = Fit(frames.inverse(tool_from_cyclopean) @ seen, tight, 0.1, 9)
    found: list[Any] = []
    monkeypatch.setattr(
        following, "fit_by_edges", lambda shape, stereo, near, reach, **_: found.append((near, reach)) or fit
    )
    target: Any = SimpleNamespace(
        label="cube", shape=shape_of("cube"), tool_from_part=grasped_at, estimate=SimpleNamespace(covariance=loose),
        plan=SimpleNamespace(grasp=SimpleNamespace(world_from_tool=np.eye(4))),
    )  # fmt: skip
    look: Any = SimpleNamespace(reading=SimpleNamespace(world_from_tool=np.eye(4)), stereo=None)
    mount: Any = CameraMount(None, OnHand(tool_from_cyclopean))
    held = held_pose(target, look, mount, doubt)
    assert held is not None
    np.testing.assert_allclose(found[0][0], frames.inverse(tool_from_cyclopean) @ grasped_at)
    assert found[0][1] == pytest.approx(largest_deviation_mm(target.shape, grasped_at, loose))
    np.testing.assert_allclose(held.seen, seen, atol=1e-9)
    turn_variance = 1e-6 + np.radians(following.FINGER_EDGE_DEG) ** 2
    assert held.chi2 == pytest.approx(mm**2 / 1.01 + np.radians(deg) ** 2 / (1e-4 + turn_variance), rel=0.05)
    shift, turned = frames.size(frames.difference(held.pose, grasped_at))
    assert (shift, np.degrees(turned)) == pytest.approx((mm / 1.01, deg * 1e-4 / (1e-4 + turn_variance)), rel=0.03)
    monkeypatch.setattr(following, "fit_by_edges", lambda *_, **__: None)
    assert held_pose(target, look, mount, doubt) is None
    monkeypatch.setattr(following, "fit_by_edges", lambda *_, **__: fit)
    assert held_pose(target, look, replace(mount, alone="left"), doubt) is None
    target.estimate = None
    assert held_pose(target, look, mount, doubt) is None


def test_a_held_part_is_known_no_better_than_the_hand_eye_by_which_grasp_and_edges_both_err(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    tool_from_cyclopean = frames.rigid(np.eye(3), np.array([0.0, 0.0, -100.0]))
    at, own = frames.rigid(np.eye(3), np.array([0.0, 0.0, 10.0])), np.diag([0.01] * 3 + [1e-6] * 3)
    fit = Fit(frames.inverse(tool_from_cyclopean) @ at, own, 0.1, 9)
    monkeypatch.setattr(following, "fit_by_edges", lambda *_, **__: fit)
    look: Any = SimpleNamespace(reading=SimpleNamespace(world_from_tool=np.eye(4)), stereo=None)
    mount: Any = CameraMount(None, OnHand(tool_from_cyclopean))
    grasped_so = HeldPart("cube", at, own + np.diag([0.09] * 3 + [0.0] * 3))
    held = held_by_edges(shape_of("cube"), grasped_so, look, mount, Doubt(0.3, 0.0, 0.0, 0.0, 0.0))
    assert held is not None
    assert np.diag(held.covariance)[:3] == pytest.approx([0.09 + 0.01 / 2] * 3)


KNOB = drawn("knob").solid
FROM_A_SIDE_DEG = 50.0


@cache
def knob_seen(leans_deg: float) -> tuple[CapturedPair, Array]:
    """A pair of a knob on its foot, from above or leaning, and its true pose, cyclopean_from_part. Its flats lie under
    its rim: from above it is round."""
    believed = load_calibration(CONFIG.calibration)
    one = drawn("knob")
    shape = shown_shape("knob", one)
    shape_from_part = shape_from_drawing(shape, one) @ rigid(np.eye(3), one.origin_mm)
    with SimulatedCell(ETC / "simcell.yaml", seed=3) as cell:
        cell.world.draw([shape])
        foot = int(np.where(KNOB.normals[:, 2] > 0.99, KNOB.centres_mm[:, 2], -np.inf).argmax())
        lies = rigid(np.diag([1.0, -1.0, -1.0]), [470.0, 0.0, -300.0]) @ KNOB.flat_from_solid[foot]
        cell.world.put("knob", lies @ frames.inverse(shape_from_part), PartPlace.TABLE)
        centre = frames.apply(lies, KNOB.corners_mm).mean(axis=0)
        leaning = tool_rotation(np.array([1.0, 0.0, 0.0]), np.radians(leans_deg))
        tool = OnHand(believed.tool_from_cyclopean).look_pose(leaning, centre, 300.0)
        cell.world_from_tool = lambda real_s=None: tool
        cell.camera.open()
        pair = cell.camera.grab(0.0, 1.0)
    return taken(pair, believed.rig), frames.inverse(tool @ believed.tool_from_cyclopean) @ lies


def off_deg(fit: Fit | None, truth: Array) -> float:
    """How far the knob, which looks the same after half a turn, is turned from the truth."""
    assert fit is not None
    ways = truth @ symmetries(KNOB).motions
    return float(np.degrees(min(frames.angle_between(way, fit.cyclopean_from_part) for way in ways)))


def known_to(deg: float) -> Estimate:
    """A pose that is known to so many degrees about each axis."""
    covariance = np.diag([0.01] * 3 + [np.radians(deg) ** 2] * 3)
    return Estimate(np.eye(4), covariance, covariance)


def turns_left(deg: float, shape: Polyhedron = KNOB) -> Array:
    """The turns that are left of a part whose pose is known to so many degrees about each axis."""
    return following.undecided_turns(shape, known_to(deg))


def turned_knob(truth: Array, deg: float) -> Array:
    about = turns_left(90.0)[1]
    axis = frames.vector_from_rotation(about[:3, :3])
    turned = frames.rotation_from_vector(axis / np.linalg.norm(axis) * np.radians(deg))
    middle = np.linalg.lstsq(np.eye(3) - about[:3, :3], about[:3, 3], rcond=None)[0]
    return np.asarray(truth @ frames.rigid(turned, middle - turned @ middle))


@pytest.mark.parametrize("deg", few([12.0, -33.0, 70.0], 1))
def test_a_round_part_of_unknown_turn_is_found_in_the_turn_that_its_edges_have(deg: float) -> None:
    """Edges of a round part hold the turn that a fit starts from: a knob was set down 12 degrees off, sure to .4."""
    seen, truth = knob_seen(FROM_A_SIDE_DEG)
    near = turned_knob(truth, deg)
    as_thought = expected_at("knob", KNOB, near).fit(seen)
    assert as_thought is None or off_deg(as_thought, truth) > 5.0
    assert off_deg(expected_at("knob", KNOB, near, estimate=known_to(90.0)).fit(seen), truth) < 1.5
    name = Recognition("knob", 0.9, 0.0, 0.0, None, False, "its edges")
    facet = measured(frames.apply(near, KNOB.corners_mm[KNOB.rings[0]]), None, 100.0)
    part = Part(name, (facet,), near, np.diag([1.0] * 3 + [1e-2] * 3), 0.2, (), near[None])
    look: Any = SimpleNamespace(world_from_cyclopean=np.eye(4), scene=SimpleNamespace(parts=(part,)), taken=seen)
    target: Any = SimpleNamespace(
        label="knob", shape=KNOB, world_from_part=near, centre=near[:3, 3], estimate=known_to(90.0)
    )
    assert off_deg(fit_target(target, look), truth) < 1.5


def test_from_where_no_turn_of_a_round_part_shows_it_stays_as_thought_and_its_turn_unknown() -> None:
    seen, truth = knob_seen(10.0)
    near = turned_knob(truth, 33.0)
    fit = expected_at("knob", KNOB, near, estimate=known_to(90.0)).fit(seen)
    assert off_deg(fit, near) < 1.5
    assert fit is not None
    assert frames.rms_deg(fit.covariance[3:, 3:]) > 20.0


@pytest.mark.parametrize(("lead", "sure"), [(1.0, False), (9.0, True)])
def test_turns_that_edges_bear_out_about_equally_are_in_the_covariance(
    monkeypatch: pytest.MonkeyPatch, lead: float, sure: bool
) -> None:
    """The look has one of two turns ahead of all others by so many nats."""
    turns, own = turns_left(90.0), 1e-6 * np.eye(6)
    monkeypatch.setattr(following, "aligned_to_edges", lambda solids, stereo, poses, mm: poses)
    monkeypatch.setattr(following, "fit_pair_by_edges", lambda shape, taken, near, mm: Fit(near, own, 0.1, 9))
    scores = [(np.eye(4), 20.0), (turns[6], 30.0), (turns[12], 30.0 + lead)]
    monkeypatch.setattr(
        following, "_nats_at", lambda shape, stereo, pose: next((n for at, n in scores if np.allclose(at, pose)), 0.0)
    )
    fit = following.fit_pair_in_any_turn(KNOB, SimpleNamespace(stereo=None), np.eye(4), 6.0, turns)  # type: ignore[arg-type]
    assert fit is not None
    np.testing.assert_allclose(fit.cyclopean_from_part, turns[12])
    assert (frames.rms_deg(fit.covariance[3:, 3:]) > 25.0) is not sure


def test_a_turn_that_looks_the_same_leaves_nothing_undecided(monkeypatch: pytest.MonkeyPatch) -> None:
    half, near = symmetries(KNOB).motions[1], np.eye(4)
    monkeypatch.setattr(following, "aligned_to_edges", lambda solids, stereo, poses, mm: poses)
    monkeypatch.setattr(following, "_nats_at", lambda shape, stereo, pose: 0.0)
    monkeypatch.setattr(
        following,
        "fit_pair_by_edges",
        lambda _, __, pose, ___: Fit(near if pose is near else half, 1e-6 * np.eye(6), 0.1, 9),
    )
    seen: Any = SimpleNamespace(stereo=None)
    fit = following.fit_pair_in_any_turn(KNOB, seen, near, 6.0, turns_left(90.0))
    assert fit is not None
    assert frames.rms_deg(fit.covariance[3:, 3:]) < 1.0


def test_turns_are_tried_of_what_is_round_and_as_long_as_its_turn_is_not_known() -> None:
    counts = len(turns_left(90.0)), len(turns_left(2.6)), len(turns_left(2.4)), len(turns_left(90.0, shape_of("cube")))
    assert counts == (36, 36, 1, 1)
    assert max(np.degrees(frames.angle_between(np.eye(4), one)) for one in turns_left(90.0)) < 90.1


@given(st.lists(st.floats(-1.0, 1.0), min_size=6, max_size=6).filter(any), st.floats(0.1, 2.0), st.floats(0.05, 1.0))
def test_edges_are_sought_as_far_off_as_a_pose_may_err_and_no_farther(
    direction: list[float], mm: float, deg: float
) -> None:
    """Of all motions of the same chi-square none takes a corner farther, and one takes it nearly as far."""
    shape, near = shape_of("cube"), frames.rigid(np.eye(3), np.array([0.0, 0.0, 10.0]))
    sigmas = np.array([mm] * 3 + [np.radians(deg)] * 3)
    reach_mm = largest_deviation_mm(shape, near, np.diag(sigmas**2))
    motion = sigmas * np.array(direction) / np.linalg.norm(direction) * np.sqrt(CHI_SQUARE_6)
    moved = frames.point_motion(shape.corners_mm) @ motion
    assert np.linalg.norm(moved, axis=1).max() <= reach_mm * (1 + 1e-9)
    assert reach_mm >= mm * np.sqrt(CHI_SQUARE_6)


def test_the_least_error_at_the_grasp_is_that_of_calibration_and_arm_alone_and_grows_with_the_distance() -> None:
    believed = load_calibration(CONFIG.calibration)
    mount = CameraMount(believed.rig, OnHand(believed.tool_from_cyclopean))
    none = Doubt(hand_eye_mm=1e-3, hand_eye_deg=1e-4, arm_mm=0.0, arm_deg=0.0, pixels=1e-3)
    assert least_error(mount, 300.0, none).predicted_mm < 0.01
    near, far = (least_error(mount, mm, replace(none, pixels=0.3)).predicted_mm for mm in (200.0, 400.0))
    assert 2.0 * near < far < 4.5 * near, "a disparity errs with the square of the distance, an image centre with it"
    aside = least_error(mount, 300.0, replace(none, hand_eye_mm=0.3)).predicted_mm
    assert aside == pytest.approx(0.3 * np.sqrt(3.0), rel=0.01), "of three axes"


def test_one_camera_that_took_both_pictures_has_what_goes_with_it_in_one_place_in_both() -> None:
    seen, mount = look_back(1, True)
    who: CameraName | None
    for who, cameras in ((None, (seen.rig.left, seen.rig.right)), ("right", (mount.rig.left, mount.rig.left))):
        views = following.images_of_gripper(seen, replace(mount, alone=who)).views
        for view, camera in zip(views, cameras, strict=True):
            np.testing.assert_array_equal(view.rectified.camera.cyclopean_from_camera, camera.cyclopean_from_camera)


def test_no_look_tells_of_a_gripper_that_shows_the_same_with_a_part_as_without_that_it_is_empty() -> None:
    assert not shows_empty_gripper(*look_back(1, False), SuctionCup())


@pytest.mark.parametrize("shown", [True, False])
def test_in_a_pair_of_one_camera_each_picture_says_where_the_part_is_and_the_arm_errs_at_both(
    monkeypatch: pytest.MonkeyPatch, shown: bool
) -> None:
    both = moved_rig(load_calibration(CONFIG.calibration).rig.left, (640, 480), (DOWN, DOWN @ ASIDE))[0]
    truth, arm = rigid(np.eye(3), [5.0, -3.0, 300.0]), Doubt(arm_mm=0.1, arm_deg=0.03).arm()
    fits = [Fit(frames.perturb(truth, np.array([off, 0, 0, 0, 0, 0])), 0.01 * np.eye(6), 0.2, 8) for off in (0.1, -0.1)]
    asked: list[Any] = []
    monkeypatch.setattr(
        following, "fit_by_each_camera", lambda *about: asked.append(about) or (fits if shown else None)
    )
    pair: Any = SimpleNamespace(stereo="the pictures", rig=both, moved=SimpleNamespace(arm=arm))
    found = following.fit_pair_by_edges(shape_of("cube"), pair, truth, 7.0)
    assert [about[1:] for about in asked] == [("the pictures", truth, 7.0)]
    if not shown:
        assert found is None
        return
    assert found is not None
    share = TOLERANCE_MM / (50.0 * np.sqrt(3.0))
    poses, own = [fit.cyclopean_from_part for fit in fits], [fit.covariance for fit in fits]
    pose, covariance = moved_pair.fuse_single_camera_poses(poses, own, (both.left, both.right), arm, share)
    np.testing.assert_allclose(found.cyclopean_from_part, pose)
    np.testing.assert_allclose(found.covariance, covariance)
    assert abs(found.cyclopean_from_part[0, 3] - 5.0) < 0.1
