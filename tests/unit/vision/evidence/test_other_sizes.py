"""Edges that a part of another size shows speak for that size, where the pose alone cannot make up for it."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from daemon.arrays import Array
from daemon.store.library import load_facets
from daemon.teaching.solid_from_mesh import solid_drawn
from daemon.vision.evidence.by_edges import OTHER_RADIUS, OTHER_SIZE
from daemon.vision.evidence.other_sizes import other_radius_nats, other_size_nats
from daemon.vision.geometry import Polyhedron, exact
from daemon.vision.image import open_stereo
from daemon.vision.refine import EdgeObservation, refine_from_pose
from tests.fakes import painted
from tests.fakes.drawn import obj
from tests.fakes.printed import straight_rig
from tests.fakes.solids import Body, pose, prism

WHERE = pose(np.array([-0.5, 0.3, 0.8]), 0.3, 330.0)
TOLERANCE_MM = 0.25


def block(length_mm: float = 60.0, width_mm: float = 45.0, shrunk_mm: float = 0.0) -> Body:
    """Worn: drawn back by so much on every side."""
    low, high = shrunk_mm, np.array([length_mm, width_mm]) - shrunk_mm
    body = prism(np.array([[low, low], [high[0], low], high, [low, high[1]]]), 40.0 - 2 * shrunk_mm)
    return Body(body.corners_mm + np.array([0.0, 0.0, shrunk_mm]), body.facets)


@cache
def nats(shown: Body) -> float:
    """What speaks for another size than the block's, where such a body is shown."""
    images = open_stereo(
        *painted.paint_pair([(shown, WHERE)], np.random.default_rng(3), straight_rig()), straight_rig()
    )
    solid: Polyhedron = exact(block().corners_mm, block().facets)
    fit, edges = refine_from_pose(solid, images, WHERE, TOLERANCE_MM)
    return other_size_nats(solid, fit.cyclopean_from_part, edges, TOLERANCE_MM)


def test_the_taught_size_is_the_likelier_one_where_it_is_shown() -> None:
    assert nats(block()) < 1.0


@pytest.mark.parametrize(("length_mm", "width_mm"), [(63.0, 45.0), (57.0, 45.0), (63.0, 46.0)])
def test_a_size_that_differs_by_three_millimetres_is_told(length_mm: float, width_mm: float) -> None:
    assert nats(block(length_mm, width_mm)) > OTHER_SIZE


def test_a_deviation_within_the_tolerance_is_no_other_size() -> None:
    assert nats(block(60.4, 45.0)) < 2.0


def test_a_worn_part_is_no_other_size() -> None:
    assert nats(block(shrunk_mm=0.4)) < OTHER_SIZE


def test_without_measured_edges_nothing_is_said() -> None:
    solid = exact(block().corners_mm, block().facets)
    assert other_size_nats(solid, WHERE, (), TOLERANCE_MM) == 0.0


RADIUS_MM, HIGH_MM = 12.0, 20.0


def round_ended(radius_mm: float, strips: int = 36) -> Body:
    """A block with a round end about the origin, of that radius, and as wide."""
    turns = np.linspace(-np.pi / 2, np.pi / 2, strips + 1)
    round_ = radius_mm * np.column_stack([np.cos(turns), np.sin(turns)])
    return prism(np.array([[-40.0, radius_mm], [-40.0, -radius_mm], *round_]), HIGH_MM)


@cache
def with_round_end() -> Polyhedron:
    """It, drawn, its centre at the origin."""
    body = round_ended(RADIUS_MM)
    solid = solid_drawn("rounded.obj", obj(body.corners_mm, list(body.facets)), "mm", load_facets())
    middle = solid.circles[solid.circles[:, 3] > 0, :3].mean(0) - [0.0, 0.0, HIGH_MM / 2]
    arcs = tuple(replace(arc, points_mm=arc.points_mm - middle) for arc in solid.arcs)
    return replace(solid, corners_mm=solid.corners_mm - middle, arcs=arcs)


@cache
def measured(shown_mm: float) -> tuple[Array, tuple[EdgeObservation, EdgeObservation]]:
    """The pose (4, 4) and the edges of one of that radius, taken for the one drawn."""
    shown = [(round_ended(shown_mm, strips=120), WHERE)]
    images = open_stereo(*painted.paint_pair(shown, np.random.default_rng(4), straight_rig()), straight_rig())
    fit, edges = refine_from_pose(with_round_end(), images, WHERE, TOLERANCE_MM)
    return fit.cyclopean_from_part, edges


def radius_nats(shown_mm: float, solid: Polyhedron | None = None) -> float:
    """What speaks for another radius than a solid's, by default the one drawn."""
    pose, edges = measured(shown_mm)
    return other_radius_nats(solid or with_round_end(), pose, edges, TOLERANCE_MM)


def test_the_taught_radius_is_the_likelier_one_where_it_is_shown() -> None:
    assert radius_nats(RADIUS_MM) < 0.2


@pytest.mark.parametrize("share", [0.95, 1.05])
def test_a_radius_that_differs_by_a_twentieth_is_told(share: float) -> None:
    assert radius_nats(share * RADIUS_MM) > 1.5 * OTHER_RADIUS


def test_a_radius_within_the_tolerance_is_no_other_one() -> None:
    assert radius_nats(RADIUS_MM + 0.15) < OTHER_RADIUS / 2


def test_a_radius_that_is_taught_roughly_is_told_less_surely() -> None:
    rough = replace(with_round_end(), covariance_mm2=with_round_end().covariance_mm2 + 4.0 * np.eye(3))
    assert radius_nats(1.05 * RADIUS_MM, rough) < 0.6 * radius_nats(1.05 * RADIUS_MM)


def test_a_part_without_arcs_has_no_other_radius() -> None:
    assert radius_nats(1.05 * RADIUS_MM, replace(with_round_end(), arcs=())) == 0.0
