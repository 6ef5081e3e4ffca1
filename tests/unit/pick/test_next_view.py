"""The next best view: what a look is expected to settle, and where hypotheses look the same."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import chdtri

from daemon import frames
from daemon.arrays import Array
from daemon.pick import find
from daemon.pick.planning.next_view import (
    CLOSE_MM,
    IN_TABLE_MM,
    SAME_FACET_TAIL,
    PartHypothesis,
    distinct_hypotheses,
    entropy,
    expected_entropy,
    farthest_viewpoint,
    hypotheses_in_words,
    hypotheses_of,
    next_best,
    ranked_gains,
    viewpoints_round,
    visible_facets,
    without_seen_facets,
)
from daemon.vision.geometry import Polyhedron, corner_covariance, exact
from daemon.vision.geometry.facet_measures import area_vector
from daemon.vision.values import UNKNOWN
from tests.fakes import drawn
from tests.fakes.fake_cell import ON_HAND, TOOL_FROM_CYCLOPEAN, rig
from tests.fakes.solids import CUBE, pose, view_of

AT = np.array([520.0, 0.0, -280.0])


def block(bevelled: bool = False) -> Polyhedron:
    """60 x 40 x 30 mm about its middle; bevelled: an edge on the side of +y is cut off."""
    outline = (
        [(0.0, 0.0), (60, 0), (60, 40), (15, 40), (0, 25)] if bevelled else [(0.0, 0.0), (60, 0), (60, 40), (0, 40)]
    )
    corners, rings = drawn.prism(outline, 30)
    return exact(corners - [30.0, 20.0, 15.0], rings)


def turned(angle: float) -> Array:
    return frames.rigid(frames.rotation_from_vector(np.array([0.0, 0.0, angle])), AT)


def hypothesis(
    label: str, solid: Polyhedron, pose: Array, share: float, seen: tuple[int, ...] = (2,)
) -> PartHypothesis:
    """The seen facets are the solid's of these numbers."""
    return PartHypothesis(label, solid, pose, np.diag([0.01] * 3 + [1e-6] * 3), seen, share)


def stranger(of: Polyhedron, pose: Array, share: float, seen: tuple[int, ...] = (2,)) -> PartHypothesis:
    corners = frames.apply(pose, of.corners_mm)
    rings = [of.facets[k] for k in seen]
    used = sorted({c for ring in rings for c in ring})
    flat = exact(corners[used], [[used.index(c) for c in ring] for ring in rings])
    return PartHypothesis(UNKNOWN, flat, np.eye(4), np.zeros((6, 6)), tuple(range(len(seen))), share)


def camera(heading_deg: float, up_deg: float = 45.0) -> Array:
    h, u = np.radians([heading_deg, up_deg])
    return AT + 340.0 * np.array([np.cos(u) * np.cos(h), np.cos(u) * np.sin(h), np.sin(u)])


TWINS = (
    hypothesis("block", block(), turned(0), 0.5),
    hypothesis("bevelled", block(True), turned(0), 0.5),
    stranger(block(), turned(0), 0.0),
)
"""Seen: the side to -y, which both have."""

chances = st.lists(st.floats(0.001, 1.0), min_size=2, max_size=6)


@given(chances, st.integers(1, 10), st.randoms(use_true_random=False))
@settings(max_examples=200, deadline=None)
def test_a_look_is_never_expected_to_leave_more_open_than_before(weights, facets, random) -> None:
    share = np.array(weights) / sum(weights)
    shows = np.array([[random.choice((0.0, random.random(), 1.0)) for _ in range(facets)] for _ in share])
    after = expected_entropy(share, shows)
    assert -1e-9 <= after <= entropy(share) + 1e-9


@given(chances, st.lists(st.floats(0, 1), min_size=1, max_size=12))
@settings(max_examples=100, deadline=None)
def test_a_place_from_which_all_look_the_same_gains_nothing(weights, row) -> None:
    share = np.array(weights) / sum(weights)
    shows = np.tile(row, (len(share), 1))
    assert expected_entropy(share, shows) == pytest.approx(entropy(share), abs=1e-9)


