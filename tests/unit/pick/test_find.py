"""Finding, state by state: looks that got old, questions that another look settles or does not."""

import asyncio
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from daemon import frames
from daemon.arm import MovedByOthersError
from daemon.events.codes import CauseCode
from daemon.events.outcomes import Outcome
from daemon.pick import find
from daemon.pick.find import MOST_STALE
from daemon.pick.outcome import PickResult, Skipped
from daemon.pick.planning.plan import NoPlan
from daemon.pick.settings import Settings, SurveyView
from daemon.pick.transitions import PickEvent, PickState
from daemon.pick.world import SuspectError
from daemon.store.place_file import BIN
from daemon.vision.values import FacetView
from tests.fakes.fake_cell import ON_HAND, one_part, shape_of
from tests.fakes.pick_steps import begun, brought_to, step
from tests.fakes.regrasps import goal_on


def test_an_old_look_sends_back_to_the_survey_a_few_times_then_the_guard_has_its_say():
    fake = one_part()
    context, world = begun(fake)
    for _ in range(MOST_STALE):
        brought_to(PickState.CHOOSE, context, world)
        fake.now_s += context.settings.limits.max_look_age_s
        assert step(context, world, PickState.CHOOSE) is PickEvent.STALE
    brought_to(PickState.CHOOSE, context, world)
    fake.now_s += context.settings.limits.max_look_age_s
    assert step(context, world, PickState.CHOOSE) is PickEvent.CHOSEN


def test_a_part_skipped_before_is_not_chosen_again_and_one_beside_it_is():
    fake = one_part()
    fake.put("pyramid", 430, -100, 0.4)
    context, world = begun(fake)
    brought_to(PickState.STOP_N, context, world)
    first = world.the_target().label
    fake.reach_mm = 100.0
    step(context, world, PickState.STOP_N)
    fake.reach_mm = 900.0
    assert step(context, world, PickState.CHOOSE) is PickEvent.CHOSEN
    assert {first, world.the_target().label} == {"cube", "pyramid"}


def test_a_table_from_which_parts_were_skipped_is_looked_at_from_every_survey_and_from_none_of_the_last_ones():
    fake = one_part()
    fake.lying.clear()
    one, two, last = Settings().surveys[:3]
    settings = replace(Settings(), surveys=(one, two), last_surveys=(last,))
    context, world = begun(fake, settings)
    world.skipped.append(Skipped("cube", np.array([500.0, 0.0, -300.0]), Outcome.UNREACHABLE, "too far"))
    assert step(context, world, PickState.SURVEY) is PickEvent.NOTHING
    looks = [(look["purpose"], look["stop"]) for look in fake.said("look")]
    assert looks == [("survey 1", 0), ("survey 2", 0)]


def test_a_survey_of_which_only_the_place_is_said_looks_at_it_leaning_along_x():
    pose = SurveyView(centre_mm=(500.0, 50.0, -300.0)).pose(ON_HAND)
    camera = ON_HAND.world_from_cyclopean_at(pose)
    away = np.array([500.0, 50.0, -300.0]) - camera[:3, 3]
    assert np.cross(away, camera[:3, 2]) == pytest.approx(np.zeros(3), abs=1e-6)
    assert pose[:3, 2] == pytest.approx([np.sqrt(0.5), 0.0, -np.sqrt(0.5)], abs=1e-6)


def questioned(fake):
    """A pick that asks whether what it found lies where it lay."""
    context, world = begun(fake)
    brought_to(PickState.CHOOSE, context, world)
    world.before_disagreement = list(world.found), []
    return context, world


def test_a_question_is_settled_by_parts_that_lie_where_they_lay():
    fake = one_part()
    context, world = questioned(fake)
    assert step(context, world, PickState.SURVEY) is PickEvent.SEEN
    assert world.before_disagreement is None
    assert fake.said("decision")[-1]["text"] == "suspect: part"


def test_a_question_that_no_other_part_answers_stops_the_pick():
    fake = one_part()
    context, world = questioned(fake)
    world.before_disagreement = [], []
    with pytest.raises(SuspectError, match="cannot tell which"):
        step(context, world, PickState.SURVEY)


