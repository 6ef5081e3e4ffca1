"""`facetctl cameras`: one line and a status for whatever may be wrong; snaps, a listing."""

from __future__ import annotations

import json
import shutil
import socket
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from daemon import ctl
from daemon.cli.cameras import measure
from daemon.store import folders
from drivers.camera.pair import Frame, StereoPair


@pytest.fixture
def config(tmp_path: Path) -> Path:
    """A configuration whose cameras are two recorded pairs."""
    shutil.copytree(folders.HOUSE / "etc", tmp_path / "etc")
    for pair in ("1", "2"):
        for k, camera in enumerate(("left", "right")):
            folder = tmp_path / "etc" / "pairs" / pair
            folder.mkdir(parents=True, exist_ok=True)
            image = np.random.default_rng(k).integers(60, 200, (480, 640), np.uint8)
            cv2.imwrite(str(folder / f"{camera}.png"), image)
    path = tmp_path / "etc" / "facetd.yaml"
    text = path.read_text().replace("cell: real", "cell: recorded")
    path.write_text(text + f"\nfolders: {{state: {tmp_path}/state}}\n")
    return path


def test_a_snap_saves_both_images_and_what_is_known_of_them(config: Path, tmp_path: Path) -> None:
    assert ctl.main(["snap", str(tmp_path / "shot"), "--config", str(config)]) == 0
    said = json.loads((tmp_path / "shot" / "snap.json").read_text())
    assert cv2.imread(str(tmp_path / "shot" / "right.png"), cv2.IMREAD_GRAYSCALE).shape == (480, 640)
    assert said["skew_ms"] == 0.0
    assert {"saturation", "darkness", "half"} <= {finding["name"] for finding in said["health"]}


def test_several_snaps_are_pairs_that_can_be_replayed(config: Path, tmp_path: Path) -> None:
    words = ["snap", str(tmp_path / "shots"), "--count", "2", "--every", "0", "--config", str(config)]
    assert ctl.main(words) == 0
    shutil.rmtree(config.parent / "pairs")
    shutil.copytree(tmp_path / "shots", config.parent / "pairs")
    assert ctl.main(["snap", str(tmp_path / "again"), "--config", str(config)]) == 0


def test_cameras_that_do_not_work_are_one_line_and_status_1(
    config: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.rmtree(config.parent / "pairs")
    assert ctl.main(["snap", str(tmp_path / "shot"), "--config", str(config)]) == 1
    assert "is not a folder" in capsys.readouterr().err
    assert ctl.main(["--json", "cameras", "--seconds", "1", "--config", str(config)]) == 1
    said = json.loads(capsys.readouterr().out)
    assert said["pair"] is None
    assert "is not a folder" in said["trouble"]


def test_a_configuration_that_is_not_there_is_one_line_and_status_2(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert ctl.main(["snap", str(tmp_path), "--config", str(tmp_path / "no.yaml")]) == 2
    assert "no.yaml" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["snap", "x", "--count", "0"], "expected 1 to 100000, found 0"),
        (["snap", "x", "--every", "-1"], "expected 0 or more, found -1"),
        (["cameras", "--seconds", "nan"], "expected 0 or more, found nan"),
        (["stream", "--fps", "0"], "expected 0.1 or more, found 0"),
        (["stream", "--port", "99999"], "expected 0 to 65535, found 99999"),
    ],
)
def test_a_number_that_makes_no_sense_is_refused(
    words: list[str], told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit, match="2"):
        ctl.main(words)
    assert told in capsys.readouterr().err


def test_a_folder_that_cannot_be_and_a_port_that_is_taken_are_one_line_each(
    config: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").touch()
    assert ctl.main(["snap", str(tmp_path / "file"), "--config", str(config)]) == 2
    assert capsys.readouterr().err == f"facetctl snap: {tmp_path}/file: File exists\n"
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        assert ctl.main(["stream", "--port", str(port), "--config", str(config)]) == 2
    told = f"facetctl stream: 127.0.0.1:{port}: Address already in use: choose another --port\n"
    assert capsys.readouterr().err == told


def test_recorded_pairs_go_by_one_a_snap(config: Path, tmp_path: Path) -> None:
    words = ["snap", str(tmp_path / "shots"), "--count", "3", "--every", "0", "--config", str(config)]
    dark = np.zeros((480, 640), np.uint8)
    cv2.imwrite(str(config.parent / "pairs" / "2" / "left.png"), dark)
    assert ctl.main(words) == 0
    shots = [cv2.imread(str(tmp_path / f"shots/{k}/left.png"), cv2.IMREAD_GRAYSCALE) for k in (1, 2, 3)]
    assert [bool(shot.any()) for shot in shots] == [True, False, True]


class Steady:
    """A camera that gives a pair every tenth of a second of its own clock, 3 ms apart."""

    now_s = 10.0

    def clock(self) -> float:
        return self.now_s

    def grab(self, not_before_s: float, timeout_s: float) -> StereoPair:
        self.now_s += 0.1
        dark = np.zeros((4, 4), np.uint8)
        return StereoPair(Frame(dark, self.now_s - 0.033, 1), Frame(dark, self.now_s - 0.03, 1))

    def open(self) -> None: ...

    def close(self) -> None: ...

    def describe(self) -> str:
        return "steady"


def test_the_listing_measures_rate_skew_and_age() -> None:
    camera: Any = Steady()
    measured = measure(camera, 1.0, camera.clock)
    assert measured["rate_hz"] == pytest.approx(10.0, rel=0.05)
    assert measured["skew_ms"] == pytest.approx(3.0)
    assert measured["age_ms"] == pytest.approx(30.0)
    assert measured["eyes"] == []
