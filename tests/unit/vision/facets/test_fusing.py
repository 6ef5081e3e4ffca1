"""Looks from several places become one partial polyhedron, and say rightly how well they know it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daemon import frames
from daemon.vision.facets import FusedLooks, LookFacets, fuse, group_of, merge_vertices
from daemon.vision.geometry import Polyhedron, chi_square_tail
from daemon.vision.values import Group
from tests.fakes.chosen import few
from tests.fakes.observed_around import DOUBT, beside_truth, looked_at, place, solid, tour
from tests.fakes.rigs import rig
from tests.fakes.solids import CUBE, L_BASE, PYRAMID, prism

SHARED = DOUBT.shared()
L_PART = solid(prism(L_BASE, 40.0))
SEEDS = st.integers(0, 10_000)


def known(looks: list[LookFacets]) -> FusedLooks:
    fused = fuse(looks, SHARED)
    assert fused is not None
    return fused


def outline_part(rng: np.random.Generator) -> Polyhedron:
    """A convex prism over five to seven corners, or an L-shaped one, of random size."""
    if rng.random() < 0.4:
        return solid(prism(L_BASE * rng.uniform(0.8, 1.3, 2), rng.uniform(25, 60)))
    count = int(rng.integers(3, 7))
    turns = 2 * np.pi * (np.arange(count) + rng.uniform(-0.2, 0.2, count)) / count
    return solid(prism(rng.uniform(28, 45) * np.column_stack([np.cos(turns), np.sin(turns)]), rng.uniform(25, 60)))


def lengths_off(fused: FusedLooks, truth: Polyhedron) -> np.ndarray:
    ends = fused.polyhedron.lines[0]
    nearest, _ = beside_truth(fused.polyhedron.corners_mm, truth)
    seen, true = (np.linalg.norm(p[ends[:, 1]] - p[ends[:, 0]], axis=1) for p in (
        fused.polyhedron.corners_mm, truth.corners_mm[nearest]))  # fmt: skip
    return np.abs(seen - true)


@pytest.mark.parametrize("part", [solid(CUBE), solid(PYRAMID), L_PART], ids=["cube", "pyramid", "l"])
def test_a_tour_knows_every_side_but_the_one_it_lies_on(part: Polyhedron) -> None:
    fused = known(tour(part, 8, np.random.default_rng(1)))
    assert len(fused.polyhedron.facets) == len(part.facets) - 1
    assert fused.connected_facets() == [list(range(len(part.facets) - 1))]
    assert fused.confirmed.sum() >= len(part.facets) - 2
    below = max(
        len(ring) for ring in part.facets if part.corners_mm[list(ring), 2].max() < part.centres_mm[:, 2].mean()
    )
    assert fused.polyhedron.open_edges == below
    assert lengths_off(fused, part).max() < 0.3


@settings(max_examples=5, deadline=None)
@given(SEEDS)
def test_a_tour_of_any_prism_finds_its_sides_with_corners_where_they_are(seed: int) -> None:
    rng = np.random.default_rng(seed)
    part = outline_part(rng)
    fused = known(tour(part, 8, rng))
    nearest, off = beside_truth(fused.polyhedron.corners_mm, part)
    assert len(set(nearest.tolist())) == len(nearest)
    true = {frozenset(ring) for ring in part.facets}
    assert all(frozenset(nearest[ring].tolist()) in true for ring in fused.polyhedron.rings)
    assert np.abs(off).max() < 3.0


def test_the_covariance_of_all_corners_is_that_of_their_errors() -> None:
    tails = []
    for seed in range(15):
        rng = np.random.default_rng(seed)
        part = outline_part(rng)
        fused = known(tour(part, 7, rng))
        _, off = beside_truth(fused.polyhedron.corners_mm, part)
        # What is sure before any look, that facets are plane, is no freedom: count along the covariance's wide axes.
        wide, axes = np.linalg.eigh(fused.covariance_mm2)
        free = wide > 0.01**2
        chi2 = float((((axes.T @ off.ravel())[free] ** 2) / wide[free]).sum())
        tails.append(chi_square_tail(chi2, int(free.sum())))
    assert np.mean(np.array(tails) < 0.01) <= 0.05
    assert 0.35 < np.mean(tails) < 0.75


@settings(max_examples=4, deadline=None)
@given(SEEDS)
def test_one_more_look_never_makes_it_less_sure(seed: int) -> None:
    rng = np.random.default_rng(seed)
    part = solid(CUBE)
    looks = tour(part, 6, rng)
    before, after = known(looks[:3]), known(looks)
    mine, _ = beside_truth(before.polyhedron.corners_mm, part)
    more, _ = beside_truth(after.polyhedron.corners_mm, part)
    for k, corner in enumerate(mine.tolist()):
        (again,) = np.flatnonzero(more == corner)
        was, now = (f.polyhedron.covariance_mm2[n] for f, n in ((before, k), (after, again)))
        assert np.trace(now) < np.trace(was) * max(1.0, after.misfit**2) * 1.05


def test_more_looks_bring_smaller_errors() -> None:
    two, eight = [], []
    for seed in range(5):
        looks = tour(L_PART, 8, np.random.default_rng(seed))
        two.append(np.median(lengths_off(known(looks[::4]), L_PART)))
        eight.append(np.median(lengths_off(known(looks), L_PART)))
    assert np.mean(eight) < 0.7 * np.mean(two)


def test_the_order_of_the_looks_does_not_matter() -> None:
    looks = tour(solid(CUBE), 5, np.random.default_rng(3))
    one, other = known(looks), known(looks[::-1])
    assert len(one.polyhedron.facets) == len(other.polyhedron.facets)
    _, off = beside_truth(one.polyhedron.corners_mm, other.polyhedron)
    assert np.abs(off).max() < 0.02


def test_the_hand_eye_error_shows_from_several_sides() -> None:
    error = np.array([0.6, -0.5, 0.4, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    rng = np.random.default_rng(5)
    part = solid(CUBE)
    places = [place(turn, 0.7) for turn in np.arange(6) * np.pi / 3]
    looks = [looked_at(part, at, rng, error, noise=0.2) for at in places]
    assert lengths_off(known(looks), part).max() < 0.1


def test_a_part_of_a_facet_hidden_in_one_look_is_known_from_the_others() -> None:
    part = solid(CUBE)
    looks = tour(part, 6, np.random.default_rng(7))
    (group,) = looks[0].groups
    facet = group.facets[0]
    cut = facet.corners_mm.copy()
    cut[1] += 0.5 * (cut[0] - cut[1])
    cut[2] += 0.5 * (cut[3] - cut[2])
    rest = replace(facet, corners_mm=cut)
    numbers = max(max(ring) for ring in group.rings) + 1
    rings = ((group.rings[0][0], numbers, numbers + 1, group.rings[0][3]), *group.rings[1:])
    fused = known([replace(looks[0], groups=(Group((rest, *group.facets[1:]), rings),)), *looks[1:]])
    assert len(fused.polyhedron.facets) == 5
    assert fused.confirmed.all()
    assert 0.4 < fused.hidden[0][fused.seen[0]].max() < 0.6
    assert lengths_off(fused, part).max() < 0.3


def test_what_one_look_alone_saw_is_not_confirmed() -> None:
    rng = np.random.default_rng(8)
    fused = known([looked_at(solid(CUBE), place(0.4, 0.6), rng, np.zeros(9))])
    assert len(fused.polyhedron.facets) == 3
    assert not fused.confirmed.any()
    assert fused.seen.all()


@pytest.mark.parametrize("seed", few(range(6), 3))
def test_a_facet_that_one_look_put_together_wrongly_spoils_none(seed: int) -> None:
    looks = tour(solid(CUBE), 8, np.random.default_rng(seed))
    (group,) = looks[0].groups
    turned = group.polyhedron.normals @ looks[0].base_from_cyclopean[2, :3]
    top = int(np.argmax(turned))
    facet = group.facets[top]
    a, b, c, d = facet.corners_mm
    wrong = np.array([a, b, b + 1.1 * (c - b), a + 1.1 * (d - a)]) + np.outer([0, 0, 7.0, 7.0], [0.0, 0.0, 1.0])
    others = [one for k, one in enumerate(group.facets) if k != top]
    bad = merge_vertices([replace(facet, corners_mm=wrong)]), *([merge_vertices(others)] if others else [])
    fused = known([replace(looks[0], groups=tuple(bad)), *looks[1:]])
    kept = fused.only(np.flatnonzero(fused.confirmed).tolist())
    assert len(kept.polyhedron.facets) == 5
    assert lengths_off(kept, solid(CUBE)).max() < 0.3


def test_nothing_measured_is_nothing_known() -> None:
    assert fuse([], SHARED) is None
    assert fuse([LookFacets((), np.eye(4), DOUBT.arm(), 800.0, 60.0)], SHARED) is None


def test_two_things_in_view_stay_two() -> None:
    one, other = solid(CUBE), solid(PYRAMID)
    aside = replace(other, corners_mm=other.corners_mm + np.array([120.0, 0.0, 0.0]))
    rng = np.random.default_rng(9)
    looks = []
    for turn in np.arange(4) * np.pi / 2:
        at = place(turn, 0.8)
        a, b = (looked_at(part, at, rng, np.zeros(9)) for part in (one, aside))
        looks.append(replace(a, groups=a.groups + b.groups, covariance=DOUBT.arm()))
    fused = known(looks)
    assert sorted(len(members) for members in fused.connected_facets()) == [4, 5]
    cube = fused.only(max(fused.connected_facets(), key=len))
    assert len(cube.polyhedron.corners_mm) == 8
    assert cube.covariance_mm2.shape == (24, 24)
    assert cube.seen.shape == (4, 5)


def test_a_group_for_the_recogniser_has_the_corners_shared() -> None:
    fused = known(tour(solid(CUBE), 6, np.random.default_rng(2)))
    cyclopean_from_base = frames.inverse(fused.base_from_cyclopean[-1])
    group = group_of(fused, range(5), cyclopean_from_base, rig())
    assert len(group.polyhedron.corners_mm) == 8
    assert group.touching.sum() == 2 * 8
    back = frames.apply(fused.base_from_cyclopean[-1], group.polyhedron.corners_mm)
    assert np.linalg.norm(back[:, None] - fused.polyhedron.corners_mm, axis=2).min(1).max() < 1e-6