def test_a_part_that_lies_alone_and_where_it_lay_is_approached_again():
    """Looks disagree now and then by chance: that must not end a night's last pick."""
    fake = one_part()
    context, world = questioned(fake)
    world.before_disagreement = [], world.before_disagreement[0]
    assert step(context, world, PickState.SURVEY) is PickEvent.SEEN
    assert fake.said("decision")[-1]["text"] == "approach it again"
    assert step(context, world, PickState.CHOOSE) is PickEvent.CHOSEN


def test_a_part_alone_that_lies_elsewhere_tells_nothing_apart_from_a_knock():
    fake = one_part()
    context, world = questioned(fake)
    world.before_disagreement = [], world.before_disagreement[0]
    fake.lying["cube"] = frames.perturb(fake.lying["cube"], np.array([6.0, 0, 0, 0, 0, 0]))
    with pytest.raises(SuspectError, match="cannot tell which"):
        step(context, world, PickState.SURVEY)


def test_a_question_answered_by_parts_that_all_moved_blames_the_cell():
    fake = one_part()
    context, world = questioned(fake)
    fake.lying["cube"] = frames.perturb(fake.lying["cube"], np.array([6.0, 0, 0, 0, 0, 0]))
    with pytest.raises(SuspectError, match="likely cause: hand-eye"):
        step(context, world, PickState.SURVEY)


def test_a_part_that_no_lone_facet_bars_and_that_cannot_be_had_is_skipped_at_once(monkeypatch):
    fake = one_part()
    context, world = begun(fake)
    brought_to(PickState.CHOOSE, context, world)
    no_plan = NoPlan(CauseCode.NO_GRASP, "no grasp")
    monkeypatch.setattr(find, "_plan_with_side_view", lambda *_: (None, no_plan))
    assert step(context, world, PickState.CHOOSE) is PickEvent.NONE_LEFT
    assert [(skipped.outcome, skipped.why) for skipped in world.skipped] == [(Outcome.UNREACHABLE, "no grasp")]


@pytest.mark.parametrize(
    ("lies_there", "before", "after"),
    [
        (False, Outcome.EMPTY, Outcome.UNKNOWN),
        (True, Outcome.EMPTY, Outcome.EMPTY),
        (False, Outcome.MISSED, Outcome.MISSED),
    ],
)
def test_outlines_that_make_no_facet_are_told_only_of_a_table_on_which_nothing_was_found(
    monkeypatch, lies_there, before, after
):
    fake = one_part()
    if not lies_there:
        fake.lying.clear()
    context, world = begun(fake)
    world.result = PickResult(before, "so far", None)
    monkeypatch.setattr(FacetView, "outlines", (1, 1))
    monkeypatch.setattr(find, "cause_of_nothing", lambda images: None)
    step(context, world, PickState.SURVEY)
    assert world.result.outcome is after


def test_an_arm_that_stands_at_a_survey_position_is_sent_nowhere_to_look_from_there():
    """In step mode a person was asked about a move of nothing, and no new look came by itself."""
    fake = one_part()
    context, world = begun(fake)
    assert step(context, world, PickState.SURVEY) is PickEvent.SEEN
    sent, looks = len(fake.said("move")), len(fake.said("look"))
    assert step(context, world, PickState.SURVEY) is PickEvent.SEEN
    assert (len(fake.said("move")), len(fake.said("look"))) == (sent, looks + 1)
    fake.at = frames.perturb(fake.at, np.array([3.0, 0, 0, 0, 0, 0]))
    with pytest.raises(MovedByOthersError):
        step(context, world, PickState.SURVEY)


@pytest.mark.parametrize("reached", [True, False])
def test_all_is_looked_at_from_far_of_the_looks_before_where_the_arm_gets_there(reached):
    fake = one_part()
    context, world = begun(fake)
    brought_to(PickState.CHOOSE, context, world)
    before, looks = fake.at.copy(), len(world.looks)
    fake.reach_mm = 900.0 if reached else 1.0
    assert asyncio.run(find.look_from_other_side(context, world)) is reached
    assert len(world.looks) - looks == int(reached)
    middle = world.found[0].centre
    ways = [ON_HAND.world_from_cyclopean_at(pose)[:2, 3] - middle[:2] for pose in (before, fake.at)]
    assert bool(ways[0] @ ways[1] < 0.0) is reached, "from the other side"


