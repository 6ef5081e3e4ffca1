"""Which part of an edge is inside an image."""

from __future__ import annotations

import numpy as np

from daemon.vision.refine.expected_edges import ROOM_PX, shares_inside


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
