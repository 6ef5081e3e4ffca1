"""A part laid on the table between two grasps on the fake cell: what is done, told and on the disk, and what becomes of
it where it is lost, cut off or refused."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from daemon import frames
from daemon.events.codes import CauseCode
from daemon.pick import take
from daemon.pick.cycle import PickCycle
from daemon.pick.place_table import PlaceTable
from daemon.pick.planning.plan import NoPlan
from daemon.pick.transitions import PickState
from daemon.store.place_file import CellPlaces
from daemon.store.place_status import PlaceStatus, PlaceStatuses
from daemon.store.recovery_state import RecoveryState, after
from tests.fakes.fake_cell import cycle_of, one_part
from tests.unit.pick.test_set_down import AT, measured, nest  # noqa: F401


class Turned:
    """A fake cell with a cube that lies as no one grasp can set it down; where it is let go it lies as it was held,
    moved by `slides` (4, 4)."""

    def __init__(self, folder: Path, slides: np.ndarray | None = None) -> None:
        self.fake, self.folder, self.slides = one_part(), folder, np.eye(4) if slides is None else slides
        self.place = nest(equivalents=False, tolerance_mm=4.0, tolerance_deg=4.0)
        self.cycle: PickCycle = cycle_of(self.fake)
        self.cycle.holding(False)
        self.cycle.use_places(PlaceTable(CellPlaces(places=(self.place,)), PlaceStatuses(folder)))
        self.held_as = np.eye(4)
        self.let_go: list[np.ndarray] = []
        self.fake.before = self.happens
        self.fake.lying["cube"] = self.lying_on_another_side()

    @property
    def goal(self) -> Any:
        return self.cycle.placing.goals[self.place.name]

    def lying_on_another_side(self) -> np.ndarray:
        """As it is to lie at its place, turned by a quarter about an axis that no one grasp turns it about here."""
        pose: np.ndarray = self.goal.poses[0]
        middle = frames.apply(pose, self.goal.shape.corners_mm).mean(axis=0)
        over = frames.rotation_from_vector(np.array([np.pi, 0.0, 0.0]))
        return frames.rigid(over, np.array([520.0, 0.0, -275.0]) - over @ middle) @ pose

    def happens(self, act: str) -> None:
        if act != "hand":
            return
        if self.fake.held is None and "cube" in self.fake.lying:
            self.held_as = frames.inverse(self.fake.at) @ self.fake.lying["cube"]
        elif self.fake.held is not None and self.fake.at[2, 3] < -200.0:
            self.let_go.append(self.fake.at.copy())
            lies = self.fake.at @ self.held_as
            lies[2, 3] -= frames.apply(lies, self.goal.shape.corners_mm)[:, 2].min() + 300.0
            between = float(np.linalg.norm(self.fake.at[:2, 3] - AT[:2])) > 80.0
            self.fake.lying["cube"] = self.slides @ lies if between else lies
            self.fake.held = None

    def pick(self) -> Any:
        return asyncio.run(self.cycle.pick())

    def texts(self) -> list[str]:
        return [str(record["text"]) for record in self.fake.said("decision")]


def test_a_part_that_no_one_grasp_sets_down_is_laid_on_the_table_and_brought_there_by_another(tmp_path: Path) -> None:
    story = Turned(tmp_path)
    end = story.pick()
    assert (end.outcome, end.place) == ("picked", "nest"), end.why
    laid = story.fake.said("laid_down")
    assert [record["status"] for record in laid] == ["set", "seen right"]
    assert {record["times"] for record in laid} == {1}
    assert (len(story.let_go), story.fake.binned) == (2, [])
    assert [record["status"] for record in story.fake.said("place")] == ["claimed", "set", "seen right"]
    off = frames.difference(story.fake.lying["cube"], story.goal.poses[0])
    assert np.linalg.norm(off[:2]) < 4.0
    assert np.degrees(np.linalg.norm(off[3:])) < 4.0
    moves = [(r["purpose"], r["how"], r["speed_pct"]) for r in story.fake.said("move")]
    assert ("down to the table", "straight", 10.0) in moves
    assert ("back from the table", "straight", 10.0) in moves
    ways = [purpose for purpose, *_ in moves]
    assert ways[ways.index("back from the table") + 1] == "look at it on the table", "before it is grasped anew"
    chosen = [record for record in story.fake.said("decision") if record["code"] == "chosen"]
    assert chosen[0]["grasps"] == 2
    assert "then laid on the table and taken anew, 2 grasps in all" in chosen[0]["why"]
    assert "take cube anew" in story.texts()


def test_a_part_that_is_not_seen_where_it_was_laid_down_is_told(tmp_path: Path) -> None:
    story = Turned(tmp_path)

    def gone(act: str) -> None:
        story.happens(act)
        if story.let_go:
            story.fake.lying.clear()

    story.fake.before = gone
    end = story.pick()
    assert (end.outcome, end.brought) == ("lost", False)
    assert "not seen where it was laid down on the table" in end.why
    assert story.fake.said("cycle_end")[-1]["code"] == CauseCode.NOT_WHERE_LAID
    assert [record["status"] for record in story.fake.said("laid_down")] == ["set", "missing"]
    assert story.cycle.belief.holds_part is False
    assert PlaceStatuses(tmp_path).of("nest").status is PlaceStatus.FREE


def test_a_part_that_slid_as_it_was_laid_down_is_taken_from_where_it_is_seen(tmp_path: Path) -> None:
    story = Turned(tmp_path, frames.rigid(np.eye(3), np.array([6.0, -4.0, 0.0])))
    end = story.pick()
    assert end.outcome == "picked", end.why
    off = frames.difference(story.fake.lying["cube"], story.goal.poses[0])
    assert np.linalg.norm(off[:2]) < 4.0


def test_no_part_is_laid_down_more_often_than_three_grasps_ask_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every time it has rolled back onto the side that it came from."""
    story = Turned(tmp_path)

    def rolled(act: str) -> None:
        before = len(story.let_go)
        story.happens(act)
        if len(story.let_go) > before:
            story.fake.lying["cube"] = story.lying_on_another_side()

    story.fake.before = rolled
    end = story.pick()
    assert end.outcome in ("unreachable", "lost"), end.why
    assert 1 <= len(story.let_go) <= 2
    assert story.fake.binned == []


