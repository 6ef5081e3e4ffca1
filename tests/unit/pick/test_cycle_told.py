"""What a pick cycle tells of itself: its status as a pick goes on, and each end, as they follow from what happened."""

from __future__ import annotations

import asyncio
from typing import Any

import numpy as np
import pytest

from daemon import frames
from daemon.events.pick_order import PickOrder
from tests.fakes.fake_cell import World, cycle_of, one_part
from tests.unit.pick.test_order import some


def test_the_end_of_a_pick_is_what_its_records_say() -> None:
    world = one_part()
    lay = world.lying["cube"].copy()
    cycle = cycle_of(world)
    before_s = world.now_s
    end = asyncio.run(cycle.pick())
    estimates, looks = world.said("estimate"), [look for look in world.said("look") if look["purpose"] == "approach"]
    last = estimates[-1]
    assert (end.cycle, end.outcome, end.label, end.stops) == (1, "picked", "cube", len(looks))
    assert (end.predicted_mm, end.predicted_deg) == (last["predicted_mm"], last["predicted_deg"])
    assert end.predicted_mm == pytest.approx(np.sqrt(np.trace(last["covariance"][:3, :3]) + 3 * 0.1**2))
    assert before_s < world.now_s
    assert 0.0 < end.seconds <= world.now_s - before_s
    (grasp,) = [move["target"] for move in world.said("move") if move["purpose"] == "grasp"]
    np.testing.assert_array_equal(end.grasp, grasp)
    corners = cycle.recogniser.shape("cube").corners_mm
    assert end.corners is not None
    assert np.abs(end.corners - frames.apply(lay, corners)).max() < 5.0
    assert (end.brought, end.place, end.skipped) == (True, None, ())
    (record,) = world.said("cycle_end")
    assert record["predicted"] == {"mm": end.predicted_mm, "deg": end.predicted_deg}
    assert {name: record[name] for name in ("cycle", "outcome", "label", "stops", "why", "skipped", "code")} == {
        "cycle": 1, "outcome": "picked", "label": "cube", "stops": end.stops, "why": end.why, "skipped": [],
        "code": None,
    }  # fmt: skip
    assert list(cycle.ends) == [end]


def test_a_pick_that_finds_nothing_ends_without_a_part_a_grasp_or_an_error() -> None:
    world = World(np.random.default_rng(0))
    cycle = cycle_of(world)
    end = asyncio.run(cycle.pick())
    assert (end.outcome, end.label, end.stops, end.predicted_mm, end.predicted_deg) == ("empty", None, 0, None, None)
    assert (end.grasp, end.corners, end.brought) == (None, None, False)
    assert world.said("cycle_end")[0]["predicted"] == {"mm": None, "deg": None}


def test_the_status_follows_the_pick_from_before_it_to_after_it() -> None:
    world = one_part()
    cycle = cycle_of(world)
    seen: list[dict[str, Any]] = []

    def note(name: str) -> None:
        if name == "moved":
            seen.append(cycle.status())

    world.before = note
    first = cycle.status()
    assert (first["state"], first["cycle"], first["last"], first["left"], first["waits_for"]) == (
        "idle",
        0,
        None,
        None,
        None,
    )
    assert (first["target"], first["stop"], first["predicted_mm"], first["predicted_deg"]) == (None,) * 4
    assert (first["picked"], first["tried"], first["failed"], first["released"], first["aborted"]) == (0,) * 5
    end = asyncio.run(cycle.pick())
    assert {status["cycle"] for status in seen} == {1}
    under_way = [status for status in seen if status["target"] is not None]
    assert {status["target"] for status in under_way} == {"cube"}
    stops = [status["stop"] for status in under_way]
    assert stops == sorted(stops)
    assert stops[-1] == end.stops
    estimated = [status for status in under_way if status["predicted_mm"] is not None]
    by_record = {(round(r["predicted_mm"], 3), round(r["predicted_deg"], 3)) for r in world.said("estimate")}
    assert {(status["predicted_mm"], status["predicted_deg"]) for status in estimated} <= by_record
    assert estimated
    last = cycle.status()
    assert (last["state"], last["target"], last["stop"], last["doing"]) == ("idle", None, None, None)
    assert (last["picked"], last["tried"], last["failed"], last["last"]) == (1, 1, 0, f"picked: {end.why}")


def test_an_auto_tells_how_much_is_left_and_how_long_that_takes_as_the_last_parts_took() -> None:
    world = some(3)
    cycle = cycle_of(world)
    told: list[tuple[Any, Any]] = []

    def note(name: str) -> None:
        status = cycle.status()
        if name == "moved" and status["auto"]:
            told.append(((status["left"] or {}).get("count"), status["left_s"]))

    world.before = note
    ends = asyncio.run(cycle.auto(PickOrder(3)))
    assert [end.outcome for end in ends] == ["picked"] * 3
    assert told[0][0] == 3
    assert {count for count, _ in told} >= {3, 2, 1}
    first, second = ends[0].seconds, ends[1].seconds
    assert told[0][1] is None, "nobody knows yet"
    assert (1, pytest.approx((first + second) / 2)) in [(count, left) for count, left in told if left is not None]
    status = cycle.status()
    assert (status["left"], status["left_s"], status["auto"], status["picked"]) == (None, None, False, 3)
