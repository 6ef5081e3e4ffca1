"""What of the arm may strike: capsules where the links are, and their distances, against balls in a row."""

import importlib.util
import itertools
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from daemon.arm.body import (
    PERHAPS_HELD,
    Capsule,
    FixtureBox,
    KeepOut,
    Link,
    above_mm,
    away_mm,
    body_of,
    capsule_around,
    held_anyhow,
    lie_at_boxes,
    within_mm,
)
from daemon.arm.collision_shapes import ARM, ARM_LINKS, BODY_MM, links_like, suction_cup, two_fingers
from drivers import puma560
from drivers.simcell import motion_monitor
from drivers.simcell.gripper import finger_rods
from drivers.simcell.truth import load_truth
from tests.fakes.swept import ARM as PUMA

TRUTH = load_truth(Path(__file__).parents[3] / "etc/simcell.yaml")
BOX = KeepOut("box", (-50.0, -80.0, 0.0), (50.0, 120.0, 300.0))
NEAR_MM = 60.0
places = st.tuples(*[st.floats(-400, 400)] * 3)


def ends(*capsules) -> tuple[np.ndarray, np.ndarray]:
    """(1, C, 2, 3) and radii."""
    return np.array([[(a, b) for a, b, _ in capsules]], float), np.array([r for *_, r in capsules], float)


def by_balls(a, b, radius):
    """The least of many balls along the axis."""
    points = np.linspace(a, b, 4001)
    beyond = np.maximum(np.array(BOX.low_mm) - points, points - np.array(BOX.high_mm))
    outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=1) + np.minimum(beyond.max(axis=1), 0.0)
    return float(outside.min()) - radius


@settings(max_examples=300, deadline=None)
@given(a=places, b=places, radius=st.floats(0, 90))
@example(a=(0.0, 0.0, 0.0), b=(0.0, 1.0, 1.2e-308), radius=0.0)
@example(a=(200.0, -50.0, 100.0), b=(200.0, 50.0, 100.0), radius=0.0)
def test_a_capsule_is_never_told_farther_from_a_box_than_it_is_and_near_it_exactly(a, b, radius):
    told = float(away_mm(*ends((a, b, radius)), [BOX], NEAR_MM)[0, 0, 0])
    true = by_balls(a, b, radius)
    assert told <= true + 1e-9
    length = float(np.linalg.norm(np.subtract(a, b)))
    assert told >= true - length / 4 - length / 1500 - 1e-9, "or far things are looked at for nothing"
    if told < NEAR_MM:
        assert told >= true - length / 1500 - 1e-9


@pytest.mark.parametrize(
    ("a", "b", "radius", "mm"),
    [
        ((150, 0, 100), (150, 0, 200), 20, 80.0),  # beside a side
        ((53, 124, 100), (53, 124, 100), 0, 5.0),  # a point off an edge: 3-4-5
        ((-200, 0, 310), (200, 0, 310), 4, 6.0),  # a long one over the top
        ((-200, 20, 150), (200, 20, 150), 10, -60.0),  # straight through, fifty from the nearest side, and thick
        ((0, 0, 5), (0, 0, 5), 0, -5.0),  # five above the floor of the box
    ],
)
def test_distances_known_by_hand(a, b, radius, mm):
    assert away_mm(*ends((a, b, radius)), [BOX], 1e3)[0, 0, 0] == pytest.approx(mm, abs=0.3)


def test_height_over_the_table_is_that_of_the_lower_end_less_the_radius():
    told = above_mm(*ends(((0, 0, -200), (0, 0, -100), 30), ((0, 0, 50), (9, 9, -290), 12)), -300.0)
    assert told.tolist() == [[70.0, -2.0]]


def test_the_sides_of_the_workspace_box_are_told_each():
    told = within_mm(np.array([[10.0, -5.0, 290.0]]), BOX.low_mm, BOX.high_mm)
    assert told.tolist() == [[60.0, 75.0, 290.0, 40.0, 125.0, 10.0]]


def test_the_body_is_every_capsule_every_point_and_the_tool_centre_point():
    body = body_of(ARM, BODY_MM)
    assert body.names == (*(c.name for c in ARM), *["tool"] * (len(BODY_MM) + 1))
    assert body.ends_mm[-1].tolist() == [[0.0, 0.0, 0.0]] * 2
    assert [tuple(p) for p in body.ends_mm[len(ARM) : -1, 0].tolist()] == list(BODY_MM)
    assert body.radius_mm.tolist() == [*(c.radius_mm for c in ARM), *[0.0] * (len(BODY_MM) + 1)]


