"""A part that is not quite as taught: its corners give way together in both cameras, its place stays where they
meet."""

from dataclasses import replace

import numpy as np
import pytest

from daemon import frames
from daemon.vision.geometry.polyhedron import exact
from daemon.vision.image.stereo_images import open_stereo
from daemon.vision.refine.edge_adjustment import OF_TOLERANCE, adjust_pose, wear_of
from daemon.vision.refine.edge_pose import locate_by_edges, solved_motion
from tests.fakes.painted import paint_pair
from tests.fakes.rigs import rig
from tests.fakes.solids import CUBE, Body, pose

WHERE = pose(np.array([0.75, 0.25, 0.6]), 0.3, 300.0)
TOLERANCE_MM = 0.25


def fitted(corners_mm):
    """A painted part with these corners, fitted as the taught cube."""
    rng, shape = np.random.default_rng(4), exact(CUBE.corners_mm, CUBE.facets)
    images = open_stereo(*paint_pair([(Body(corners_mm, CUBE.facets), WHERE)], rng), rig())
    located = locate_by_edges(shape, images, WHERE, 3.0)
    assert located is not None
    return shape, located, adjust_pose(shape, located.pose, located.observed, TOLERANCE_MM)


@pytest.mark.parametrize("larger", [0.99, 1.01])
def test_a_part_a_little_larger_or_smaller_than_taught_is_not_taken_for_a_nearer_or_farther_one(larger):
    middle = CUBE.corners_mm.mean(axis=0)
    _, located, found = fitted(middle + larger * (CUBE.corners_mm - middle))
    there = frames.apply(WHERE, middle)
    each_for_itself = frames.perturb(located.pose, solved_motion(located.observed, located.pose, located.pose, 3.0))
    assert abs(frames.apply(found.pose, middle)[2] - there[2]) < 0.6
    assert abs(frames.apply(each_for_itself, middle)[2] - there[2]) > 1.0


def test_a_corner_off_its_taught_place_is_found_where_it_is():
    near = int(np.argmin(frames.apply(WHERE, CUBE.corners_mm)[:, 2]))
    corners = CUBE.corners_mm.copy()
    corners[near] += WHERE[:3, :3].T @ [0.4, 0.0, 0.0]
    shape, _, found = fitted(corners)
    truth = frames.apply(WHERE, corners)[near]
    as_taught = frames.apply(found.pose, shape.corners_mm)[near]
    across = [np.linalg.norm((corner - truth)[:2]) for corner in (found.corners_mm[near], as_taught)]
    assert across[0] < 0.05 < 0.15 < across[1]


def test_the_pose_is_as_near_as_its_covariance_says():
    _, _, found = fitted(CUBE.corners_mm)
    off = frames.difference(found.pose, WHERE)
    assert off @ np.linalg.solve(found.covariance, off) < 16.8  # six numbers, one time in a hundred
    assert np.sqrt(np.trace(found.covariance[:3, :3])) < 0.5


def made_otherwise(located, off_mm):
    """The lines of both cameras as a part has them whose corners are off (K, 3) mm, cyclopean."""
    for seen in located.observed:
        ends = (seen.edges.by_corner * off_mm[seen.edges.ends][:, None]).sum((2, 3))
        yield replace(seen, off=seen.off + ends)


def test_the_pose_of_a_part_that_is_not_quite_as_drawn_is_where_its_own_corners_lie_best():
    """Neither twice in doubt, by all corners going one way and by the pose going it, nor less than it is off."""
    shape, located, drawn = fitted(CUBE.corners_mm)
    slopes = frames.point_motion(shape.corners_mm @ located.pose[:3, :3].T).reshape(-1, 6)
    chi_squares = []
    for seed in range(60):
        off_mm = np.random.default_rng(seed).normal(0, OF_TOLERANCE * TOLERANCE_MM, shape.corners_mm.shape)
        found = adjust_pose(shape, located.pose, list(made_otherwise(located, off_mm)), TOLERANCE_MM)
        true = frames.perturb(drawn.pose, np.linalg.lstsq(slopes, off_mm.ravel(), rcond=None)[0])
        off = frames.difference(found.pose, true)
        chi_squares.append(off @ np.linalg.solve(found.covariance, off))
    assert 0.95 < np.median(chi_squares) < 6.0  # .78 with the corners' common motion in doubt twice


def test_strokes_of_print_beside_the_edges_between_faces_hardly_turn_the_part():
    shape, located, clean = fitted(CUBE.corners_mm)
    beside_print = []
    for seen in located.observed:
        assert seen.sides is not None
        inner = ~seen.edges.outline
        ragged = np.where(inner[:, None, None], 0.19**2 * np.eye(2), seen.sides.covariance)
        sides = replace(seen.sides, covariance=ragged, evidence=np.where(inner, 140.0, seen.sides.evidence))
        beside_print.append(replace(seen, off=seen.off + 2.0 * inner[:, None], sides=sides))
    found = adjust_pose(shape, located.pose, beside_print, TOLERANCE_MM)
    turned = np.degrees(np.linalg.norm(frames.difference(found.pose, clean.pose)[3:]))
    assert turned < 0.18


