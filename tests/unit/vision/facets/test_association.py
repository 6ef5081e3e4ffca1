"""Which corners and facets of several looks are one."""

from __future__ import annotations

import numpy as np

from daemon.vision.facets.many_looks.association import (
    connected_by_marks,
    drop_contradicted,
    match_corners,
    match_facets,
)

SQUARE = np.array([[0.0, 0, 0], [40, 0, 0], [40, 40, 0], [0, 40, 0]])
RING: list[tuple[int, ...]] = [(0, 1, 2, 3)]
SURE = np.repeat(0.05**2 * np.eye(3)[None], 4, axis=0)


def test_corners_that_lie_together_are_one_whatever_their_order() -> None:
    owner = match_corners([SQUARE, SQUARE[::-1] + 0.2], [SURE, SURE], [RING, RING])
    assert owner[0].tolist() == [0, 1, 2, 3]
    assert owner[1].tolist() == [3, 2, 1, 0]


def test_corners_farther_apart_than_their_errors_are_two_and_surer_ones_sooner() -> None:
    shifted = SQUARE + np.array([2.0, 0.0, 0.0])
    assert len(set(np.concatenate(match_corners([SQUARE, shifted], [SURE, SURE], [RING, RING])).tolist())) == 8
    wide = SURE * 100
    assert len(set(np.concatenate(match_corners([SQUARE, shifted], [wide, wide], [RING, RING])).tolist())) == 4


def test_a_corner_hardly_known_moves_none_that_is_known_whatever_the_order_of_the_looks() -> None:
    rough, doubt = SQUARE + np.array([0.0, 3.0, 0.0]), np.repeat(2.0**2 * np.eye(3)[None], 4, axis=0)
    three = [(rough, doubt), (SQUARE, SURE), (SQUARE + 0.1, SURE)]
    for looks in (three, three[::-1]):
        moved, spread = map(list, zip(*looks, strict=True))
        assert {tuple(one.tolist()) for one in match_corners(moved, spread, [RING] * 3)} == {(0, 1, 2, 3)}


def test_corners_of_two_facets_of_one_look_are_one_where_another_look_says_so_but_not_those_of_one_outline() -> None:
    twice, rings = np.vstack([SQUARE, SQUARE + 0.3]), [*RING, (4, 5, 6, 7)]
    both, surer = np.vstack([SURE, SURE]), SURE / 4
    (alone,) = match_corners([twice], [both], [rings])
    assert len(set(alone.tolist())) == 8
    owner, _ = match_corners([twice, SQUARE], [both, surer], [rings, RING])
    assert owner.tolist() == [0, 1, 2, 3, 0, 1, 2, 3]


def test_a_narrow_facets_own_corners_stay_two() -> None:
    narrow = SQUARE * [1.0, 0.03, 1.0]
    owner = match_corners([narrow, narrow + 0.1], [SURE * 100] * 2, [RING, RING])
    assert [len(set(numbers.tolist())) for numbers in owner] == [4, 4]


def test_pieces_of_one_plane_that_touch_are_one_facet() -> None:
    beside, far = SQUARE + np.array([41.0, 0, 0]), SQUARE + np.array([90.0, 0, 0])
    assert len(match_facets([SQUARE, beside], [SURE, SURE], [RING, RING])) == 1
    assert len(match_facets([SQUARE, far], [SURE, SURE], [RING, RING])) == 2


def test_a_step_or_a_bend_makes_two_facets() -> None:
    bent = SQUARE @ np.array([[0.9, 0, 0.44], [0, 1.0, 0], [-0.44, 0, 0.9]]).T
    assert len(match_facets([SQUARE, SQUARE + np.array([0, 0, 6.0])], [SURE, SURE], [RING, RING])) == 2
    assert len(match_facets([SQUARE, bent], [SURE, SURE], [RING, RING])) == 2


def test_a_piece_hardly_known_does_not_say_where_the_plane_is() -> None:
    lifted = SQUARE * 1.2 + np.array([[0, 0, 6.0], [0, 0, 6.0], [0, 0, 0], [0, 0, 0]])
    rough = np.array([4.0, 4.0, 0.05, 0.05])[:, None, None] ** 2 * np.eye(3)
    for doubt, sets in ((rough, 1), (SURE, 2)):
        assert len(match_facets([lifted, SQUARE, SQUARE], [doubt, SURE, SURE], [RING] * 3)) == sets
    ((first, *_),) = match_facets([lifted, SQUARE, SQUARE], [rough, SURE, SURE], [RING] * 3)
    assert first != (0, 0)


CENTRES = np.array([[20.0 + 10 * k, 20.0, 300.0] for k in range(4)])
ASKEW = SQUARE + np.array([[0, 0, 7.0], [0, 0, 7.0], [0, 0, -7.0], [0, 0, -7.0]])


def kept(shapes: list[np.ndarray], centres: np.ndarray = CENTRES) -> int:
    facets = match_facets(shapes, [SURE] * len(shapes), [RING] * len(shapes))
    return len(drop_contradicted(facets, shapes, [RING] * len(shapes), centres[: len(shapes)]))


def test_what_one_look_saw_and_two_others_deny_is_left_out() -> None:
    assert kept([SQUARE, SQUARE, ASKEW]) == 1
    assert kept([ASKEW, SQUARE, SQUARE]) == 1


def test_one_against_one_stays_open() -> None:
    assert kept([SQUARE, ASKEW]) == 2


def test_looks_that_all_disagree_do_not_leave_nothing() -> None:
    assert kept([SQUARE, ASKEW, ASKEW @ np.diag([1.0, 1.0, -1.0])]) > 0


def test_nobody_denies_what_stands_behind_something_or_is_turned_away() -> None:
    above = SQUARE * 2 - 20 + np.array([0.0, 0.0, 60.0])
    assert kept([above, above, SQUARE]) == 2
    below = CENTRES * [1.0, 1.0, -1.0]
    assert kept([ASKEW[::-1], SQUARE, SQUARE], np.vstack([below[:1], CENTRES[:2]])) == 2


def test_what_shares_a_mark_is_one_thing() -> None:
    assert connected_by_marks([{(-1, 1)}, {(-1, 2), (0, 0)}, {(0, 0)}, {(-1, 9)}]) == [[0], [1, 2], [3]]
