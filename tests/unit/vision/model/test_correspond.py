"""Laying seen facets onto taught ones: the true numbering is always among those found, and a mirror's never."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daemon import frames
from daemon.vision.geometry.polyhedron import Polyhedron, exact
from daemon.vision.model.correspond import Correspondence, correspondences
from daemon.vision.model.symmetry import EXACT_MM, symmetries, turns_onto_themselves
from tests.fakes.solids import CUBE, KNOWN, L_BASE, PENTAGONAL, PYRAMID, TETRAHEDRON, TRIANGULAR, Body, prism

BODIES = {**KNOWN, "tetrahedron": TETRAHEDRON, "l_block": prism(L_BASE, 40.0)}
# A triangle, a square and a pentagon round one corner: seen in a mirror they come in the other order.
HANDED = Body(np.zeros((7, 3)), ((0, 1, 2), (0, 2, 3, 4), (0, 4, 5, 6, 1)))

seeds = st.integers(0, 2**31)


def solid_of(body: Body) -> Polyhedron:
    return exact(body.corners_mm, body.facets)


def view(body: Body, facets: list[int], rng: np.random.Generator) -> tuple[Polyhedron, list[int], dict[int, int]]:
    """Some facets of a body in any order, their rings begun anywhere, their corners numbered anew; the true facet
    behind each, and the true corner behind each."""
    order = [facets[k] for k in rng.permutation(len(facets))]
    corners = sorted({k for f in order for k in body.facets[f]})
    number = dict(zip(corners, rng.permutation(len(corners)).tolist(), strict=True))
    rings = [[number[k] for k in np.roll(body.facets[f], int(rng.integers(9)))] for f in order]
    return exact(np.zeros((len(corners), 3)), rings), order, {n: k for k, n in number.items()}


def connected(body: Body, size: int, rng: np.random.Generator) -> list[int]:
    """So many facets of a body that hang together by shared edges."""
    touching = solid_of(body).touching
    found = [int(rng.integers(len(body.facets)))]
    while len(found) < size:
        near = [int(k) for k in np.flatnonzero(touching[found].any(0)) if k not in found]
        found.append(near[int(rng.integers(len(near)))])
    return found


def is_true(found: Correspondence, facets: list[int], corners: dict[int, int]) -> bool:
    return found.facets == tuple(facets) and all(found.corners[n] == k for n, k in corners.items())


@settings(max_examples=60, deadline=None)
@given(st.sampled_from(sorted(BODIES)), st.integers(1, 5), seeds)
def test_the_true_numbering_of_every_part_of_a_known_solid_is_found(name: str, size: int, seed: int) -> None:
    rng, body = np.random.default_rng(seed), BODIES[name]
    seen, facets, corners = view(body, connected(body, min(size, len(body.facets)), rng), rng)
    found = correspondences(seen, solid_of(body))
    assert any(is_true(c, facets, corners) for c in found)
    assert {c.explained for c in found} == {len(facets)}


@settings(max_examples=40, deadline=None)
@given(st.sampled_from(sorted(BODIES)), st.integers(1, 5), seeds)
def test_every_numbering_keeps_shared_edges_shared_and_corners_apart(name: str, size: int, seed: int) -> None:
    rng, body = np.random.default_rng(seed), BODIES[name]
    seen, _, _ = view(body, connected(body, min(size, len(body.facets)), rng), rng)
    taught = solid_of(body)
    for found in correspondences(seen, taught):
        assert len(set(found.corners.tolist())) == len(found.corners)
        for ring, facet in zip(seen.rings, found.facets, strict=True):
            laid, known = found.corners[ring].tolist(), list(taught.facets[facet])
            assert laid in [known[k:] + known[:k] for k in range(len(known))]


@pytest.mark.parametrize(
    ("body", "turns"), [(CUBE, 24), (PYRAMID, 4), (TRIANGULAR, 6), (PENTAGONAL, 10), (TETRAHEDRON, 12)]
)
def test_a_whole_solid_lies_on_itself_as_often_as_it_can_be_turned(body: Body, turns: int) -> None:
    seen, _, _ = view(body, list(range(len(body.facets))), np.random.default_rng(0))
    assert len(correspondences(seen, solid_of(body))) == turns


@settings(deadline=None)
@given(seeds)
def test_a_mirrored_view_is_laid_nowhere_whole(seed: int) -> None:
    rng = np.random.default_rng(seed)
    seen, _, _ = view(HANDED.mirrored(), [0, 1, 2], rng)
    assert all(c.explained < 3 for c in correspondences(seen, solid_of(HANDED)))
    same, facets, corners = view(HANDED, [0, 1, 2], rng)
    (only,) = correspondences(same, solid_of(HANDED))
    assert is_true(only, facets, corners)


@settings(max_examples=25, deadline=None)
@given(seeds)
def test_facets_beyond_what_was_taught_stay_open(seed: int) -> None:
    rng = np.random.default_rng(seed)
    taught = exact(CUBE.corners_mm, [CUBE.facets[f] for f in (1, 2, 3)])
    seen, facets, corners = view(CUBE, [1, 2, 3, 0], rng)
    found = correspondences(seen, taught, may_add=True)
    wanted = {0: -1, 1: 0, 2: 1, 3: 2}
    true = tuple(wanted[f] for f in facets)
    assert any(c.facets == true and all(c.corners[n] in (k, -1) for n, k in corners.items()) for c in found), (
        "the true numbering with the untaught facet left open"
    )


def test_a_facet_that_no_taught_one_has_the_sides_of_is_never_laid() -> None:
    hexagon = exact(np.zeros((6, 3)), [range(6)])
    assert all(not correspondences(hexagon, solid_of(body)) for body in KNOWN.values())


def test_a_neighbour_with_other_sides_than_the_taught_one_contradicts_the_numbering() -> None:
    square_and_triangle = exact(np.zeros((5, 3)), [(0, 1, 2, 3), (1, 0, 4)])
    assert correspondences(square_and_triangle, solid_of(CUBE), may_add=True) == ()


def test_two_facets_that_share_an_edge_are_never_laid_on_two_that_do_not() -> None:
    seen, _, _ = view(CUBE, [1, 2], np.random.default_rng(1))
    apart = [pair for pair in combinations(range(6), 2) if not solid_of(CUBE).touching[pair]]
    assert {tuple(sorted(c.facets)) for c in correspondences(seen, solid_of(CUBE))}.isdisjoint(apart)


@pytest.mark.parametrize(
    ("body", "count"), [(CUBE, 24), (PYRAMID, 4), (TRIANGULAR, 6), (PENTAGONAL, 10), (BODIES["l_block"], 2)]
)
def test_the_symmetries_of_a_drawn_part_take_its_corners_onto_each_other(body: Body, count: int) -> None:
    solid = solid_of(body)
    every, turns = symmetries(solid)
    assert len(every) == len(turns) == count
    assert every[0].tolist() == list(range(len(body.corners_mm)))
    for corners, turn in zip(every, turns, strict=True):
        assert frames.apply(turn, body.corners_mm[corners]) == pytest.approx(body.corners_mm, abs=1e-6)


def test_a_part_that_was_measured_has_no_symmetry() -> None:
    off = np.random.default_rng(3).normal(0, 0.1, CUBE.corners_mm.shape)
    assert len(symmetries(exact(CUBE.corners_mm + off, CUBE.facets))[0]) == 1


def test_facets_that_do_not_hang_together_have_the_turns_that_take_them_onto_each_other() -> None:
    """A model file may say so; recognising with it was a ValueError."""
    every, turns = symmetries(exact(CUBE.corners_mm, (CUBE.facets[0], CUBE.facets[1])))
    assert len(every) == 8
    assert every[0].tolist() == list(range(8))
    assert turns[0] == pytest.approx(np.eye(4), abs=1e-9)


def test_of_many_solids_each_has_its_own_turns() -> None:
    """Large and small, with as many corners as another or not; each alone has the same."""
    solids = [solid_of(body) for body in (CUBE, PYRAMID, CUBE, TRIANGULAR, PENTAGONAL, BODIES["l_block"])]
    together = turns_onto_themselves(solids, EXACT_MM)
    for solid, turns in zip(solids, together, strict=True):
        alone = symmetries(solid)
        assert np.array_equal(alone.corners, turns.corners)
        assert alone.motions == pytest.approx(turns.motions, abs=1e-12)


def test_what_is_nearly_alike_is_as_far_as_is_asked() -> None:
    off = np.random.default_rng(3).normal(0, 0.1, CUBE.corners_mm.shape)
    (near,) = turns_onto_themselves([exact(CUBE.corners_mm + off, CUBE.facets)], 1.5)
    assert len(near.corners) == 24


def test_a_facet_that_is_not_known_tells_turns_apart() -> None:
    """By its corners alone a cube of three faces turns as a whole one does."""
    known = exact(CUBE.corners_mm, [ring for ring in CUBE.facets if 0 in ring])
    assert len(symmetries(known).corners) == 3
