"""Evidence for a pose: edges on segments of their own direction, weighed by what chance gives in this very picture."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from daemon import frames
from daemon.vision.evidence.photo_consistency import ENOUGH, face_consistency, places_on_face, print_apart_px
from daemon.vision.geometry import exact
from daemon.vision.geometry.polyhedron import SolidBatch
from daemon.vision.hypotheses.directional_edge_map import (
    DirectionalEdgeMap,
    Rays,
    edge_distances,
    evidence,
    promising,
    self_similarity,
)
from daemon.vision.hypotheses.pose_batch import PoseBatch
from daemon.vision.hypotheses.search import ScoredPoses, distinct
from daemon.vision.image.stereo_images import StereoImages, open_stereo
from tests.fakes.printed import print_pair, straight_rig
from tests.fakes.solids import KNOWN, STRANGERS, pose

WHERE = pose(np.array([0.75, 0.35, 0.6]), 0.3, 330.0)


@cache
def images_of(name: str | None, printed: bool = True, patterned: bool = True) -> StereoImages:
    body = None if name is None else {**KNOWN, **STRANGERS}[name]
    return open_stereo(*print_pair(body, WHERE, 3, printed=printed, patterned=patterned), straight_rig())


def shape(name: str):
    body = {**KNOWN, **STRANGERS}[name]
    return exact(body.corners_mm, body.facets)


def maps(images: StereoImages):
    return edge_distances(images.left), edge_distances(images.right)


def posed(solid, poses) -> PoseBatch:
    return PoseBatch(SolidBatch.of((solid,)), np.zeros(len(poses), np.intp), np.asarray(poses))


def seen_edge() -> tuple[int, int]:
    """Two corners of the cube that bound two faces in view."""
    solid = shape("cube")
    faces = np.flatnonzero(solid.facing(WHERE) > 0.3)
    one, other = (set(solid.facets[k]) for k in faces[:2])
    first, second = sorted(one & other)
    return first, second


def often(seen: DirectionalEdgeMap, chance: float) -> DirectionalEdgeMap:
    return replace(seen, chance=np.full_like(seen.chance, chance))


def moved(mm: float, axis: int = 0):
    shift = np.zeros(3)
    shift[axis] = mm
    return frames.rigid(np.eye(3), shift) @ WHERE


@pytest.mark.parametrize("name", sorted(KNOWN))
def test_most_speaks_for_a_part_where_it_is(name: str) -> None:
    images, solid = images_of(name), shape(name)
    poses = np.stack([WHERE, moved(8.0), moved(-8.0, 1), moved(40.0, 2)])
    nats, most = evidence(posed(solid, poses), images.geometry, maps(images))
    assert nats[0] > 2 * max(nats[1:].max(), 0.0)
    assert (nats <= most).all()
    assert nats[0] > 0.7 * most[0]


@pytest.mark.parametrize("name", sorted(KNOWN))
def test_little_speaks_for_a_part_elsewhere_and_nearly_as_much_where_the_picture_repeats_itself(name: str) -> None:
    images, solid = images_of(name, printed=False, patterned=False), shape(name)
    once = images.left.grey
    again = replace(images.left, grey=np.maximum(once, np.roll(once, 60, axis=1)), scales={}, windows={})
    lone, two = (self_similarity(solid, WHERE, images.geometry, edge_distances(view)) for view in (images.left, again))
    assert lone < 0.65
    assert two > 0.75


def test_of_many_poses_a_glance_leaves_those_that_much_speaks_for() -> None:
    images, solid = images_of("cube"), shape("cube")
    seen = maps(images)
    rng = np.random.default_rng(3)
    poses = np.stack([frames.perturb(WHERE, rng.normal(size=6) * ([15.0] * 3 + [0.3] * 3)) for _ in range(300)])
    poses[::50] = WHERE
    nats, _ = evidence(posed(solid, poses), images.geometry, seen)
    left, by_glance = promising(posed(solid, poses), images.geometry, seen)
    assert len(left) < 150
    assert nats[left].tolist().count(nats.max()) == 6
    assert (nats[left] > 180).sum() > 0.9 * (nats > 180).sum()
    assert set(range(0, 300, 50)) <= set(left[by_glance > 0.9 * by_glance.max()])


def test_solids_of_other_shapes_beside_it_leave_a_part_what_speaks_for_it() -> None:
    images, names = images_of("cube"), ("cube", "pentagonal_prism", "pyramid")
    side_by_side = SolidBatch.of([shape(name) for name in names])
    together = PoseBatch(side_by_side, np.array([2, 0, 1, 0]), np.stack([WHERE, WHERE, moved(8.0), moved(8.0)]))
    nats, most = evidence(together, images.geometry, maps(images))
    for k, part in enumerate(together.part):
        alone = evidence(posed(shape(names[part]), together.poses[k : k + 1]), images.geometry, maps(images))
        assert (nats[k], most[k]) == pytest.approx((alone[0][0], alone[1][0]), rel=1e-4)


def test_an_edge_of_the_right_length_has_most_evidence_along_its_ray() -> None:
    """Shorter, less of it shows; longer, some is missing; and what goes on beyond its end is another's."""
    images, body = images_of("cube"), KNOWN["cube"]
    corners = frames.apply(WHERE, body.corners_mm)
    first, second = seen_edge()
    geometry = images.geometry
    for seen, x_mm in zip(maps(images), (0.0, geometry.length_mm), strict=True):
        at = (corners - geometry.middle_mm) @ geometry.cyclopean_from_baseline + [geometry.length_mm / 2, 0, 0]
        way = at[second] - at[first]
        length = np.linalg.norm(way)
        rays = Rays.of(at[first][None], way[None] / length, x_mm, seen)
        nats = rays.of_edges(np.zeros(5, np.intp), (length * np.array([0.5, 0.7, 1.0, 1.3, 1.6])).astype(np.float32))
        assert nats.argmax() == 2


