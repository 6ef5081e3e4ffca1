"""Calibrations that went through other tools' files come back the same."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from daemon import ctl, frames
from daemon.calibration.file import Calibration, load_calibration, save_calibration
from daemon.calibration.foreign import InterchangeError, read_foreign
from daemon.calibration.interchange import to_opencv, to_ros
from daemon.vision.geometry.rig import StereoRig
from tests.fakes.rigs import unlike_rig


def assert_same(found: StereoRig, expected: StereoRig) -> None:
    for side in ("left", "right"):
        a, b = getattr(found, side), getattr(expected, side)
        np.testing.assert_allclose(a.matrix, b.matrix)
        np.testing.assert_allclose(a.distortion, b.distortion)
        np.testing.assert_allclose(frames.difference(a.cyclopean_from_camera, b.cyclopean_from_camera), 0, atol=1e-9)
    assert found.image_size == expected.image_size


def rig_in(files: list[Path], size: tuple[int, int] | None = None, **more: Any) -> StereoRig:
    rig = read_foreign(files, size, **more).rig
    assert rig is not None
    return rig


def test_ros_camera_info_comes_back_as_it_went(tmp_path: Path) -> None:
    to_ros(unlike_rig(), tmp_path / "l.yaml", tmp_path / "r.yaml")
    assert_same(rig_in([tmp_path / "l.yaml", tmp_path / "r.yaml"]), unlike_rig())


def test_opencv_file_storage_comes_back_as_it_went(tmp_path: Path) -> None:
    to_opencv(unlike_rig(), tmp_path / "stereo.yml")
    assert_same(rig_in([tmp_path / "stereo.yml"]), unlike_rig())


def test_the_same_eye_given_twice_is_told(tmp_path: Path) -> None:
    to_ros(unlike_rig(), tmp_path / "l.yaml", tmp_path / "r.yaml")
    with pytest.raises(InterchangeError, match="no baseline"):
        rig_in([tmp_path / "l.yaml", tmp_path / "l.yaml"])


def test_a_file_that_is_none_says_so_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "bad.yml").write_text("%YAML:1.0\n---\nM1: 3\n")
    out = tmp_path / "calibration.yaml"
    assert ctl.main(["calibrate", "import", "--opencv", str(tmp_path / "bad.yml"), "--out", str(out)]) == 2
    told = capsys.readouterr().err
    assert told.count("\n") == 1
    assert "M1: expected 9 numbers, found 1" in told
    assert not out.exists()


def test_the_commands_carry_a_calibration_out_and_back(tmp_path: Path) -> None:
    save_calibration(Calibration(unlike_rig()), tmp_path / "c.yaml")
    names = [str(tmp_path / "l.yaml"), str(tmp_path / "r.yaml")]
    assert ctl.main(["calibrate", "export", "--calibration", str(tmp_path / "c.yaml"), "--ros", *names]) == 0
    assert ctl.main(["calibrate", "import", "--ros", *names, "--out", str(tmp_path / "d.yaml")]) == 0
    assert_same(load_calibration(tmp_path / "d.yaml").rig, unlike_rig())


@pytest.mark.parametrize("unit", ["furlong", "0", "-1", "nan"])
def test_a_unit_that_is_none_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str], unit: str) -> None:
    to_opencv(unlike_rig(), tmp_path / "s.yml")
    words = ["calibrate", "import", str(tmp_path / "s.yml"), f"--unit={unit}", "--out", str(tmp_path / "c.yaml")]
    assert ctl.main(words) == 2
    assert "expected mm, cm, inch, m, or a number of mm" in capsys.readouterr().err


@pytest.mark.parametrize("size", ["640", "640xabc", "x480"])
def test_a_size_that_is_none_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str], size: str) -> None:
    to_ros(unlike_rig(), tmp_path / "l.yaml", tmp_path / "r.yaml")
    files = [str(tmp_path / "l.yaml"), str(tmp_path / "r.yaml")]
    assert ctl.main(["calibrate", "import", *files, "--size", size, "--out", str(tmp_path / "c.yaml")]) == 2
    assert "expected WIDTHxHEIGHT, such as 640x480" in capsys.readouterr().err


def test_what_could_not_be_read_again_leaves_the_old_calibration(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Lengths in metres, as many OpenCV files have them: the eyes come out a tenth of a millimetre apart."""
    out, foreign = tmp_path / "c.yaml", tmp_path / "stereo.yml"
    save_calibration(Calibration(unlike_rig()), out)
    before = out.read_bytes()
    to_opencv(unlike_rig(), foreign)
    storage = cv2.FileStorage(str(foreign), cv2.FILE_STORAGE_READ)
    values = {name: storage.getNode(name).mat() for name in ("imageSize", "M1", "D1", "M2", "D2", "R", "T")}
    written = cv2.FileStorage(str(foreign), cv2.FILE_STORAGE_WRITE)
    for name, value in values.items():
        written.write(name, value / 1000 if name == "T" else value)
    written.release()
    assert ctl.main(["calibrate", "import", "--opencv", str(foreign), "--out", str(out)]) == 2
    assert "not written" in (told := capsys.readouterr().err)
    assert "--unit m" in told
    assert out.read_bytes() == before


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [("cols: 4", "cols: 3", "projection_matrix: expected 3x4"), ("cols: 5", "cols: 6", "found 1x6 of 5 numbers")],
)
def test_a_matrix_of_another_size_than_it_must_have_is_named(tmp_path: Path, old: str, new: str, told: str) -> None:
    to_ros(unlike_rig(), tmp_path / "l.yaml", tmp_path / "r.yaml")
    (tmp_path / "r.yaml").write_text((tmp_path / "r.yaml").read_text().replace(old, new))
    with pytest.raises(InterchangeError, match=rf"r\.yaml: .*{told}"):
        rig_in([tmp_path / "l.yaml", tmp_path / "r.yaml"])


def test_a_turn_that_is_no_matrix_is_named(tmp_path: Path) -> None:
    written = cv2.FileStorage(str(tmp_path / "stereo.yml"), cv2.FILE_STORAGE_WRITE)
    for name in ("M1", "M2"):
        written.write(name, np.eye(3))
    for name in ("D1", "D2", "R", "T"):
        written.write(name, np.zeros((3, 1)))
    written.release()
    with pytest.raises(InterchangeError, match=r"stereo\.yml: R: expected 9 numbers, found 3"):
        rig_in([tmp_path / "stereo.yml"], (640, 480))