def test_the_points_of_the_hand_are_as_far_to_one_side_as_to_the_other_and_the_fingers_tips_among_them():
    points = set(BODY_MM)
    assert {(x, -y, z) for x, y, z in points} == points
    tips = {point for point in points if point[2] == 10.0}
    assert {(-x, y, z) for x, y, z in tips} == tips
    assert len(tips) == len(points - tips) == 4
    fingers = [capsule for capsule in ARM if "finger" in capsule.name]
    bar = [capsule for capsule in ARM if capsule.name == "camera bar"]
    for some, by in ((tips, fingers), (points - tips, bar)):
        off_mm = np.min([depth_mm(np.array(list(some)), capsule) for capsule in by], axis=0)
        assert off_mm.max() < 5.0, "beside what stands for the same"


def test_the_hand_s_capsules_are_as_far_to_one_side_as_to_the_other():
    of_hand = {(c.link, frozenset((c.from_mm, c.to_mm)), c.radius_mm) for c in ARM if c.link == "tool"}
    assert {(link, frozenset((x, -y, z) for x, y, z in ends), r) for link, ends, r in of_hand} == of_hand
    assert [c.from_mm[1] for c in ARM if "finger" in c.name] == [49.0, -49.0]


@pytest.mark.parametrize(
    ("start", "end", "away"),
    [
        ((-5.0, 20.0, 5.0), (5.0, 40.0, 5.0), np.hypot(5.0, 10.0)),  # leaves, though past a side's plane
        ((5.0, 40.0, 5.0), (-5.0, 20.0, 5.0), np.hypot(5.0, 10.0)),  # comes, and ends before it is nearest
        ((-10.0, 5.0, 12.0), (20.0, 5.0, 12.0), 2.0),  # along a side
        ((15.0, -5.0, 5.0), (25.0, 5.0, 5.0), np.hypot(5.0, 5.0)),  # nearest is an end
        ((5.0, 25.0, 5.0), (25.0, 5.0, 5.0), np.sqrt(50.0)),  # past an edge
        ((2.0, -10.0, 5.0), (2.0, 20.0, 5.0), -2.0),  # through it, two millimetres under a side
    ],
)
@pytest.mark.parametrize("times", [1.0, 0.01])
def test_the_nearest_of_an_axis_is_found_wherever_on_it_that_is_and_as_well_where_all_is_small(start, end, away, times):
    box = KeepOut("box", (0.0, 0.0, 0.0), (10.0 * times, 10.0 * times, 10.0 * times))
    told = away_mm(times * np.array([[[start, end]]]), np.zeros(1), [box], 100.0)
    assert told[0, 0, 0] == pytest.approx(times * away)


def test_each_capsule_goes_with_its_link():
    joints = np.radians([[20.0, 40.0, -120.0, 30.0, -50.0, 10.0]])
    links = puma560.link_frames(joints)
    of_link: tuple[Link, ...] = ("upper_arm", "forearm", "wrist", "tool")
    capsules = tuple(Capsule(link, link, (1.0, 2.0, 3.0), (4.0, 5.0, 6.0), 7.0) for link in of_link)
    placed = body_of(capsules, ()).placed(links)[0]
    for row, frame in zip(placed[:4], (2, 3, 6, 7), strict=True):
        assert row[0] == pytest.approx((links[0, frame] @ [1.0, 2.0, 3.0, 1.0])[:3])
        assert row[1] == pytest.approx((links[0, frame] @ [4.0, 5.0, 6.0, 1.0])[:3])


def test_the_arm_s_own_capsules_lie_on_their_links_each_beginning_where_the_one_before_ends():
    shoulder, upper, elbow, forearm, wrist = ARM[:5]
    assert shoulder.to_mm == upper.from_mm
    assert elbow.to_mm == forearm.from_mm
    assert upper.to_mm[:2] == elbow.from_mm[:2] == wrist.from_mm[:2] == (0.0, 0.0), "on the axes of joints 3 to 6"
    assert wrist.from_mm == (0.0, 0.0, 0.0), "from where these meet"
    for capsule in ARM[:5]:
        along = np.subtract(capsule.to_mm, capsule.from_mm)
        assert np.count_nonzero(along) == 1, f"{capsule.name} is aslant"


def test_the_forearm_leads_from_the_elbow_to_the_wrist_centre():
    links = puma560.link_frames(np.radians([[20.0, 40.0, -120.0, 30.0, -50.0, 10.0]]))
    forearm = next(capsule for capsule in ARM if capsule.name == "forearm")
    placed = body_of((forearm,), ()).placed(links)[0, 0]
    assert placed[1] == pytest.approx(links[0, 6, :3, 3], abs=0.1)


