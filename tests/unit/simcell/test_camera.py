"""When simulated frames are exposed, what the sensor adds, and what can go wrong with a camera."""

from __future__ import annotations

import time

import numpy as np
import pytest

from daemon.arrays import Array
from daemon.store import folders
from drivers.camera.pair import CameraError
from drivers.puma560 import READY_RAD, configuration_of
from drivers.rigid import rigid, turn
from drivers.simcell.camera import SimulatedPair, SimulatedScene
from drivers.simcell.cell import SimulatedCell
from drivers.simcell.parts import part_shape
from drivers.simcell.render import RenderedSolid
from drivers.simcell.truth import load_truth

TRUTH = load_truth(folders.HOUSE / "etc" / "simcell.yaml")
OVERHEAD = rigid(turn([1, 0, 0], np.pi), [520.0, 0.0, 100.0])
LOOKING_DOWN = rigid(turn([1, 0, 0], np.pi), [520.0, 0.0, 60.0])


class Clock:
    """A clock that only sleeping moves."""

    def __init__(self) -> None:
        self.now_s = 100.0

    def __call__(self) -> float:
        return self.now_s

    def sleep(self, seconds: float) -> None:
        self.now_s += seconds


def pair_of(speed_mm_s: float = 0.0, time_scale: float = 1.0) -> tuple[SimulatedPair, Clock]:
    """Cameras over a cube, moving along world x."""
    clock = Clock()
    cube = RenderedSolid(part_shape("cube").hull, rigid(np.eye(3), [520.0, 0.0, -275.0]), 0.85)

    def sight(now_s: float) -> SimulatedScene:
        pose: Array = OVERHEAD.copy()
        pose[0, 3] += speed_mm_s * (now_s - 100.0)
        return SimulatedScene(pose, (cube,), 0)

    pair = SimulatedPair(TRUTH, sight, np.random.default_rng(0), time_scale, clock, clock.sleep)
    pair.open()
    return pair, clock


def test_a_pair_is_wholly_exposed_after_the_asked_moment() -> None:
    pair, clock = pair_of()
    for wait_s in (0.0, 0.01, 0.0333, 0.2):
        not_before_s = clock() + wait_s
        got = pair.grab(not_before_s, 1.0)
        half_s = TRUTH.sensor.exposure_s / 2
        assert got.left.taken_s - half_s >= not_before_s - 1e-9
        assert got.right.taken_s + half_s <= clock() + 1e-9, "and it is over when it is delivered"
        assert got.skew_ms == pytest.approx(TRUTH.sensor.skew_s * 1000)


def test_an_old_moment_gives_the_newest_pair_not_the_first_one() -> None:
    pair, clock = pair_of()
    clock.now_s += 5.0
    assert pair.grab(100.0, 1.0).left.taken_s > clock() - 0.05


def test_a_moment_too_far_off_ends_in_one_line_after_the_timeout() -> None:
    pair, clock = pair_of()
    with pytest.raises(CameraError, match=r"no frame within 0\.50 s"):
        pair.grab(clock() + 10.0, 0.5)
    assert clock() == pytest.approx(100.5)


def test_frames_are_grey_of_the_stated_size_and_cannot_be_written_to() -> None:
    frame = pair_of()[0].grab(100.0, 1.0).left
    assert frame.pixels.dtype == np.uint8
    assert frame.pixels.shape == (480, 640)
    with pytest.raises(ValueError, match="read-only"):
        frame.pixels[0, 0] = 0


def test_noise_is_about_two_grey_levels_and_new_in_every_frame() -> None:
    pair, clock = pair_of()
    first = pair.grab(100.0, 1.0).left.pixels.astype(float)
    second = pair.grab(clock(), 1.0).left.pixels.astype(float)
    difference = second - first
    assert abs(difference.mean()) < 0.05
    assert 1.5 < difference.std() / np.sqrt(2) < 2.5


def test_the_right_camera_sees_a_little_less_light() -> None:
    got = pair_of()[0].grab(100.0, 1.0)
    left, right = got.left.pixels.astype(float).mean(), got.right.pixels.astype(float).mean()
    assert 0.93 < right / left < 0.99


def test_a_moving_camera_smears_its_frames() -> None:
    def sharpness(speed_mm_s: float) -> float:
        pixels = pair_of(speed_mm_s)[0].grab(100.0, 1.0).left.pixels.astype(float)
        return float(np.sort(np.abs(np.diff(pixels, axis=1)).ravel())[-300:].mean())

    assert sharpness(500.0) < 0.5 * sharpness(0.0)


def test_a_covered_camera_is_dark_until_it_is_uncovered() -> None:
    pair, clock = pair_of()
    pair.cover("left")
    got = pair.grab(clock(), 1.0)
    assert got.left.pixels.mean() < 8
    assert got.right.pixels.mean() > 30
    pair.cover("left", False)
    assert pair.grab(clock(), 1.0).left.pixels.mean() > 30


def test_a_knocked_camera_sees_everything_shifted_by_the_angle() -> None:
    pair, clock = pair_of()
    before = pair.grab(clock(), 1.0)
    pair.displace("right", [0.2, 0.0, 0.0])
    after = pair.grab(clock(), 1.0)

    def height(pixels: np.ndarray) -> float:
        return float(np.argwhere(pixels > 140)[:, 0].mean())

    expected_px = 700 * np.radians(0.2)
    assert height(after.right.pixels) - height(before.right.pixels) == pytest.approx(expected_px, abs=0.3)
    assert height(after.left.pixels) == pytest.approx(height(before.left.pixels), abs=0.1)


