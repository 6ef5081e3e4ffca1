"""Corners that two cameras see meet in space, and say where a taught part would have them."""

from __future__ import annotations

import numpy as np
import pytest

from daemon import frames
from daemon.vision.geometry import Baseline, baseline, exact
from daemon.vision.hypotheses.junctions import indistinguishable_turns, meet, taught_junctions
from daemon.vision.image import SegmentCorners, Segments, segment_corners
from tests.fakes.rigs import rig
from tests.fakes.solids import KNOWN, STRANGERS, pose, seen_facets

WHERE = pose(np.array([0.75, 0.35, 0.6]), 0.3, 330.0)


def shape(name: str):
    body = {**KNOWN, **STRANGERS}[name]
    return exact(body.corners_mm, body.facets)


def edges_seen(name: str, camera) -> SegmentCorners:
    """The corners that exact segments along a part's visible edges make, a face always on the same hand."""
    solid = shape(name)
    px = camera.project(frames.apply(WHERE, solid.corners_mm))
    pairs = {}
    for k in seen_facets(KNOWN[name], WHERE, 0.0):
        ring = solid.facets[k]
        for a, b in zip(ring, (*ring[1:], ring[0]), strict=True):
            pairs.setdefault(frozenset((a, b)), (a, b))
    ends = np.array(list(pairs.values()))
    return segment_corners(Segments(px[ends[:, 0]], px[ends[:, 1]]))


def both(name: str) -> tuple[SegmentCorners, SegmentCorners, Baseline]:
    images = rig()
    return edges_seen(name, images.left), edges_seen(name, images.right), baseline(images)


COUNTS = [("cube", 2), ("pyramid", 9), ("triangular_prism", 6), ("pentagonal_prism", 6)]


@pytest.mark.parametrize(("name", "count"), COUNTS)
def test_a_solid_has_each_kind_of_corner_once(name: str, count: int) -> None:
    """48 ordered pairs of edges by 24 turns of a cube, 36 by 4, 36 by 6, 60 by 10."""
    assert len(taught_junctions((shape(name),)).part) == count


def test_a_solid_taught_from_one_side_has_no_turn_that_takes_a_known_side_where_none_is_known() -> None:
    """By its corners alone a cube of three faces turns as a whole one does; it was then guessed with its unknown
    sides to the front."""
    whole = shape("cube")
    corner = next(iter(whole.facets[0]))
    known = exact(whole.corners_mm, [ring for ring in whole.facets if corner in ring])
    assert len(taught_junctions((known,)).part) > len(taught_junctions((whole,)).part)
    from_part = taught_junctions((known,)).corner_from_part
    for one in range(len(from_part)):
        for other in range(one):
            turn = np.linalg.inv(from_part[other]) @ from_part[one]
            at = frames.apply(turn, known.corners_mm)
            to = np.linalg.norm(at[:, None] - known.corners_mm, axis=2).argmin(1)
            moved = {frozenset(to[list(ring)].tolist()) for ring in known.facets}
            assert moved != {frozenset(ring) for ring in known.facets} or not np.allclose(known.corners_mm[to], at)


TURNS = [("cube", 24), ("pyramid", 4), ("triangular_prism", 6), ("pentagonal_prism", 10), ("l_block", 2)]


@pytest.mark.parametrize(("name", "count"), TURNS)
def test_a_solid_looks_the_same_after_its_own_turns(name: str, count: int) -> None:
    turns = indistinguishable_turns(shape(name), tuple(range(len(shape(name).corners_mm))))
    assert len(turns) == count
    assert np.array_equal(turns[0], np.eye(4))
    corners = shape(name).corners_mm
    for turn in turns:
        off = np.linalg.norm(frames.apply(turn, corners)[:, None] - corners, axis=2).min(1)
        assert off.max() < 1e-6
        assert np.linalg.det(turn[:3, :3]) > 0


def test_a_part_that_is_known_in_part_looks_alike_where_what_is_seen_does() -> None:
    """Three faces of a cube are known: turned about their corner all look the same; of two, either may be first."""
    cube = shape("cube")
    corner = 0
    three = [f for f in cube.facets if corner in f]
    numbers = sorted({c for f in three for c in f})
    known = exact(cube.corners_mm[numbers], [tuple(numbers.index(c) for c in f) for f in three])
    assert len(indistinguishable_turns(known, tuple(range(7)))) == 3
    assert len(indistinguishable_turns(known, tuple(sorted({*known.facets[0], *known.facets[1]})))) == 6


def test_a_corner_knows_how_long_its_edges_are() -> None:
    body = shape("pyramid")
    taught = taught_junctions((body,))
    cosines, lengths = taught.cosine, taught.lengths_mm
    edges = np.linalg.norm(np.diff(body.corners_mm[body.lines[0]], axis=1)[:, 0], axis=1)
    assert np.allclose(np.unique(lengths.round(6)), np.unique(edges.round(6)))
    square = np.abs(cosines) < 1e-9  # only the corners of its foot
    assert square.any()
    assert np.allclose(lengths[square, 0], lengths[square, 1])


def test_corners_meet_where_they_are_in_space() -> None:
    left, right, geometry = both("cube")
    met = meet(left, right, geometry)
    at = (met.at - [geometry.length_mm / 2, 0, 0]) @ geometry.cyclopean_from_baseline.T + geometry.middle_mm
    there = frames.apply(WHERE, shape("cube").corners_mm)
    assert np.linalg.norm(there[:, None] - at, axis=2).min(1).min() < 0.2
    assert np.allclose(np.linalg.norm(met.firm, axis=1), 1.0)


def test_a_corner_on_other_rows_or_with_the_shading_the_other_way_round_is_another() -> None:
    left, right, geometry = both("cube")
    assert len(meet(left, right, geometry).at)
    down = np.array([0.0, 30.0])
    lower = SegmentCorners(right.at + down, right.arms + down, right.sign)
    assert len(meet(left, lower, geometry).at) < len(meet(left, right, geometry).at) / 2
    inverse = SegmentCorners(right.at, right.arms, -right.sign)
    assert len(meet(left, inverse, geometry).at) < len(meet(left, right, geometry).at)


def test_nothing_seen_meets_nowhere() -> None:
    none = segment_corners(Segments(np.zeros((0, 2)), np.zeros((0, 2))))
    assert len(meet(none, none, baseline(rig())).at) == 0