def depth_mm(points, capsule):
    """(N,): how far (N, 3) points are from a capsule's skin, negative inside."""
    start, way = np.array(capsule.from_mm), np.subtract(capsule.to_mm, capsule.from_mm)
    share = np.clip((points - start) @ way / max(way @ way, 1e-30), 0.0, 1.0)
    return np.linalg.norm(points - start - share[:, None] * way, axis=1) - capsule.radius_mm


@pytest.mark.parametrize(("mesh", "link"), [("link2", "upper_arm"), ("link3", "forearm")])
def test_nothing_of_the_arm_s_own_shape_is_outside_its_capsules(mesh, link):
    """The shape: the robotics toolbox's mesh, mm in the link's frame; looked at all over its triangles."""
    package = importlib.util.find_spec("rtbdata")
    assert package is not None
    assert package.origin is not None
    text = (Path(package.origin).parent / f"meshes/UNIMATE/puma560/{mesh}.stl").read_text()
    lines = [line.split()[1:] for line in text.splitlines() if line.split()[:1] == ["vertex"]]
    triangles = 1000.0 * np.array(lines, float).reshape(-1, 3, 3)
    shares = np.random.default_rng(0).dirichlet(np.ones(3), (len(triangles), 30))
    points = np.concatenate([(shares @ triangles).reshape(-1, 3), triangles.reshape(-1, 3)])
    assert np.ptp(points, axis=0).max() > 400.0
    outside = np.min([depth_mm(points, capsule) for capsule in ARM if capsule.link == link], axis=0)
    assert outside.max() < 0.5


def outside_mm(points, links):
    """(N,): how far (N, 3) points of the world are outside of the arm's capsules where its links are (8, 4, 4)."""
    axes = body_of(ARM, ()).placed(links[None])[0, :-1]
    start, way = axes[:, 0], axes[:, 1] - axes[:, 0]
    share = np.einsum("nci,ci->nc", points[:, None] - start, way) / np.einsum("ci,ci->c", way, way)
    nearest = start + np.clip(share, 0.0, 1.0)[..., None] * way
    return (np.linalg.norm(points[:, None] - nearest, axis=-1) - [capsule.radius_mm for capsule in ARM]).min(axis=1)


def test_what_the_motion_monitor_of_the_simulated_cell_watches_of_the_arm_is_within_its_capsules():
    """Palm, camera bar, fingers, wrist, forearm, upper arm, told apart from ours; the tips of the fingers stand as
    points here."""
    rods = [*TRUTH.safety.body, *(rod for rod in finger_rods(TRUTH.gripper) if rod.radius_mm != 2.0)]
    watched = motion_monitor.ArmSpheres(rods, PUMA, np.zeros(6))
    for joints in np.random.default_rng(0).uniform(PUMA.limits_rad[:, 0], PUMA.limits_rad[:, 1], (10, 6)):
        motion: Any = SimpleNamespace(joints_at=lambda _, joints=joints: joints)
        balls, _ = watched.at(motion, np.zeros(1))
        out_mm = outside_mm(balls[0], puma560.link_frames(joints[None], PUMA)[0]) + watched.radii_mm
        assert out_mm.max() < 0.1


def test_all_within_45_mm_of_the_wrist_s_axis_from_the_wrist_centre_to_the_flange_is_within_its_capsules():
    """The flange: 56.25 mm out, as the arm's maker has it."""
    around = np.linspace(0.0, 2.0 * np.pi, 24)
    ring = np.column_stack([45.0 * np.cos(around), 45.0 * np.sin(around), np.zeros(24)])
    wrist = next(capsule for capsule in ARM if capsule.name == "wrist")
    for along_mm in np.linspace(0.0, 56.25, 12):
        assert depth_mm(ring + np.array([0.0, 0.0, along_mm]), wrist).max() < 0.01


def test_the_camera_arm_leads_from_the_palm_to_the_middle_of_the_camera_bar_and_is_as_high_as_that():
    palm, arm, bar = (next(c for c in ARM if c.name == name) for name in ("palm", "camera arm", "camera bar"))
    assert depth_mm(np.array([arm.from_mm]), palm) < 0.0
    assert arm.from_mm[:2] == (0.0, 0.0), "on the hand's own axis"
    assert arm.to_mm == tuple(np.mean([bar.from_mm, bar.to_mm], axis=0))
    assert np.count_nonzero(np.subtract(arm.to_mm, arm.from_mm)) == 1
    heights = [z for x, _, z in BODY_MM if x < -50.0]
    assert (arm.to_mm[2] - arm.radius_mm, arm.to_mm[2] + arm.radius_mm) == (min(heights), max(heights))


