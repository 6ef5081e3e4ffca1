"""Digital inputs and outputs over the line: what is typed, what it changes, and that none of it counts as motion."""

from __future__ import annotations

import pytest

from drivers.simcell.controller import Manners
from drivers.val2.commands import signals
from drivers.val2.errors import ControllerError, LineHeldBack
from tests.fakes.arm_line import MakesLine
from tests.fakes.in_time import lived
from tests.unit.val2.test_link import quick


class Withheld:
    """A permission that lets nothing move."""

    stop_tests = stop_answered = heard = 0
    stop_took_s = 0.0
    withheld = True


def test_outputs_are_set_and_inputs_read_also_while_nothing_may_move(timed_line: MakesLine) -> None:
    async def scene() -> None:
        line = timed_line()
        async with line.link(quick()) as link:
            link.permission = Withheld()
            link._session.talk._permission = link.permission
            await link.set_outputs([1, 2])
            await link.set_outputs([-1, 3])
            assert line.server._controller.machine.outputs == {2, 3}
            assert await link.ask_plainly("LISTR SIG(1001)") == ("0",)
            line.server._controller.machine.inputs.add(1001)
            assert await link.ask_plainly("LISTR SIG(1001)") == ("-1",)
            with pytest.raises(ControllerError, match="Illegal command"):
                await link.ask_plainly("DO TYPE SIG(1001)")
            with pytest.raises(LineHeldBack):
                await link.work_valves([-3])
            assert line.server._controller.machine.outputs == {2, 3}, "a valve of the gripper is the gripper"

    lived(scene())


def test_a_controller_with_another_word_for_an_input_is_read_by_that(timed_line: MakesLine) -> None:
    async def scene() -> None:
        line = timed_line(Manners(reads_inputs_by="TYPE"))
        async with line.link(quick()) as link:
            line.server._controller.machine.inputs.add(1004)
            assert await link.ask_plainly("DO TYPE SIG(1004)") == ("-1",)
            with pytest.raises(ControllerError):
                await link.ask_plainly("LISTR SIG(1004)")

    lived(scene())


@pytest.mark.parametrize("wrong", [[], [0], [1, 0]])
def test_a_number_that_is_no_output_is_never_typed(wrong: list[int]) -> None:
    assert signals([1, -12]) == "DO SIGNAL 1,-12"
    with pytest.raises(ValueError, match="not outputs"):
        signals(wrong)
