"""Records of earlier releases, as they are read."""

from __future__ import annotations

import pytest

from daemon.events.codes import CauseCode
from daemon.events.outcomes import is_tried
from daemon.events.upgrade import VERSION, read_prose, upgraded


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


def test_a_rule_of_an_earlier_name_is_read_by_its_name_of_today() -> None:
    for v in (1, VERSION):
        assert upgraded({"v": v, "kind": "refusal", "rule": "fault_stands"})["rule"] == "fault_active"
        assert upgraded({"v": v, "kind": "refusal", "rule": "below_table"})["rule"] == "below_table"


@pytest.mark.parametrize(
    ("code", "texts"),
    [
        (CauseCode.OPERATOR_NO, ["the operator refused: to the bin", "somebody answered no to: to the bin"]),
        (
            CauseCode.ARM_NOT_THERE,
            [
                "NotAtTargetError: grasp: sent, but WHERE is 3.12 mm and 0.41 degrees off",
                "NotAtTargetError: grasp: the arm did not arrive: WHERE is 3.12 mm and 0.41 degrees from the target",
                "Elsewhere: at rest 41 mm and 2 degrees from where it was sent",
                "Elsewhere: at rest 41 mm and 2 degrees from its target",
            ],
        ),
        (
            CauseCode.LINE_NOISE,
            [
                "the answer to 'SPEED 5' did not come through whole",
                "the answer to 'SPEED 5' arrived damaged (noise on the line?)",
                "WHERE did not give its table",
                "the answer to WHERE was incomplete",
            ],
        ),
        (
            CauseCode.HAND_EYE,
            [
                "SuspectError: looks 1 and 2 disagree; suspect: hand-eye",
                "SuspectError: looks 1 and 2 disagree; likely cause: hand-eye; `calibrate verify`",
            ],
        ),
        (
            CauseCode.CAMERA_KNOCKED,
            [
                "SuspectError: looks 1 and 2 disagree; suspect: camera",
                "SuspectError: looks 1 and 2 disagree; likely cause: camera; `calibrate verify`",
            ],
        ),
        (CauseCode.STALE_LOOK, ["the look behind it is 31.0 s old", "it was computed from a look that is 31.0 s old"]),
        (
            CauseCode.LOOKS_DISAGREE,
            [
                "the cameras were knocked: with no other part in view it cannot be told",
                "the cameras were knocked: with no other part in view facetd cannot tell which",
            ],
        ),
        (
            CauseCode.CONTROLLER_RESTARTED,
            [
                "ControllerError: the controller asks 'Load VAL-II from floppy (Y/N)?': answer that first",
                "ControllerError: the controller asks 'Load VAL-II from floppy (Y/N)?': answer it (`robot power-up`)",
            ],
        ),
    ],
)
def test_a_text_means_the_same_cause_in_the_words_of_every_release(code: CauseCode, texts: list[str]) -> None:
    assert [read_prose(text)["code"] for text in texts] == [code] * len(texts)
