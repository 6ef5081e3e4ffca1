"""Finding, state by state: looks that got old, questions that another look settles or does not."""

import asyncio
from dataclasses import replace

import numpy as np
import pytest

from daemon import frames
from daemon.arm import MovedByOthersError
from daemon.events.codes import CauseCode
from daemon.events.outcomes import Outcome
from daemon.pick import find
from daemon.pick.find import MOST_OLD
from daemon.pick.outcome import PickResult
from daemon.pick.plan import NoPlan
from daemon.pick.settings import Settings, SurveyView
from daemon.pick.transitions import PickEvent, PickState
from daemon.pick.world import BeforeDisagreement, SuspectError
from tests.fakes.fake_cell import ON_HAND, one_part
from tests.fakes.pick_steps import begun, brought_to, step


def test_an_old_look_sends_back_to_the_survey_a_few_times_then_the_guard_has_its_say():
    fake = one_part()
    context, world = begun(fake)
    for _ in range(MOST_OLD):
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
    world.skipped.append(PickResult(Outcome.UNREACHABLE, "too far", "cube"))
    assert step(context, world, PickState.SURVEY) is PickEvent.NOTHING
    looks = [(look["purpose"], look["stop"]) for look in fake.said("look")]
    assert looks == [("survey 1", 0), ("survey 2", 0)]


def test_a_survey_of_which_only_the_place_is_said_looks_at_it_leaning_along_x():
    pose = SurveyView(centre_mm=(500.0, 50.0, -300.0)).pose(ON_HAND)
    eye = ON_HAND.world_from_cyclopean_at(pose)
    away = np.array([500.0, 50.0, -300.0]) - eye[:3, 3]
    assert np.cross(away, eye[:3, 2]) == pytest.approx(np.zeros(3), abs=1e-6)
    assert pose[:3, 2] == pytest.approx([np.sqrt(0.5), 0.0, -np.sqrt(0.5)], abs=1e-6)


def questioned(fake):
    """A pick that asks whether what it found lies where it lay."""
    context, world = begun(fake)
    brought_to(PickState.CHOOSE, context, world)
    world.questioned = BeforeDisagreement(list(world.found), [])
    return context, world


def test_a_question_is_settled_by_parts_that_lie_where_they_lay():
    fake = one_part()
    context, world = questioned(fake)
    assert step(context, world, PickState.SURVEY) is PickEvent.SEEN
    assert world.questioned is None
    assert fake.said("decision")[-1]["text"] == "suspect: part"


def test_a_question_that_no_other_part_answers_stops_the_pick():
    fake = one_part()
    context, world = questioned(fake)
    world.questioned = BeforeDisagreement([], [])
    with pytest.raises(SuspectError, match="cannot be told"):
        step(context, world, PickState.SURVEY)


def test_a_part_that_lies_alone_and_where_it_lay_is_approached_again():
    """Looks disagree now and then by chance: that must not end a night's last pick."""
    fake = one_part()
    context, world = questioned(fake)
    world.questioned = BeforeDisagreement([], world.questioned.others)
    assert step(context, world, PickState.SURVEY) is PickEvent.SEEN
    assert fake.said("decision")[-1]["text"] == "approach it again"
    assert step(context, world, PickState.CHOOSE) is PickEvent.CHOSEN


def test_a_part_alone_that_lies_elsewhere_tells_nothing_apart_from_a_knock():
    fake = one_part()
    context, world = questioned(fake)
    world.questioned = BeforeDisagreement([], world.questioned.others)
    fake.lying["cube"] = frames.perturb(fake.lying["cube"], np.array([6.0, 0, 0, 0, 0, 0]))
    with pytest.raises(SuspectError, match="cannot be told"):
        step(context, world, PickState.SURVEY)


def test_a_question_answered_by_parts_that_all_moved_blames_the_cell():
    fake = one_part()
    context, world = questioned(fake)
    fake.lying["cube"] = frames.perturb(fake.lying["cube"], np.array([6.0, 0, 0, 0, 0, 0]))
    with pytest.raises(SuspectError, match="suspect: hand-eye"):
        step(context, world, PickState.SURVEY)


def test_a_part_that_no_lone_facet_bars_and_that_cannot_be_had_is_skipped_at_once(monkeypatch):
    fake = one_part()
    context, world = begun(fake)
    brought_to(PickState.CHOOSE, context, world)
    no_plan = NoPlan(CauseCode.NO_GRASP, "no grasp")
    monkeypatch.setattr(find, "_planned", lambda *_: (None, no_plan))
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
    monkeypatch.setattr(find, "outlines", lambda view: (1, 1))
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
    assert asyncio.run(find.other_side(context, world)) is reached
    assert len(world.looks) - looks == int(reached)
    middle = world.found[0].centre
    ways = [ON_HAND.world_from_cyclopean_at(pose)[:2, 3] - middle[:2] for pose in (before, fake.at)]
    assert bool(ways[0] @ ways[1] < 0.0) is reached, "from the other side"
