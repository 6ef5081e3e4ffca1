"""What is still to be picked of a job counts down to nothing, whatever is brought, left out or was in the gripper."""

from __future__ import annotations

from collections import Counter

import msgspec
from hypothesis import given
from hypothesis import strategies as st

from daemon.events.pick_order import ALL, OrderStep, PickOrder, auto_record, read_order

LABELS = st.sampled_from(("cube", "pyramid", "prism"))
STEPS = st.lists(st.builds(OrderStep, LABELS, st.integers(1, 3)), min_size=1, max_size=4).map(tuple)


@st.composite
def orders(draw: st.DrawFn) -> PickOrder:
    steps, times = draw(STEPS), draw(st.integers(1, 3))
    count = times * sum(step.count for step in steps)
    return PickOrder(count, job="kit", steps=steps, in_turn=draw(st.booleans()), times=times, whole=steps)


@given(orders(), st.data())
def test_a_job_is_done_after_just_its_parts_in_an_order_that_it_allows(order: PickOrder, data: st.DataObject) -> None:
    begun, brought = order, Counter[str]()
    while not order.done:
        wanted = [label for label in ("cube", "pyramid", "prism") if order.wants(label)]
        label = data.draw(st.sampled_from(wanted))
        assert order.only in (None, label)
        before, order = order, order.brought(label)
        brought[label] += 1
        assert (before.count, order.count) == (before.count, (before.count or 0) - 1)
        assert order.count == sum(s.count for s in order.steps) + (order.times - 1) * sum(s.count for s in order.whole)
    assert begun.missing(brought) == {}
    assert order.steps == ()


@given(orders())
def test_what_is_left_out_is_missing_and_the_job_comes_to_its_end(order: PickOrder) -> None:
    begun, brought, skipped = order, Counter[str](), Counter[str]()
    while not order.done:
        if order.wants("cube"):
            order = order.brought("cube")
            brought["cube"] += 1
        else:
            before, order = order, order.without_wanted()
            skipped["all"] += (before.count or 0) - (order.count or 0)
    assert sum(begun.missing(brought).values()) == (begun.count or 0) - brought["cube"]
    assert skipped["all"] == sum(begun.missing(brought).values())


@given(orders())
def test_what_nobody_ordered_counts_for_nothing(order: PickOrder) -> None:
    assert order.brought(None) == order
    assert order.brought("wedge") == order
    assert not order.wants("wedge")


def test_in_turn_only_the_first_step_is_wanted_and_the_place_is_the_steps_own() -> None:
    steps = (OrderStep("cube", 1, "tray"), OrderStep("pyramid"), OrderStep("cube", 1, "bin"))
    order = PickOrder(3, job="kit", steps=steps, whole=steps)
    assert (order.only, order.place("cube"), order.wants("pyramid")) == ("cube", "tray", False)
    order = order.brought("cube")
    assert (order.only, order.place("pyramid"), order.wants("cube")) == ("pyramid", None, False)
    order = order.brought("pyramid")
    assert (order.only, order.place("cube"), order.count) == ("cube", "bin", 1)


def test_an_order_without_steps_wants_whatever_lies_there() -> None:
    assert ALL.wants("anything")
    assert ALL.brought("anything") == ALL
    assert ALL.only is None
    assert PickOrder(2).brought("cube") == PickOrder(2).brought(None) == PickOrder(1)


@given(orders())
def test_an_order_comes_back_from_the_log_as_it_was(order: PickOrder) -> None:
    record = msgspec.json.decode(msgspec.json.encode(auto_record(order)))
    assert read_order(record["order"]) == order
    assert read_order(msgspec.json.decode(msgspec.json.encode(order.json()))) == order
    assert "order" not in auto_record(PickOrder(3))