def drawn_back(observed, by_mm):
    """What is seen of a part whose edges are broken so far."""
    moved = [-by_mm * (o.edges.jacobian[..., :3] @ o.edges.outward[..., None])[..., 0] for o in observed]
    return [replace(seen, off=seen.off + by) for seen, by in zip(observed, moved, strict=True)]


def without_wear(observed):
    return [replace(o, edges=replace(o.edges, outward=np.zeros_like(o.edges.outward))) for o in observed]


def test_a_part_with_broken_edges_is_not_taken_for_one_farther_away():
    shape, located, sharp = fitted(CUBE.corners_mm)
    worn = drawn_back(located.observed, 0.4)
    away = [
        np.linalg.norm(adjust_pose(shape, located.pose, seen, TOLERANCE_MM).pose[:3, 3] - sharp.pose[:3, 3])
        for seen in (worn, without_wear(worn))
    ]
    assert away[0] < 0.05 < 0.15 < away[1]


@pytest.mark.parametrize("by_mm", [0.0, -0.1])
def test_no_edge_grows_and_a_sharp_part_lies_where_its_edges_are(by_mm):
    shape, located, _ = fitted(CUBE.corners_mm)
    seen = drawn_back(located.observed, by_mm)
    with_it, without = (adjust_pose(shape, located.pose, o, TOLERANCE_MM) for o in (seen, without_wear(seen)))
    assert np.linalg.norm(with_it.pose[:3, 3] - without.pose[:3, 3]) < 0.03
    np.testing.assert_allclose(with_it.covariance, without.covariance, rtol=0.3, atol=1e-4)


def test_edges_that_seem_to_have_grown_are_weighed_as_those_of_a_sharp_part():
    shape, located, _ = fitted(CUBE.corners_mm)
    seen = drawn_back(located.observed, -0.3)
    with_it, without = (adjust_pose(shape, located.pose, o, TOLERANCE_MM) for o in (seen, without_wear(seen)))
    np.testing.assert_allclose(with_it.pose, without.pose, atol=1e-6)


def test_wear_is_believed_where_it_is_seen():
    assert wear_of(-0.2, 0.01) == (0.0, 0.0)
    little, much = wear_of(0.05, 0.05**2)[0], wear_of(0.3, 0.05**2)[0]
    assert 0 < little < 0.015 < 0.295 < much < 0.3
    assert wear_of(30.0, 1e-4)[0] == pytest.approx(30.0)


def contradicting(located, rng):
    """The lines of both cameras, some much surer than others, all of them astray by .4 px at either end."""
    for seen in located.observed:
        as_sure = seen.sides.covariance * rng.choice([0.2, 20.0], len(seen.off))[:, None, None]
        off = seen.off + rng.normal(0.0, 0.4, seen.off.shape)
        yield replace(seen, off=off, sides=replace(seen.sides, covariance=as_sure))


def test_of_lines_that_contradict_each_other_the_surest_do_not_have_their_way():
    shape, located, _ = fitted(CUBE.corners_mm)
    off_mm, chi_squares = [], []
    for seed in range(30):
        lines = list(contradicting(located, np.random.default_rng(seed)))
        ways = [None, (located.pose, 1e-3 * np.eye(6))]
        found = [adjust_pose(shape, located.pose, lines, TOLERANCE_MM, way) for way in ways]
        off = [frames.difference(one.pose, WHERE) for one in found]
        off_mm.append([np.linalg.norm(one[:3] + 30.0 * one[3:]) for one in off])
        chi_squares.append(off[1] @ np.linalg.solve(found[1].covariance, off[1]))
    surest, all_doubted = np.mean(off_mm, axis=0)
    assert all_doubted < 0.8 * surest
    assert np.median(chi_squares) < 8.0
    assert np.mean(np.array(chi_squares) < 12.6) > 0.7


def test_an_anchor_holds_a_part_and_makes_it_no_surer():
    shape, located, free = fitted(CUBE.corners_mm)
    aside = frames.perturb(WHERE, np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0]))
    held = adjust_pose(shape, located.pose, located.observed, TOLERANCE_MM, (aside, 1e6 * np.eye(6)))
    assert np.linalg.norm(frames.difference(held.pose, aside)) < 0.05
    assert np.linalg.norm(frames.difference(free.pose, aside)) > 0.7
    assert np.trace(held.covariance) > 0.9 * np.trace(free.covariance)
