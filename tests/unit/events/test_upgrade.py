"""Records of earlier releases, as they are read."""

from __future__ import annotations

import pytest

from daemon.events.outcomes import is_tried
from daemon.events.upgrade import VERSION, upgraded


@pytest.mark.parametrize(
    ("why", "outcome"),
    [
        ("stopped by ann", "aborted"),
        ("stopped by control-C of ann (process 7), socket", "aborted"),
        ("by control-C", "aborted"),
        ("NoAnswer: no prompt", "fault"),
        ("ControllerError: *Emergency stop*", "fault"),
    ],
)
def test_a_persons_stop_was_a_fault_in_version_1(why: str, outcome: str) -> None:
    record = {"v": 1, "kind": "cycle_end", "outcome": "fault", "why": why}
    assert upgraded(record)["outcome"] == outcome
    assert upgraded(record | {"v": VERSION})["outcome"] == "fault"
    assert upgraded(record | {"outcome": "missed"})["outcome"] == "missed"


def test_words_that_meant_the_bin_are_read_as_the_words_of_today() -> None:
    """Whatever version wrote them: `place` and `placed` were said of the bin before parts were set down at places."""
    for v in (1, 2, None):
        state = {"kind": "state", "v": v, "from": "place", "event": "placed", "to": "home"}
        assert upgraded(state) == {**state, "from": "bin", "event": "binned"}
        assert upgraded({"kind": "state", "v": v, "to": "place"})["to"] == "bin"
        assert upgraded({"kind": "left", "v": v, "state": "place"})["state"] == "bin"
        end = {"kind": "cycle_end", "v": v, "outcome": "placed", "why": "put down what was in the hand"}
        assert upgraded(end)["outcome"] == "emptied"
        assert not is_tried(upgraded(end)["outcome"])
