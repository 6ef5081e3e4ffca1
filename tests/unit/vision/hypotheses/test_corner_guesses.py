"""Where taught parts could be: at corners in space that could be theirs, and few of all those that could."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from daemon import frames
from daemon.vision.geometry import exact
from daemon.vision.geometry.polyhedron import SolidBatch
from daemon.vision.hypotheses import junctions
from daemon.vision.hypotheses.directional_edge_map import edge_distances
from daemon.vision.hypotheses.junctions import junction_kinds, meet, poses_from_junctions
from daemon.vision.hypotheses.pose_batch import PoseBatch
from daemon.vision.image import StereoImages, join_segments, open_stereo, segment_corners
from tests.fakes.printed import print_pair, straight_rig
from tests.fakes.solids import CUBE, KNOWN, pose

WHERE = pose(np.array([0.75, 0.35, 0.6]), 0.3, 330.0)
NAMES = tuple(sorted(KNOWN))


@cache
def images_of(name: str) -> StereoImages:
    return open_stereo(*print_pair(KNOWN[name], WHERE, 3), straight_rig())


def solids(*scales: float) -> SolidBatch:
    """All known parts in sizes."""
    return SolidBatch.of([exact(KNOWN[name].corners_mm * by, KNOWN[name].facets) for by in scales for name in NAMES])


def guessed(name: str, taught: SolidBatch) -> tuple[PoseBatch, int]:
    images = images_of(name)
    left, right = (segment_corners(join_segments(view.segments)) for view in images.views)
    maps = edge_distances(images.left), edge_distances(images.right)
    found, _, could = poses_from_junctions(meet(left, right, images.geometry), images.geometry, maps, taught)
    return found, could


def off_mm(name: str, found: PoseBatch) -> np.ndarray:
    """How far each guess has the corners of a part of this name from where they are; infinite for other parts."""
    there = frames.apply(WHERE, KNOWN[name].corners_mm)
    own = found.part == NAMES.index(name)
    off = np.full(len(own), np.inf)
    off[own] = [
        np.linalg.norm(frames.apply(one, KNOWN[name].corners_mm)[:, None] - there, axis=2).min(1).max()
        for one in found.poses[own]
    ]
    return off


@pytest.mark.parametrize("name", NAMES)
def test_a_part_is_guessed_where_it_is(name: str) -> None:
    found, could = guessed(name, solids(1.0))
    assert off_mm(name, found).min() < 3.0
    assert len(found.part) < could


@pytest.mark.parametrize("name", NAMES)
def test_of_many_sizes_the_right_one_is_among_as_few_guesses(name: str) -> None:
    sizes = solids(1.0, *np.linspace(0.5, 1.6, 16))
    found, could = guessed(name, sizes)
    assert could > 10 * guessed(name, solids(1.0))[1]
    assert len(found.part) <= junctions.most_guesses(len(sizes.shapes), 1)[0]
    assert off_mm(name, found).min() < 6.0


def test_guesses_are_few_at_each_corner_and_in_all(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(junctions, "most_guesses", lambda taught, corners: (10**6, 3))
    several, _ = guessed("cube", solids(1.0, 0.7, 1.3))
    monkeypatch.setattr(junctions, "most_guesses", lambda taught, corners: (10**6, 1))
    few, could = guessed("cube", solids(1.0, 0.7, 1.3))
    assert 0 < len(few.part) < len(several.part)
    monkeypatch.setattr(junctions, "most_guesses", lambda taught, corners: (50, 1))
    fewest, still = guessed("cube", solids(1.0, 0.7, 1.3))
    assert len(fewest.poses) == 50
    assert {one.tobytes() for one in fewest.poses} < {one.tobytes() for one in few.poses}
    assert still == could


@pytest.mark.parametrize("name", NAMES)
def test_the_right_guess_is_among_the_first_five_by_how_the_outline_goes_on(name: str) -> None:
    found, _ = guessed(name, solids(1.0, *np.linspace(0.5, 1.6, 16)))
    assert np.flatnonzero(off_mm(name, found) < 6.0)[0] < 5
    assert len(found.part) == junctions.MOST_BY_OUTLINE


def test_the_outline_goes_on_along_the_facet_between_two_edges_or_seen_from_behind_along_those_beside_it() -> None:
    taught = junctions.taught_junctions((exact(CUBE.corners_mm, CUBE.facets),))
    side_mm = taught.lengths_mm[0, 0]
    (face, behind) = taught.outline_mm[0] / side_mm
    assert face == pytest.approx(np.array([[1, 0, 0], [0, 1, 0], [1, 1, 0], [1, 1, 0]]), abs=1e-5)
    assert np.abs(behind) == pytest.approx(np.array([[1, 0, 0], [0, 1, 0], [1, 0, 1], [0, 1, 1]]), abs=1e-5)


@pytest.mark.parametrize(
    ("taught", "corners", "most"),
    [
        (4, 800, (4000, 16)),
        (64, 800, (12800, 64)),
        (4, 50, (4000, 80)),
        (64, 50, (12800, 256)),
        (1000, 800, (20000, 100)),
    ],
)
def test_more_may_be_guessed_where_more_is_taught_and_at_a_corner_where_those_are_few(
    taught: int, corners: int, most: tuple[int, int]
) -> None:
    assert junctions.most_guesses(taught, corners) == most


def test_parts_share_the_kinds_of_their_corners() -> None:
    """A cube has one edge length and one angle; another as large has no kind of its own."""
    cube, prism = (exact(KNOWN[name].corners_mm, KNOWN[name].facets) for name in ("cube", "triangular_prism"))
    again = exact(cube.corners_mm, cube.facets)
    assert len(junction_kinds((cube,)).kinds) == len(junction_kinds((cube, again)).kinds) == 1
    both = junction_kinds((cube, prism))
    assert len(both.kinds) < len(junction_kinds((cube,)).kinds) + len(both.part)
    assert both.begins[-1] == len(both.part) == len(junction_kinds((cube,)).part) + len(junction_kinds((prism,)).part)


def test_nothing_seen_or_nothing_taught_is_nothing_guessed() -> None:
    found, could = guessed("cube", SolidBatch.of(()))
    assert len(found.poses) == could == 0
    images = images_of("cube")
    left, right = (segment_corners(view.segments) for view in images.views)
    none = meet(left, right, images.geometry).chosen(np.zeros(0, np.intp))
    maps = edge_distances(images.left), edge_distances(images.right)
    found, _, could = poses_from_junctions(none, images.geometry, maps, solids(1.0))
    assert found.poses.shape == (0, 4, 4)
    assert could == 0
