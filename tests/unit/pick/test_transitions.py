"""The pick cycle's table: whole, reached, left, and kept by every handler."""

from typing import get_args, get_type_hints

import pytest

from daemon.pick.cycle import HANDLERS
from daemon.pick.transitions import NEXT, SHOWN, TABLE, PickEvent, PickState, follows


def test_every_state_of_the_table_has_a_handler_and_every_row_leads_somewhere_known():
    states = {row.state for row in TABLE} - {"*", "idle", "fault", "paused"}
    assert states == set(HANDLERS)
    assert {row.then for row in TABLE} <= states | {"idle", "fault", "paused", "back"}
    assert len(NEXT) == len(TABLE)


def test_every_state_can_be_reached_from_idle_and_leads_back_to_it():
    leads = {}
    for row in TABLE:
        if row.state != "*":
            leads.setdefault(row.state, set()).add(row.then)
    assert _reached(leads, "idle") >= set(HANDLERS)
    assert all("idle" in _reached(leads, state) for state in HANDLERS)


def _reached(leads, start):
    seen, todo = set(), [start]
    while todo:
        for then in leads.get(todo.pop(), set()) - seen:
            seen.add(then)
            todo.append(then)
    return seen


@pytest.mark.parametrize("state", list(HANDLERS))
def test_a_handler_returns_the_events_of_its_rows_and_no_other(state):
    says = set(get_args(get_type_hints(HANDLERS[state])["return"]))
    assert says == {row.event for row in TABLE if row.state is state}


@pytest.mark.parametrize("state", [s for s in PickState if s not in (PickState.ANY, PickState.BACK)])
def test_a_stop_an_abort_and_an_error_are_heard_in_every_state(state):
    assert follows(state, PickEvent.STOP, PickState.IDLE) is PickState.FAULT
    assert follows(state, PickEvent.ERROR, PickState.IDLE) is PickState.FAULT
    stands = state is PickState.FAULT
    assert follows(state, PickEvent.ABORT, PickState.IDLE) is (PickState.FAULT if stands else PickState.IDLE)


@pytest.mark.parametrize("state", list(HANDLERS))
def test_a_pause_leads_back_to_where_it_came_in(state):
    assert follows(state, PickEvent.PAUSE, PickState.IDLE) is PickState.PAUSED
    assert follows(PickState.PAUSED, PickEvent.RESUME, state) is state


def test_a_state_knows_no_event_but_those_of_its_rows():
    general = {row.event for row in TABLE if row.state is PickState.ANY}
    for state in HANDLERS:
        own = {row.event for row in TABLE if row.state is state}
        for event in set(PickEvent) - own - general:
            with pytest.raises(KeyError):
                follows(state, event, PickState.IDLE)


def test_after_a_fault_only_resume_leads_on():
    assert {row.event for row in TABLE if row.state is PickState.FAULT and row.then is not PickState.FAULT} == {
        PickEvent.RESUME
    }


def test_every_state_that_a_pick_can_be_in_is_shown_to_an_operator_in_words():
    assert set(SHOWN) == set(PickState) - {PickState.ANY, PickState.BACK}
    assert not any("_" in words for words in SHOWN.values())
