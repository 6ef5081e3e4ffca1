"""What lies beside on the table: where another part may be laid down, and where the hand keeps off."""

from dataclasses import replace

import numpy as np
import pytest

from daemon import frames
from daemon.arm import KeepOut, two_fingers
from daemon.pick.settings import Settings
from daemon.pick.table_room import BESIDE_MM, BIN_MM, SPOTS_OUT_MM, Beside, beside_of, free_spots
from daemon.pick.two_fingers import tool_rotation

TABLE_MM = -300.0
CENTRE = np.array([520.0, 0.0])


def block(x, y, half=25.0, high=50.0):
    """(8, 3) corners of a block on the table."""
    signs = np.array(np.meshgrid([-1, 1], [-1, 1], [0, 1])).reshape(3, -1).T
    return np.array([x, y, TABLE_MM]) + signs * [half, half, high]


def lean(tilt_deg, z, heading=(1.0, 0.0, 0.0)):
    return frames.rigid(tool_rotation(np.array(heading), np.radians(tilt_deg)), np.array([520.0, 0.0, z]))


def test_a_spot_is_free_of_parts_boxes_and_the_bin():
    settings, radius = Settings(), 35.0
    every = free_spots(beside_of([]), radius, settings)
    assert np.allclose(every[0], CENTRE)
    assert len(every) > 20
    assert all(np.linalg.norm(spot - CENTRE) <= SPOTS_OUT_MM for spot in every)
    other = block(520.0, 0.0)
    beside = beside_of([other])
    left = free_spots(beside, radius, settings)
    assert 0 < len(left) < len(every)
    for spot in left:
        gap = np.linalg.norm(other[:, :2] - spot, axis=1).min() - radius
        assert gap >= BESIDE_MM - 1e-9
    post = KeepOut("post", (500.0, -20.0, -300.0), (700.0, 20.0, 0.0))
    barred = free_spots(beside_of([]), radius, replace(settings, limits=replace(settings.limits, keep_out=(post,))))
    assert 0 < len(barred) < len(every)
    assert not any(460.0 < x < 750.0 and abs(y) < 60.0 for x, y in barred)
    bin_here = replace(settings, bin=replace(settings.bin, point_mm=(520.0, 100.0, 0.0)))
    away = free_spots(beside_of([]), radius, bin_here)
    assert 0 < len(away) < len(every)
    assert min(np.linalg.norm(spot - [520.0, 100.0]) for spot in away) > BIN_MM + radius


def test_what_is_laid_down_stays_inside_the_workspace():
    settings = Settings()
    narrow = replace(settings, limits=replace(settings.limits, box_high_mm=(560.0, 650.0, 1100.0)))
    assert max(spot[0] for spot in free_spots(beside_of([]), 35.0, narrow)) < 560.0 - 35.0


@pytest.mark.parametrize(("tilt_deg", "clear"), [(40.0, True), (-40.0, False)])
def test_the_hand_keeps_off_what_lies_beside_with_its_cameras_too(tilt_deg, clear):
    """A block stands where the cameras come down to when they are on the lower side, and far from the fingers."""
    limits, tool = Settings().limits, lean(tilt_deg, TABLE_MM + 30.0)
    bar = frames.apply(lean(-40.0, TABLE_MM + 30.0), np.array([[-90.0, 0.0, -95.0]]))[0]
    beside = beside_of([block(bar[0], bar[1], 20.0, bar[2] - TABLE_MM + 5.0)])
    assert bool(beside.clear(tool[None], limits)[0]) is clear
    assert beside_of([]).clear(tool[None], limits)[0]


def test_the_hand_is_as_near_as_its_capsules_are():
    """Against points on the capsules of the hand, one by one."""
    rng, limits = np.random.default_rng(3), Settings().limits
    hand = [c for c in limits.capsules if c.link == "tool"]
    assert {c.name for c in two_fingers().capsules} < {c.name for c in hand}
    near = 0
    for _ in range(400):
        tool = lean(rng.uniform(-50.0, 70.0), TABLE_MM + rng.uniform(10.0, 150.0))
        beside = Beside(CENTRE[None] + rng.uniform(-200.0, 200.0, (1, 2)), np.array([rng.uniform(10.0, 50.0)]),
                        np.array([TABLE_MM + rng.uniform(5.0, 120.0)]))  # fmt: skip
        met = False
        for capsule in hand:
            axis = np.linspace(np.array(capsule.from_mm), np.array(capsule.to_mm), 40)
            points = frames.apply(tool, axis)
            away = np.linalg.norm(points[:, :2] - beside.middles[0], axis=1) - beside.radii[0] - capsule.radius_mm
            met |= bool(((away < 0.0) & (points[:, 2] - capsule.radius_mm < beside.tops[0])).any())
        near += met
        assert not (met and beside.clear(tool[None], limits)[0])
    assert near > 20


def test_what_a_part_hides_is_not_seen_to_be_free():
    beside, eye = beside_of([block(520.0, 0.0)]), np.array([300.0, 0.0, 0.0])
    behind, before = np.array([[590.0, 0.0, TABLE_MM]]), np.array([[440.0, 0.0, TABLE_MM]])
    assert beside.hides(behind, eye)
    assert not beside.hides(before, eye)
    assert not beside.hides(behind, np.array([590.0, 0.0, 200.0])), "from above"
    assert not beside_of([]).hides(behind, eye)
