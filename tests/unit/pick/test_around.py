"""From where a thing is looked at all round."""

from __future__ import annotations

import asyncio
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from daemon import frames
from daemon.arm import OnHand, OutOfReachError, RefusedError
from daemon.pick.around import (
    LEAST_PLACES,
    MOST_PLACES,
    NEAREST_MM,
    CircledPart,
    NoSinglePartError,
    look_from_around,
    single_part_in,
    viewpoints_around,
)
from daemon.pick.settings import Settings
from daemon.vision.facets import merge_vertices
from tests.fakes.solids import CUBE, pose, view_of

TOOL_FROM_CYCLOPEAN = frames.rigid(np.eye(3), np.array([-70.0, 0.0, -100.0]))
THING = CircledPart(np.array([520.0, 0.0, -280.0]), 40.0)


def cameras(poses: list[np.ndarray]) -> np.ndarray:
    return np.array([(p @ TOOL_FROM_CYCLOPEAN)[:3, 3] - THING.middle for p in poses])


@pytest.mark.parametrize("count", [LEAST_PLACES, 9, MOST_PLACES])
def test_the_places_lie_all_round_and_look_at_the_middle(count: int) -> None:
    poses = viewpoints_around(THING, count, OnHand(TOOL_FROM_CYCLOPEAN), lambda _: True)
    assert len(poses) == count
    away = cameras(poses)
    assert np.linalg.norm(away, axis=1) == pytest.approx(NEAREST_MM, abs=1e-6)
    axes = np.array([(p @ TOOL_FROM_CYCLOPEAN)[:3, 2] for p in poses])
    assert np.abs(axes + away / NEAREST_MM).max() < 1e-9
    turns = np.sort(np.arctan2(away[:, 1], away[:, 0]))
    gaps = np.diff([*turns, turns[0] + 2 * np.pi])
    assert gaps.max() < 1.6 * 2 * np.pi / count


def test_only_allowed_places_are_chosen_each_once() -> None:
    def allowed(world_from_tool: np.ndarray) -> bool:
        return bool((world_from_tool @ TOOL_FROM_CYCLOPEAN)[1, 3] > 20.0)

    poses = viewpoints_around(THING, 12, OnHand(TOOL_FROM_CYCLOPEAN), allowed)
    assert all(allowed(p) for p in poses)
    assert len({p.tobytes() for p in poses}) == len(poses) == 12
    assert viewpoints_around(THING, 12, OnHand(TOOL_FROM_CYCLOPEAN), lambda _: False) == []


def test_a_large_thing_is_looked_at_from_farther_away() -> None:
    far = viewpoints_around(CircledPart(THING.middle, 80.0), 6, OnHand(TOOL_FROM_CYCLOPEAN), lambda _: True)
    assert np.linalg.norm(cameras(far), axis=1).min() > 1.3 * NEAREST_MM


def test_what_lies_beside_the_thing_is_not_its() -> None:
    group = view_of(CUBE, pose(np.array([1.0, 1.0, 1.0]), 0.3))
    group = merge_vertices(group.facets)
    world_from_cyclopean = np.eye(4)
    middle = group.polyhedron.corners_mm.mean(0)
    assert CircledPart(middle, 45.0).holds(group, world_from_cyclopean)
    assert not CircledPart(middle + np.array([120.0, 0.0, 0.0]), 45.0).holds(group, world_from_cyclopean)


def look_at_groups(*groups: Any) -> Any:
    view = SimpleNamespace(groups=groups)
    return SimpleNamespace(scene=SimpleNamespace(view=view), world_from_cyclopean=np.eye(4))


def test_the_thing_to_walk_round_is_the_one_group_of_facets_in_view() -> None:
    group = merge_vertices(view_of(CUBE, pose(np.array([1.0, 1.0, 1.0]), 0.3)).facets)
    lone = SimpleNamespace(facets=group.facets[:1])
    thing = single_part_in(look_at_groups(lone, group))
    assert thing.holds(group, np.eye(4))
    with pytest.raises(NoSinglePartError, match="no part is seen"):
        single_part_in(look_at_groups(lone))
    with pytest.raises(NoSinglePartError, match="2 parts are in view"):
        single_part_in(look_at_groups(group, lone, group))


