"""One line and its answer in a first contact, read without a port."""

from __future__ import annotations

from collections.abc import Generator
from typing import Any

import pytest

from drivers.val2.contact_findings import (
    Consult,
    ContactFindings,
    Exchange,
    Heard,
    UnclearError,
    agreed,
    errors_in,
    same_place,
)
from drivers.val2.first_contact import introduce
from drivers.val2.location import Location
from drivers.val2.wire import Where

HERE = Location(400.0, 100.0, -50.0, 10.0, 80.0, 20.0)
JOINTS = (10.0, 80.0, -70.0, 30.0, 0.0, -30.0)


def test_two_readings_alike_in_place_and_joints_are_one_place() -> None:
    assert same_place(Where(HERE, JOINTS), Where(HERE, (10.01, *JOINTS[1:])))


@pytest.mark.parametrize(
    "now",
    [
        Where(Location(400.3, 100.0, -50.0, 10.0, 80.0, 20.0), JOINTS),
        Where(Location(400.0, 100.0, -50.0, 10.0, 80.0, 20.5), JOINTS),
        # The wrist is straight: joints 4 and 6 turn against each other, and the tool stays where it is.
        Where(HERE, (10.0, 80.0, -70.0, 31.0, 0.0, -31.0)),
    ],
)
def test_an_arm_that_still_moves_is_at_no_place(now: Where) -> None:
    assert not same_place(Where(HERE, JOINTS), now)


def answered(asking: Generator[Any, Any, bool], said: str) -> bool:
    consult = next(asking)
    assert isinstance(consult, Consult)
    assert consult.text == "May I?. (yes or no)"
    with pytest.raises(StopIteration) as end:
        asking.send(said)
    return bool(end.value.value)


@pytest.mark.parametrize(("said", "yes"), [("yes", True), (" Y ", True), ("no", False), ("", False), ("yesno", False)])
def test_only_a_yes_is_a_yes(said: str, yes: bool) -> None:
    assert answered(agreed("move", "May I?"), said) is yes


def test_what_stands_between_asterisks_is_an_error_and_the_rest_is_not() -> None:
    assert errors_in(b"SPEED 20\r\n *Illegal command*\r\n.") == ("*Illegal command*",)


def test_a_halted_processor_is_recognised_at_the_first_line_and_its_remedy_told() -> None:
    typed: list[bytes] = []

    def answered(step: object) -> Heard | None:
        if not isinstance(step, Exchange):
            return None
        typed.append(step.data)
        echo = ((0.01, step.data.replace(b"\r", b"?\r\n@")),) if step.data else ()
        return Heard(echo, step.most_s)

    def story() -> None:
        steps = introduce(ContactFindings())
        step = next(steps)
        while True:
            step = steps.send(answered(step))

    with pytest.raises(UnclearError, match="HALT/RUN switch"):
        story()
    assert b"".join(typed) == b"!!\r"
    assert len(typed) < 5, "each takes three seconds at most"
