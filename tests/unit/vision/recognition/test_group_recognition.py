"""Naming and locating parts from facets in space, taught on six views: right, or silent."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import combinations
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daemon import frames
from daemon.vision.facets.grouping import merge_vertices
from daemon.vision.model.model import Model, learn_view
from daemon.vision.recognition.group_recognition import candidate_poses, recognise_groups, recognise_part
from daemon.vision.values import Facet, Part
from tests.fakes.remembered import SIX_VIEWS, shown
from tests.fakes.solids import CUBE, KNOWN, PENTAGONAL, PYRAMID, STRANGERS, TRIANGULAR, Body, measured, pose, view_of

directions = st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda d: np.linalg.norm(d) > 0.3)
seeds = st.integers(0, 2**31)


@cache
def taught() -> Model:
    return shown(SIX_VIEWS)


def look(body: Body, direction: tuple[float, ...], roll: float, seed: int, noise: float = 1.0) -> Part:
    rng = np.random.default_rng(seed)
    return recognise_part(view_of(body, pose(np.array(direction), roll), rng, noise), taught())


def named_or_silent(part: Part, label: str) -> bool:
    """Right where two facets or more are in view; a lone facet must be left unnamed."""
    return part.recognition.label == (label if len(part.facets) > 1 else "unknown")


def test_the_six_views_make_six_nodes_and_one_whole_shape_a_part() -> None:
    model = taught()
    assert model.artmap.node_labels == tuple(label for label, _, _ in SIX_VIEWS)
    assert {name: len(m.solid.facets) for name, m in model.metric.items()} == {
        "cube": 3,
        "pyramid": 5,
        "triangular_prism": 3,
        "pentagonal_prism": 4,
    }
    assert all(len(m.joined) == sum(v.label == n for v in model.views) for n, m in model.metric.items())


@settings(max_examples=40, deadline=None)
@given(st.sampled_from(sorted(KNOWN)), directions, st.floats(-3, 3), seeds)
def test_a_taught_part_keeps_its_name_under_any_rigid_motion(
    label: str, direction: tuple[float, ...], roll: float, seed: int
) -> None:
    part = look(KNOWN[label], direction, roll, seed)
    assert named_or_silent(part, label), part.recognition.reason


@settings(max_examples=20, deadline=None)
@given(st.sampled_from(sorted(KNOWN | STRANGERS)), directions, st.floats(-3, 3), seeds)
def test_what_stands_leaves_a_share_to_what_was_not_taught_and_a_name_has_the_sum_of_its_poses(
    label: str, direction: tuple[float, ...], roll: float, seed: int
) -> None:
    seen = view_of({**KNOWN, **STRANGERS}[label], pose(np.array(direction), roll), np.random.default_rng(seed))
    found, told = candidate_poses(seen, taught()), recognise_part(seen, taught()).recognition
    shares = [one.probability for one in found]
    assert shares == sorted(shares, reverse=True)
    assert 0 <= sum(shares) < 1 + 1e-9
    if told.label != "unknown":
        assert sum(one.probability for one in found if one.label == told.label) == pytest.approx(told.confidence)
    for one in found:
        there = frames.apply(one.pose, taught().metric[one.label].solid.centres_mm[list(one.facets)])
        middles = np.array([f.corners_mm.mean(axis=0) for f in seen.facets])
        assert np.linalg.norm(there - middles, axis=1).max() < 8.0, "each seen facet lies where the taught one does"


@settings(max_examples=40, deadline=None)
@given(st.sampled_from(sorted(STRANGERS)), directions, st.floats(-3, 3), seeds)
def test_a_part_never_taught_is_never_named(label: str, direction: tuple[float, ...], roll: float, seed: int) -> None:
    part = look(STRANGERS[label], direction, roll, seed)
    assert part.recognition.label == "unknown", part.recognition.reason


@settings(max_examples=20, deadline=None)
@given(st.sampled_from(sorted(KNOWN)), directions, seeds, st.randoms())
def test_the_order_of_facets_and_where_their_corners_start_change_nothing(
    label: str, direction: tuple[float, ...], seed: int, random: object
) -> None:
    rng = np.random.default_rng(seed)
    group = view_of(KNOWN[label], pose(np.array(direction), 0.4), rng)
    order = rng.permutation(len(group.facets))
    turned = tuple(rolled(group.facets[k], int(rng.integers(5))) for k in order)
    shuffled = merge_vertices(turned)
    one, other = recognise_part(group, taught()), recognise_part(shuffled, taught())
    assert one.recognition.label == other.recognition.label
    assert one.recognition.match_ratio == other.recognition.match_ratio
    assert one.recognition.activation == pytest.approx(other.recognition.activation, abs=1e-12)


def rolled(facet: Facet, by: int) -> Facet:
    turned: dict[str, Any] = {
        name: np.roll(getattr(facet, name), by, axis=0)
        for name in ("corners_mm", "covariance_mm2", "left_px", "right_px", "epipolar_px")
    }
    return replace(facet, **turned)


def test_two_rectangles_of_a_triangular_prism_are_not_a_pentagonal_prism() -> None:
    for seed in range(20):
        part = look(TRIANGULAR, (1.0, 0.0, 0.0) if seed % 2 else (-0.5, 0.87, 0.0), 0.2 * seed, seed)
        assert len(part.facets) == 2
        assert part.recognition.label == "triangular_prism"
        assert part.recognition.runner_up is None, "their dihedral angle is another: it is not even recalled"
        assert part.recognition.match_ratio == pytest.approx(2 / 3)


def test_a_part_that_fell_into_two_groups_with_one_name_is_one_part() -> None:
    whole = view_of(PENTAGONAL, pose(np.array([0.81, 0.59, 0.6]), 0.4), np.random.default_rng(1))
    assert sorted(len(f.corners_mm) for f in whole.facets) == [4, 4, 4, 5]
    cuts = 0
    for one in combinations(range(4), 2):
        halves = [merge_vertices(tuple(whole.facets[k] for k in half)) for half in (one, set(range(4)) - set(one))]
        if all(recognise_part(half, taught()).recognition.label == "pentagonal_prism" for half in halves):
            cuts += 1
            (found,) = recognise_groups(halves, taught())
            assert (found.label, len(found.part.facets)) == ("pentagonal_prism", 4)
    assert cuts >= 2


def test_two_like_parts_that_lie_edge_to_edge_stay_two() -> None:
    at = pose(np.array([0.5, 0.4, 1.0]), 0.2)
    beside = at @ frames.rigid(np.eye(3), np.array([0.0, 50.0, 0.0]))
    groups = tuple(view_of(CUBE, place, np.random.default_rng(k)) for k, place in enumerate((at, beside)))
    assert [r.label for r in recognise_groups(groups, taught())] == ["cube", "cube"]


def test_a_lone_square_is_said_to_fit_cube_and_pyramid() -> None:
    part = look(PYRAMID, (0.02, 0.01, -1.0), 0.5, 1)
    assert len(part.facets) == 1
    assert part.recognition.label == "unknown"
    assert part.recognition.ambiguous
    assert set(part.recognition.candidates) == {"cube", "pyramid"}


def test_a_partial_view_has_a_lower_match_ratio_than_a_whole_one() -> None:
    whole, partial = look(CUBE, (1.0, 0.1, 0.8), 0.1, 1), look(CUBE, (0.7, 0.7, 1.0), 0.1, 1)
    assert whole.recognition.match_ratio == 1.0
    assert partial.recognition.match_ratio == pytest.approx(2 / 3)
    assert partial.recognition.activation < whole.recognition.activation


def test_the_mirror_image_of_a_handed_part_is_refused() -> None:
    handed = Body(
        np.array([[0.0, 0, 0], [60, 0, 0], [0, 40, 0], [0, 0, 25], [0, 0, 0]])[:4],
        ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)),
    )
    model = learn_view(taught(), view_of(handed, pose(np.array([-0.5, -0.6, -0.4]), 0.0)), "corner piece")
    rng = np.random.default_rng(0)
    same = recognise_part(view_of(handed, pose(np.array([-0.4, -0.5, -0.6]), 1.0), rng), model)
    mirrored = recognise_part(view_of(handed.mirrored(), pose(np.array([0.4, -0.5, -0.6]), 1.0), rng), model)
    assert same.recognition.label == "corner piece"
    assert mirrored.recognition.label == "unknown"


@settings(max_examples=15, deadline=None)
@given(st.sampled_from(sorted(KNOWN)), directions, st.floats(-3, 3), seeds)
def test_the_pose_puts_taught_corners_on_true_ones_within_its_covariance(
    label: str, direction: tuple[float, ...], roll: float, seed: int
) -> None:
    true_pose = pose(np.array(direction), roll)
    part = look(KNOWN[label], direction, roll, seed)
    if part.recognition.label == "unknown":
        return
    known = frames.apply(part.cyclopean_from_part, taught().metric[label].solid.corners_mm)
    true = frames.apply(true_pose, KNOWN[label].corners_mm)
    apart = np.linalg.norm(known[:, None] - true[None], axis=2).min(1)
    assert apart.max() < 2.5
    predicted = np.sqrt(np.trace(part.covariance[:3, :3]))
    assert predicted < 1.5


def test_corners_of_a_recognised_part_are_nearer_the_truth_than_the_measured_ones() -> None:
    raw, fitted = [], []
    for seed in range(40):
        rng = np.random.default_rng(seed)
        where = pose(rng.normal(size=3), float(rng.uniform(-3, 3)))
        body = list(KNOWN.values())[seed % 4]
        part = recognise_part(view_of(body, where, rng), taught())
        if part.recognition.label != "unknown":
            true = frames.apply(where, body.corners_mm)
            for facet, corners in zip(part.facets, part.fitted_mm, strict=True):
                raw += list(np.linalg.norm(facet.corners_mm[:, None] - true, axis=2).min(1))
                fitted += list(np.linalg.norm(corners[:, None] - true, axis=2).min(1))
    assert np.median(fitted) < 0.75 * np.median(raw)


def test_every_pose_that_a_symmetry_allows_is_listed() -> None:
    assert len(look(CUBE, (1.0, 0.1, 0.8), 0.1, 1).equivalents) == 3
    assert len(look(CUBE, (0.7, 0.7, 1.0), 0.1, 1).equivalents) == 6
    assert len(look(PYRAMID, (0.05, 0.03, 1.0), 0.1, 1).equivalents) == 4


def test_what_is_taught_later_leaves_earlier_parts_alone() -> None:
    model = taught()
    hexagonal = STRANGERS["hexagonal_prism"]
    more = learn_view(model, view_of(hexagonal, pose(np.array([0.6, 0.3, 0.5]), 0.0)), "hexagonal_prism")
    rng = np.random.default_rng(5)
    seen = view_of(hexagonal, pose(np.array([0.5, 0.6, 0.6]), 1.0), rng)
    assert recognise_part(seen, more).recognition.label == "hexagonal_prism"
    assert recognise_part(seen, model).recognition.label == "unknown"
    for label, metric in model.metric.items():
        np.testing.assert_array_equal(metric.solid.corners_mm, more.metric[label].solid.corners_mm)


def test_two_facets_of_one_part_in_two_groups_are_put_together() -> None:
    rng = np.random.default_rng(2)
    group = view_of(TRIANGULAR, pose(np.array([1.0, 0.0, 0.0]), 0.4), rng)
    apart = tuple(merge_vertices([f]) for f in group.facets)
    assert [r.label for r in recognise_groups(apart, taught())] == ["triangular_prism"]


def test_a_shadow_beside_a_part_does_not_hide_it() -> None:
    where = pose(np.array([1.0, 0.0, 0.4]), 0.2)
    group = view_of(CUBE, where, np.random.default_rng(6))
    low, high = group.facets[0].corners_mm[0], group.facets[0].corners_mm[1]
    aside = np.array([0.0, 0.0, -1.0]) * 30 + np.cross(high - low, [0.0, 0.0, 1.0]) * 0.3
    shadow = measured(np.stack([high, low, low + aside, high + 0.6 * aside]), None)
    whole = merge_vertices((*group.facets, shadow))
    assert whole.touching[0, -1]
    assert "cube" in [r.label for r in recognise_groups([whole], taught())]
