"""A known part found again by its facets' corners: the same of equal poses, no wild facet, an honest covariance."""

from dataclasses import replace

import numpy as np
import pytest

from daemon import frames
from daemon.vision.geometry import OutlineArc, exact
from daemon.vision.refine.following import Fit, fit_to_facets
from daemon.vision.values import Facet
from tests.fakes.fake_cell import shape_of

POSE = frames.rigid(frames.rotation_from_vector(np.array([2.0, 0.4, 0.3])), np.array([10.0, -20.0, 350.0]))


def facets_of(shape, pose, which, rng, sigma=0.2):
    found = []
    for index in which:
        corners = frames.apply(pose, shape.corners_mm[shape.rings[index]])
        noisy = corners + rng.normal(0, sigma, corners.shape)
        covariance = np.tile(np.eye(3) * sigma**2, (len(corners), 1, 1))
        px = np.zeros((len(corners), 2))
        found.append(Facet(noisy, covariance, px, px, np.zeros(len(corners)), 0.0))
    return found


@pytest.mark.parametrize("label", ["cube", "pyramid", "triangular_prism", "pentagonal_prism"])
def test_a_symmetric_part_keeps_the_pose_it_had_from_look_to_look(label):
    rng = np.random.default_rng(0)
    shape = shape_of(label)
    fit = fit_to_facets(
        shape, facets_of(shape, POSE, (0, 1), rng), frames.perturb(POSE, np.array([3, -2, 3, 0.05, 0.03, -0.05]))
    )
    assert isinstance(fit, Fit)
    motion = frames.difference(fit.cyclopean_from_part, POSE)
    assert np.linalg.norm(motion[:3]) < 1.0
    assert np.linalg.norm(motion[3:]) < 0.03


def test_a_facet_that_is_hardly_known_does_not_lose_the_part():
    rng = np.random.default_rng(1)
    shape = shape_of("triangular_prism")
    good, bad = facets_of(shape, POSE, (0, 2), rng)
    wild = replace(bad, corners_mm=bad.corners_mm + 9.0, covariance_mm2=bad.covariance_mm2 * 1000)
    assert fit_to_facets(shape, [good, wild], POSE) is not None
    assert fit_to_facets(shape, [wild], POSE) is None


def test_nothing_is_found_where_nothing_fits():
    rng = np.random.default_rng(2)
    shape = shape_of("cube")
    facets = facets_of(shape, frames.perturb(POSE, np.array([60.0, 0, 0, 0, 0, 0.4])), (0, 1), rng)
    assert fit_to_facets(shape, facets, POSE) is None
    assert fit_to_facets(shape, [], POSE) is None


def test_the_covariance_of_a_fit_is_the_scatter_of_fits():
    rng = np.random.default_rng(3)
    shape = shape_of("cube")
    fits = [fit_to_facets(shape, facets_of(shape, POSE, (0, 2), rng, 0.3), POSE) for _ in range(200)]
    motions = np.array([frames.difference(f.cyclopean_from_part, POSE) for f in fits if f is not None])
    predicted_sigma = np.sqrt(np.diag(np.mean([f.covariance for f in fits if f is not None], axis=0)))
    ratio = motions.std(axis=0) / predicted_sigma
    assert np.all(ratio > 0.5)
    assert np.all(ratio < 1.3)


def test_chords_of_an_arc_that_begin_elsewhere_along_it_do_not_turn_the_part():
    rng = np.random.default_rng(4)
    shape, elsewhere = half_discs(0.0), half_discs(0.5)
    seen = facets_of(elsewhere, POSE, (0,), rng, 0.05)
    near = frames.perturb(POSE, np.array([1.0, -1.0, 1.0, 0.0, 0.0, 0.02]))
    assert fit_to_facets(shape, seen, near) is None  # the two ends of its flat hold no turn about that
    seen += facets_of(shape, POSE, (2,), rng, 0.05)
    fit = fit_to_facets(shape, seen, near)
    assert fit is not None
    motion = frames.difference(fit.cyclopean_from_part, POSE)
    assert np.linalg.norm(motion[:3]) < 0.3
    assert np.linalg.norm(motion[3:]) < 0.01


def half_discs(begin: float):
    """A half disc of 20 mm, 15 mm high, whose arc has five chords between one begun at `begin` of it and its ends."""
    turns = np.concatenate([[0.0], np.pi * (np.arange(5) + 0.5 + begin / 2) / 5.5, [np.pi]])
    outline = 20.0 * np.column_stack([np.cos(turns), np.sin(turns)])
    count = len(outline)
    corners = np.vstack([np.column_stack([outline, np.full(count, high)]) for high in (15.0, 0.0)])
    flat = (count - 1, 0, count, 2 * count - 1)[::-1]
    solid = exact(corners, [range(count), range(2 * count - 1, count - 1, -1), flat])
    fine = np.linspace(0, np.pi, 48)[:, None]
    arcs = [20.0 * np.hstack([np.cos(fine), np.sin(fine), np.full_like(fine, high / 20.0)]) for high in (15.0, 0.0)]
    return replace(solid, arcs=(OutlineArc(0, arcs[0]), OutlineArc(1, arcs[1][::-1])))
