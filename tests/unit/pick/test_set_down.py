"""A part set down at its place on the fake cell: what is on the disk when, what the look afterwards says, what a
restart makes of a pick that was cut off at any line."""

from __future__ import annotations

import asyncio
import contextlib
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from daemon import frames
from daemon.arm import BeliefSource, HeldPart, RefusedError, carried_part
from daemon.arm.motion import MoveRefusedError
from daemon.arm.permission import Refusal
from daemon.events.pick_order import PickOrder
from daemon.pick import set_down, take
from daemon.pick.cycle import PickCycle
from daemon.pick.following import HeldPose
from daemon.pick.looks import Look
from daemon.pick.place_table import PlaceTable
from daemon.pick.planning.place_goals import Goal, goal_of
from daemon.pick.pose_fusion import CHI_SQUARE_6, Estimate
from daemon.pick.seen import seen_parts
from daemon.pick.settings import Settings
from daemon.pick.transitions import PickState
from daemon.pick.world import WorldModel, look
from daemon.store.place_file import CellPlaces, Place, PlaceSettings
from daemon.store.place_status import AT_PLACE_MM, FILLABLE, PlaceStatus, PlaceStatuses
from daemon.vision.refine import Fit
from tests.fakes.fake_cell import cycle_of, one_part, shape_of

MEASURE = set_down.measure
AT = (430.0, -220.0, -300.0)


def nest(name: str = "nest", at: tuple[float, float, float] = AT, part: str = "cube", **place_settings: Any) -> Place:
    return Place(name, PlaceSettings(part=part, **place_settings), np.eye(4), None, 1, at, 20.0)