def test_a_facet_that_only_one_of_two_shows_and_is_always_found_settles_all() -> None:
    assert expected_entropy(np.array([0.5, 0.5]), np.array([[1.0], [0.0]])) == pytest.approx(0.0, abs=1e-9)
    assert expected_entropy(np.array([0.5, 0.5]), np.array([[0.5], [0.0]])) == pytest.approx(0.75 * 0.9183, abs=1e-4)


def test_symmetric_poses_of_one_part_count_once_and_those_of_two_parts_do_not() -> None:
    half = frames.rigid(frames.rotation_from_vector(np.array([0.0, 0.0, np.pi])), np.zeros(3))
    both = hypothesis("block", block(), turned(0) @ half, 0.3, seen=(4,))
    look = distinct_hypotheses(
        [hypothesis("block", block(), turned(0), 0.3), both, stranger(block(), turned(0), 0.4)], rig()
    )
    assert [h.label for h in look.hypotheses] == [UNKNOWN, "block"]
    assert look.chances == pytest.approx([0.4, 0.6])
    other = hypothesis("another", block(), turned(0), 0.3)
    assert (
        len(distinct_hypotheses([hypothesis("block", block(), turned(0), 0.3), other, TWINS[2]], rig()).hypotheses) == 3
    )


def test_facets_about_one_middle_are_one_only_where_their_corners_are() -> None:
    """Tops: a square, as it lies; turned by a quarter, which changes nothing; by an eighth; and a triangle."""
    square, triangle = [(-20.0, -20), (20, -20), (20, 20), (-20, 20)], [(0.0, 20), (-20.0, -10), (20, -10)]
    towers = [exact(*drawn.prism(outline, 30)) for outline in (square, triangle)]
    lies = [(towers[0], 0.0), (towers[0], np.pi / 2), (towers[0], np.pi / 4), (towers[1], 0.0)]
    some = [hypothesis(str(k), tower, turned(angle), 0.2, seen=()) for k, (tower, angle) in enumerate(lies)]
    look = distinct_hypotheses([*some, stranger(towers[0], turned(0), 0.2, seen=(0,))], rig())
    by_label = {h.label: (h, own) for h, own in zip(look.hypotheses, look.numbers, strict=True)}
    tops = [next(n for n, up in zip(own, h.solid.normals, strict=True) if up[2] > 0.9)
            for h, own in (by_label[str(k)] for k in range(4))]  # fmt: skip
    assert tops[0] == tops[1]
    assert len(set(tops)) == 3


@pytest.mark.parametrize("doubt_mm", [0.0, 0.4])
@pytest.mark.parametrize(("of_limit", "same"), [(0.98, True), (1.02, False)])
@pytest.mark.parametrize("way", [(0.0, 0.0, 1.0), (0.6, 0.8, 0.0)])
def test_facets_are_one_as_far_apart_as_the_cameras_and_the_doubt_of_both_places_may_set_them(
    doubt_mm: float, of_limit: float, same: bool, way: tuple[float, float, float]
) -> None:
    """Of a facet with four corners all of them count: twelve coordinates, each the difference of two."""
    camera_mm2 = np.diag(corner_covariance(rig(), CLOSE_MM)).mean()
    limit_mm = np.sqrt(chdtri(12, SAME_FACET_TAIL) * 2 * (camera_mm2 + doubt_mm**2) / 4)
    covariance = np.diag([doubt_mm**2] * 3 + [0.0] * 3)
    apart = frames.rigid(np.eye(3), of_limit * limit_mm * np.array(way))
    lies = {"here": turned(0), "there": apart @ turned(0)}
    some = [PartHypothesis(name, block(), pose, covariance, (), 0.4) for name, pose in lies.items()]
    look = distinct_hypotheses([*some, stranger(block(), turned(2.0), 0.2, seen=(0,))], rig())
    here, there = (own for h, own in zip(look.hypotheses, look.numbers, strict=True) if h.label != UNKNOWN)
    assert np.array_equal(here, there) is same
    assert set(here.tolist()).isdisjoint(there.tolist()) is not same


