"""What the memory proposes of facets: whole views, views by their pairs, open types; and that nothing else does."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daemon.vision.geometry.polyhedron import Polyhedron
from daemon.vision.model import Model, empty_model, relational_view, types_of
from daemon.vision.recognition.fits import Recalled, recall_views
from daemon.vision.recognition.group_recognition import candidate_poses, recognise_part
from daemon.vision.values import Group
from tests.fakes import drawn
from tests.fakes.remembered import LIBRARY, SIX_VIEWS, remembered, shown
from tests.fakes.solids import CUBE, KNOWN, PENTAGONAL, Body, pose, view_of

SHOWN = (SIX_VIEWS[0], ("cube", CUBE, (1.0, 0.7, 0.8)), *SIX_VIEWS[1:])
directions = st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda d: np.linalg.norm(d) > 0.3)
seeds = st.integers(0, 2**31)


@cache
def taught() -> Model:
    return shown(SHOWN)


def asked(group: Group, model: Model, vigilance: float = 0.995) -> tuple[Recalled, ...]:
    return recall_views(group.polyhedron, types_of(group.facets, model.library), model, vigilance)


def body_of(solid: Polyhedron) -> Body:
    return Body(solid.corners_mm - solid.corners_mm.mean(0), solid.facets)


def test_a_view_is_recalled_as_it_was_taught_with_what_lies_behind_each_facet_and_corner() -> None:
    label, body, direction = SHOWN[2]
    group = view_of(body, pose(np.array(direction), 0.9), np.random.default_rng(8))
    first = asked(group, taught())[0]
    assert (first.label, first.node, first.ratio, first.correspondence.explained) == (label, 2, 1.0, 4)
    solid = taught().metric[label].solid
    for ring, facet in zip(group.polyhedron.facets, first.correspondence.facets, strict=True):
        assert {int(first.correspondence.corners[k]) for k in ring} == set(solid.facets[facet])


def test_a_view_of_which_one_taught_view_showed_some_and_another_the_rest_is_recalled_by_its_pairs() -> None:
    group = view_of(PENTAGONAL, pose(np.array([0.81, 0.59, 0.6]), 0.4), np.random.default_rng(1))
    assert sorted(len(f.corners_mm) for f in group.facets) == [4, 4, 4, 5]
    model = taught()
    whole = relational_view(group.polyhedron, types_of(group.facets, LIBRARY), LIBRARY, model.parameters.tolerance_mm)
    assert len(model.artmap.recall(whole, 0.0).node) == 0, "no node knows four facets so joined"
    found = asked(group, model)
    assert {one.label for one in found} == {"pentagonal_prism"}
    assert {one.correspondence.explained for one in found} == {4}
    assert recognise_part(group, model).recognition.label == "pentagonal_prism"


def test_what_explains_more_facets_is_proposed_alone() -> None:
    """A part of which only two of three seen facets were taught is no answer where another knows all three."""
    half = drawn.block(50, 50, 50)
    angle = half.only(half.seams[0])
    group = view_of(CUBE, pose(np.array([1.0, 0.1, 0.8]), 0.2), np.random.default_rng(2))
    both = asked(group, remembered({"cube": half, "angle": angle}))
    assert {(one.label, one.correspondence.explained) for one in both} == {("cube", 3)}
    alone = asked(group, remembered({"angle": angle}))
    assert {(one.label, one.correspondence.explained) for one in alone} == {("angle", 2)}
    assert all(-1 in one.correspondence.facets for one in alone)


@pytest.mark.parametrize(
    ("types", "labels"),
    [(("square", "rectangle"), {"square", "oblong"}), (("square",), {"square"}), (("rectangle",), {"oblong"})],
)
def test_a_facet_whose_type_is_left_open_is_recalled_either_way(types, labels) -> None:
    model = remembered({"square": drawn.block(50, 50, 30), "oblong": drawn.block(54, 50, 30)})
    seen = drawn.block(52, 50, 30)
    face = next(k for k, ring in enumerate(seen.rings) if np.ptp(seen.corners_mm[ring][:, 2]) < 1e-6)
    side = int(np.flatnonzero(seen.touching[face])[0])
    pair = seen.only((face, side))
    unsure = replace(pair, covariance_mm2=np.repeat(0.7**2 * np.eye(3)[None], len(pair.corners_mm), 0))
    found = recall_views(unsure, [types, ("rectangle",)], model, 1.0)
    assert {one.label for one in found} == labels


def cut(sides: tuple[float, float, float], corner: int, by_mm: float = 12.0) -> Polyhedron:
    """A box with one corner cut off."""
    corners, rings = drawn.box(*sides)
    beside = sorted({ring[ring.index(corner) - way] for ring in rings if corner in ring for way in (1, 3)})
    at = {k: len(corners) + n for n, k in enumerate(beside)}
    away = corners[beside] - corners[corner]
    points = corners[corner] + by_mm * away / np.linalg.norm(away, axis=1, keepdims=True)
    found, onward = [], {}
    for ring in rings:
        if corner not in ring:
            found.append(ring)
            continue
        place = ring.index(corner)
        before, after = at[ring[place - 1]], at[ring[(place + 1) % 4]]
        found.append((*ring[:place], before, after, *ring[place + 1 :]))
        onward[after] = before
    first = next(iter(onward))
    found.append((first, onward[first], onward[onward[first]]))
    whole = np.vstack([corners, points])
    kept = [k for k in range(len(whole)) if k != corner]
    return drawn.solid("cut.obj", drawn.obj(whole[kept], [tuple(kept.index(k) for k in ring) for ring in found]))


def test_a_box_is_recalled_at_each_of_its_corners_beside_whatever_shows_the_same_there() -> None:
    """Relations in pairs are the same at a corner of either hand: what follows from two facets says which it is."""
    sides = (40.0, 50.0, 60.0)
    brick = drawn.block(*sides)
    model = remembered({"brick": brick, "cut here": cut(sides, 0), "cut there": cut(sides, 1)})
    rivals = []
    for towards in np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float):
        group = view_of(body_of(brick), pose(towards, 0.3), np.random.default_rng(5))
        assert len(group.facets) == 3
        found = {one.label for one in asked(group, model, 1.0)}
        assert "brick" in found
        rivals.append(tuple(sorted(found - {"brick"})))
        told = recognise_part(group, model).recognition
        assert told.label == "unknown"
        assert set(told.candidates) == found
    assert sorted(rivals) == [("cut here",)] * 4 + [("cut there",)] * 4


@settings(max_examples=12, deadline=None)
@given(st.sampled_from(sorted(KNOWN)), directions, seeds)
def test_without_nodes_nothing_is_recalled_and_nothing_is_named(label, direction, seed) -> None:
    empty = replace(taught(), artmap=empty_model(LIBRARY).artmap)
    group = view_of(KNOWN[label], pose(np.array(direction), 0.4), np.random.default_rng(seed))
    assert asked(group, empty, 0.0) == ()
    assert recognise_part(group, empty).recognition.label == "unknown"


@settings(max_examples=20, deadline=None)
@given(st.sampled_from(sorted(KNOWN)), directions, seeds, st.integers(1, len(KNOWN) - 1))
def test_with_the_labels_of_nodes_permuted_no_name_is_right(label, direction, seed, by) -> None:
    model = taught()
    wrong = replace(model, artmap=replace(model.artmap, counts=np.roll(model.artmap.counts, by, axis=1)))
    assert all(a != b for a, b in zip(model.artmap.node_labels, wrong.artmap.node_labels, strict=True))
    group = view_of(KNOWN[label], pose(np.array(direction), 0.4), np.random.default_rng(seed))
    assert recognise_part(group, wrong).recognition.label != label


def test_what_lies_in_a_nodes_slots_is_told_by_a_view_that_was_joined() -> None:
    model = taught()
    first = replace(model.views[0], sides=(-1,) * len(model.views[0].sides))
    for views in ((first, *model.views), (*model.views, first)):
        np.testing.assert_array_equal(replace(model, views=views).facet_in_slot, model.facet_in_slot)
    lost = replace(model, views=(first, *model.views[1:]))
    assert (lost.facet_in_slot[first.node] == -1).all()
    group = view_of(CUBE, pose(np.array(SHOWN[0][2]), 0.3), np.random.default_rng(1))
    assert all(one.node != first.node for one in asked(group, lost))


def test_the_view_that_is_told_is_the_one_that_was_measured_and_proved() -> None:
    """Of a nut whose sides differ by little many views are recalled, and not the first of them fits best."""
    reach = [30.0, 30.4, 30.8, 31.2, 31.6, 32.0]
    outline = [(r * np.cos(k * np.pi / 3), r * np.sin(k * np.pi / 3)) for k, r in enumerate(reach)]
    nut = drawn.solid("nut.obj", drawn.obj(*drawn.prism(outline, 40)))
    model, named = remembered({"nut": nut}), 0
    for seed, towards in enumerate(np.random.default_rng(7).normal(size=(40, 3))):
        group = view_of(body_of(nut), pose(towards, 0.3), np.random.default_rng(seed))
        told, (best, *_) = recognise_part(group, model).recognition, (*candidate_poses(group, model), None)
        if told.label != "nut":
            continue
        named += 1
        node = int(told.reason.partition("(node ")[2].partition(")")[0]) - 1
        ways = [one for level in (1.0, 0.995) for one in asked(group, model, level) if one.node == node]
        assert best is not None
        assert best.facets in [one.correspondence.facets for one in ways]
        assert told.match_ratio in [one.ratio for one in ways]
    assert named > 20


def test_a_lone_facet_and_facets_that_do_not_hang_together_recall_nothing() -> None:
    group = view_of(CUBE, pose(np.array([1.0, 0.5, 0.8]), 0.2))
    assert asked(group.only([0]), taught(), 0.0) == ()
    opposite = exact_two(CUBE)
    assert recall_views(opposite, [("square",)] * 2, taught(), 0.0) == ()


def exact_two(body: Body) -> Polyhedron:
    """Two facets of a prism that share no edge: its ends."""
    return Polyhedron(body.corners_mm, body.facets[:2], np.zeros((len(body.corners_mm), 3, 3)))
