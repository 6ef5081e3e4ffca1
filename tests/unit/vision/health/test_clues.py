"""What the outlines of both cameras say of a knock: true corners agree on it, a pattern's chance pairs do not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from daemon import frames
from daemon.arrays import Array
from daemon.vision.geometry.rig import StereoRig
from daemon.vision.health.clues import clue_of, same_height
from daemon.vision.values import FacetView, Part, Recognition, Rejected, Scene
from tests.fakes.rigs import turned, unlike_rig

CUBE = 25.0 * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
AT_MM = np.array([10.0, -5.0, 350.0])
OUTLINES = 3
"""That go through each corner of a part: a facet's, its neighbour's, another effort's."""


def seen_by_both(truth: StereoRig) -> tuple[Array, Array]:
    """A cube's corners in either camera."""
    cube = CUBE @ frames.rotation_from_vector(np.array([0.4, 0.7, 0.2])).T + AT_MM
    return truth.left.project(cube), truth.right.project(cube)


def named(confidence: float) -> Part:
    """A part of which no edge is measured."""
    return Part(Recognition("cube", confidence, 1, 1, None, False, "fits"), (), np.eye(4), np.eye(6), 0.1)


def outlined(left: Array, right: Array, seed: int = 0) -> Scene:
    """What a look tells of corners that several refused outlines of either camera go through."""
    rng = np.random.default_rng(seed)
    refused = [
        Rejected(corners + rng.normal(0, 0.1, corners.shape), camera, "no polygon of the other camera fits")
        for camera, corners in (("left", left), ("right", right))
        for _ in range(OUTLINES)
    ]
    return Scene((), (), FacetView((), tuple(refused), (), (), 1.0))


@pytest.mark.parametrize("degrees", [0.0, 0.1, -0.3])
def test_the_corners_of_many_outlines_say_how_far_the_right_camera_has_pitched(degrees: float) -> None:
    rig = unlike_rig()
    seen = clue_of(outlined(*seen_by_both(turned(rig, 0, degrees))), rig, lambda _: None)
    assert np.degrees(seen.turn[0]) == pytest.approx(degrees, abs=0.02)
    assert np.degrees(seen.sigma[0]) < 0.02


def test_where_a_part_is_surely_named_no_camera_is_so_far_off_that_none_could_be() -> None:
    """Half a degree is 6 px: the outlines' pairs are a pattern's."""
    rig = unlike_rig()
    seen = outlined(*seen_by_both(turned(rig, 0, 0.5)))
    says = [np.isfinite(clue_of(replace(seen, parts=p), rig, lambda _: None).sigma[0]) for p in ((), (named(0.5),))]
    assert all(says)
    assert not np.isfinite(clue_of(replace(seen, parts=(named(0.99),)), rig, lambda _: None).sigma[0])


def test_three_corners_say_nothing_however_many_outlines_go_through_them() -> None:
    rig = unlike_rig()
    left, right = (corners[:3] for corners in seen_by_both(turned(rig, 0, 0.3)))
    assert not np.isfinite(clue_of(outlined(left, right), rig, lambda _: None).sigma).any()


def test_a_row_of_dots_has_one_vote_a_dot_for_the_offset_that_all_of_it_shares() -> None:
    """Three dots in each camera, all of them four px off, pair in nine ways; the cube is where the calibration has
    it."""
    rig = unlike_rig()
    row = np.array([[-12.0, 40.0, 350.0], [0.0, 40.0, 350.0], [12.0, 40.0, 350.0]])
    dots = [camera.project(row) for camera in (rig.left, rig.right)]
    astray = dots[1] + [0.0, 4.0]
    assert len(same_height(rig, dots[0], astray)[0]) == 0
    cube = seen_by_both(rig)
    left, right = same_height(rig, np.concatenate([cube[0], dots[0]]), np.concatenate([cube[1], astray]))
    assert {tuple(px) for px in left} == {tuple(px) for px in cube[0]}
    assert {tuple(px) for px in right} == {tuple(px) for px in cube[1]}
