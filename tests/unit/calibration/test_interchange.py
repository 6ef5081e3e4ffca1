"""Calibrations that went through other tools' files come back the same."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml

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


def test_the_same_camera_given_twice_is_told(tmp_path: Path) -> None:
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


def test_an_export_to_opencv_is_one_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    save_calibration(Calibration(unlike_rig()), tmp_path / "c.yaml")
    export = ["calibrate", "export", "--calibration", str(tmp_path / "c.yaml"), "--opencv", str(tmp_path / "rig.yml")]
    with pytest.raises(SystemExit):
        ctl.main([*export, str(tmp_path / "other.yml")])
    assert not list(tmp_path.glob("*.yml"))
    assert ctl.main(export) == 0
    assert capsys.readouterr().out == f"written: {tmp_path / 'rig.yml'}\n"
    assert_same(rig_in([tmp_path / "rig.yml"]), unlike_rig())


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
    """Lengths in metres, as many OpenCV files have them: the cameras come out a tenth of a millimetre apart."""
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


def imported(tmp_path: Path, *words: str) -> list[str]:
    return ["calibrate", "import", *words, "--out", str(tmp_path / "c.yaml")]


def test_an_import_says_what_it_read_wrote_and_kept(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file, out = tmp_path / "s.yml", tmp_path / "c.yaml"
    to_opencv(unlike_rig(), file)
    rig = unlike_rig()
    focal = f"{rig.left.matrix[0, 0]:.1f} and {rig.right.matrix[0, 0]:.1f} px"
    written = f"{out}: 640x480 px, focal lengths {focal}, baseline {rig.baseline_mm:.2f} mm"
    assert ctl.main(imported(tmp_path, str(file), "--size", "640x480")) == 0
    assert capsys.readouterr().out.splitlines() == [f"{file}: read as OpenCV FileStorage", written]
    assert load_calibration(out).quality.method == "imported"
    save_calibration(Calibration(rig, frames.rigid(np.eye(3), np.array([10.0, 60.0, -90.0]))), out)
    assert ctl.main(imported(tmp_path, "--opencv", str(file), "--size", "640x480")) == 0
    kept = [path.name for path in tmp_path.glob("c-*.yaml")]
    told = capsys.readouterr().out.splitlines()
    assert told == [
        f"{file}: read as OpenCV FileStorage",
        "the old file's hand-eye is of the old cameras and is dropped: run calibrate hand-eye next",
        f"{written}; the old one is {sorted(kept)[-1]}",
    ]
    assert load_calibration(out).tool_from_cyclopean is None


def test_an_import_without_a_file_and_one_of_cameras_that_cannot_be_write_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert ctl.main(imported(tmp_path)) == 2
    assert "no file was named: facetctl calibrate import FILE... --out" in capsys.readouterr().err
    to_ros(unlike_rig(), tmp_path / "l.yaml", tmp_path / "r.yaml")
    assert (
        ctl.main(imported(tmp_path, "--ros", str(tmp_path / "l.yaml"), str(tmp_path / "r.yaml"), "--unit", "mm")) == 2
    )
    assert f"{tmp_path}/l.yaml, {tmp_path}/r.yaml: not written: " in capsys.readouterr().err
    assert not (tmp_path / "c.yaml").exists()


def test_a_lens_that_is_converted_is_told_with_its_error_for_each_camera(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rig = unlike_rig()
    pose = frames.inverse(rig.right.cyclopean_from_camera) @ rig.left.cyclopean_from_camera
    chain = {}
    for name, camera in (("cam0", rig.left), ("cam1", rig.right)):
        m = camera.matrix
        chain[name] = {
            "camera_model": "pinhole", "distortion_model": "equidistant" if name == "cam1" else "none",
            "distortion_coeffs": [0.01, 0.0, 0.0, 0.0] if name == "cam1" else [],
            "intrinsics": [float(m[0, 0]), float(m[1, 1]), float(m[0, 2]), float(m[1, 2])], "resolution": [640, 480],
        }  # fmt: skip
    chain["cam1"]["T_cn_cnm1"] = np.vstack([np.column_stack([pose[:3, :3], pose[:3, 3] / 1000]), [0, 0, 0, 1]]).tolist()
    (tmp_path / "chain.yaml").write_text(yaml.safe_dump(chain))
    assert ctl.main(imported(tmp_path, str(tmp_path / "chain.yaml"))) == 0
    told = capsys.readouterr().out
    off_px = read_foreign([tmp_path / "chain.yaml"]).refit_px
    assert off_px[0] == 0.0 < off_px[1]
    assert f"right camera: lens converted to k1 k2 p1 p2 k3, off by {off_px[1]:.3f} px at most, at the corners" in told
    assert "left camera" not in told


@pytest.mark.parametrize("fixed", [False, True])
def test_a_hand_eye_that_is_read_says_of_which_frame_and_takes_the_others_place(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], fixed: bool
) -> None:
    rig, out = unlike_rig(), tmp_path / "c.yaml"
    other = frames.rigid(np.eye(3), np.array([1.0, 2.0, 3.0]))
    save_calibration(Calibration(rig, *((other, None) if fixed else (None, None))), out)
    pose = {"qw": 1.0, "qx": 0.0, "qy": 0.0, "qz": 0.0, "x": 0.010, "y": 0.060, "z": 0.9 if fixed else -0.09}
    (tmp_path / "he.yaml").write_text(
        yaml.safe_dump({"parameters": {"eye_on_hand": not fixed}, "transformation": pose})
    )
    assert ctl.main(imported(tmp_path, str(tmp_path / "he.yaml"))) == 0
    told, found = capsys.readouterr().out, load_calibration(out)
    assert ("optical frame in the WORLD frame" in told, "optical frame in the TOOL frame" in told) == (fixed, not fixed)
    assert (found.tool_from_cyclopean is None, found.world_from_cyclopean is None) == (fixed, not fixed)
    assert found.quality.method == "imported"
    mounting = found.world_from_cyclopean if fixed else found.tool_from_cyclopean
    assert mounting is not None
    left = (mounting @ rig.left.cyclopean_from_camera)[:3, 3]
    np.testing.assert_allclose(left, [10.0, 60.0, 900.0 if fixed else -90.0], atol=1e-9)