def test_a_look_that_missed_what_all_would_surely_have_shown_speaks_against_none() -> None:
    look = distinct_hypotheses(TWINS, rig())
    count = 1 + max(int(own.max()) for own in look.numbers)
    assert without_seen_facets(look, np.ones((1, len(look.hypotheses), count))).chances == pytest.approx(look.chances)


def test_twins_are_told_apart_from_the_side_on_which_they_differ() -> None:
    look = distinct_hypotheses(TWINS, rig())
    cameras = np.array([camera(-90), camera(0), camera(135)])
    gains = {g.place: g.bits for g in ranked_gains(look, visible_facets(look, AT, cameras), [1.0] * 3)}
    assert gains[2] > 0.8
    assert gains[0] < gains[2], "the tops differ as well, by a corner"
    low = ranked_gains(look, visible_facets(look, AT, np.array([camera(-90, 2.0)])), [1.0])
    assert low[0].bits == pytest.approx(0.0, abs=1e-9)


def test_what_hides_the_side_on_which_twins_differ_makes_a_look_worth_less() -> None:
    look = distinct_hypotheses(TWINS, rig())
    cameras, wall = (
        np.array([camera(135)]),
        AT + np.array([[-80.0, 30, -60], [20, 130, -60], [20, 130, 200], [-80, 30, 200]]),
    )
    free, hidden = (
        ranked_gains(look, visible_facets(look, AT, cameras, beside), [1.0])[0].bits for beside in ((), (wall,))
    )
    assert hidden < free


def test_only_something_not_taught_is_expected_to_show_what_nothing_taught_would() -> None:
    """Otherwise a look that finds a facet that nobody expected would speak for the wrong one of the two."""
    look = distinct_hypotheses((hypothesis("block", block(), turned(0), 0.5), stranger(block(), turned(0), 0.5)), rig())
    strange = [h.label for h in look.hypotheses].index(UNKNOWN)
    (aside,) = visible_facets(look, AT, np.array([camera(135)]))[..., -1]
    assert aside[strange] > 0.5
    assert aside[1 - strange] == 0.0
    (as_before,) = visible_facets(look, AT, np.array([camera(-90, 2.0)]))[..., -1]
    assert (as_before == 0.0).all(), "from there nothing taught would show anything new"


def test_the_same_gain_in_less_time_comes_first() -> None:
    cameras = np.array([camera(135), camera(134)])
    order = next_best(TWINS, rig(), AT, cameras, [5.0, 1.0], np.array([camera(-90)]))
    assert order[0].place == 1


def test_a_look_that_should_have_shown_a_difference_and_did_not_makes_it_less_worth_to_look_again() -> None:
    cameras = np.array([camera(135)])
    unseen = next_best(TWINS, rig(), AT, cameras, [1.0], np.array([camera(-90, 2.0)]))[0].bits
    seen = next_best(TWINS, rig(), AT, cameras, [1.0], np.array([camera(-90, 2.0), camera(135)]))[0].bits
    assert seen < unseen


def test_where_nothing_is_to_be_settled_the_farthest_from_all_looks_comes_first() -> None:
    cameras = np.array([camera(0), camera(90), camera(180)])
    assert farthest_viewpoint(AT, cameras, [camera(10)])[0] == 2
    order = next_best([stranger(block(), turned(0), 1.0)], rig(), AT, cameras, [1.0] * 3, np.array([camera(10)]))
    assert [g.place for g in order] == [2, 1, 0]


def test_places_look_at_the_point_from_all_round() -> None:
    poses = viewpoints_round(AT, ON_HAND)
    seen = [frames.apply(frames.inverse(p @ TOOL_FROM_CYCLOPEAN), AT) for p in poses]
    assert np.allclose(seen, [0, 0, 340.0], atol=1e-6)
    assert len(poses) == 48