@pytest.fixture(autouse=True)
def measured(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The pictures of a fake cell show no edge: the part is held as it was grasped."""
    told: list[str] = []

    async def measure(context: Any, target: Any, taken: Any) -> Any:
        told.append(target.label)
        return target.tool_from_part

    monkeypatch.setattr(take, "measure", measure)
    return told


class Story:
    """A fake cell with one cube and places; where it lets go at a place, the cube lies there, off by so much."""

    def __init__(
        self, folder: Path, places: tuple[Place, ...] = (nest(),), off_mm: float | None = 0.0, seed: int = 0
    ) -> None:
        self.fake, self.folder, self.off_mm = one_part(seed=seed), folder, off_mm
        self.cycle = self.new_cycle(places)
        self.fake.before = self.happens
        self.opened_with: list[str] = []
        self.places = places

    def new_cycle(self, places: tuple[Place, ...]) -> PickCycle:
        cycle = cycle_of(self.fake)
        cycle.use_places(PlaceTable(CellPlaces(places=places), PlaceStatuses(self.folder)))
        return cycle

    @property
    def goal(self) -> Goal:
        return self.cycle.placing.goals[self.places[0].name]

    def happens(self, act: str) -> None:
        at_place = float(np.linalg.norm(self.fake.at[:2, 3] - AT[:2])) < 80.0
        if act == "hand" and self.fake.held and at_place:
            self.opened_with.append(str(PlaceStatuses(self.folder).of(self.places[0].name).status))
            if self.off_mm is not None:
                moved = frames.rigid(np.eye(3), np.array([self.off_mm, 0.0, 0.0]))
                self.fake.lying["cube"] = moved @ self.goal.poses[0]
            self.fake.held = None

    def pick(self) -> Any:
        return asyncio.run(self.cycle.pick())

    def status(self) -> PlaceStatus:
        return PlaceStatuses(self.folder).of(self.places[0].name).status

    def statuses(self) -> list[str]:
        return [record["status"] for record in self.fake.said("place")]


def test_what_the_gripper_may_hold_now_bars_no_way_that_is_planned_beforehand(tmp_path: Path) -> None:
    story = Story(tmp_path)
    story.cycle.beliefs.learn(BeliefSource.OPERATOR, holding=False)
    empty = asyncio.run(story.cycle.plan_from_side(story.goal, 0))
    long = np.array([[0.0, 0.0, z] for z in (0.0, 250.0)])
    story.cycle.beliefs.learn(
        BeliefSource.OPERATOR, holding=True, held_shape=carried_part(long, "a bar in the gripper")
    )
    assert empty.found
    assert asyncio.run(story.cycle.plan_from_side(story.goal, 0)).found == empty.found


def test_a_part_goes_to_its_place_and_not_to_the_bin(tmp_path: Path) -> None:
    story = Story(tmp_path, (nest(tolerance_mm=4.0, tolerance_deg=4.0),))
    end = story.pick()
    assert end.outcome == "picked", end.why
    assert story.statuses() == ["claimed", "set", "seen right"]
    assert story.opened_with == ["set"], "it is on the disk before the gripper opens"
    assert story.fake.binned == []
    moves = [(r["purpose"], r["how"], r["speed_pct"]) for r in story.fake.said("move")]
    assert ("down to place nest", "straight", 10.0) in moves
    assert ("back from place nest", "straight", 10.0) in moves


def test_what_went_wrong_before_is_not_the_cause_of_an_end_that_is_right(tmp_path: Path) -> None:
    story = Story(tmp_path, (nest(tolerance_mm=4.0, tolerance_deg=4.0),))
    story.fake.slippery = 1
    end = story.pick()
    assert [r["text"] for r in story.fake.said("decision")].count("missed") == 1
    assert (end.outcome, story.status()) == ("picked", PlaceStatus.RIGHT), end.why
    assert story.fake.said("cycle_end")[-1]["code"] is None


def test_a_part_that_lies_off_its_place_is_told_with_how_far(tmp_path: Path) -> None:
    story = Story(tmp_path, off_mm=12.0)
    end = story.pick()
    assert (end.outcome, story.status()) == ("off", PlaceStatus.OFF)
    off_mm = PlaceStatuses(tmp_path).of("nest").off_mm
    assert off_mm == pytest.approx(12.0, abs=2.0)
    assert f"{off_mm:.2f} mm" in end.why
    assert story.fake.said("cycle_end")[-1]["code"] == "off_place"


def test_a_part_that_is_not_at_its_place_is_missing_and_nothing_more_is_brought_there(tmp_path: Path) -> None:
    story = Story(tmp_path, off_mm=None)
    end = story.pick()
    assert (end.outcome, story.status()) == ("released", PlaceStatus.MISSING)
    story.fake.put("cube", 520, 0, 0.4)
    end = story.pick()
    assert (end.outcome, story.status()) == ("full", PlaceStatus.MISSING)
    assert "none of its places is free" in end.why


@pytest.mark.parametrize("purpose", ["back from place nest", "look at place nest"])
def test_a_part_let_go_at_its_place_before_a_stop_is_released_and_the_place_is_looked_at_later(
    tmp_path: Path, purpose: str
) -> None:
    story, stops = Story(tmp_path), list[Any]()
    cycle, lies_there = story.cycle, story.happens

    def stop(act: str) -> None:
        lies_there(act)
        if act == "moving" and not stops and story.fake.said("move")[-1]["purpose"].startswith(purpose):
            stops.append(asyncio.get_running_loop().create_task(cycle.supervisor.stop()))

    async def stopped() -> Any:
        story.fake.before = stop
        end = (await cycle.auto(PickOrder(3)))[-1]
        await asyncio.gather(*stops)
        return end

    end = asyncio.run(stopped())
    assert (end.outcome, end.place, end.brought, end.ended_by) == ("released", "nest", True, "stop"), end.why
    assert story.fake.said("cycle_end")[-1]["stopped"] == "operator_stop"
    assert story.status() is PlaceStatus.SET, "until somebody looks"
    assert cycle.pick_order == PickOrder(2)


def test_a_part_that_lies_at_its_place_is_not_picked_again(tmp_path: Path) -> None:
    story = Story(tmp_path, (nest(tolerance_mm=4.0, tolerance_deg=4.0),))
    story.pick()
    end = story.pick()
    assert (end.outcome, story.status()) == ("empty", PlaceStatus.RIGHT)
    assert end.why == "nothing to pick: cube lies at place nest already"


def test_a_part_that_somebody_laid_at_a_free_place_is_left_there_and_said_to_be(tmp_path: Path) -> None:
    story = Story(tmp_path, (nest(at=(520.0, 0.0, -300.0)),))
    story.fake.lying["cube"] = story.goal.poses[0]
    end = story.pick()
    assert (end.outcome, story.status()) == ("full", PlaceStatus.FREE)
    assert "lies at place nest already: `place check nest`" in end.why


def test_where_the_guard_refuses_the_way_the_part_goes_to_the_bin_and_the_place_stays_free(tmp_path: Path) -> None:
    story = Story(tmp_path)
    cycle, fake = story.cycle, story.fake

    def barred(act: str) -> None:
        if fake.held and any(r["status"] == "claimed" for r in fake.said("place")):
            fake.unreached = np.array([AT[0], AT[1], -275.0])

    fake.before = barred
    end = asyncio.run(cycle.pick())
    assert fake.binned == ["cube"], end.why
    assert (story.statuses(), story.status()) == (["claimed", "free"], PlaceStatus.FREE)


def test_what_no_grasp_can_set_down_is_said_before_anything_moves_to_it(tmp_path: Path) -> None:
    story = Story(tmp_path, (nest(at=(10.0, -900.0, -300.0)),))
    end = story.pick()
    assert end.outcome == "unreachable"
    assert "can set it down at nest" in end.why
    assert story.fake.said("cycle_end")[-1]["code"] == "no_way_to_place"
    assert not any(r["purpose"].startswith("stand-off") for r in story.fake.said("move"))


def test_a_part_that_was_not_measured_goes_to_the_bin(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    async def unmeasured(*_: Any) -> None:
        return None

    monkeypatch.setattr(take, "measure", unmeasured)
    story = Story(tmp_path)
    story.pick()
    assert (story.fake.binned, story.statuses(), story.status()) == (["cube"], [], PlaceStatus.FREE)


def test_a_dry_pick_claims_nothing(tmp_path: Path) -> None:
    story = Story(tmp_path)
    story.cycle.supervisor.mover.dry = True
    assert story.pick().outcome == "dry"
    assert story.statuses() == []


def test_a_full_disk_keeps_the_gripper_closed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    story = Story(tmp_path)

    def refuse(self: PlaceStatuses, name: str, status: PlaceStatus, *rest: Any) -> None:
        if status is PlaceStatus.SET:
            raise OSError(28, "No space left on device")

    monkeypatch.setattr(PlaceStatuses, "put", refuse)
    end = story.pick()
    assert end.outcome == "fault"
    assert story.fake.held == "cube"
    assert story.opened_with == []


def test_a_part_that_was_set_down_before_a_fault_is_less_to_bring_and_is_not_reported_to_the_line(
    tmp_path: Path,
) -> None:
    story, told = Story(tmp_path), list[str]()

    async def brought() -> None:
        told.append("brought")

    def torn(act: str) -> None:
        story.happens(act)
        if act == "see" and PlaceStatuses(tmp_path).of("nest").status is PlaceStatus.SET:
            raise OSError(5, "the camera is gone")

    story.cycle.production_line.brought = brought
    story.fake.before = torn
    (end,) = asyncio.run(story.cycle.auto(PickOrder(2)))
    assert (end.outcome, end.place, end.ended_by, told) == ("released", "nest", "error", [])
    assert story.cycle.pick_order is not None
    assert story.cycle.pick_order.count == 1


def test_killed_at_any_line_no_place_that_may_hold_a_part_is_free_and_a_look_says_how_it_is(tmp_path: Path) -> None:
    """Each act of arm, gripper and camera of one set-down is the last before a kill; what the disk says then is all the
    next daemon has."""
    kept: list[tuple[bytes | None, bool]] = []
    story = Story(tmp_path / "first", (nest(tolerance_mm=4.0, tolerance_deg=4.0),))
    file = PlaceStatuses(story.folder).path

    def watched(act: str) -> None:
        story.happens(act)
        there = "cube" in story.fake.lying and float(abs(story.fake.lying["cube"][0, 3] - AT[0])) < 60.0
        kept.append((file.read_bytes() if file.exists() else None, there))

    story.fake.before = watched
    assert story.pick().outcome == "picked"
    assert {there for _, there in kept} == {True, False}
    for number, (content, there) in enumerate(dict.fromkeys(kept)):
        after = Story(tmp_path / f"killed{number}", story.places)
        after.folder.mkdir()
        if content is not None:
            PlaceStatuses(after.folder).path.write_bytes(content)
        if there:
            assert after.status() not in FILLABLE
            after.fake.lying = {"cube": after.goal.poses[0]}
        after.pick()
        assert after.status() is (PlaceStatus.RIGHT), (content, there)
        assert len(after.fake.lying) == 1, "none was brought to a full place"
        assert after.fake.binned == []


def test_a_claim_that_a_stop_left_is_looked_at_and_free_again_where_nothing_lies_there(tmp_path: Path) -> None:
    story = Story(tmp_path)
    story.cycle.placing.statuses.put("nest", PlaceStatus.CLAIMED)
    story.fake.lying.clear()
    assert story.pick().outcome == "empty"
    assert story.status() is PlaceStatus.FREE


def test_places_are_looked_at_on_demand(tmp_path: Path) -> None:
    story = Story(tmp_path, (nest(tolerance_mm=4.0, tolerance_deg=4.0),))
    story.pick()
    del story.fake.lying["cube"]
    asyncio.run(story.cycle.look_at_places([story.goal]))
    assert story.status() is PlaceStatus.FREE
    story.fake.lying["pyramid"] = story.goal.poses[0]
    asyncio.run(story.cycle.look_at_places([story.goal]))
    assert story.status() is PlaceStatus.OFF
    assert "does not show as cube" in PlaceStatuses(tmp_path).of("nest").why


def test_auto_counts_what_it_set_down(tmp_path: Path) -> None:
    story = Story(tmp_path, (nest(tolerance_mm=4.0, tolerance_deg=4.0),))
    ends = asyncio.run(story.cycle.auto(PickOrder(1)))
    assert [end.outcome for end in ends] == ["picked"]
    assert story.cycle.pick_order is None
    assert story.cycle.status()["picked"] == 1


def test_an_arm_that_somebody_moved_from_the_place_lets_go_nowhere(tmp_path: Path) -> None:
    story = Story(tmp_path)
    lowered: list[bool] = []

    def nudge(act: str) -> None:
        story.happens(act)
        moves = story.fake.said("move")
        if act == "where" and moves and moves[-1]["purpose"] == "down to place nest" and not lowered:
            lowered.append(True)
            story.fake.at = story.fake.at.copy()
            story.fake.at[2, 3] += 40.0

    story.fake.before = nudge
    end = story.pick()
    assert lowered
    assert (end.outcome, story.fake.held, story.status()) == ("fault", "cube", PlaceStatus.CLAIMED), end.why
    assert story.opened_with == []


def test_where_a_part_lies_is_found_by_looks_that_show_its_edges(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    story, whole_look = Story(tmp_path), look
    with pytest.raises(RefusedError, match="the edges of the cube do not show clearly"):
        asyncio.run(story.cycle.locate("cube"))

    async def with_edges(*about: Any) -> Look:
        seen = await whole_look(*about)
        part = seen_parts(seen)[0].part
        return replace(seen, tracked=Fit(part.cyclopean_from_part, part.covariance, part.residual_mm, 8))

    monkeypatch.setattr(set_down, "look", with_edges)
    pose = asyncio.run(story.cycle.locate("cube"))
    np.testing.assert_allclose(pose[:3, 3], story.fake.lying["cube"][:3, 3], atol=3.0)
    with pytest.raises(RefusedError, match="0 parts are recognised as pyramid"):
        asyncio.run(story.cycle.locate("pyramid"))


def test_where_the_part_in_the_gripper_is_follows_from_where_and_a_look(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    story = Story(tmp_path)
    fake, beliefs, here = story.fake, story.cycle.beliefs, story.cycle.held_here
    grasped = frames.rigid(np.eye(3), np.array([0.0, 0.0, 20.0]))
    chi2, seen = 1.0, frames.rigid(np.eye(3), np.array([0.3, 0.0, 20.2]))

    def refused(why: str) -> None:
        with pytest.raises(RefusedError, match=why):
            asyncio.run(here())

    refused("the gripper holds no part that facetd picked")
    beliefs.learn(BeliefSource.COMMANDED, holding=True, grasped_part=HeldPart("cube", grasped, np.eye(6)))
    refused("the edges of the cube do not show clearly in the gripper")
    monkeypatch.setattr(
        set_down, "held_by_edges", lambda *_: HeldPose(seen, seen, np.diag([0.04] * 3 + [1e-6] * 3), chi2)
    )
    fake.records.clear()
    label, pose, errs_mm, errs_deg = asyncio.run(here())
    assert label == "cube"
    assert np.sqrt(3 * 0.04) < errs_mm < 1.0, "the arm's own error is in it"
    assert np.degrees(np.sqrt(3e-6)) < errs_deg < 0.2
    np.testing.assert_allclose(pose, fake.at @ seen, atol=1e-9)
    assert not fake.said("move")
    chi2 = CHI_SQUARE_6 + 1.0
    refused("the cube is not held as it was grasped")
    chi2, asked = 1.0, []

    def nudge(act: str) -> None:
        asked.append(act)
        if asked.count("where") == 2:
            fake.at = fake.at.copy()
            fake.at[0, 3] += 5.0

    fake.before = nudge
    refused("keep the arm still, then repeat")
    fake.before = lambda act: None
    beliefs.learn(BeliefSource.COMMANDED, grasped_part=HeldPart("bolt", grasped, np.eye(6)))
    refused("the bolt in the gripper is no longer taught")
    beliefs.learn(BeliefSource.OPERATOR, holding=False, grasped_part=None)
    refused("the gripper holds no part that facetd picked")


def test_a_place_that_has_moved_is_looked_at_before_a_part_is_brought_there(tmp_path: Path) -> None:
    story = Story(tmp_path, (nest(tolerance_mm=4.0, tolerance_deg=4.0),))
    assert story.pick().outcome == "picked"
    story.fake.lying.clear()
    story.fake.put("cube", 520, 0, 0.4)
    moved = (nest(at=(430.0, -180.0, -300.0), tolerance_mm=4.0, tolerance_deg=4.0),)
    story.cycle = story.new_cycle(moved)
    assert story.cycle.placing.status("nest") is PlaceStatus.TO_LOOK_AT
    story.fake.records.clear()
    story.pick()
    purposes = [record["purpose"] for record in story.fake.said("look")]
    assert purposes[0] == "place nest"
    assert story.statuses()[:2] == ["free", "claimed"]


def test_a_place_that_moved_out_of_reach_is_left_alone(tmp_path: Path) -> None:
    story = Story(tmp_path, (nest(tolerance_mm=4.0, tolerance_deg=4.0), nest("other", (430.0, 220.0, -300.0))))
    statuses = story.cycle.placing.statuses
    statuses.put("other", PlaceStatus.CLAIMED)
    far = (story.places[0], nest("other", (2430.0, 220.0, -300.0)))
    story.cycle = story.new_cycle(far)
    assert story.pick().outcome == "picked"
    assert story.cycle.placing.status("other") is PlaceStatus.TO_LOOK_AT
    assert any("left alone" in record["text"] for record in story.fake.said("decision"))


@pytest.mark.parametrize(("open_to", "told"), [(2, None), (9, "kept_out: place 2")])
def test_round_a_place_the_arm_goes_to_the_first_that_is_not_refused_and_says_why_the_last_was(
    open_to: int, told: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With all refused it was told that no place is in reach."""
    poses, tried = [np.eye(4) * k for k in range(3)], []

    async def three(*_: Any) -> list[Any]:
        return poses

    async def refusing(_: Any, __: Any, pose: Any, purpose: str) -> None:
        tried.append(next(k for k, one in enumerate(poses) if one is pose))
        assert purpose == "look at tray"
        if tried[-1] != open_to:
            raise MoveRefusedError(Refusal("kept_out", f"place {tried[-1]}"))

    monkeypatch.setattr(set_down, "travel", refusing)
    monkeypatch.setattr(set_down, "viewpoints_round", lambda *_: poses)
    monkeypatch.setattr(set_down, "reraise_if_all_refused", lambda _: None)
    cell = SimpleNamespace(mounting=None, compute=three)
    context = SimpleNamespace(cell=cell, settings=Settings(), mover=SimpleNamespace(reach=None))
    with contextlib.nullcontext() if told is None else pytest.raises(MoveRefusedError, match=told):
        asyncio.run(set_down.go_round(cast(Any, context), cast(Any, None), np.zeros(3), "tray", []))
    assert tried == [0, 1, 2]


@pytest.mark.parametrize("moment", ["hand", "handed"])
def test_a_stop_while_the_gripper_lets_go_at_a_place_asks_about_the_gripper(tmp_path: Path, moment: str) -> None:
    story = Story(tmp_path)
    stops: list[asyncio.Task[Any]] = []

    def stop(act: str) -> None:
        story.happens(act)
        if act == moment and story.cycle.state is PickState.SET_DOWN and not stops:
            stops.append(asyncio.get_running_loop().create_task(story.cycle.supervisor.stop()))

    story.fake.before = stop
    story.pick()
    assert stops
    assert story.cycle.status()["holding"] is None


TOLERANCE_MM, TOLERANCE_DEG = 4.0, 5.0
A_GOAL = goal_of(nest(tolerance_mm=TOLERANCE_MM, tolerance_deg=TOLERANCE_DEG), shape_of("cube"))


@settings(max_examples=50)
@given(
    st.floats(0.0, 12.0), st.floats(-12.0, 12.0), st.floats(-20.0, 20.0), st.floats(0.05, 3.0), st.floats(0.05, 3.0),
    st.floats(0.05, 3.0), st.floats(-3.1, 3.1),
)  # fmt: skip
def test_what_looks_say_of_a_place_is_sure_where_their_error_would_not_change_it(
    off_mm: float, height_mm: float, off_deg: float, sigma_mm: float, height_sigma_mm: float, sigma_deg: float,
    way: float,
) -> None:  # fmt: skip
    turn = frames.rotation_from_vector(np.radians([0.0, 0.0, off_deg]))
    lying = A_GOAL.poses[0].copy()
    lying[:3, :3] = turn @ lying[:3, :3]
    middle = frames.apply(lying, A_GOAL.shape.corners_mm).mean(axis=0)
    lying[:3, 3] += A_GOAL.centre - middle + [off_mm * np.cos(way), off_mm * np.sin(way), height_mm]
    sigmas = [sigma_mm, sigma_mm, height_sigma_mm, *np.radians([sigma_deg] * 3)]
    found = set_down.combined_pose(A_GOAL, Estimate(lying, np.diag(np.square(sigmas)), np.diag(np.square(sigmas))))
    assert found.off == pytest.approx((off_mm, abs(off_deg), height_mm), abs=1e-6)
    most_height_mm = max(TOLERANCE_MM, 3.0 * height_sigma_mm)
    errs_mm, errs_deg = sigma_mm * np.sqrt(2.0), sigma_deg * np.sqrt(3.0)
    edges = [TOLERANCE_MM, TOLERANCE_MM - errs_mm, TOLERANCE_MM + errs_mm]
    turns = [TOLERANCE_DEG, TOLERANCE_DEG - errs_deg, TOLERANCE_DEG + errs_deg]
    heights = [most_height_mm, 2 * most_height_mm]
    assume(all(abs(off_mm - edge) > 1e-6 for edge in edges) and all(abs(abs(off_deg) - t) > 1e-6 for t in turns))
    assume(all(abs(abs(height_mm) - h) > 1e-6 for h in heights))
    if abs(height_mm) > most_height_mm:
        assert found.status is PlaceStatus.OFF
        told_mm = abs(found.off.height_mm)  # half a tenth is rounded as its last bit has it
        assert f"{told_mm:.1f} mm {'higher' if height_mm > 0 else 'lower'} than it would rest" in found.why
        assert found.sure is (abs(height_mm) > 2 * most_height_mm)
        return
    right = off_mm <= TOLERANCE_MM and abs(off_deg) <= TOLERANCE_DEG
    assert found.status is (PlaceStatus.RIGHT if right else PlaceStatus.OFF)
    assert ("within 4 mm and 5 degrees" in found.why) is right
    surely_in = off_mm + errs_mm < TOLERANCE_MM and abs(off_deg) + errs_deg < TOLERANCE_DEG
    surely_out = off_mm - errs_mm > TOLERANCE_MM or abs(off_deg) - errs_deg > TOLERANCE_DEG
    assert found.sure == (surely_in or surely_out)


def shows(label: str, named: bool, off_mm: float, residual_mm: float = 0.2, turned: int = 0) -> Any:
    """A part in a look from the world's origin, so far from the middle of the place."""
    pose = A_GOAL.poses[turned].copy()
    pose[0, 3] += off_mm
    part = SimpleNamespace(
        cyclopean_from_part=pose, equivalents=[A_GOAL.poses[0] @ np.diag([1.0, 1, 1, 1])], covariance=np.eye(6),
        residual_mm=residual_mm, fitted_mm=[np.zeros((4, 3)), np.zeros((3, 3))],
    )  # fmt: skip
    return SimpleNamespace(named=named, label=label, centre=np.add(A_GOAL.centre, (off_mm, 0, 0)), part=part)


def test_the_part_that_is_named_at_a_place_counts_there_and_in_the_pose_nearest_to_the_goal(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    here: Any = SimpleNamespace(world_from_cyclopean=np.eye(4))

    def of(*parts: Any) -> tuple[Fit | None, PlaceStatus]:
        monkeypatch.setattr(set_down, "seen_parts", lambda _: list(parts))
        return set_down.named_at(A_GOAL, here), set_down.judged(A_GOAL, here, PlaceStatus.MISSING).status

    fit, _ = of(
        shows("cube", True, 3.0, 0.5), shows("cube", True, 1.0, 0.3, turned=5), shows("pyramid", True, 0.0, 0.1)
    )
    assert fit is not None
    np.testing.assert_array_equal(fit.cyclopean_from_part, A_GOAL.poses[0])
    assert (fit.residual_mm, fit.matched) == (0.3, 7)
    for others in ([], [shows("cube", True, AT_PLACE_MM + 1.0)]):
        assert of(*others) == (None, PlaceStatus.MISSING)
    for others in ([shows("pyramid", True, 0.0)], [shows("cube", False, AT_PLACE_MM - 1.0)]):
        assert of(*others) == (None, PlaceStatus.OFF)


@pytest.mark.parametrize(("chi2", "trusted"), [(CHI_SQUARE_6, True), (1.01 * CHI_SQUARE_6, False), (None, False)])
def test_how_a_part_is_held_is_taken_from_its_edges_where_these_agree_with_the_grasp(
    chi2: float | None, trusted: bool
) -> None:
    records, learnt = [], []
    held = frames.rigid(np.eye(3), np.array([0.0, 0.0, 12.0]))
    seen = frames.perturb(np.eye(4), np.array([3.0, 0.0, 4.0, 0.0, 0.0, np.radians(2.0)]))

    async def compute(*_: Any) -> HeldPose | None:
        return None if chi2 is None else HeldPose(seen, held, np.eye(6), chi2)

    cell = SimpleNamespace(
        compute=compute, rig=None, mounting=None, alone=None,
        log=SimpleNamespace(record=lambda kind, **fields: records.append((kind, fields))),
    )  # fmt: skip
    beliefs = SimpleNamespace(learn=lambda source, held_shape: learnt.append((source, held_shape)))
    context: Any = SimpleNamespace(
        cell=cell, settings=Settings(), cycle=7, mover=SimpleNamespace(beliefs=beliefs)
    )  # fmt: skip
    target: Any = SimpleNamespace(label="cube", shape=shape_of("cube"), tool_from_part=np.eye(4))
    found = asyncio.run(MEASURE(context, target, cast("Any", None)))
    assert found is (held if trusted else None)
    assert bool(learnt) is trusted
    if chi2 is not None:
        ((kind, fields),) = records
        assert (kind, fields["cycle"], fields["label"], fields["chi2"]) == ("in_gripper", 7, "cube", chi2)
        assert (fields["shift_mm"], fields["shift_deg"]) == pytest.approx((5.0, 2.0))
    if trusted:
        ((source, held_shape),) = learnt
        assert source is BeliefSource.OBSERVED
        assert held_shape == carried_part(frames.apply(held, target.shape.corners_mm), "cube in the gripper")


def test_dry_a_place_keeps_the_status_it_has_and_nobody_goes_to_look() -> None:
    placing = SimpleNamespace(status={"nest": PlaceStatus.SET}.__getitem__)
    context: Any = SimpleNamespace(mover=SimpleNamespace(dry=True), placing=placing)
    goal: Any = SimpleNamespace(place=SimpleNamespace(name="nest"))
    assert asyncio.run(set_down.look_at(context, WorldModel([]), goal)) is PlaceStatus.SET