@pytest.mark.parametrize(
    ("candidates", "outcome", "fits"),
    [((), Outcome.UNKNOWN, "nothing that was taught"), (("cube", "block"), Outcome.AMBIGUOUS, "cube or block")],
)
def test_a_part_that_is_taught_no_more_is_not_picked_and_told_with_all_that_it_fits(
    monkeypatch, candidates, outcome, fits
):
    fake = one_part()
    context, world = begun(fake, replace(Settings(), views_of_doubtful=0))
    brought_to(PickState.CHOOSE, context, world)
    part = world.found[0]
    world.found = [replace(part, part=replace(part.part, recognition=replace(part.recognition, candidates=candidates)))]
    monkeypatch.setattr(type(context.recogniser), "shape", lambda *_: None)
    assert step(context, world, PickState.CHOOSE) is PickEvent.NONE_LEFT
    assert world.target is None
    (skipped,) = world.skipped
    assert skipped.outcome is outcome
    assert skipped.why.startswith(f"fits {fits}: ")


def lies_at(goal: Any, off_mm: float, off_deg: float) -> Any:
    motion = np.array([off_mm, 0, 0, 0, 0, np.radians(off_deg)])
    pose = frames.perturb(goal.poses[0], motion)
    return SimpleNamespace(label="block", world_from_part=pose, centre=pose[:3, 3], named=True)


@pytest.mark.parametrize(
    ("part_off", "other_off", "told"),
    [
        ((200.0, 0.0), None, None),
        ((4.0, 9.0), None, "it lies at place nest already: `place check nest`"),
        ((6.0, 0.0), None, None),
        ((0.0, 11.0), None, None),
        ((200.0, 0.0), (0.0, 0.0), "none of its places is free"),
        ((200.0, 0.0), (150.0, 0.0), None),
    ],
)
def test_a_part_goes_to_a_place_where_nothing_shows_and_not_where_it_lies_already(part_off, other_off, told):
    goal = goal_on("pyramid", shape_of("pyramid"), 0)
    part = lies_at(goal, *part_off)
    others = [] if other_off is None else [lies_at(goal, *other_off)]
    table = SimpleNamespace(has=lambda _: True, free=lambda *_: [goal], taken=list, goals={"nest": goal}, unusable={},
                            places=SimpleNamespace(of=lambda _: [goal.place]))  # fmt: skip
    context: Any = SimpleNamespace(placing=table, order=SimpleNamespace(place=lambda _: None))
    world: Any = SimpleNamespace(found=[part, *others])
    found: Any = find.destination_of(context, world, part)
    assert found == told if told else list(found.goals) == [goal]
    table.free = lambda *_: []
    assert find.destination_of(context, world, part) == "none of its places is free"
    table.unusable = {"nest": "no part is taught"}
    assert find.destination_of(context, world, part) == "none of its places is free; no part is taught"
    context.order.place = lambda _: BIN
    assert find.destination_of(context, world, part) is None
    context.order.place = lambda _: None
    table.has = lambda _: False
    assert find.destination_of(context, world, part) is None


def test_what_is_found_is_told_by_name_in_order_and_what_has_none_last():
    parts: Any = (SimpleNamespace(named=label != "", label=label) for label in ("cube", "pyramid", ""))
    cube, pyramid, nameless = parts
    assert find.describe_parts([nameless, pyramid, cube, pyramid]) == "1 cube, 2 pyramid, 1 without a name"
    assert find.describe_parts([cube]) == "1 cube"
    assert find.describe_parts([]) == "nothing"


def test_what_has_no_name_is_looked_at_again_as_often_as_is_set_and_the_least_known_first():
    one, two = (SimpleNamespace(named=False, label="", centre=np.array([x, 0.0, -280.0])) for x in (400.0, 600.0))
    named = SimpleNamespace(named=True, label="cube", centre=np.array([500.0, 100.0, -280.0]))
    context: Any = SimpleNamespace(settings=replace(Settings(), views_of_doubtful=2))
    world: Any = SimpleNamespace(left=lambda _: [named, one, two], looked_again=[])
    for expected in (one, two, one, two, None):
        least: Any = find.next_unnamed_part(context, world)
        assert least is expected
        world.looked_again += [] if expected is None else [expected.centre]
