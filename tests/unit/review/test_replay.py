"""Replay through today's recogniser: what changed, and what of it is worse."""

from __future__ import annotations

from daemon.review.replay import compare
from tests.worlds.made_run import part


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


def test_a_look_that_only_followed_a_part_is_held_against_a_whole_one_as_two_measurements() -> None:
    def shifted(mm: float) -> dict[str, object]:
        pose = [[1.0, 0, 0, mm], [0, 1.0, 0, 0], [0, 0, 1.0, 0], [0, 0, 0, 1.0]]
        return part("cube", cyclopean_from_part=pose)

    then = scene(part("cube"))
    assert compare(then, scene(shifted(0.41)), whole=False) == []
    assert compare(then, scene(shifted(0.44)), whole=False)[0][2]
    assert compare(then, scene(part("unknown", reason="one facet")), whole=False) == []
    assert compare(then, scene(part("pyramid")), whole=False)[0][2]
    assert compare(then, scene(), whole=False) == []