def test_what_it_may_be_is_told_by_label_the_likeliest_first() -> None:
    some = [hypothesis("a", block(), turned(0), 0.1), hypothesis("b", block(), turned(0), 0.5)]
    some += [hypothesis("a", block(), turned(1), 0.2), stranger(block(), turned(0), 0.2)]
    assert hypotheses_in_words(some) == "b 50 %, a 30 %, not taught 20 %"


class Standing:
    """A recogniser that lets stand what it is asked about as many facets for."""

    def __init__(self, **by_count: list[tuple[str, Array, float]]) -> None:
        self.by_count = by_count

    def shape(self, label: str) -> Polyhedron | None:
        return None if label == "forgotten" else block()

    def candidate_poses(self, group: Any) -> list[Any]:
        return [
            SimpleNamespace(label=label, pose=pose, covariance=np.eye(6), facets=(0,), probability=share)
            for label, pose, share in self.by_count.get("of_1" if len(group.facets) == 1 else "all_of_it", [])
        ]


def observed(height_mm: float = 0.0) -> Any:
    """Facets of a cube, in a look from the world's origin."""
    return SimpleNamespace(
        facets=view_of(CUBE, pose(np.array([1.0, 1.0, 1.0]), 0.3)).facets,
        look=SimpleNamespace(world_from_cyclopean=frames.rigid(np.eye(3), np.array([0.0, 0.0, height_mm]))),
    )


FLAT, SUNK = (frames.rigid(np.eye(3), np.array([0.0, 0.0, z])) for z in (15.0, 14.9 - IN_TABLE_MM))


def test_what_a_part_may_be_is_what_recognition_and_the_table_let_stand_and_something_not_taught() -> None:
    part, allowed = observed(), [("block", FLAT, 0.5), ("block", SUNK, 0.2), ("forgotten", FLAT, 0.1)]
    found = hypotheses_of(part, cast("Any", Standing(all_of_it=allowed)), 0.0)
    assert [(h.label, round(h.probability, 6)) for h in found] == [("block", 0.625), (UNKNOWN, 0.375)]
    found = hypotheses_of(part, cast("Any", Standing(all_of_it=allowed)), None)
    assert [(h.label, round(h.probability, 6)) for h in found] == [("block", 0.5), ("block", 0.2), (UNKNOWN, 0.3)]
    raised = hypotheses_of(observed(100.0), cast("Any", Standing(all_of_it=allowed[1:2])), 0.0)
    assert raised[0].world_from_part[2, 3] == pytest.approx(SUNK[2, 3] + 100.0)


def test_where_nothing_explains_all_facets_the_largest_that_is_explained_counts_and_else_it_is_not_taught() -> None:
    part = observed()
    found = hypotheses_of(part, cast("Any", Standing(of_1=[("block", FLAT, 0.6)])), 0.0)
    assert [(h.label, round(h.probability, 6)) for h in found] == [("block", 0.6), (UNKNOWN, 0.4)]
    areas = [float(np.linalg.norm(area_vector(f.corners_mm))) for f in part.facets]
    seen = found[-1].solid
    largest = float(np.linalg.norm(area_vector(seen.corners_mm[list(seen.facets[0])])))
    assert largest == pytest.approx(max(areas))
    assert len(seen.facets) == 1
    found = hypotheses_of(part, cast("Any", Standing(of_1=[("block", SUNK, 0.6)])), 0.0)
    assert [(h.label, h.probability) for h in found] == [(UNKNOWN, 1.0)]
    assert len(found[0].solid.facets) == len(part.facets)


def test_how_much_is_open_of_a_part_is_what_its_likely_poses_leave_undecided() -> None:
    """Two that are as likely as each other are one bit, and one alone nothing."""
    assert find.entropy_bits(TWINS[:2], rig()) == pytest.approx(1.0, abs=1e-6)
    assert find.entropy_bits(TWINS[:1], rig()) == pytest.approx(0.0, abs=1e-6)
