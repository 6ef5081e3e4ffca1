"""Edges that both cameras see inside a part are on its faces, or speak against it; print does not."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daemon.arrays import Array
from daemon.vision.evidence import off_faces
from daemon.vision.evidence.off_faces import off_faces_px
from daemon.vision.geometry import Hole, Polyhedron, exact
from daemon.vision.image import StereoImages, open_stereo
from tests.fakes.printed import print_pair, straight_rig
from tests.fakes.solids import pose, prism

BLOCK = prism(np.array([[0.0, 0], [60, 0], [60, 45], [0, 45]]), 40.0)
SOLID = exact(BLOCK.corners_mm, BLOCK.facets)
WHERE = pose(np.array([-0.5, 0.3, 0.8]), 0.3, 330.0)


@cache
def printed(seed: int = 3, ink: bool = True) -> StereoImages:
    return open_stereo(*print_pair(BLOCK, WHERE, seed, printed=ink, patterned=False), straight_rig())


def behind(mm: float) -> Array:
    """The pose with the part so much farther along the sight of the cameras."""
    where = WHERE.copy()
    where[:3, 3] *= (where[2, 3] + mm) / where[2, 3]
    return where


@pytest.mark.parametrize("seed", [3, 4, 5])
def test_print_lies_on_the_faces_of_a_part_that_is_there(seed: int) -> None:
    assert off_faces_px(SOLID, WHERE, printed(seed)) < 15.0


@pytest.mark.parametrize("mm", [-14.0, 14.0])
def test_print_before_or_behind_the_faces_speaks_against_a_part(mm: float) -> None:
    assert off_faces_px(SOLID, behind(mm), printed()) > 200.0


def test_what_shows_in_a_hole_is_on_no_face() -> None:
    rims = [
        SOLID.centres_mm[k] + 0.9 * (SOLID.corners_mm[ring] - SOLID.centres_mm[k]) for k, ring in enumerate(SOLID.rings)
    ]
    holed = replace(SOLID, holes=tuple(Hole(k, rim) for k, rim in enumerate(rims)))
    assert off_faces_px(holed, behind(14.0), printed()) < 0.2 * off_faces_px(SOLID, behind(14.0), printed())


def test_what_one_face_shows_is_off_another_that_is_claimed_there() -> None:
    """A pyramid claimed as taken out of the block's top, which is flat there."""
    assert off_faces_px(_with_pit(), WHERE, printed()) > 100.0


def _with_pit() -> Polyhedron:
    top = max(BLOCK.facets, key=lambda ring: BLOCK.corners_mm[list(ring), 2].min())
    corners = np.vstack([BLOCK.corners_mm, BLOCK.corners_mm[list(top)].mean(0) - [0.0, 0.0, 20.0]])
    apex = len(corners) - 1
    sides = [(a, b, apex) for a, b in zip(top, (*top[1:], top[0]), strict=True)]
    return exact(corners, [*(ring for ring in BLOCK.facets if ring != top), *sides])


def test_faces_without_an_edge_on_them_say_nothing() -> None:
    assert off_faces_px(SOLID, WHERE, printed(ink=False)) == 0.0


def test_without_its_own_search_elsewhere_nothing_is_off_the_faces(monkeypatch: pytest.MonkeyPatch) -> None:
    """An edge that is nowhere in the other image may be hidden there."""
    monkeypatch.setattr(off_faces, "AS_STRONG", np.inf)
    assert off_faces_px(SOLID, behind(14.0), printed()) == 0.0


@settings(max_examples=15, deadline=None)
@given(st.tuples(*[st.floats(-600, 600)] * 2), st.floats(60, 900))
def test_any_pose_gives_a_length(aside: tuple[float, float], away: float) -> None:
    where = WHERE.copy()
    where[:3, 3] = *aside, away
    assert 0.0 <= off_faces_px(SOLID, where, printed()) < 1e5