CUBE_SEEN = merge_vertices(view_of(CUBE, pose(np.array([1.0, 1.0, 1.0]), 0.3)).facets)


class Walk:
    """A mover and looks that are played: what was travelled to, and what the looks show in their order."""

    def __init__(self, *shown: Any, refused: tuple[str, ...] = (), dry: bool = False) -> None:
        self.shown, self.refused, self.travelled, self.told = list(shown), refused, list[str](), list[str]()
        reach = SimpleNamespace(allows=lambda _: True)
        self.mover = SimpleNamespace(
            travel=self.travel,
            dry=dry,
            belief=SimpleNamespace(resting_reading=None),
            wait_until_at_rest=self.wait_until_at_rest,
            reach=reach,
        )
        self.context: Any = SimpleNamespace(
            cell=SimpleNamespace(mounting=OnHand(TOOL_FROM_CYCLOPEAN)), mover=self.mover,
            settings=Settings(surveys=Settings().surveys[:1] * 2), look=self.look, look_exposed=self.look,
        )  # fmt: skip

    async def wait_until_at_rest(self) -> str:
        return "here"

    async def travel(self, _: Any, purpose: str, __: Any) -> None:
        self.travelled.append(purpose)
        if purpose in self.refused:
            raise OutOfReachError("the wrist")
        if not self.mover.dry:
            self.mover.belief.resting_reading = purpose

    async def look(self, at: str, purpose: str) -> Any:
        assert at == (self.travelled[-1] if self.travelled and not self.mover.dry else "here")
        return self.shown.pop(0) if self.shown else look_at_groups(CUBE_SEEN)

    def walked(self, count: int) -> tuple[CircledPart, list[Any]]:
        async def told(text: str) -> None:
            self.told.append(text)

        return asyncio.run(look_from_around(self.context, count, told))


def test_a_thing_is_looked_at_from_each_place_that_is_reached_and_how_much_of_it_each_shows_is_told() -> None:
    nothing = look_at_groups()
    match_facets = look_at_groups(merge_vertices(CUBE_SEEN.facets[:1]))
    walk = Walk(nothing, look_at_groups(CUBE_SEEN), nothing, match_facets, refused=("round it, place 2 of 6",))
    thing, looks = walk.walked(6)
    assert thing.holds(CUBE_SEEN, np.eye(4))
    assert walk.travelled == ["find it", *(f"round it, place {k} of 6" for k in range(1, 7))]
    whole = f"{len(CUBE_SEEN.facets)} facets"
    assert walk.told == [f"place {k} of 6: {text}" for k, text in enumerate(
        ("0 facets", "left out: the wrist", "1 facet", whole, whole, whole), 1)]  # fmt: skip
    assert len(looks) == 5


def test_where_nothing_is_found_from_anywhere_or_too_few_places_are_reached_nobody_walks() -> None:
    nothing = look_at_groups()
    walk = Walk(nothing, nothing, nothing)
    with pytest.raises(NoSinglePartError, match="no part is seen"):
        walk.walked(6)
    assert walk.travelled == ["find it"] * 2
    few = Walk()
    with pytest.raises(RefusedError, match=f"reaches only {LEAST_PLACES - 1} places"):
        few.walked(LEAST_PLACES - 1)
    assert few.travelled == []
    dry = Walk(dry=True)
    dry.mover.belief.resting_reading = "here"
    assert len(dry.walked(LEAST_PLACES)[1]) == 0
    assert len(dry.travelled) == LEAST_PLACES
    with pytest.raises(NoSinglePartError):
        Walk(nothing, dry=True).walked(LEAST_PLACES)
