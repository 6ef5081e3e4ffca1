"""What looks saw, in the world: one part where two sights meet, no name unlearnt, and what would show again."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from daemon import frames
from daemon.pick.seen import (
    Facing,
    ObservedPart,
    facings,
    in_pick_order,
    is_facet_of,
    missing_parts,
    seen_parts,
    visible_share,
)
from daemon.vision.values import UNKNOWN, Part, Recognition
from tests.fakes.rigs import rig
from tests.fakes.solids import measured

WORLD_FROM_CYCLOPEAN = frames.rigid(np.diag([1.0, -1.0, -1.0]), np.array([500.0, 0.0, 50.0]))
SQUARE = 25.0 * np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])


def take_look(*parts: Part) -> Any:
    """As much of a look as its parts need."""
    return SimpleNamespace(
        world_from_cyclopean=WORLD_FROM_CYCLOPEAN, scene=SimpleNamespace(parts=parts), taken=SimpleNamespace(rig=rig())
    )


def part_at(
    x: float, y: float, label: str = "cube", facets: int = 1, confidence: float = 0.9, z: float = 350.0
) -> Part:
    """A part whose facets are squares seen from above, at (x, y) mm before the cameras."""
    corners = [SQUARE[::-1] + np.array([x, y + 60.0 * k, z]) for k in range(facets)]
    told = Recognition(label, confidence, 1.0, 1.0, None, False, "told", (label,))
    pose = frames.rigid(np.eye(3), np.array([x, y, z]))
    return Part(told, tuple(measured(c, None) for c in corners), pose, np.eye(6), 0.1)


def seen_at(x: float, y: float, label: str = "cube", **more: Any) -> ObservedPart:
    return seen_parts(take_look(part_at(x, y, label, **more)))[0]


def test_a_part_is_brought_to_the_world_with_its_corners_and_its_facets_look_out_of_it() -> None:
    seen = seen_at(10.0, 20.0)
    assert seen.centre == pytest.approx([510.0, -20.0, -300.0])
    assert seen.world_from_part[:3, 3] == pytest.approx([510.0, -20.0, -300.0])
    (facing,) = facings(seen)
    assert facing.centre == pytest.approx(seen.centre)
    assert facing.normal == pytest.approx([0, 0, 1])


def test_a_part_without_facets_is_not_told() -> None:
    assert len(seen_parts(take_look(part_at(0, 0), replace(part_at(60, 0), facets=())))) == 1


def test_a_lone_facet_within_a_part_is_its_own_and_one_beside_it_is_not() -> None:
    part = seen_at(0, 0, "cube", facets=2)
    assert is_facet_of(seen_at(0, 30, UNKNOWN), part)
    assert not is_facet_of(seen_at(90, 0, UNKNOWN), part)
    assert not is_facet_of(seen_at(0, 30, "pyramid"), part), "what has a name is somebody"
    assert not is_facet_of(seen_at(0, 0, UNKNOWN, facets=2), part), "two facets are no misread one"


def test_a_facet_shows_again_the_better_the_squarer_it_is_seen_and_not_from_behind() -> None:
    facing = Facing(np.zeros(3), np.array([0, 0, 1.0]))
    cameras = [np.array([np.sin(a), 0, np.cos(a)]) * 300 for a in np.radians([0, 30, 60, 80, 180])]
    told = [visible_share([facing], camera) for camera in cameras]
    assert told[0] == pytest.approx(1.0)
    assert told == sorted(told, reverse=True)
    assert told[3:] == [0.0, 0.0]
    assert visible_share([], cameras[0]) == 0.0
    assert visible_share([facing, Facing(np.zeros(3), np.array([0, 0, -1.0]))], cameras[0]) == pytest.approx(0.5)


def test_a_lone_facet_that_should_show_and_does_not_is_unconfirmed() -> None:
    lone, named = seen_at(0, 0, UNKNOWN), seen_at(0, 0, "cube")
    around, nothing = lone.centre + np.array([20.0, 0, 0]), take_look()
    assert missing_parts([lone, named], nothing, around) == [lone]
    assert missing_parts([lone], take_look(part_at(5, 5, UNKNOWN)), around) == [], "it shows again"
    assert missing_parts([lone], nothing, around + np.array([150.0, 0, 0])) == [], "it bars nothing"
    assert missing_parts([seen_at(160, 0, UNKNOWN)], nothing, seen_at(160, 0).centre) == [], "out of view"


def test_what_is_nearest_or_surest_comes_first_and_what_has_no_name_last() -> None:
    far_sure, near, nameless = seen_at(0, 0, z=400.0, confidence=0.99), seen_at(50, 0), seen_at(0, 0, UNKNOWN, z=200.0)
    parts = [nameless, far_sure, near]
    assert in_pick_order(parts, "nearest") == [near, far_sure, nameless]
    assert in_pick_order(parts, "surest") == [far_sure, near, nameless]
