"""Replay through today's recogniser: what changed, and what of it is worse."""

from __future__ import annotations

import pytest

from daemon.review.replay import _table, apart_mm, compare, paired
from tests.worlds.made_run import FACET, part


def scene(*parts: dict[str, object]) -> dict[str, object]:
    return {"parts": list(parts)}


def test_replay_tells_what_changed_and_what_of_it_is_worse() -> None:
    then = scene(part("cube"))
    assert compare(then, scene(part("cube"))) == []
    assert compare(then, scene())[0][2]
    lost_name = compare(then, scene(part("unknown", reason="one facet")))
    assert lost_name == [("cube", "now unknown: one facet", True)]
    gained = compare(scene(part("unknown")), scene(part("cube")))
    assert gained == [("unknown", "now cube: 3 facets fit to 0.10 mm rms", False)]


def test_replay_takes_a_pose_within_three_sigma_for_the_same_and_one_beyond_for_worse() -> None:
    def shifted(mm: float) -> dict[str, object]:
        pose = [[1.0, 0, 0, mm], [0, 1.0, 0, 0], [0, 0, 1.0, 0], [0, 0, 0, 1.0]]
        return part("cube", cyclopean_from_part=pose)

    assert compare(scene(part("cube")), scene(shifted(0.29))) == []
    assert compare(scene(part("cube")), scene(shifted(0.35)))[0][2]


def beside(mm: float) -> dict[str, object]:
    """A cube whose corners lie so far off, and that is said to lie another way round."""
    turned = [[0.0, -1.0, 0, 30.0], [1.0, 0, 0, 0], [0, 0, 1.0, 0], [0, 0, 0, 1.0]]
    facet = {**FACET, "corners_mm": [[x + mm, y, z] for x, y, z in FACET["corners_mm"]]}  # type: ignore[attr-defined]
    return part("cube", cyclopean_from_part=turned, facets=[facet])


def test_a_look_that_only_followed_a_part_is_held_against_a_whole_one_by_the_corners() -> None:
    """Which of several ways that show the same it lies, the look before had told it."""
    then = scene(part("cube"))
    assert compare(then, scene(beside(0.41)), whole=False) == []
    assert compare(then, scene(beside(0.44)), whole=False)[0][2]
    assert compare(then, scene(part("unknown", reason="one facet")), whole=False) == []
    assert compare(then, scene(part("pyramid")), whole=False)[0][2]
    assert compare(then, scene(), whole=False) == []


def test_a_part_of_another_model_is_held_against_the_old_by_its_corners_not_by_its_pose() -> None:
    """Another model's part has another origin: where the part lies is the same, its pose is not."""
    then = scene(part("cube"))
    assert compare(then, scene(beside(0.0)))[0][2]
    assert compare(then, scene(beside(0.0)), one_model=False) == []
    assert compare(then, scene(beside(0.4)), one_model=False) == []
    assert "moved by 0.45 mm at its corners" in compare(then, scene(beside(0.45)), one_model=False)[0][1]


def test_how_far_apart_two_parts_lie_is_told_by_the_corners_that_both_show() -> None:
    fewer = part("cube", facets=[{**FACET, "corners_mm": [[0.3, 0, 300], [0.3, 50, 300]]}])
    assert apart_mm(part("cube"), fewer) == apart_mm(fewer, part("cube")) == pytest.approx(0.3)
    assert apart_mm(part("cube"), part("cube", facets=[])) is None


def test_parts_belong_together_that_lie_within_so_much_and_each_has_one_other() -> None:
    near, far = beside(24.9), beside(25.1)
    then = scene(part("cube"))
    assert paired(then, scene(near)) == [(then["parts"][0], near)]  # type: ignore[index]
    assert paired(then, scene(far)) == [(then["parts"][0], None), (None, far)]  # type: ignore[index]
    two = paired(scene(part("cube"), beside(1.0)), scene(beside(0.9)))
    assert [match is None for _, match in two] == [False, True]
    assert paired(scene(part("cube", facets=[])), scene(part("cube", facets=[])))[0][1] is None


def test_what_is_new_or_gone_is_told_only_where_all_was_looked_for_and_it_has_a_name() -> None:
    named, nameless = scene(part("cube")), scene(part("unknown"))
    assert compare(named, scene()) == [("cube", "no longer found", True)]
    assert compare(scene(), named) == [("cube", "was not found before", False)]
    assert compare(nameless, scene()) == compare(scene(), nameless) == []
    assert compare(scene(), named, whole=False) == []


def test_the_table_of_a_look_is_the_one_it_was_taken_over() -> None:
    table = _table({"table": {"up": [0, 0, 1], "level_mm": 3}})
    assert table is not None
    assert (table.up.tolist(), table.level_mm) == ([0, 0, 1], 3.0)
    assert _table({}) is _table({"table": None}) is None
