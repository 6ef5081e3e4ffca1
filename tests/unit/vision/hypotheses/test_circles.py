"""Circles that both cameras see: where, how turned, how large; and the poses of parts that have such a rim."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from daemon import frames
from daemon.arrays import Array
from daemon.vision.facets import MeasuredCircle, find_circles
from daemon.vision.geometry import Hole, Polyhedron, SolidBatch
from daemon.vision.hypotheses.circles import poses_from_circles, rims_of, taught_radii
from daemon.vision.image import StereoImages, open_stereo
from tests.fakes.drawn import block
from tests.fakes.painted import paint_pair
from tests.fakes.rigs import rig
from tests.fakes.solids import pose

PLAIN = block(64.0, 44.0, 26.0)
TOP = int(np.argmax(np.linalg.norm(PLAIN.areas_mm2, axis=1)))
WHERE = pose(np.array([-0.5, 0.3, 0.8]), 0.3, 330.0)
BORES = (-16.0, 5.0), (0.0, 3.0), (15.0, 5.0)
"""Of the block below: how far along its top from the middle, and of what radius, mm."""


@cache
def bored() -> Polyhedron:
    """A block with three bores in a row in its top, turned to both cameras at WHERE."""
    x, y = PLAIN.flat_from_solid[TOP, :3, :3][:2]
    turns = 2 * np.pi * np.arange(48) / 48
    circle = np.cos(turns)[:, None] * x + np.sin(turns)[:, None] * y
    return replace(PLAIN, holes=tuple(Hole(TOP, PLAIN.centres_mm[TOP] + a * x + r * circle) for a, r in BORES))


@cache
def where() -> Array:
    """A pose (4, 4) at which both cameras look at the top, neither straight nor along it."""
    tilts = (frames.rotation_from_vector(np.array(v)) for v in ([0.0, 0, 0], [np.pi / 2, 0, 0], [0, np.pi / 2, 0],
             [-np.pi / 2, 0, 0], [0, -np.pi / 2, 0], [np.pi, 0, 0]))  # fmt: skip
    return next(
        one
        for one in (WHERE @ frames.rigid(tilt, np.zeros(3)) for tilt in tilts)
        if 0.6 < PLAIN.facing(one)[TOP] < 0.95
    )


@cache
def painted() -> StereoImages:
    """Both cameras' pictures of it."""
    return open_stereo(*paint_pair([(bored(), where())], np.random.default_rng(2), rig()), rig())


@cache
def seen() -> list[MeasuredCircle]:
    """What both cameras see of it."""
    return find_circles(painted(), taught_radii((bored(),)))


def test_the_rims_of_bores_are_found_in_space_with_their_normals_and_radii() -> None:
    normal = where()[:3, :3] @ PLAIN.normals[TOP]
    for rim in rims_of(bored()):
        centre = frames.apply(where(), rim.centre_mm[None])[0]
        near = min(seen(), key=lambda one: float(np.linalg.norm(one.centre_mm - centre)))
        assert np.linalg.norm(near.centre_mm - centre) < 1.0
        assert near.radius_mm == pytest.approx(rim.radius_mm, rel=0.06)
        assert np.degrees(np.arccos(near.normal @ normal)) < 8.0
    assert len(seen()) == len(BORES)


def test_two_ellipses_at_different_heights_are_no_circle() -> None:
    images = paint_pair([(bored(), where())], np.random.default_rng(2), rig())
    lower = open_stereo(images[0], np.roll(images[1], 9, axis=0), rig())
    assert find_circles(lower, taught_radii((bored(),))) == []


def test_circles_of_other_radii_than_the_taught_rims_are_left_out() -> None:
    assert find_circles(painted(), np.array([20.0])) == []
    assert find_circles(painted(), np.zeros(0)) == []
    (one,) = find_circles(painted(), np.array([3.0]))
    assert one.radius_mm == pytest.approx(3.0, rel=0.06)


def test_of_the_turns_about_a_rim_the_other_rims_speak_for_the_right_one() -> None:
    posed, nats = poses_from_circles(seen(), SolidBatch.of([bored()]))
    best = posed.poses[np.flatnonzero(nats == nats.max())]
    assert nats.max() > 0
    there = frames.apply(where(), bored().corners_mm)
    off = [np.linalg.norm(frames.apply(one, bored().corners_mm) - there, axis=1).max() for one in best]
    assert min(off) < 6.0  # 36 mm from a rim's axis a step of five degrees is 3 mm
    assert len(best) < 0.1 * len(nats)


def test_no_circle_gives_no_pose() -> None:
    posed, nats = poses_from_circles([], SolidBatch.of([bored(), PLAIN]))
    assert len(posed.part) == len(nats) == 0
    assert rims_of(PLAIN) == ()
