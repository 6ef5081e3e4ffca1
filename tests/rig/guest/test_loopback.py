"""In the guest: two real V4L2 devices, fed frames we know. What the driver gives is what was fed, or a clear word."""

from __future__ import annotations

import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import loopback
import numpy as np
import pytest
import yaml

from daemon import ctl
from drivers.camera.pair import CameraError, StereoPair
from drivers.camera.pixels import FORMATS
from drivers.camera.settings import CameraSettings
from drivers.camera.v4l2_stereo import V4L2StereoCamera

FPS = 10.0
CHECKOUT = Path(__file__).resolve().parents[3]
HUNG_S = 15.0
"""Longer than anything takes that does not hang, however slow the machine that emulates this one."""
RANDOM = np.random.default_rng(2).integers(0, 256, (480, 640), np.uint8)
SMOOTH = cv2.GaussianBlur(RANDOM, (0, 0), 8)


def numbered(base: np.ndarray) -> Callable[[int], tuple[np.ndarray, np.ndarray]]:
    """Pictures whose every frame says its number, in a block that survives JPEG."""

    def picture(number: int) -> tuple[np.ndarray, np.ndarray]:
        left = base.copy()
        for bit in range(8):
            left[:16, 16 * bit : 16 * bit + 16] = 255 * (number >> bit & 1)
        return left, 255 - left

    return picture


def number_of(image: np.ndarray) -> int:
    return sum(int(image[8, 16 * bit + 8] > 127) << bit for bit in range(8))


def settings(**more: object) -> CameraSettings:
    return CameraSettings(**({"left": "left", "right": "right", "fps": FPS, "max_skew_ms": 40.0} | more))  # type: ignore[arg-type]


@pytest.fixture(scope="module", autouse=True)
def devices() -> Iterator[None]:
    loopback.load()
    yield
    loopback.modprobe("-r", "v4l2loopback")


@pytest.fixture
def camera() -> Iterator[Callable[..., V4L2StereoCamera]]:
    opened: list[V4L2StereoCamera] = []

    def make(**more: object) -> V4L2StereoCamera:
        opened.append(V4L2StereoCamera(settings(**more)))
        return opened[-1]

    yield make
    for each in opened:
        each.close()


def grab_now(cameras: V4L2StereoCamera, timeout_s: float = 20.0) -> StereoPair:
    return cameras.grab(time.monotonic(), timeout_s)


@pytest.mark.parametrize("code", FORMATS)
def test_what_is_fed_comes_out_bit_for_bit(code: str, camera: Callable[..., V4L2StereoCamera]) -> None:
    picture = numbered(SMOOTH if code == "MJPEG" else RANDOM)
    with loopback.Feeder(picture, code, fps=4.0 if code == "MJPEG" else FPS):
        cameras = camera(formats=(code,), max_skew_ms=80.0)
        for _ in range(2):
            pair = grab_now(cameras)
            for got, fed in zip((pair.left, pair.right), picture(number_of(pair.left.pixels)), strict=True):
                if code == "MJPEG":
                    packed = np.frombuffer(loopback.pack(code, fed), np.uint8)
                    fed = np.asarray(cv2.imdecode(packed, cv2.IMREAD_GRAYSCALE))
                assert np.array_equal(got.pixels, fed)
        assert f"{code} 640x480" in cameras.describe()


def test_a_pair_is_never_older_than_the_moment_asked_for(camera: Callable[..., V4L2StereoCamera]) -> None:
    asked: list[tuple[float, int]] = []
    with loopback.Feeder(numbered(RANDOM), fps=FPS) as feeder:
        cameras = camera()
        for pause_s in (0.0, 0.02, 0.9, 0.05, 0.5):  # long enough for every buffer to fill with old frames, too
            time.sleep(pause_s)
            asked_s = time.monotonic()
            asked.append((asked_s, number_of(grab_now(cameras).left.pixels)))
            assert time.monotonic() - asked_s < HUNG_S
    for asked_s, number in asked:
        assert feeder.written_s[number][0][0] >= asked_s


def test_the_skew_is_the_one_fed_and_too_much_of_it_is_refused(camera: Callable[..., V4L2StereoCamera]) -> None:
    given: list[tuple[float, int]] = []
    with loopback.Feeder(numbered(RANDOM), fps=2.0, delay_s=0.05) as feeder:
        cameras = camera(max_skew_ms=240.0, fps=2.0)
        for _ in range(4):
            pair = grab_now(cameras)
            assert number_of(pair.left.pixels) == number_of(255 - pair.right.pixels)
            given.append((pair.skew_ms, number_of(pair.left.pixels)))
        cameras.close()
        with pytest.raises(CameraError, match=r"ms apart, more than max_skew_ms 20"):
            grab_now(camera(max_skew_ms=20.0, fps=2.0), 4.0)
    for skew_ms, number in given:
        early, late = feeder.written_s[number]
        assert (late[0] - early[1]) * 1000.0 - 0.01 <= skew_ms <= (late[1] - early[0]) * 1000.0 + 0.01


def test_half_a_frame_is_looked_past_and_said(camera: Callable[..., V4L2StereoCamera]) -> None:
    cameras = camera()
    with loopback.Feeder(numbered(RANDOM), fps=FPS) as feeder:
        grab_now(cameras)
        feeder.cut = 1000
        with pytest.raises(CameraError, match=r"left: \d+ damaged frames, the last 306200 of 307200 bytes"):
            grab_now(cameras, 3.0)
        feeder.cut = 0
        grab_now(cameras)


