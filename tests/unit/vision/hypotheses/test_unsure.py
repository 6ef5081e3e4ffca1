"""A guess whose corner points elsewhere in depth is turned to where the part's other edges lie."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from daemon import frames
from daemon.arrays import Array
from daemon.vision.geometry import exact
from daemon.vision.geometry.polyhedron import SolidBatch
from daemon.vision.hypotheses.directional_edge_map import edge_distances, evidence
from daemon.vision.hypotheses.junctions import angle, meet, poses_from_junctions
from daemon.vision.hypotheses.pose_batch import PoseBatch
from daemon.vision.hypotheses.search import TILT, TURNS, ScoredPoses, best_turned, perturbed_poses
from daemon.vision.image import join_segments, segment_corners
from daemon.vision.image.stereo_images import StereoImages, open_stereo
from tests.fakes.printed import print_pair, straight_rig
from tests.fakes.solids import KNOWN, pose

WHERE = pose(np.array([0.75, 0.35, 0.6]), 0.3, 330.0)
PYRAMID = exact(KNOWN["pyramid"].corners_mm, KNOWN["pyramid"].facets)


@cache
def images() -> StereoImages:
    return open_stereo(*print_pair(KNOWN["pyramid"], WHERE, 0), straight_rig())


def about(point: Array, way: Array, by: float) -> Array:
    turn = frames.rotation_from_vector(by * way)
    return frames.rigid(turn, point - turn @ point)


def turned_best(guess: Array, hinge: Array) -> Array:
    maps = edge_distances(images().left), edge_distances(images().right)
    posed = PoseBatch(SolidBatch.of((PYRAMID,)), np.zeros(1, np.intp), guess[None])
    nats, _ = evidence(posed, images().geometry, maps)
    found, tries = best_turned(ScoredPoses(posed, -nats), hinge[None], images().geometry, maps)
    assert tries[0] == (1.0 if np.array_equal(found.posed.poses[0], guess) else len(TURNS) + 1)
    return found.posed.poses[0]


@pytest.mark.parametrize("by", [-16.0, 0.0, 8.0, 24.0])
def test_a_guess_is_turned_about_its_hinge_to_where_the_part_is(by: float) -> None:
    corner = frames.apply(WHERE, PYRAMID.corners_mm)[0]
    hinge = np.stack([corner, np.cross(corner, [0.0, 1.0, 0.0]) / np.linalg.norm(np.cross(corner, [0.0, 1.0, 0.0]))])
    found = turned_best(about(hinge[0], hinge[1], np.radians(by)) @ WHERE, hinge)
    assert frames.angle_between(found, WHERE) < np.radians(5.0)
    assert frames.apply(found, PYRAMID.corners_mm[:1])[0] == pytest.approx(corner)


def test_a_guess_that_has_no_hinge_stays_as_it_is() -> None:
    guess = about(WHERE[:3, 3], np.array([1.0, 0.0, 0.0]), 0.1) @ WHERE
    assert turned_best(guess, np.zeros((2, 3))) == pytest.approx(guess)


def test_a_corner_turned_about_its_hinge_looks_the_same_to_the_left_camera() -> None:
    """Both of its edges point where they did; to the right camera elsewhere."""
    left, right = (segment_corners(join_segments(view.segments)) for view in images().views)
    maps, geometry = (edge_distances(images().left), edge_distances(images().right)), images().geometry
    taught = SolidBatch.of((PYRAMID,))
    guessed, hinges, _ = poses_from_junctions(meet(left, right, geometry), geometry, maps, taught)
    by_camera = []
    for guess, hinge in zip(guessed.poses[:40], hinges, strict=False):
        own = int(np.linalg.norm(frames.apply(guess, PYRAMID.corners_mm) - hinge[0], axis=1).argmin())
        ends = [a if b == own else b for a, b in PYRAMID.lines[0].tolist() if own in (a, b)]
        assert frames.apply(guess, PYRAMID.corners_mm[own : own + 1])[0] == pytest.approx(hinge[0])
        poses = guess, about(hinge[0], hinge[1], 0.02) @ guess
        before, after = (geometry.project(frames.apply(p, PYRAMID.corners_mm)) for p in poses)
        by_camera.append(
            [sorted(angle(b[ends] - b[own], a[ends] - a[own]))[1] for b, a in zip(before, after, strict=True)]
        )
    in_left, in_right = np.median(by_camera, axis=0)
    assert in_left < 0.1 * in_right


def test_poses_nearby_leave_the_middle_of_a_part_where_it_is_seen() -> None:
    middle = frames.apply(WHERE, PYRAMID.corners_mm).mean(0)
    found = perturbed_poses(PYRAMID, WHERE)
    there = np.array([frames.apply(one, PYRAMID.corners_mm).mean(0) for one in found])
    assert there / np.linalg.norm(there, axis=1)[:, None] == pytest.approx(
        np.tile(middle / np.linalg.norm(middle), (len(found), 1))
    )
    assert [round(frames.angle_between(one, WHERE) / TILT) for one in found] == [1, 1, 1, 1, 0, 0]
