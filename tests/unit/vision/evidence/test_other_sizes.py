"""Edges that a part of another size shows speak for that size, where the pose alone cannot make up for it."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from daemon import frames
from daemon.vision.evidence.by_edges import OTHER_RADIUS, OTHER_SIZE
from daemon.vision.evidence.other_sizes import other_radius_nats, other_size_nats
from daemon.vision.facets import MeasuredCircle
from daemon.vision.geometry import OutlineArc, Polyhedron, exact
from daemon.vision.hypotheses import rims_of
from daemon.vision.image import open_stereo
from daemon.vision.refine import refine_from_pose
from tests.fakes import painted
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


RADIUS_MM = 14.0


@cache
def with_round_ends() -> Polyhedron:
    """A block of whose outline two arcs of one radius are part, on one face."""
    solid = exact(block().corners_mm, block().facets)
    x, y = solid.flat_from_solid[0, :3, :3][:2]
    turns = np.linspace(0, np.pi, 24)[:, None]
    half = RADIUS_MM * (np.cos(turns) * x + np.sin(turns) * y)
    arcs = (OutlineArc(0, solid.centres_mm[0] + half + 12 * y), OutlineArc(0, solid.centres_mm[0] - half - 12 * y))
    return replace(solid, arcs=arcs)


def radius_nats(share: float, *, beside_mm: float = 0.0, seen_from: float = 1.0) -> float:
    """What circles so many times as large, and so far beside its arcs, say against it."""
    spread = np.diag([0.05**2] * 3 + [1e-4] * 2 + [0.05**2])
    circles = [
        MeasuredCircle(
            frames.apply(WHERE, rim.centre_mm[None])[0] + [beside_mm, 0, 0],
            seen_from * WHERE[:3, :3] @ rim.normal,
            share * rim.radius_mm,
            spread,
            None,
            None,
        )
        for rim in rims_of(with_round_ends())
    ]
    return other_radius_nats(with_round_ends(), WHERE, circles, TOLERANCE_MM)


def test_circles_of_the_taught_radius_say_nothing_against_it_and_others_do() -> None:
    assert radius_nats(1.0) < 0.1
    assert radius_nats(1.01) < 1.5
    assert min(radius_nats(0.95), radius_nats(1.05)) > OTHER_RADIUS


def test_a_rim_that_shows_from_behind_says_as_much() -> None:
    assert radius_nats(1.0, seen_from=-1.0) < 0.1
    assert radius_nats(0.95, seen_from=-1.0) == radius_nats(0.95) > OTHER_RADIUS


def test_what_bends_two_circles_alike_counts_once() -> None:
    assert len(rims_of(with_round_ends())) == 2
    assert OTHER_RADIUS < radius_nats(0.95) < 1.5 * OTHER_RADIUS + 4.0


def test_circles_elsewhere_and_bores_about_the_same_axis_say_nothing() -> None:
    assert radius_nats(0.6) == 0.0
    assert radius_nats(1.05, beside_mm=8.0) == 0.0
    assert other_radius_nats(with_round_ends(), WHERE, [], TOLERANCE_MM) == 0.0