def test_a_feeder_that_stops_is_said_and_one_that_returns_is_taken_up_again(
    camera: Callable[..., V4L2StereoCamera],
) -> None:
    cameras = camera()
    with loopback.Feeder(numbered(RANDOM), fps=FPS):
        grab_now(cameras)
    started_s = time.monotonic()
    with pytest.raises(CameraError, match=r"no frame (any more )?from the left and the right camera"):
        grab_now(cameras, 3.0)
    assert time.monotonic() - started_s < HUNG_S
    with pytest.raises(
        CameraError, match=r"left camera `left` is not there; there is: only /dev/video0, /dev/video1, which capture"
    ):
        grab_now(cameras, 1.0)
    with loopback.Feeder(numbered(RANDOM), fps=FPS):
        assert abs(grab_now(cameras).skew_ms) <= 40


def test_a_module_that_is_removed_and_comes_back_under_other_numbers_is_found_by_name(
    camera: Callable[..., V4L2StereoCamera],
) -> None:
    cameras = camera()
    with loopback.Feeder(numbered(RANDOM), fps=FPS):
        grab_now(cameras)
    with pytest.raises(CameraError):
        grab_now(cameras, 0.5)
    loopback.modprobe("-r", "v4l2loopback")
    with pytest.raises(CameraError, match="is not there"):
        grab_now(cameras, 0.5)
    loopback.load("6,7")
    with loopback.Feeder(numbered(RANDOM), fps=FPS, paths=("/dev/video6", "/dev/video7")):
        grab_now(cameras)
        assert "/dev/video6 `left`" in cameras.describe()
        cameras.close()
    loopback.modprobe("-r", "v4l2loopback")
    loopback.load()


def test_a_user_outside_the_group_video_is_told_so() -> None:
    program = (
        "import os\n"
        "from drivers.camera.settings import CameraSettings\n"
        "from drivers.camera.v4l2_stereo import V4L2StereoCamera\n"
        "os.setgroups([]); os.setgid(65534); os.setuid(65534)\n"
        "V4L2StereoCamera(CameraSettings('/dev/video0', '/dev/video1')).open()\n"
    )
    with loopback.Feeder(numbered(RANDOM), fps=1.0):
        done = subprocess.run([sys.executable, "-c", program], stderr=subprocess.PIPE, text=True, check=False)
    assert "left camera /dev/video0: permission denied: add this user to the group `video`" in done.stderr


def test_a_person_lists_the_cameras_and_saves_what_they_show(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """`facetctl cameras` and `snap`, with the configuration that a cell of these cameras would have."""
    shutil.copytree(CHECKOUT / "etc", tmp_path / "etc")
    config = tmp_path / "etc/facetd.yaml"
    said = yaml.safe_load(config.read_text())
    said["cameras"] |= {"left": "left", "right": "right", "fps": FPS, "max_skew_ms": 80}
    said["folders"] = {"state": str(tmp_path / "state")}
    config.write_text(yaml.safe_dump(said))
    picture, shot = numbered(RANDOM), tmp_path / "shot"
    with loopback.Feeder(picture, fps=FPS):
        assert ctl.main(["cameras", "--seconds", "2", "--config", str(config)]) == 0
        listed = capsys.readouterr().out
        assert ctl.main(["snap", str(shot), "--config", str(config)]) == 0
    print(listed)
    for line in ("/dev/video0  `left`  (v4l2 loopback", "GREY 640x480", "pairs in 2", "skew median ", " 0 damaged"):
        assert line in listed
    left, right = (
        np.asarray(cv2.imread(str(shot / f"{camera}.png"), cv2.IMREAD_UNCHANGED)) for camera in ("left", "right")
    )
    for got, fed in zip((left, right), picture(number_of(left)), strict=True):
        assert np.array_equal(got, fed)
    capsys.readouterr()
    assert ctl.main(["snap", str(shot), "--config", str(config)]) == 1
    told = capsys.readouterr().err
    assert told.startswith("facetctl: left camera `left` is not there; there is: only /dev/video0, /dev/video1")
    assert told.count("\n") == 1


def test_grabbing_at_fifteen_frames_a_second_is_measured(camera: Callable[..., V4L2StereoCamera]) -> None:
    """No limit here: the guest is emulated. The figures are printed for the record."""
    rows = []
    with loopback.Feeder(numbered(RANDOM), fps=15.0):
        cameras = camera(fps=15.0)
        grab_now(cameras)
        began_s, cpu_s = time.monotonic(), time.thread_time()
        while time.monotonic() - began_s < 6.0:
            pair = grab_now(cameras)
            rows.append((pair.skew_ms, (time.monotonic() - pair.right.taken_s) * 1000.0))
        share = (time.thread_time() - cpu_s) / (time.monotonic() - began_s)
        row = cameras.rows()[0]
        counts = ", ".join(f"{row[name]} {name}" for name in ("frames", "dropped", "damaged"))
    skew, age = np.abs(np.array(rows)).T
    with Path("/results/measured").open("a") as lines:
        lines.write(
            f"grabbing at 15 fps, 640x480 GREY: {len(rows)} pairs in 6 s; skew median {np.median(skew):.2f} ms, "
            f"worst {skew.max():.2f} ms; age when given (from mid-exposure) median {np.median(age):.0f} ms, "
            f"worst {age.max():.0f} ms; {share:.1%} of one emulated processor; {counts}\n"
        )
    assert len(rows) >= 10