def volume(length, radius):
    return np.pi * radius**2 * (length + 4.0 / 3.0 * radius)


def test_of_the_capsules_along_a_part_s_axes_it_gets_the_smallest():
    signs = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    for half in itertools.product((10.0, 12.0, 14.0, 17.0, 20.0, 30.0), repeat=3):
        if len(set(half)) < 3:
            continue  # of sides as long as each other any two axes across do
        found = capsule_around(signs * half, "box")
        length = float(np.linalg.norm(np.subtract(found.to_mm, found.from_mm)))
        each = [volume(2 * a, np.hypot(b, c)) for a, b, c in (half, half[1:] + half[:1], half[2:] + half[:2])]
        assert volume(length, found.radius_mm) == pytest.approx(min(each))


def test_the_capsule_around_a_part_that_narrows_to_its_ends_rounds_them():
    """Tips 100 mm out: the ball of 20 mm that the middle asks for anyway reaches them from 80 mm."""
    ring = [(x, 20.0 * np.cos(a), 20.0 * np.sin(a)) for x in (-60.0, 60.0) for a in np.arange(4) * np.pi / 2]
    found = capsule_around(np.array([(-100.0, 0.0, 0.0), (100.0, 0.0, 0.0), *ring]), "pencil")
    assert sorted([found.from_mm[0], found.to_mm[0]]) == pytest.approx([-80.0, 80.0])
    assert found.radius_mm == pytest.approx(20.0)


@given(points=st.lists(places, min_size=4, max_size=9))
def test_the_capsule_around_a_part_holds_every_corner_and_no_less_than_it_must(points):
    corners = np.array(points, float)
    capsule = capsule_around(corners, "part")
    assert capsule.link == "tool"
    assert depth_mm(corners, capsule).max() < 1e-4  # of a mm: corners nearer than that count as one
    assert capsule.radius_mm <= np.linalg.norm(corners - corners.mean(axis=0), axis=1).max() + 1e-9


def test_what_may_be_held_anyhow_is_as_large_as_the_longest_of_the_parts_is_long_all_along_the_pads():
    rod, cube = np.array([[0.0, 0, 0], [0, 0, 90], [0, 5, 40]]), 20.0 * np.eye(3)
    held = held_anyhow([cube, rod], back_mm=50.0, tip_mm=10.0, width_mm=15.0)
    assert held == Capsule(PERHAPS_HELD, "tool", (0, 0, -50), (0, 0, 10), 97.5)
    assert held_anyhow([], 50.0, 10.0, 15.0) is None


@given(st.integers(0, 10**6))
def test_a_part_is_within_what_may_be_held_however_it_is_gripped(seed):
    """At any point of it, turned in any way: only the tips, or a corner far back, may be between the pads."""
    rng = np.random.default_rng(seed)
    part = rng.uniform(-60, 60, (8, 3))
    held = held_anyhow([part], back_mm=50.0, tip_mm=10.0, width_mm=15.0)
    weights = rng.dirichlet(np.ones(8))
    rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    between = np.array([rng.uniform(-7.5, 7.5), 0.0, rng.uniform(-50.0, 10.0)])
    corners = (part - weights @ part) @ rotation.T + between
    along = np.clip(corners[:, 2], -50.0, 10.0)
    assert held is not None
    assert np.linalg.norm(corners - np.outer(along, [0.0, 0.0, 1.0]), axis=1).max() <= held.radius_mm + 1e-9


def test_the_capsule_around_a_cube_is_little_larger_than_the_cube():
    cube = 20.0 * np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    capsule = capsule_around(cube, "cube")
    assert capsule.radius_mm <= 20.0 * np.sqrt(3.0) + 1e-9
    assert depth_mm(cube, capsule).max() == pytest.approx(0.0, abs=1e-6)


def test_an_arm_of_the_same_lengths_has_the_same_body_and_a_mirrored_one_the_mirrored() -> None:
    usual = puma560.PUMA560
    assert links_like(usual.a2_mm, usual.d3_mm, usual.d4_mm) == ARM_LINKS
    for mirrored, own in zip(links_like(usual.a2_mm, -usual.d3_mm, usual.d4_mm), ARM_LINKS, strict=True):
        aside = -1.0 if own.link == "upper_arm" else 1.0
        assert mirrored.from_mm == pytest.approx((*own.from_mm[:2], aside * own.from_mm[2]))
        assert mirrored.radius_mm == own.radius_mm


