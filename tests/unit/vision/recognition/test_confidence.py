"""How far a fit is believed: by what it says against all that could have fitted as well by chance."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daemon import frames
from daemon.vision.geometry.polyhedron import Polyhedron, exact
from daemon.vision.model.model import Model
from daemon.vision.recognition.confidence import count_correspondences, fits_by_chance, label_probabilities
from daemon.vision.recognition.fits import FacetHypothesis
from tests.fakes.drawn import block, obj, prism, solid
from tests.fakes.remembered import hypotheses, remembered
from tests.fakes.solids import pose

SIGMA_MM = 0.2
RECALLED = 0.9
"""A vigilance that lets all sizes by that are asked for here: how far they are believed is said afterwards."""
AWAY = pose(np.array([0.5, 0.6, 0.7]), 0.3)


def knows(*parts: Polyhedron) -> Model:
    return remembered({f"part {k}": p for k, p in enumerate(parts)})


def view(
    part: Polyhedron, facets: list[int], sigma_mm: float = SIGMA_MM, shift: np.ndarray | None = None
) -> Polyhedron:
    """Some of a part's facets as they would be measured, without error but not known better than that."""
    whole = exact(frames.apply(AWAY, part.corners_mm), [part.facets[f] for f in facets])
    used = sorted({k for ring in whole.facets for k in ring})
    rings = tuple(tuple(used.index(k) for k in ring) for ring in whole.facets)
    corners = whole.corners_mm[used] + (0.0 if shift is None else shift[: len(used)])
    return Polyhedron(corners, rings, np.repeat(sigma_mm**2 * np.eye(3)[None], len(used), 0))


def fits(seen: Polyhedron, model: Model) -> list[FacetHypothesis]:
    return [h for h in hypotheses(seen, model, RECALLED) if h.explained == len(seen.facets)]


BRICK = block(40, 52, 66)
CORNER, PAIR = [0, 2, 4], [0, 2]
"""Facets of a box that meet in a corner, and in an edge."""


@cache
def among_others() -> Model:
    return knows(BRICK, *(block(20 + k, 30 + 2 * k, 90 - k) for k in range(15)))


def chance(seen: Polyhedron, model: Model) -> float:
    return fits_by_chance(seen, fits(seen, model)[0], model)[0]


def test_a_fit_of_well_measured_corners_is_proof() -> None:
    model = knows(BRICK)
    seen = view(BRICK, CORNER)
    assert label_probabilities(seen, fits(seen, model), model)["part 0"] > 0.999


def test_corners_that_are_unsure_fit_anything_and_prove_nothing() -> None:
    model = among_others()
    sure, unsure, blind = (view(BRICK, PAIR, sigma_mm) for sigma_mm in (0.2, 3.0, 12.0))
    told = [label_probabilities(seen, fits(seen, model), model)["part 0"] for seen in (sure, unsure, blind)]
    assert told[0] > 0.999 > told[1] > 0.9 > told[2]
    assert told[2] < 0.5


def test_what_could_have_fitted_by_chance_grows_with_the_parts_that_were_taught() -> None:
    seen = view(BRICK, PAIR, 0.5)
    alone, among = chance(seen, knows(BRICK)), chance(seen, among_others())
    assert among == pytest.approx(16 * alone, rel=0.05)


def test_a_lone_facet_proves_less_than_two_that_share_an_edge() -> None:
    model = knows(BRICK)
    assert chance(view(BRICK, PAIR[:1]), model) > 10 * chance(view(BRICK, PAIR), model)


def test_facets_of_equal_sides_prove_less_than_others() -> None:
    """A cube has one size by which it can be told from other cubes; a brick has three."""
    cube = block(50, 50, 50)
    assert chance(view(cube, CORNER), knows(cube)) > 10 * chance(view(BRICK, CORNER), knows(BRICK))


@settings(deadline=None, max_examples=6)
@given(st.floats(0.2, 3.0), st.floats(0.1, 2.0))
def test_the_worse_the_sizes_fit_the_less_it_is_believed(off_mm: float, more_mm: float) -> None:
    model = knows(BRICK)
    told = []
    for longer in (off_mm, off_mm + more_mm):
        seen = view(block(40 + longer, 52, 66), CORNER)
        told.append(label_probabilities(seen, fits(seen, model), model)["part 0"])
    assert 0 <= told[1] <= told[0] <= 1


def test_two_parts_that_fit_alike_halve_the_belief_in_either() -> None:
    model = knows(BRICK, block(40, 52, 66))
    seen = view(BRICK, CORNER)
    both = label_probabilities(seen, fits(seen, model), model)
    assert both["part 0"] == pytest.approx(0.5, abs=0.01) == both["part 1"]


def test_a_part_that_differs_by_more_than_was_measured_takes_nothing_away() -> None:
    model = knows(BRICK, block(40, 52, 70))
    seen = view(BRICK, CORNER)
    assert label_probabilities(seen, fits(seen, model), model)["part 0"] > 0.999


def test_ways_are_counted_by_the_edge_between_facets_that_is_rarest() -> None:
    wedge = solid("wedge.obj", obj(*prism([(0, 0), (40, 0), (0, 30)], 60)))
    both = knows(BRICK, wedge)
    assert count_correspondences(view(BRICK, PAIR), both.metric) == 2 * 12 + 2 * 3
    triangle = next(k for k, ring in enumerate(wedge.facets) if len(ring) == 3)
    beside = int(np.flatnonzero(wedge.touching[triangle])[0])
    assert count_correspondences(view(wedge, [triangle, beside]), both.metric) == 6
    assert count_correspondences(view(wedge, [triangle]), both.metric) == 2 * 3
