"""Which part of an edge is inside an image, and which the part itself leaves in view."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from daemon import frames
from daemon.arrays import Array
from daemon.vision.geometry import SolidBatch
from daemon.vision.image import open_stereo
from daemon.vision.refine.expected_edges import (
    ROOM_PX,
    ExpectedEdges,
    across,
    longest_runs,
    project_edges,
    shares_inside,
)
from tests.fakes.drawn import block
from tests.fakes.rigs import rig
from tests.fakes.solids import pose


def test_the_part_of_an_edge_inside_an_image_is_where_its_points_are() -> None:
    rng = np.random.default_rng(4)
    start, end = rng.uniform(-300, 900, (2, 400, 2))
    start[:40, 0] = end[:40, 0]  # upright, then level ones
    start[40:80, 1] = end[40:80, 1]
    share = np.linspace(0, 1, 4001)
    points = start[:, None] + share[:, None] * (end - start)[:, None]
    there = ((points >= ROOM_PX) & (points <= np.array([639.0, 479.0]) - ROOM_PX)).all(2)
    first, last = shares_inside(start, end, (640, 480))
    seen = there.any(1)
    assert 40 < seen.sum() < 360
    assert (last[there.sum(1) > 2] > first[there.sum(1) > 2]).all()
    assert (last[~seen] <= first[~seen] + 1e-3).all()
    assert np.abs(first[seen] - share[there[seen].argmax(1)]).max() < 1e-3
    assert np.abs(last[seen] - share[4000 - there[seen, ::-1].argmax(1)]).max() < 1e-3


def test_a_share_of_an_edge_lies_on_it_and_moves_with_the_pose_as_the_whole_does() -> None:
    solid, where = block(40.0, 30.0, 20.0), pose(np.array([-0.9, 0.25, 0.5]), 0.3, 300.0)
    dark = np.zeros(rig().image_size[::-1], np.uint8)
    images, motion = open_stereo(dark, dark, rig()), np.array([0.02, -0.03, 0.01, 2e-4, -1e-4, 3e-4])

    def at(poses: Array) -> tuple[ExpectedEdges, ExpectedEdges]:
        return project_edges(SolidBatch.of([solid]), images, poses, np.ones(1, bool), 0.25)

    for whole, moved in zip(at(where[None]), at(frames.perturb(where, motion)[None]), strict=True):
        number = len(whole.start)
        some = whole.between(np.full(number, 0.25), np.full(number, 0.6))
        way = whole.end - whole.start
        np.testing.assert_allclose(some.start, whole.start + 0.25 * way, atol=1e-9)
        np.testing.assert_allclose(some.end, whole.start + 0.6 * way, atol=1e-9)
        normal = across(whole.start, whole.end)
        ends = moved.start + np.array([0.25, 0.6])[:, None, None] * (moved.end - moved.start)
        off = ((ends - np.stack([some.start, some.end])) * normal).sum(2).T
        np.testing.assert_allclose(off, some.jacobian @ motion, atol=2e-3)
        beside = replace(whole, start=whole.start + 0.5 * way).between(np.zeros(number), np.full(number, 0.4))
        np.testing.assert_allclose(beside.lengths_px, 0.0, atol=1e-9)
        by_corners = np.einsum("enci,cj->enij", some.by_corner, np.ones((2, 1)))[..., 0]
        np.testing.assert_allclose(by_corners, some.jacobian[..., :3], atol=1e-9)


def test_the_longest_run_of_what_shows_is_the_first_of_the_longest() -> None:
    shows = np.array([[0, 1, 1, 0, 1], [1, 1, 0, 1, 1], [0, 0, 0, 0, 0], [1, 1, 1, 1, 1], [1, 0, 1, 1, 1]], bool)
    first, last = longest_runs(shows)
    assert list(zip(first.tolist(), last.tolist(), strict=True)) == [(1, 3), (0, 2), (0, 0), (0, 5), (2, 5)]
