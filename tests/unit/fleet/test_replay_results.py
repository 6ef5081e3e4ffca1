"""What a replay came to, counted: named, right by the pick, apart, by cell, part and light."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from daemon.fleet.replay_results import count_by_kind, differences, light_of, summed


def look(seq: int, *parts: tuple[str | None, str | None, str | None], **more: Any) -> dict[str, Any]:
    """parts: (then, now, proved)."""
    pairs = [
        {"then": then, "now": now, "proved": proved, "mm": 0.1 if then == now else None} for then, now, proved in parts
    ]
    changes = [
        {"seq": seq, "cycle": 1, "part": then or "x", "what": f"now {now}", "regression": then != "unknown"}
        for then, now, _ in parts
        if then != now
    ]
    return {
        "seq": seq, "cycle": 1, "purpose": "survey", "whole": True, "light": "over 180", "then_ms": 10.0,
        "now_ms": 20.0, "identical": not changes, "changes": changes, "parts": pairs, "now": {} if changes else None,
        **more,
    }  # fmt: skip


def result(*looks: dict[str, Any]) -> dict[str, Any]:
    return {"run": "r", "looks": list(looks), "skipped": []}


def test_a_name_counts_as_right_or_wrong_only_where_the_pick_proved_it() -> None:
    total = summed([("north", result(
        look(1, ("cube", "cube", "cube"), ("unknown", "pyramid", None)),
        look(2, ("cube", "unknown", "cube"), ("unknown", "cube", "cube")),
        look(3, ("pyramid", "cube", "cube")),
    ))])["all"]  # fmt: skip
    assert (total["parts"], total["named"]) == (5, [3, 4])
    assert (total["proved"], total["right"], total["wrong"]) == (4, [2, 3], [1, 0])
    assert (total["mm"], total["ms"]) == (0.1, [10.0, 20.0])


def test_a_look_that_was_told_the_name_counts_for_the_distance_alone() -> None:
    total = summed([("north", result(look(1, ("cube", "cube", "cube"), whole=False)))])["all"]
    assert (total["parts"], total["proved"], total["right"], total["mm"]) == (0, 0, [0, 0], 0.1)


def test_everything_is_counted_by_cell_by_part_and_by_light_in_their_order() -> None:
    dim = look(2, ("pyramid", "pyramid", None), light="under 60")
    by = summed([("south", result(look(1, ("cube", "unknown", None)))), ("north", result(dim))])["by"]
    assert {kind: list(groups) for kind, groups in by.items()} == {
        "cell": ["north", "south"], "part": ["cube", "pyramid"], "light": ["under 60", "over 180"],
    }  # fmt: skip
    assert by["cell"]["south"]["named"] == [1, 0]
    assert by["light"]["under 60"]["named"] == [1, 1]


def test_proved_names_that_were_lost_come_first_among_the_differences() -> None:
    found = differences([("north", result(
        look(1, ("unknown", "cube", None)), look(2, ("cube", "cube", None)), look(3, ("cube", "pyramid", None)),
        look(4, ("cube", "unknown", "cube")),
    ))])  # fmt: skip
    assert [one["seq"] for one in found] == [4, 3, 1]
    assert count_by_kind(found) == {"cube -> unknown": 1, "cube -> pyramid": 1, "unknown -> cube": 1}


@pytest.mark.parametrize(
    ("left", "right", "light"),
    [(220.0, 59.0, "under 60"), (60.0, 90.0, "60 to 120"), (200.0, None, "over 180"), (None, None, "not measured")],
)
def test_the_light_of_a_look_is_that_of_its_darker_camera(left: float | None, right: float | None, light: str) -> None:
    assert light_of({"darkness_left": left, "darkness_right": right}) == light


def test_the_same_results_in_another_grouping_come_to_the_same() -> None:
    rng = np.random.default_rng(1)
    names = ["cube", "pyramid", "unknown"]
    looks = [look(k, tuple(rng.choice(names, 3))) for k in range(40)]
    whole = summed([("north", result(*looks))])
    pieces = summed([("north", result(*looks[k : k + 7])) for k in range(0, 40, 7)])
    assert whole == pieces
