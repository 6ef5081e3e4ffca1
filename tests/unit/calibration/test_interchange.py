"""Calibrations that went through other tools' files come back the same."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from daemon import ctl, frames
from daemon.calibration.file import Calibration, load_calibration, save_calibration
from daemon.calibration.interchange import InterchangeError, from_opencv, from_ros, to_opencv, to_ros
from daemon.vision.geometry.rig import StereoRig
from tests.worlds.rigs import unlike_rig


def assert_same(found: StereoRig, expected: StereoRig) -> None:
    for side in ("left", "right"):
        a, b = getattr(found, side), getattr(expected, side)
        np.testing.assert_allclose(a.matrix, b.matrix)
        np.testing.assert_allclose(a.distortion, b.distortion)
        np.testing.assert_allclose(frames.difference(a.cyclopean_from_camera, b.cyclopean_from_camera), 0, atol=1e-9)
    assert found.image_size == expected.image_size


def test_ros_camera_info_comes_back_as_it_went(tmp_path: Path) -> None:
    to_ros(unlike_rig(), tmp_path / "l.yaml", tmp_path / "r.yaml")
    assert_same(from_ros(tmp_path / "l.yaml", tmp_path / "r.yaml"), unlike_rig())


def test_opencv_file_storage_comes_back_as_it_went(tmp_path: Path) -> None:
    to_opencv(unlike_rig(), tmp_path / "stereo.yml")
    assert_same(from_opencv([tmp_path / "stereo.yml"], None), unlike_rig())


def test_the_same_eye_given_twice_is_told(tmp_path: Path) -> None:
    to_ros(unlike_rig(), tmp_path / "l.yaml", tmp_path / "r.yaml")
    with pytest.raises(InterchangeError, match="no baseline"):
        from_ros(tmp_path / "l.yaml", tmp_path / "l.yaml")


def test_a_file_that_is_none_says_so_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "bad.yml").write_text("%YAML:1.0\n---\nM1: 3\n")
    out = tmp_path / "calibration.yaml"
    assert ctl.main(["calibrate", "import", "--opencv", str(tmp_path / "bad.yml"), "--out", str(out)]) == 2
    told = capsys.readouterr().err
    assert told.count("\n") == 1
    assert "lacks M1 D1 M2 D2 R T" in told
    assert not out.exists()


def test_the_commands_carry_a_calibration_out_and_back(tmp_path: Path) -> None:
    save_calibration(Calibration(unlike_rig()), tmp_path / "c.yaml")
    names = [str(tmp_path / "l.yaml"), str(tmp_path / "r.yaml")]
    assert ctl.main(["calibrate", "export", "--calibration", str(tmp_path / "c.yaml"), "--ros", *names]) == 0
    assert ctl.main(["calibrate", "import", "--ros", *names, "--out", str(tmp_path / "d.yaml")]) == 0
    assert_same(load_calibration(tmp_path / "d.yaml").rig, unlike_rig())