def test_what_no_three_grasps_can_do_is_said_before_anything_is_taken(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    none = NoPlan(CauseCode.NO_WAY_TO_PLACE, "no sequence of up to 3 grasps can set it down")
    monkeypatch.setattr("daemon.pick.planning.regrasp.Regrasping.plan", lambda *_: none)
    story = Turned(tmp_path)
    end = story.pick()
    assert (end.outcome, end.why) == ("unreachable", f"cube: {none.why}")
    assert not any(record["closed"] for record in story.fake.said("hand"))


def test_something_that_lies_where_the_part_was_to_be_laid_down_keeps_it_from_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    story = Turned(tmp_path)
    monkeypatch.setattr(take, "is_blocked", lambda *_: True)
    story.pick()
    assert story.fake.binned == ["cube"]
    assert not story.fake.said("laid_down")


@pytest.mark.parametrize("moment", ["move", "hand", "grab"])
def test_a_stop_as_it_is_laid_down_leaves_what_is_known_of_it_true(tmp_path: Path, moment: str) -> None:
    story, stops = Turned(tmp_path), list[Any]()

    def stopped(act: str) -> None:
        state = story.cycle.state
        if act == moment and state in (PickState.SET_DOWN, PickState.LOOK_AT_LAID) and not stops:
            stops.append(asyncio.ensure_future(story.cycle.supervisor.stop("by the test")))
        story.happens(act)

    async def pick() -> Any:
        end = await story.cycle.pick()
        await asyncio.gather(*stops)
        return end

    story.fake.before = stopped
    end = asyncio.run(pick())
    assert stops
    assert end.outcome == "aborted"
    assert story.cycle.state is PickState.FAULT
    holds = story.cycle.belief.holds_part
    assert holds is None or holds is (story.fake.held is not None)
    assert story.fake.binned == []
    assert PlaceStatuses(tmp_path).of("nest").status is PlaceStatus.FREE


def test_killed_at_any_line_the_gripper_that_holds_the_part_is_not_taken_for_empty(tmp_path: Path) -> None:
    """What the records say at each act is all that the next daemon has."""
    story, seen = Turned(tmp_path), set[tuple[bool, bool]]()

    def watched(act: str) -> None:
        story.happens(act)
        state = RecoveryState("run")
        for record in story.fake.records:
            fields = {key: value for key, value in record.items() if key != "kind"}
            state = after(state, record["kind"], fields)
        holds = story.fake.held is not None
        seen.add((holds, state.hand_closed))
        assert state.hand_closed or not holds
        assert state.cycle is not None
        assert state.needs_attention

    story.fake.before = watched
    assert story.pick().outcome == "picked"
    assert {(True, True), (False, False)} <= seen
