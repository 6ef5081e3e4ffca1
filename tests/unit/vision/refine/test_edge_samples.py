"""Stretches of edges draw a near pose to where the part is, and say how much more speaks for it than chance."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from daemon import frames
from daemon.arrays import Array
from daemon.vision.geometry import exact
from daemon.vision.geometry.polyhedron import SolidBatch
from daemon.vision.image.stereo_images import StereoImages, open_stereo
from daemon.vision.refine.edge_samples import EdgeEvidence, aligned_to_edges, edge_samples_of
from tests.fakes.printed import print_pair, straight_rig
from tests.fakes.solids import KNOWN, pose

WHERE = pose(np.array([0.75, 0.35, 0.6]), 0.3, 330.0)
TOLERANCE_MM = 0.25


@cache
def images_of(name: str | None) -> StereoImages:
    return open_stereo(*print_pair(None if name is None else KNOWN[name], WHERE, 3), straight_rig())


def shape(name: str):
    return exact(KNOWN[name].corners_mm, KNOWN[name].facets)


def moved(motion: list[float]) -> Array:
    return frames.perturb(WHERE, np.array(motion))


def said(name: str, where: Array, images: StereoImages) -> EdgeEvidence:
    return EdgeEvidence.of(edge_samples_of(SolidBatch.of([shape(name)]), images, where[None], TOLERANCE_MM))


@pytest.mark.parametrize("name", sorted(KNOWN))
def test_near_poses_settle_where_the_part_is(name: str) -> None:
    solid, rng = shape(name), np.random.default_rng(4)
    scale = [0.8, 0.8, 2.0, *[np.radians(1.0)] * 3]
    near = np.stack([moved((rng.normal(size=6) * scale).tolist()) for _ in range(8)])
    found = aligned_to_edges(SolidBatch.of([solid] * 8), images_of(name), near, TOLERANCE_MM)
    corners = frames.apply(WHERE, solid.corners_mm)
    before, after = (
        np.array([np.linalg.norm(frames.apply(p, solid.corners_mm) - corners, axis=1).max() for p in poses])
        for poses in (near, found)
    )
    assert np.median(after) < 1.0
    assert np.median(after) < 0.3 * np.median(before)


@pytest.mark.parametrize("name", sorted(KNOWN))
def test_much_speaks_for_a_part_where_it_is_and_little_elsewhere(name: str) -> None:
    here = said(name, WHERE, images_of(name))
    assert here.fraction > 0.7
    for motion in ([6.0, 0, 0, 0, 0, 0], [0, 6.0, 0, 0, 0, 0], [0, 0, 0, 0, 0, 0.2]):
        there = said(name, moved(motion), images_of(name))
        assert there.nats < 0.5 * here.nats
        assert there.fraction < 0.5


def test_a_patterned_table_says_no_more_than_chance() -> None:
    rng = np.random.default_rng(5)
    places = [moved((rng.normal(size=6) * [20.0, 20.0, 20.0, 0.5, 0.5, 0.5]).tolist()) for _ in range(20)]
    assert max(said("cube", where, images_of(None)).fraction for where in places) < 0.1


def test_what_one_says_does_not_hang_on_what_is_laid_beside_it() -> None:
    solids = [shape("cube"), shape("pyramid")]
    laid = SolidBatch.of(solids)
    both = edge_samples_of(laid, images_of("cube"), np.stack([WHERE, WHERE]), TOLERANCE_MM)
    for k, name in enumerate(("cube", "pyramid")):
        assert EdgeEvidence.of([seen.only(k, laid) for seen in both]) == pytest.approx(
            said(name, WHERE, images_of("cube"))
        )


def test_edges_that_show_are_told_from_those_that_do_not() -> None:
    laid = SolidBatch.of([shape("cube")])
    on, off = (
        np.concatenate([seen.shows for seen in edge_samples_of(laid, images_of("cube"), where[None], TOLERANCE_MM)])
        for where in (WHERE, moved([0, 0, 0, 0.1, 0.1, 0.15]))
    )
    assert on.mean() > 0.8
    assert off.mean() < 0.5


def test_a_part_outside_the_images_stays_where_it_was_thought_and_has_no_evidence() -> None:
    away = moved([900.0, 0, 0, 0, 0, 0])
    assert np.array_equal(
        aligned_to_edges(SolidBatch.of([shape("cube")]), images_of("cube"), away[None], TOLERANCE_MM)[0], away
    )
    assert said("cube", away, images_of("cube")) == (0.0, 0.0)
