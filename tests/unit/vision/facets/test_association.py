"""Which corners and facets of several looks are one."""

from __future__ import annotations

import numpy as np

from daemon.vision.facets.association import one_corner, one_facet, one_thing

SQUARE = np.array([[0.0, 0, 0], [40, 0, 0], [40, 40, 0], [0, 40, 0]])
RING = [(0, 1, 2, 3)]
SURE = np.repeat(0.05**2 * np.eye(3)[None], 4, axis=0)


def test_corners_that_lie_together_are_one_whatever_their_order() -> None:
    owner = one_corner([SQUARE, SQUARE[::-1] + 0.2], [SURE, SURE], [RING, RING])
    assert owner[0].tolist() == [0, 1, 2, 3]
    assert owner[1].tolist() == [3, 2, 1, 0]


def test_corners_farther_apart_than_their_errors_are_two_and_surer_ones_sooner() -> None:
    shifted = SQUARE + np.array([2.0, 0.0, 0.0])
    assert len(set(np.concatenate(one_corner([SQUARE, shifted], [SURE, SURE], [RING, RING])).tolist())) == 8
    wide = SURE * 100
    assert len(set(np.concatenate(one_corner([SQUARE, shifted], [wide, wide], [RING, RING])).tolist())) == 4


def test_a_narrow_facets_own_corners_stay_two() -> None:
    narrow = SQUARE * [1.0, 0.03, 1.0]
    owner = one_corner([narrow, narrow + 0.1], [SURE * 100] * 2, [RING, RING])
    assert [len(set(numbers.tolist())) for numbers in owner] == [4, 4]


def test_pieces_of_one_plane_that_touch_are_one_facet() -> None:
    beside, far = SQUARE + np.array([41.0, 0, 0]), SQUARE + np.array([90.0, 0, 0])
    assert len(one_facet([SQUARE, beside], [RING, RING])) == 1
    assert len(one_facet([SQUARE, far], [RING, RING])) == 2


def test_a_step_or_a_bend_makes_two_facets() -> None:
    bent = SQUARE @ np.array([[0.9, 0, 0.44], [0, 1.0, 0], [-0.44, 0, 0.9]]).T
    assert len(one_facet([SQUARE, SQUARE + np.array([0, 0, 6.0])], [RING, RING])) == 2
    assert len(one_facet([SQUARE, bent], [RING, RING])) == 2


def test_what_shares_a_mark_is_one_thing() -> None:
    assert one_thing([{(-1, 1)}, {(-1, 2), (0, 0)}, {(0, 0)}, {(-1, 9)}]) == [[0], [1, 2], [3]]