@given(st.floats(0.05, 0.95), st.floats(5.0, 150.0), st.floats(0.0, 1.0), st.floats(0.0, 6.28))
def test_nothing_of_a_suction_cup_and_its_tube_is_outside_its_body_nor_its_body_beyond_the_lip(
    of_length: float, length_mm: float, share: float, turn: float
) -> None:
    radius_mm = of_length * length_mm
    body = suction_cup(radius_mm, length_mm)
    palm, cup = body.capsules
    low_mm, high_mm = cup.from_mm[2], cup.to_mm[2]
    height_mm = low_mm + share * (high_mm - low_mm)
    wall = np.array([radius_mm * np.cos(turn), radius_mm * np.sin(turn), height_mm])
    assert _to_axis(wall, np.array([[cup.from_mm, cup.to_mm]]))[0] <= cup.radius_mm + 1e-9
    assert high_mm + cup.radius_mm == pytest.approx(0.0), "its round end stays behind the lip"
    assert low_mm == -length_mm
    assert palm.to_mm[2] + palm.radius_mm >= low_mm, "the tube begins in the palm"
    rim = np.array(body.points_mm)
    np.testing.assert_allclose(np.linalg.norm(rim[:, :2], axis=1), radius_mm)
    assert not rim[:, 2].any()
    np.testing.assert_allclose(rim.mean(axis=0), 0.0, atol=1e-9)


def test_a_shoulder_offset_however_small_is_to_its_own_side():
    for d3_mm in (0.3, -0.3, 0.0):
        upper = next(capsule for capsule in links_like(431.8, d3_mm, 431.8) if capsule.name == "upper arm")
        assert upper.to_mm[2] == pytest.approx(218.5 * d3_mm / 150.05)


@given(st.floats(0.3, 2.0), st.floats(0.3, 2.0), st.floats(0.3, 2.0))
def test_the_links_of_an_arm_of_other_lengths_stay_inside_its_capsules(upper, aside, fore) -> None:
    """From shoulder to elbow in the upper arm's, from elbow to wrist in the forearm's, whatever the proportions."""
    arm = puma560.ArmGeometry(431.8 * upper, 20.3, 150.05 * aside, 431.8 * fore)
    body = body_of((*links_like(arm.a2_mm, arm.d3_mm, arm.d4_mm), *two_fingers().capsules), ())
    links = puma560.link_frames(np.radians([[20.0, 40.0, -70.0, 10.0, 30.0, 5.0]]), arm)
    placed = body.placed(links)[0]
    beside = [name in ("elbow", "forearm") for name in body.names]
    along = np.linspace(puma560.elbow_mm(np.radians([20.0, 40.0, -70.0, 0, 0, 0]), arm), links[0, 6, :3, 3], 20)
    gaps = [_to_axis(point, placed[beside]) - body.radius_mm[beside] for point in along]
    assert max(gap.min() for gap in gaps) < 0.0


def _to_axis(point, axes):
    start, way = axes[:, 0], axes[:, 1] - axes[:, 0]
    share = np.clip(np.einsum("ci,ci->c", point - start, way) / np.einsum("ci,ci->c", way, way), 0.0, 1.0)
    return np.linalg.norm(start + share[:, None] * way - point, axis=1)


@given(st.floats(-180, 180), st.floats(-3, 3), st.floats(-2, 3), st.floats(-3, 3))
def test_points_lie_at_boxes_where_none_is_farther_out_than_asked(heading: float, x: float, y: float, z: float) -> None:
    box = FixtureBox("wall", (-10.0, -2.0, 0.0), (10.0, 2.0, 30.0), (500.0, 20.0, -300.0), heading)
    sine, cosine = np.sin(np.radians(heading)), np.cos(np.radians(heading))
    world_from_box = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    corner = np.array([10.0 + x, 2.0 + y, 30.0 + z])
    points = np.array([[0.0, 0.0, 10.0], corner]) @ world_from_box.T + np.array([500.0, 20.0, -300.0])
    beyond = float(np.linalg.norm(np.maximum([x, y, z], 0.0)))
    out = beyond or max(x, y, z, -2.0)  # the first point lies 2 mm inside
    assert lie_at_boxes(points, (KeepOut("post", (0, 0, 0), (1, 1, 1)), box), out + 0.01)
    assert not lie_at_boxes(points, (KeepOut("post", (0, 0, 0), (1, 1, 1)), box), out - 0.01)
    assert not lie_at_boxes(points, (), 1e9)
