"""How the time of a run was used: by hand-made runs whose seconds are known, and whatever the records."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon.review.digest import Digest, digest
from daemon.review.downtime import PAUSED, Doing, spans, use_of_time

Line = tuple[float, str, dict[str, Any]]


def run(*lines: Line) -> Digest:
    """A run of records: when (s), kind, fields."""
    records = [{"kind": kind, "mono_s": at, "seq": n, **fields} for n, (at, kind, fields) in enumerate(lines)]
    return digest("20260101T000000Z", records)


def on(at: float) -> Line:
    return at, "auto", {"on": True}


def off(at: float) -> Line:
    return at, "auto", {"on": False}


def pick(at: float, seconds: float = 10.0, outcome: str = "picked", **end: Any) -> list[Line]:
    return [(at, "cycle_start", {"cycle": 1}), (at + seconds, "cycle_end", {"cycle": 1, "outcome": outcome, **end})]


def fault(at: float, code: str) -> Line:
    return at, "fault", {"code": code, "text": code}


def resumed(at: float) -> Line:
    return at, "state", {"from": "fault", "to": "idle", "event": "resume"}


def told(made: Digest) -> list[tuple[Doing, float, str]]:
    return [(span.doing, span.seconds, span.cause) for span in spans(made)]


def test_an_auto_with_a_stop_a_wait_for_parts_and_an_end() -> None:
    made = run(
        on(0), *pick(0), (13, "cycle_start", {}), fault(15, "operator_stop"),
        (15.5, "cycle_end", {"outcome": "aborted", "code": "operator_stop"}), (40, "command", {"text": "resume"}),
        resumed(41), on(45), *pick(45), *pick(60, 5, "empty"), *pick(90, 10), off(100), *pick(200, 7),
        (300, "run_end", {}),
    )  # fmt: skip
    assert told(made) == [
        (Doing.PICKING, 15.0, ""),
        (Doing.DOWN, 30.0, "operator's stop"),
        (Doing.PICKING, 20.0, ""),
        (Doing.WAITING, 25.0, ""),
        (Doing.PICKING, 10.0, ""),
        (Doing.PICKING, 7.0, ""),
    ]


@pytest.mark.parametrize("end", [{"outcome": "aborted", "code": "operator_no"}, {"stopped": "operator_no"}])
def test_a_persons_no_costs_an_auto_until_it_goes_on_and_a_single_pick_nothing(end: dict[str, Any]) -> None:
    made = run(on(0), *pick(0, **end), on(40), *pick(40), off(50), *pick(100, **end), (900, "run_end", {}))
    assert told(made) == [
        (Doing.PICKING, 10.0, ""),
        (Doing.DOWN, 30.0, "operator refused a move"),
        (Doing.PICKING, 10.0, ""),
        (Doing.PICKING, 10.0, ""),
    ]


def test_a_fault_of_a_single_pick_costs_until_it_is_cleared() -> None:
    made = run(
        (0, "cycle_start", {}), fault(4, "camera_lost"), (5, "cycle_end", {"outcome": "fault", "code": "camera_lost"}),
        resumed(64), (100, "run_end", {}),
    )  # fmt: skip
    assert told(made) == [(Doing.PICKING, 4.0, ""), (Doing.DOWN, 60.0, "camera not connected")]


def test_an_abort_costs_until_the_next_pick_and_a_pause_until_it_is_over() -> None:
    made = run(
        on(0), *pick(0, 5, "aborted", code="operator_abort"), *pick(25, 10),
        (40, "cycle_start", {}), (42, "state", {"from": "looking", "to": "paused", "event": "pause"}),
        (52, "state", {"from": "paused", "to": "looking", "event": "resume"}),
        (60, "cycle_end", {"outcome": "picked"}), off(60),
    )  # fmt: skip
    assert told(made) == [
        (Doing.PICKING, 5.0, ""), (Doing.DOWN, 20.0, "operator's abort"), (Doing.PICKING, 17.0, ""),
        (Doing.DOWN, 10.0, PAUSED), (Doing.PICKING, 8.0, ""),
    ]  # fmt: skip


def test_what_an_earlier_daemon_left_is_downtime_until_somebody_resumes_it() -> None:
    left = (0.0, "left", {"cycle": 3, "auto": {"count": 2}})
    assert told(run(left, resumed(30), on(40), *pick(40), off(50))) == [
        (Doing.DOWN, 40.0, "daemon restarted"),
        (Doing.PICKING, 10.0, ""),
    ]
    assert told(run((0.0, "left", {"cycle": 3}), resumed(30), (99, "run_end", {}))) == [
        (Doing.DOWN, 30.0, "daemon restarted")
    ]


def test_a_fault_while_nobody_wanted_parts_is_no_downtime() -> None:
    assert told(run(fault(3, "camera_lost"), resumed(50), (99, "run_end", {}))) == []


def test_oee_is_the_product_of_its_factors() -> None:
    lines = [on(0)]
    for n in range(9):
        lines += pick(10.0 * n)
    lines += pick(90, 10, "missed")
    made = run(*lines, fault(100, "gripper"), on(150), off(150))
    times = use_of_time([made])
    assert (times["picking_s"], times["down_s"]) == (100.0, 50.0)
    assert times["ideal_s"] == pytest.approx(10.0)
    assert times["availability"] == pytest.approx(2 / 3)
    assert times["performance"] == pytest.approx(1.0)
    assert times["quality"] == pytest.approx(0.9)
    assert times["oee"] == pytest.approx(0.6)
    assert times["stops"] == [{"cause": "gripper does not open or close", "count": 1, "s": 50.0}]


def test_the_costliest_stop_comes_first_and_several_runs_count_together() -> None:
    often = run(on(0), *[x for n in range(3) for x in (*pick(20 * n, 5, "aborted", code="operator_abort"),)], off(60))
    long = run((0, "cycle_start", {}), fault(1, "camera_lost"), resumed(500))
    stops = use_of_time([often, long])["stops"]
    assert [(stop["cause"], stop["count"]) for stop in stops] == [("camera not connected", 1), ("operator's abort", 3)]


def test_a_few_picks_are_no_measure_of_performance() -> None:
    times = use_of_time([run(on(0), *pick(0), off(10))])
    assert (times["oee"], times["quality"], times["picking_s"]) == (None, None, 10.0)
    assert use_of_time([])["oee"] is None


KINDS = st.sampled_from([
    ("auto", {"on": True}), ("auto", {"on": False}), ("cycle_start", {}), ("cycle_end", {"outcome": "picked"}),
    ("cycle_end", {"outcome": "empty"}), ("cycle_end", {"outcome": "fault", "code": "gripper"}), ("cycle_end", {}),
    ("fault", {"code": "gripper"}), ("fault", {}), ("state", {"from": "fault", "to": "idle"}),
    ("state", {"from": "looking", "to": "paused"}), ("state", {"from": "paused", "to": "looking"}),
    ("left", {"cycle": 1}), ("run_start", {}), ("look", {}),
])  # fmt: skip


@given(st.lists(st.tuples(st.floats(0, 100), KINDS), max_size=30))
def test_no_second_is_counted_twice_whatever_the_records(lines: list[tuple[float, Any]]) -> None:
    at, made = 0.0, []
    for after, (kind, fields) in lines:
        at += after
        made.append((at, kind, fields))
    whole = run(*made)
    every = list(spans(whole))
    assert all(span.seconds >= 0 and bool(span.cause) == (span.doing is Doing.DOWN) for span in every)
    assert sum(span.seconds for span in every) <= (at - made[0][0] if made else 0.0) + 1e-6
    times = use_of_time([whole])
    assert times["oee"] is None or 0 <= times["oee"] <= 1


def test_the_page_of_a_run_has_the_times(tmp_path: Path) -> None:
    from daemon.review.page import read_digest
    from daemon.review.pagedata import page_data
    from tests.fakes.made_run import MadeRun

    made = MadeRun(tmp_path / "20260102T060000Z", pictures=False)
    made.write("auto", on=True, count=None, every_s=None)
    for _ in range(6):
        made.pick()
    made.write("auto", on=False, count=None, every_s=None)
    done = page_data(read_digest(made.close()))["production"]
    assert done["oee"] == done["times"]["oee"]
    assert 0.9 < done["oee"] <= 1
