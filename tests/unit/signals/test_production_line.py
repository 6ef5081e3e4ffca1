"""Permits, hand-shakes and outputs against a line in a table: no controller, no clock."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from typing import Any

import pytest

from daemon.arm import HeldBackError
from daemon.signals import production_line as lines
from daemon.signals.input_form import FORMS, InputForm, SignalError
from daemon.signals.packml import PackMLState, packml_state
from daemon.signals.production_line import ProductionLine, keep_watch
from daemon.signals.settings import SignalSettings

SIGNALS = {
    "permit": SignalSettings(number=1001, role="permit_pick"),
    "start": SignalSettings(number=1003, role="cycle_start"),
    "reset": SignalSettings(number=1004, role="reset"),
    "busy": SignalSettings(number=1, role="busy"),
    "done": SignalSettings(number=2, role="part_done"),
    "fault": SignalSettings(number=3, role="fault", level="low"),
}
ABORTED, IDLE, EXECUTE, COMPLETE = PackMLState.ABORTED, PackMLState.IDLE, PackMLState.EXECUTE, PackMLState.COMPLETE


class Line:
    """Inputs and outputs by number; `then`: what the line does at each reading, in turn."""

    def __init__(self, *on: int) -> None:
        self.on, self.typed, self.fails = set(on), [], False
        self.then: list[Callable[[], object]] = []
        self.withheld = False

    async def set_outputs(self, numbers: Sequence[int]) -> None:
        self.typed.append(list(numbers))
        if self.fails:
            raise OSError("no answer")
        for number in numbers:
            (self.on.add if number > 0 else self.on.discard)(abs(number))

    async def work_valves(self, numbers: Sequence[int]) -> None:
        if self.withheld:
            raise HeldBackError("a stop")
        await self.set_outputs(numbers)

    async def ask_input(self, text: str) -> str:
        if self.then:
            self.then.pop(0)()
        if self.fails:
            raise OSError("no answer")
        return "-1" if int(text.removeprefix("LISTR SIG(").removesuffix(")")) in self.on else "0"


@pytest.fixture(autouse=True)
def at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lines, "POLL_S", 0.0)
    monkeypatch.setattr(lines, "FAILED_S", 0.0)


def served(line: Line, signals: Any = SIGNALS) -> ProductionLine:
    return ProductionLine(signals, line, InputForm(FORMS[0], "0", "-1"), lambda: 0.0, lambda *_, **__: None)


def test_a_permit_that_is_off_is_waited_for_and_said() -> None:
    line = Line()
    signals, said = served(line), []
    line.then = [lambda: None, lambda: said.append(signals.waits_for), lambda: line.on.add(1001)]
    assert asyncio.run(signals.wait_for_permit("permit_pick"))
    assert said == ["the permit to pick (permit)"]
    assert signals.waits_for is None
    assert not asyncio.run(signals.wait_for_permit("permit_pick")), "it is there now"
    assert not asyncio.run(signals.wait_for_permit("permit_place")), "this line has none"
    assert not asyncio.run(signals.wait_for_permit(None)), "a move that needs none"


def test_a_start_counts_once_and_only_where_it_was_seen_off_before() -> None:
    line = Line(1001, 1003)
    signals, left = served(line), iter([True] * 4 + [False])
    assert not asyncio.run(signals.wanted(lambda: next(left))), "on since before the auto: somebody else's"
    line.on.discard(1003)
    line.then = [*[lambda: None] * 3, lambda: line.on.add(1003)]
    assert asyncio.run(signals.wanted(lambda: True))
    left = iter([True] * 4 + [False])
    assert not asyncio.run(signals.wanted(lambda: next(left))), "the same start asks for no second part"


def test_no_part_is_wanted_without_the_permit_to_pick() -> None:
    line = Line()
    signals = served(line)
    line.then = [*[lambda: None] * 2, lambda: line.on.add(1003)]
    left = iter([True] * 6 + [False])
    assert not asyncio.run(signals.wanted(lambda: next(left)))
    line.on.add(1001)
    assert asyncio.run(signals.wanted(lambda: True))


@pytest.mark.parametrize("is_button", [False, True])
def test_part_done_is_held_until_the_start_changes(is_button: bool) -> None:
    """A PLC takes its start away; a button was let go long ago and is pressed anew."""

    async def story() -> None:
        line = Line(1001, *(() if is_button else (1003,)))
        signals = served(line)
        await signals.brought()
        for _ in range(3):
            await signals.watch(COMPLETE)
            assert 2 in line.on
        (line.on.add if is_button else line.on.discard)(1003)
        await signals.watch(COMPLETE)
        assert not signals.done
        await signals.watch(IDLE)
        assert 2 not in line.on

    asyncio.run(story())


def test_outputs_are_set_where_they_differ_and_again_once_the_controller_was_switched_off() -> None:
    async def story() -> list[list[int]]:
        line = Line()
        signals = served(line)
        for state, seen in ((IDLE, 1), (IDLE, 1), (EXECUTE, 1), (EXECUTE, 0), (ABORTED, 0)):
            await signals.watch(state, seen)
        return line.typed

    assert asyncio.run(story()) == [[-1, -2, 3], [1], [1, -2, 3], [-1, -3]]


@pytest.mark.parametrize(
    ("on_stop", "done", "wanted"),
    [("hold", True, True), ("hold", False, False), ("on", False, True), ("off", True, False), (None, True, True)],
)
def test_a_stop_makes_of_part_done_what_the_file_says(on_stop: Any, done: bool, wanted: bool) -> None:
    signals = {**SIGNALS, "done": SignalSettings(number=2, role="part_done", on_stop=on_stop)}
    line = Line(1001, 1003)
    served_line = served(line, signals)

    async def story() -> None:
        if done:
            await served_line.brought()
        await served_line.watch(COMPLETE if done else EXECUTE)
        await served_line.watch(ABORTED)

    asyncio.run(story())
    assert (2 in line.on) is wanted


def test_a_reset_counts_where_it_comes_on_during_the_fault() -> None:
    async def story() -> list[bool]:
        line = Line(1004)
        signals, found = served(line), []
        for on in (True, True, False, True, True):
            (line.on.add if on else line.on.discard)(1004)
            found.append(await signals.watch(ABORTED))
        found.append(await signals.watch(IDLE))
        return found

    assert asyncio.run(story()) == [False, False, False, True, False, False]


def test_what_cannot_be_read_permits_nothing() -> None:
    line = Line(1001)
    signals = served(line)
    signals.form = None
    assert signals.unreadable is not None
    with pytest.raises(SignalError, match="`signal find permit` at a console"):
        asyncio.run(signals.wait_for_permit("permit_pick"))


def test_a_line_that_fails_twice_is_a_trouble_and_one_that_answers_again_is_over_it() -> None:
    line, said = Line(), []
    signals, rounds = served(line), iter(range(6))

    async def sleep(_: float) -> None:
        number = next(rounds, None)
        if number is None:
            raise asyncio.CancelledError
        line.fails = number < 3

    line.fails = True
    watch = keep_watch(signals, lambda: IDLE, lambda: 1, lambda: None, said.append, (OSError,), sleep)
    with pytest.raises(asyncio.CancelledError):
        asyncio.run(watch)
    assert [text for text in said if text] == ["signals: no answer"] * 3
    assert said[-1] is None


@pytest.mark.parametrize(
    ("stopped", "enabled", "at_work", "done", "state"),
    [
        (True, True, True, True, ABORTED),
        (False, False, True, True, PackMLState.STOPPED),
        (False, True, True, True, EXECUTE),
        (False, True, False, True, COMPLETE),
        (False, True, False, False, IDLE),
    ],
)
def test_the_five_states_of_packml(stopped: bool, enabled: bool, at_work: bool, done: bool, state: PackMLState) -> None:
    assert packml_state(stopped, enabled, at_work, done) is state


CUP = {
    "vacuum": SignalSettings(number=11, role="vacuum"),
    "blow": SignalSettings(number=12, role="blow_off", level="low"),
    "fault": SignalSettings(number=3, role="fault"),
}


def test_the_cup_sucks_until_it_is_to_let_go_and_blows_off_for_as_long_as_it_needs() -> None:
    line = Line()
    signals = served(line, CUP)

    async def story() -> list[list[int]]:
        await signals.work_cup(closed=True, work_time_s=0.0)
        blows = asyncio.create_task(signals.work_cup(closed=False, work_time_s=0.05))
        while len(line.typed) < 2:
            await asyncio.sleep(0)
        await signals.watch(EXECUTE)
        await blows
        return line.typed

    assert asyncio.run(story()) == [[11, 12], [-11, -12], [-3], [12]], "the watch leaves valves at work alone"
    assert signals.levels["vacuum"].on is signals.levels["blow"].on is False


def test_a_stop_leaves_the_vacuum_on_and_ends_a_blow_off_that_it_cut_off() -> None:
    line = Line()
    signals = served(line, CUP)

    async def story() -> None:
        await signals.work_cup(closed=True, work_time_s=0.0)
        await signals.watch(ABORTED)
        assert 11 in line.on, "the part does not fall"
        blows = asyncio.create_task(signals.work_cup(closed=False, work_time_s=600.0))
        while 11 in line.on:
            await asyncio.sleep(0)
        blows.cancel()
        with pytest.raises(asyncio.CancelledError):
            await blows
        await signals.watch(ABORTED)

    asyncio.run(story())
    assert line.typed[-1] == [12], "the blow-off alone"


def test_valves_are_held_back_as_the_gripper_is_and_nothing_of_it_is_made_up_for_later() -> None:
    line = Line(11)
    line.withheld = True
    signals = served(line, CUP)

    async def story() -> None:
        with pytest.raises(HeldBackError):
            await signals.work_cup(closed=False, work_time_s=0.0)
        await signals.watch(ABORTED)

    asyncio.run(story())
    assert 11 in line.on
    assert [12, 3] in [sorted(typed, reverse=True) for typed in line.typed], "the blow-off is off, whatever it was"
