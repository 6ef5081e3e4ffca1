"""What lies beside on the table: where another part may be laid down, and where the hand keeps off."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon import frames
from daemon.arm import KeepOut, two_fingers
from daemon.pick.grippers.two_fingers import tool_rotation
from daemon.pick.planning.table_room import BIN_MM, CLEARANCE_MM, SPOTS_OUT_MM, Obstacles, free_spots, obstacles_of
from daemon.pick.settings import Settings

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
    every = free_spots(obstacles_of([]), radius, settings)
    assert np.allclose(every[0], CENTRE)
    assert len(every) > 20
    away_mm = [float(np.linalg.norm(spot - CENTRE)) for spot in every]
    assert away_mm == sorted(away_mm)
    assert away_mm[-1] == SPOTS_OUT_MM
    other = block(520.0, 0.0)
    beside = obstacles_of([other])
    left = free_spots(beside, radius, settings)
    assert 0 < len(left) < len(every)
    for spot in left:
        gap = np.linalg.norm(other[:, :2] - spot, axis=1).min() - radius
        assert gap >= CLEARANCE_MM - 1e-9
    post = KeepOut("post", (500.0, -20.0, -300.0), (700.0, 20.0, 0.0))
    barred = free_spots(obstacles_of([]), radius, replace(settings, limits=replace(settings.limits, keep_out=(post,))))
    assert 0 < len(barred) < len(every)
    assert not any(460.0 < x < 750.0 and abs(y) < 60.0 for x, y in barred)
    bin_here = replace(settings, bin=replace(settings.bin, point_mm=(520.0, 100.0, 0.0)))
    away = free_spots(obstacles_of([]), radius, bin_here)
    assert 0 < len(away) < len(every)
    assert min(np.linalg.norm(spot - [520.0, 100.0]) for spot in away) > BIN_MM + radius


@pytest.mark.parametrize(("off_mm", "free"), [(-0.005, False), (0.005, True)])
@pytest.mark.parametrize("axis", [0, 1])
def test_a_part_keeps_so_far_from_a_keep_out(axis, off_mm, free):
    settings, edge = Settings(), CENTRE[axis] + 35.0 + CLEARANCE_MM + off_mm
    low, high = np.array([520.0, 0.0, -300.0]) - 5.0, np.array([520.0, 0.0, 0.0]) + 5.0
    low[axis], high[axis] = edge, edge + 10.0
    barred = replace(settings.limits, keep_out=(KeepOut("post", tuple(low), tuple(high)),))
    spots = free_spots(obstacles_of([]), 35.0, replace(settings, limits=barred))
    assert any(np.allclose(spot, CENTRE) for spot in spots) is free


AMONG = st.floats(-60.0, 60.0)


@given(st.lists(st.lists(st.tuples(AMONG, AMONG, AMONG), min_size=1, max_size=6), max_size=3))
def test_a_thing_takes_up_a_circle_around_all_that_is_known_of_it_as_high_as_its_highest_point(things):
    corners = [np.array(each) for each in things]
    beside = obstacles_of(corners)
    assert len(beside.middles) == len(beside.radii) == len(beside.tops) == len(things)
    for each, middle, radius, top in zip(corners, beside.middles, beside.radii, beside.tops, strict=True):
        assert np.linalg.norm(each[:, :2] - middle, axis=1).max() == pytest.approx(radius)
        assert np.allclose(middle, (each[:, :2].min(axis=0) + each[:, :2].max(axis=0)) / 2)
        assert top == each[:, 2].max()


@pytest.mark.parametrize(
    ("middle_mm", "top_mm", "hidden"),
    [((50.0, 0.0), 60.0, True), ((50.0, 0.0), 40.0, False), ((150.0, 0.0), 150.0, False), ((50.0, 30.0), 60.0, False)],
    ids=["before it", "too low", "beyond the camera", "beside"],
)
def test_a_point_is_hidden_by_what_is_as_high_as_its_ray_on_the_way_to_the_camera(middle_mm, top_mm, hidden):
    beside = Obstacles(np.array([middle_mm]), np.array([5.0]), np.array([top_mm]))
    assert beside.hides(np.zeros((1, 3)), np.array([100.0, 0.0, 100.0])) is hidden


@given(st.tuples(AMONG, AMONG, AMONG), st.tuples(AMONG, AMONG, st.floats(1.5, 90.0)), st.floats(2.0, 40.0), AMONG)
def test_a_point_is_hidden_where_its_ray_to_the_camera_crosses_what_lies_beside(point, up, radius, top):
    beside = Obstacles(np.array([[5.0, -10.0]]), np.array([radius]), np.array([top]))
    start, ray = np.array(point), np.array(up)
    along = start + np.linspace(0.0, 1.0, 400)[:, None] * ray
    off = np.linalg.norm(along[:, :2] - beside.middles[0], axis=1) - radius
    hidden = beside.hides(start[None], start + ray)
    if ((off < -1e-6) & (along[:, 2] < top)).any():
        assert hidden
    if off[0] > 0.5 and not ((off < 0.5) & (along[:, 2] < top + 0.5)).any():
        assert not hidden


def test_what_is_laid_down_stays_inside_the_workspace():
    settings = Settings()
    narrow = replace(settings, limits=replace(settings.limits, box_high_mm=(560.0, 650.0, 1100.0)))
    assert max(spot[0] for spot in free_spots(obstacles_of([]), 35.0, narrow)) < 560.0 - 35.0


@pytest.mark.parametrize(("tilt_deg", "clear"), [(40.0, True), (-40.0, False)])
def test_the_hand_keeps_off_what_lies_beside_with_its_cameras_too(tilt_deg, clear):
    """A block stands where the cameras come down to when they are on the lower side, and far from the fingers."""
    limits, tool = Settings().limits, lean(tilt_deg, TABLE_MM + 30.0)
    bar = frames.apply(lean(-40.0, TABLE_MM + 30.0), np.array([[-90.0, 0.0, -95.0]]))[0]
    beside = obstacles_of([block(bar[0], bar[1], 20.0, bar[2] - TABLE_MM + 5.0)])
    assert bool(beside.clear(tool[None], limits)[0]) is clear
    assert obstacles_of([]).clear(tool[None], limits)[0]


def test_the_hand_is_as_near_as_its_capsules_are():
    """Against points on the capsules of the hand, one by one."""
    rng, limits = np.random.default_rng(3), Settings().limits
    hand = [c for c in limits.capsules if c.link == "tool"]
    assert {c.name for c in two_fingers().capsules} < {c.name for c in hand}
    near = far = 0
    for _ in range(400):
        tool = lean(rng.uniform(-50.0, 70.0), TABLE_MM + rng.uniform(10.0, 150.0))
        beside = Obstacles(CENTRE[None] + rng.uniform(-200.0, 200.0, (1, 2)), np.array([rng.uniform(10.0, 50.0)]),
                        np.array([TABLE_MM + rng.uniform(5.0, 120.0)]))  # fmt: skip
        met, off = False, True
        for capsule in hand:
            axis = np.linspace(np.array(capsule.from_mm), np.array(capsule.to_mm), 40)
            points = frames.apply(tool, axis)
            away = np.linalg.norm(points[:, :2] - beside.middles[0], axis=1) - beside.radii[0] - capsule.radius_mm
            low = points[:, 2] - capsule.radius_mm - beside.tops[0]
            met |= bool(((away < 0.0) & (low < 0.0)).any())
            off &= bool(away.min() > CLEARANCE_MM or low.min() > CLEARANCE_MM)
        near, far = near + met, far + off
        assert bool(beside.clear(tool[None], limits)[0]) or not off
        assert not (met and beside.clear(tool[None], limits)[0])
    assert min(near, far) > 20


def test_what_a_part_hides_is_not_seen_to_be_free():
    beside, camera = obstacles_of([block(520.0, 0.0)]), np.array([300.0, 0.0, 0.0])
    behind, before = np.array([[590.0, 0.0, TABLE_MM]]), np.array([[440.0, 0.0, TABLE_MM]])
    assert beside.hides(behind, camera)
    assert not beside.hides(before, camera)
    assert not beside.hides(behind, np.array([590.0, 0.0, 200.0])), "from above"
    assert not obstacles_of([]).hides(behind, camera)
