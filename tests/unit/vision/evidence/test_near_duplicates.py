"""Shapes that a part could be taken for are solids, and lie where the part does but for what differs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon.vision.evidence.edge_places import PLACES, EdgePlaces
from daemon.vision.evidence.near_duplicates import (
    LEAST_CUT,
    MOST_CUT,
    STRETCHED,
    completed_corners,
    cut_corners,
    inverted_corners,
    near_duplicates,
    without_corner,
)
from daemon.vision.geometry import Polyhedron, exact
from daemon.vision.image import open_stereo
from daemon.vision.model import mirror_images
from tests.fakes.printed import print_pair, straight_rig
from tests.fakes.solids import KNOWN, pose

CUBE = exact(KNOWN["cube"].corners_mm, KNOWN["cube"].facets)


def volume(solid: Polyhedron) -> float:
    return float((solid.areas_mm2 * solid.centres_mm).sum() / 3)


def beside(solid: Polyhedron, corner: int) -> list[int]:
    return sorted({k for edge in solid.edges if corner in edge for k in edge} - {corner})


def block_with_tip(mm: float) -> Polyhedron:
    """A block of 40 mm with a pyramid on it, or taken out of it."""
    square = np.array([[-20.0, -20.0], [20.0, -20.0], [20.0, 20.0], [-20.0, 20.0]])
    low, high = (np.column_stack([square, np.full(4, z)]) for z in (0.0, 30.0))
    sides = [(k, (k + 1) % 4, (k + 1) % 4 + 4, k + 4) for k in range(4)]
    tip = [(k + 4, (k + 1) % 4 + 4, 8) for k in range(4)]
    return exact(np.vstack([low, high, [0.0, 0.0, 30.0 + mm]]), [(3, 2, 1, 0), *sides, *tip])


def places(
    solid: Polyhedron, missing: dict[tuple[int, int], int], hidden: tuple[tuple[int, int], ...] = ()
) -> EdgePlaces:
    """All edges seen but those hidden; of those missing, so many places beside the first of the two corners."""
    count = len(solid.lines[0])
    here = np.ones((count, PLACES))
    visible = np.ones((count, PLACES), bool)
    for k, (a, b) in enumerate(solid.lines[0].tolist()):
        here[k, : missing.get((a, b), 0)] = 0.0
        here[k, PLACES - missing.get((b, a), 0) :] = 0.0
        visible[k] = (a, b) not in hidden and (b, a) not in hidden
    yes = np.ones((count, PLACES), bool)
    return EdgePlaces(np.ones(count), np.ones(count), visible, yes, yes, 50 * here, here, np.zeros((count, 1)))


@given(st.integers(0, 7), st.lists(st.floats(0.05, 0.9), min_size=3, max_size=3))
def test_a_cube_without_a_corner_is_closed_and_lacks_that_much(corner: int, shares: list[float]) -> None:
    cut = without_corner(CUBE, corner, dict(zip(beside(CUBE, corner), shares, strict=True)))
    assert cut.open_edges == 0
    assert len(cut.facets) == 7
    side_mm = np.linalg.norm(CUBE.corners_mm[CUBE.facets[0][0]] - CUBE.corners_mm[CUBE.facets[0][1]])
    assert volume(CUBE) - volume(cut) == pytest.approx(side_mm**3 * np.prod(shares) / 6, rel=1e-6)
    (whole,) = completed_corners(cut)
    assert whole.open_edges == 0
    assert volume(whole) == pytest.approx(volume(CUBE), rel=1e-6)


def test_what_has_no_cut_corner_has_none_whole() -> None:
    assert completed_corners(CUBE) == ()
    assert completed_corners(exact(KNOWN["pyramid"].corners_mm, KNOWN["pyramid"].facets)) == ()


def test_where_a_facet_was_not_taught_a_cut_is_not_bounded_there() -> None:
    open_cube = CUBE.only([k for k in range(6) if k != 0])
    corner = next(k for k in range(8) if len([f for f in open_cube.facets if k in f]) == 2)
    cut = without_corner(open_cube, corner, dict.fromkeys(beside(open_cube, corner), 0.3))
    assert len(cut.facets) == len(open_cube.facets)


def test_tips_are_sunk_or_raised() -> None:
    assert [len(inverted_corners(block_with_tip(mm))) for mm in (12.0, -12.0)] == [1, 1]
    assert inverted_corners(block_with_tip(12.0))[0].corners_mm == pytest.approx(block_with_tip(-12.0).corners_mm)


def test_a_part_that_shows_all_its_edges_and_is_its_own_mirror_image_could_be_nothing_else() -> None:
    where = pose(np.array([0.75, 0.35, 0.6]), 0.3, 330.0)
    images = open_stereo(*print_pair(KNOWN["cube"], where, 3), straight_rig())
    assert not mirror_images(CUBE)
    assert near_duplicates(CUBE, where, images, [places(CUBE, {})] * 2) == []


def test_a_corner_is_cut_where_all_its_edges_in_view_end_early_in_both_images() -> None:
    ends = {(0, other): 6 for other in beside(CUBE, 0)}
    lacking, whole = places(CUBE, ends), places(CUBE, {})
    found = list(cut_corners(CUBE, [lacking, lacking]))
    assert len(found) == len(STRETCHED) ** 3
    assert all(len(one.facets) == 7 for one in found)
    assert list(cut_corners(CUBE, [lacking, whole])) == []
    one_there = places(CUBE, dict(list(ends.items())[1:]))
    assert list(cut_corners(CUBE, [one_there, one_there])) == []
    hidden = places(CUBE, ends, hidden=(next(iter(ends)),))
    assert len(list(cut_corners(CUBE, [hidden, hidden]))) == len(STRETCHED) ** 2
    unseen = replace(lacking, visible=np.zeros_like(lacking.visible))
    assert list(cut_corners(CUBE, [unseen, unseen])) == []
    assert len(list(cut_corners(CUBE, [lacking, unseen]))) == len(STRETCHED) ** 3


def test_of_several_corners_the_one_of_which_most_is_missing_is_cut() -> None:
    far = max(range(8), key=lambda k: float(np.linalg.norm(CUBE.corners_mm[k] - CUBE.corners_mm[0])))
    ends = {(0, other): 4 for other in beside(CUBE, 0)} | {(far, other): 8 for other in beside(CUBE, far)}
    seen = places(CUBE, ends)
    for one in cut_corners(CUBE, [seen, seen]):
        off_mm = np.linalg.norm(one.corners_mm - CUBE.corners_mm[far], axis=1)
        assert off_mm.min() > 1.0
        assert np.linalg.norm(one.corners_mm - CUBE.corners_mm[0], axis=1).min() < 1e-9


def test_little_that_is_missing_is_no_cut_and_no_cut_goes_beyond_the_edge() -> None:
    few = int(LEAST_CUT * PLACES) - 1
    seen = places(CUBE, {(0, other): few for other in beside(CUBE, 0)})
    assert list(cut_corners(CUBE, [seen, seen])) == []
    seen = places(CUBE, {(0, other): PLACES for other in beside(CUBE, 0)})
    side_mm = np.linalg.norm(CUBE.corners_mm[beside(CUBE, 0)[0]] - CUBE.corners_mm[0])
    for one in cut_corners(CUBE, [seen, seen]):
        new = one.corners_mm[-3:]
        assert np.linalg.norm(new - CUBE.corners_mm[0], axis=1).max() <= MOST_CUT * side_mm * (1 + 1e-9)