def test_an_unplugged_camera_says_so() -> None:
    pair, clock = pair_of()
    pair.unplug()
    with pytest.raises(CameraError, match="unplugged"):
        pair.grab(clock(), 0.2)
    with pytest.raises(CameraError, match="unplugged"):
        pair.open()
    pair.unplug(False)
    pair.grab(clock(), 1.0)


def test_a_closed_camera_gives_nothing() -> None:
    pair, clock = pair_of()
    pair.close()
    pair.close()
    with pytest.raises(CameraError, match="not open"):
        pair.grab(clock(), 1.0)


def test_frames_come_faster_where_the_cell_lives_faster() -> None:
    pair, _ = pair_of(time_scale=10.0)
    pair.grab(100.0, 1.0)
    numbers = [pair.grab(100.0 + k / 300.0, 1.0).left.sequence for k in range(4)]
    assert numbers == sorted(set(numbers))


def test_light_remembered_from_the_last_frame_is_never_light_of_something_that_has_changed() -> None:
    """Two equal cells go through the same changes; one works all light out anew each time."""
    truth = folders.HOUSE / "etc" / "simcell.yaml"
    changes = (
        lambda cell: cell.scatter(["cube", "pyramid"]),
        lambda cell: cell.world.nudge("cube-1", 3.0, 0.0),
        lambda cell: cell.world.close_hand(cell.world_from_tool()),
        lambda cell: cell.camera.cover("left"),
        lambda cell: cell.camera.cover("left", False),
        lambda cell: cell.camera.displace("left", (0.2, 0.0, 0.0)),
        lambda cell: cell.arm.move_joints(READY_RAD, 1.0, cell.server.now_s() - 100.0),
        lambda cell: cell.show_board(),
        lambda cell: cell.clear(),
    )
    with SimulatedCell(truth, seed=3) as remembering, SimulatedCell(truth, seed=3) as forgetful:
        before = b""
        for cell in (remembering, forgetful):
            began_s = cell.server.now_s() - 100.0
            joints = cell.arm.joints_for(LOOKING_DOWN, configuration_of(READY_RAD), began_s)
            cell.arm.move_joints(joints, 1.0, began_s)
            cell.camera.open()
        for change in changes:
            pictures = []
            for cell in (remembering, forgetful):
                change(cell)
                forgetful.camera._seen.clear()
                pairs = [cell.camera.grab(time.monotonic(), 1.0) for _ in range(2)]
                pictures.append(b"".join(pair.left.pixels.tobytes() + pair.right.pixels.tobytes() for pair in pairs))
            assert pictures[0] == pictures[1]
            assert pictures[0] != before
            before = pictures[0]


def test_a_longer_exposure_gathers_as_much_more_light_in_that_camera_within_what_a_shutter_can() -> None:
    pair, _ = pair_of()
    before = pair.grab(100.0, 1.0)
    assert pair.expose(0.5, 2.0) == (0.5, 2.0)
    after = pair.grab(100.2, 1.0)
    unlit = 4.0  # what the sensor shows without light
    for camera, factor in (("left", 0.5), ("right", 2.0)):
        was, now = (np.median(getattr(got, camera).pixels.astype(float)) - unlit for got in (before, after))
        assert now / was == pytest.approx(factor, rel=0.08)
    assert pair.expose(1e-9, 1.0)[0] == pytest.approx(1 / 32)


def test_a_rolling_shutter_shears_what_moves_and_nothing_else() -> None:
    def shear_px(speed_mm_s: float) -> float:
        """How much farther the cube's lower edges lie from a global shutter's than its upper ones."""
        offs = []
        for fault in (None, "rolling"):
            pair, _ = pair_of(speed_mm_s)
            pair.set_fault("left", fault)
            pixels = pair.grab(100.0, 1.0).left.pixels.astype(float)
            bright = np.maximum(pixels - np.median(pixels) - 20, 0)
            columns = np.arange(pixels.shape[1])
            rows = np.flatnonzero(bright.sum(axis=1) > 500)
            offs.append([float((bright[row] @ columns) / bright[row].sum()) for row in (rows[5], rows[-5])])
        return (offs[1][1] - offs[0][1]) - (offs[1][0] - offs[0][0])

    assert abs(shear_px(0.0)) < 0.5
    assert abs(shear_px(800.0)) > 2.0


@pytest.mark.parametrize("how", ["away", "frozen", "half"])
def test_a_camera_fails_as_it_is_told_and_is_well_again(how: str) -> None:
    pair, clock = pair_of()
    pair.grab(0.0, 1.0)
    pair.set_fault("right", how)  # type: ignore[arg-type]
    clock.now_s += 0.5
    if how == "away":
        with pytest.raises(CameraError, match="right camera unplugged"):
            pair.grab(clock.now_s, 1.0)
        pair.use("left")
        assert pair.grab(clock.now_s, 1.0).left.pixels.any()
        pair.use(None)
    else:
        first = pair.grab(clock.now_s, 1.0)
        now = pair.grab(first.right.taken_s, 1.0)
        assert np.array_equal(first.right.pixels, now.right.pixels) == (how == "frozen")
        assert np.array_equal(now.right.pixels[-1], now.right.pixels[-2]) == (how == "half")
        assert not np.array_equal(first.left.pixels, now.left.pixels)
    pair.set_fault("right", None)
    clock.now_s += 0.5
    first = pair.grab(clock.now_s, 1.0)
    now = pair.grab(first.right.taken_s, 1.0)
    assert not np.array_equal(first.right.pixels, now.right.pixels)
    assert not np.array_equal(now.right.pixels[-1], now.right.pixels[-2])
