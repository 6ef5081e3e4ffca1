"""Views of one part joined: its edges come out as long as they are, in whatever order it was shown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from daemon.arrays import Array
from daemon.store.library import load_facets
from daemon.vision.geometry.polyhedron import Polyhedron
from daemon.vision.model.merge import MetricModel, merge_views
from daemon.vision.model.relations import types_of
from tests.fakes.solids import KNOWN, Body, pose, prism, view_of

LIBRARY = load_facets()
NOISE = 0.5
# No two of its edges at a corner are alike, so that two views fit together in one way only.
WEDGE = prism(np.array([[0.0, 0], [64, 0], [52, 38], [9, 47]]), 30.0)
ROUND = [(1.0, 0.3, 0.6), (0.3, 1.0, 0.6), (-1.0, 0.3, 0.6), (-0.3, -1.0, 0.6), (0.8, -0.7, -0.6), (-0.7, 0.8, -0.6)]


def views(body: Body, directions: Sequence[tuple[float, ...]], seed: int, noise: float = NOISE) -> list[Polyhedron]:
    """What looks from these directions show, each in the frame of its own look."""
    rng = np.random.default_rng(seed)
    found = []
    for direction in directions:
        group = view_of(body, pose(np.array(direction), float(rng.uniform(-3, 3))), rng, noise)
        found.append(replace(group.polyhedron, types=tuple(names[0] for names in types_of(group.facets, LIBRARY))))
    return found


def edge_lengths(solid: Polyhedron) -> Array:
    ends, _ = solid.lines
    return np.sort(np.linalg.norm(np.diff(solid.corners_mm[ends], axis=1)[:, 0], axis=1))


def true_lengths(body: Body) -> Array:
    edges = {frozenset((ring[k - 1], ring[k])) for ring in body.facets for k in range(len(ring))}
    ends = np.array([sorted(edge) for edge in edges])
    return np.sort(np.linalg.norm(body.corners_mm[ends[:, 0]] - body.corners_mm[ends[:, 1]], axis=1))


def whole(merged: MetricModel, body: Body) -> bool:
    solid = merged.solid
    return (len(solid.facets), len(solid.corners_mm)) == (len(body.facets), len(body.corners_mm))


@settings(max_examples=6, deadline=None)
@given(st.permutations(range(len(ROUND))), st.integers(0, 2**31))
def test_views_from_all_round_make_the_whole_part_in_any_order(order: list[int], seed: int) -> None:
    shown = views(WEDGE, ROUND, seed)
    merged = merge_views(tuple(shown[k] for k in order), LIBRARY)
    assert merged.joined == tuple(range(len(ROUND)))
    assert whole(merged, WEDGE)
    np.testing.assert_allclose(edge_lengths(merged.solid), true_lengths(WEDGE), atol=1.2)


@settings(max_examples=4, deadline=None)
@given(st.permutations(range(len(ROUND))), st.integers(0, 2**31))
def test_the_order_changes_the_shape_by_less_than_the_noise(order: list[int], seed: int) -> None:
    shown = views(WEDGE, ROUND, seed)
    one, other = (merge_views(tuple(shown[k] for k in way), LIBRARY) for way in (range(len(ROUND)), order))
    np.testing.assert_allclose(edge_lengths(one.solid), edge_lengths(other.solid), atol=0.6)


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 2**31))
def test_more_views_of_the_same_side_make_it_surer_and_no_larger(seed: int) -> None:
    shown = views(WEDGE, [ROUND[0]] * 5, seed)
    one, five = merge_views((shown[0],), LIBRARY), merge_views(tuple(shown), LIBRARY)
    assert five.joined == (0, 1, 2, 3, 4)
    assert len(five.solid.facets) == len(one.solid.facets)
    assert np.trace(five.solid.covariance_mm2.sum(0)) < 0.5 * np.trace(one.solid.covariance_mm2.sum(0))


@settings(max_examples=8, deadline=None)
@given(st.sampled_from(sorted(KNOWN)), st.integers(0, 2**31))
def test_views_of_a_symmetric_part_keep_its_edges_though_they_could_be_joined_in_several_ways(
    name: str, seed: int
) -> None:
    merged = merge_views(tuple(views(KNOWN[name], ROUND[:4], seed)), LIBRARY)
    lengths = true_lengths(KNOWN[name])
    assert np.abs(edge_lengths(merged.solid)[:, None] - lengths).min(1).max() < 1.2


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 2**31))
def test_a_view_of_another_part_stays_out(seed: int) -> None:
    stranger = prism(np.array([[0.0, 0], [80, 0], [66, 52], [12, 60]]), 44.0)
    shown = (*views(WEDGE, ROUND[:1], seed), *views(stranger, ROUND[:1], seed))
    assert merge_views(shown, LIBRARY).joined == (0,)


@settings(max_examples=8, deadline=None)
@given(st.permutations(range(3)), st.integers(0, 2**31))
def test_the_part_frame_sits_at_its_corners_middle_on_the_first_facet(order: list[int], seed: int) -> None:
    shown = views(WEDGE, ROUND[:3], seed)
    solid = merge_views(tuple(shown[k] for k in order), LIBRARY).solid
    np.testing.assert_allclose(solid.corners_mm.mean(0), 0.0, atol=1e-9)
    np.testing.assert_allclose(solid.normals[0], [0.0, 0.0, 1.0], atol=1e-6)
    side = solid.corners_mm[solid.facets[0][1]] - solid.corners_mm[solid.facets[0][0]]
    assert side[0] > 0
    assert abs(side[1]) < 1e-6 * side[0]
