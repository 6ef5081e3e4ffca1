"""The one definition of tried and of success."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from daemon.events.outcomes import GOING_ON, UNFINISHED, Outcome, is_success, is_tried, tally

ANY = st.sampled_from([*Outcome, UNFINISHED, GOING_ON])


def test_what_counts_as_tried_outcome_by_outcome() -> None:
    tried = {o for o in (*Outcome, UNFINISHED, GOING_ON) if is_tried(o)}
    assert tried == {
        "picked", "released", "off", "missed", "lost", "ambiguous", "unknown", "unreachable", "unsure", "fault",
    }  # fmt: skip
    assert [o for o in tried if is_success(o)] == ["picked"]


def test_an_outcome_of_a_newer_release_counts_as_tried_without_success() -> None:
    assert (is_tried("melted"), is_success("melted")) == (True, False)


@given(st.lists(ANY))
def test_every_pick_is_counted_once_at_most(outcomes: list[str]) -> None:
    found = tally(outcomes)
    assert found.tried == found.picked + found.released + found.failed
    assert found.tried + found.aborted <= len(outcomes)
    assert min(found.failed, found.picked, found.released, found.aborted) >= 0
