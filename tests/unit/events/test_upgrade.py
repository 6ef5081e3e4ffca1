"""Records of earlier releases, as they are read."""

from __future__ import annotations

import pytest

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