def test_edges_that_abound_speak_for_less() -> None:
    images = images_of("cube")
    seen = maps(images)
    nats = [
        evidence(posed(shape("cube"), WHERE[None]), images.geometry, (often(seen[0], chance), often(seen[1], chance)))[
            0
        ][0]
        for chance in (0.02, 0.3)
    ]
    assert 0 < nats[1] < 0.5 * nats[0]


def test_a_cloth_has_chances_along_its_stripes() -> None:
    plain, cloth = maps(images_of(None, patterned=False))[0], maps(images_of(None))[0]
    assert cloth.chance.max() > 5 * plain.chance.max()
    assert cloth.chance.min() < 0.3 * cloth.chance.max()


def test_what_lies_outside_the_images_is_not_there() -> None:
    images = images_of("cube")
    nats, _ = evidence(posed(shape("cube"), moved(900.0)[None]), images.geometry, maps(images))
    assert nats[0] < 0


def test_no_pose_has_no_evidence() -> None:
    images = images_of("cube")
    nats, most = evidence(posed(shape("cube"), np.zeros((0, 4, 4))), images.geometry, maps(images))
    assert nats.shape == most.shape == (0,)


def test_print_is_alike_where_it_lies_on_the_faces_and_only_there() -> None:
    images, solid = images_of("cube"), shape("cube")
    on = face_consistency(solid, WHERE, images)
    assert on is not None
    assert on > 0.95
    nearer = face_consistency(solid, moved(-15.0, 2), images)
    assert nearer is not None
    assert nearer < 0.7
    assert face_consistency(solid, WHERE, images_of("cube", printed=False)) is None


def test_a_large_face_is_asked_at_no_more_places_than_say_enough() -> None:
    cube = shape("cube")
    large = exact(20.0 * cube.corners_mm, cube.facets)
    small, many = places_on_face(cube, 0), places_on_face(large, 0)
    assert len(small) < len(many) < 1.2 * ENOUGH
    assert np.allclose(np.ptp(many, axis=0), 20.0 * np.ptp(small, axis=0), atol=50.0)


def test_of_poses_that_look_the_same_only_one_is_looked_at_and_none_outside_the_images() -> None:
    images, solid = images_of("cube"), shape("cube")
    quarter = frames.rigid(frames.rotation_from_vector(np.array([0.0, 0.0, np.pi / 2])), np.zeros(3))
    middle = solid.corners_mm.mean(0)
    about = frames.rigid(np.eye(3), middle) @ quarter @ frames.rigid(np.eye(3), -middle)
    poses = np.stack([WHERE @ about, WHERE, moved(30.0), moved(500.0)])
    kept = list(distinct(ScoredPoses(posed(solid, poses), np.array([2.0, 1.0, 3.0, 0.0])), images))
    assert [which for which, _ in kept] == [1, 2]
    assert np.allclose(kept[0][1], images.rig.left.project(frames.apply(WHERE, solid.corners_mm)), atol=1e-3)


def test_a_map_is_as_large_as_its_segments_and_empty_at_its_rim() -> None:
    images = images_of("cube", printed=False, patterned=False)
    seen = edge_distances(images.left)
    ends = (
        images.left.rectified.ideal(np.concatenate([images.left.segments.start, images.left.segments.end]))
        - seen.origin
    ) * (seen.scale)
    assert (ends.min(0) > 0).all()
    assert (ends.max(0) < seen.hit.shape[:0:-1]).all()
    assert seen.hit[0].size < 0.5 * images.left.grey.size / 4
    assert not seen.hit[:, [0, -1]].any()
    assert not seen.hit[:, :, [0, -1]].any()
    x = np.array([[-50.0], [ends[0, 0]], [2000.0]], np.float32)
    y = np.array([[ends[0, 1]], [-50.0], [2000.0]], np.float32)
    assert not seen.hits(np.array([[1.0, 0.0]], np.float32), x, y)[0].any()


@pytest.mark.parametrize("off_px", [-3.0, 0.0, 3.0])
def test_by_how_much_print_lies_apart_is_told_where_the_cameras_are_turned_in_a_little(off_px: float) -> None:
    whole = straight_rig()
    matrix = whole.right.matrix + np.array([[0, 0, -off_px], [0, 0, 0], [0, 0, 0]])
    turned = replace(whole, right=replace(whole.right, matrix=matrix))
    images = open_stereo(*print_pair(KNOWN["cube"], WHERE, 3), turned)
    assert print_apart_px(shape("cube"), WHERE, images) == off_px


def test_faces_through_thin_air_and_faces_without_print_say_nothing_of_the_cameras() -> None:
    tilted = frames.perturb(WHERE, np.array([0.0, 0.0, 40.0, 0.3, 0.3, 0.0]))
    assert print_apart_px(shape("cube"), tilted, images_of("cube")) == 0.0
    assert print_apart_px(shape("cube"), WHERE, images_of("cube", printed=False)) == 0.0
