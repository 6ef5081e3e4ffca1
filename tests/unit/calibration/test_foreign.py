"""Files of other tools as people have them: each read for what it is, or named for what it is and lacks."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import replace
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
from daemon.calibration.lens_refit import LensError, rays_in_view, refit_lens
from daemon.vision.geometry import StereoRig
from tests.fakes.rigs import unlike_rig
from tests.unit.calibration.test_interchange import assert_same, rig_in


def right_from_left(rig: StereoRig) -> np.ndarray:
    return frames.inverse(rig.right.cyclopean_from_camera) @ rig.left.cyclopean_from_camera


def rows(name: str, matrix: np.ndarray) -> str:
    """As OpenCV's C++ FileStorage writes a matrix in YAML."""
    numbers = ", ".join(repr(float(v)) for v in np.ravel(matrix))
    shape = f"   rows: {len(matrix)}\n   cols: {np.size(matrix) // len(matrix)}\n   dt: d\n"
    return f"{name}: !!opencv-matrix\n{shape}   data: [ {numbers} ]\n"


def storage(names: tuple[str, ...], size: str, rig: StereoRig, **other: np.ndarray) -> str:
    pose = right_from_left(rig)
    values = {
        names[0]: rig.left.matrix, names[1]: rig.left.distortion[None], names[2]: rig.right.matrix,
        names[3]: rig.right.distortion[None], "R": pose[:3, :3], "T": pose[:3, 3:],
        "R1": np.eye(3), "P1": np.eye(3, 4), "Q": np.eye(4), **other,
    }  # fmt: skip
    return f"%YAML:1.0\n---\n{size}" + "".join(rows(name, value) for name, value in values.items())


@pytest.mark.parametrize(
    ("names", "size"),
    [
        (("M1", "D1", "M2", "D2"), "imageSize: [ 640, 480 ]\n"),
        (("K1", "D1", "K2", "D2"), "image_width: 640\nimage_height: 480\n"),
        (("cameraMatrix1", "distCoeffs1", "cameraMatrix2", "distCoeffs2"), "image_Width: 640\nimage_Height: 480\n"),
        (("camera_matrix_left", "dist_coeffs_left", "camera_matrix_right", "dist_coeffs_right"), "size: [640, 480]\n"),
    ],
    ids=lambda value: value[0] if isinstance(value, tuple) else value.split(":")[0],
)
def test_a_file_storage_is_read_as_cpp_programs_write_it(tmp_path: Path, names: tuple[str, ...], size: str) -> None:
    (tmp_path / "s.yml").write_text(storage(names, size, unlike_rig()))
    assert_same(rig_in([tmp_path / "s.yml"]), unlike_rig())


def test_a_file_storage_in_xml_is_read(tmp_path: Path) -> None:
    to_opencv(unlike_rig(), tmp_path / "s.yml")
    source = cv2.FileStorage(str(tmp_path / "s.yml"), cv2.FILE_STORAGE_READ)
    written = cv2.FileStorage(str(tmp_path / "s.xml"), cv2.FILE_STORAGE_WRITE)
    for name in ("M1", "D1", "M2", "D2", "R", "T"):
        written.write(name, source.getNode(name).mat())
    written.startWriteStruct("imageSize", cv2.FILE_NODE_SEQ)
    written.write("", 640)
    written.write("", 480)
    written.endWriteStruct()
    written.release()
    assert_same(rig_in([tmp_path / "s.xml"]), unlike_rig())


def test_a_rotation_that_is_none_is_told_without_a_warning(tmp_path: Path) -> None:
    text = storage(("M1", "D1", "M2", "D2"), "imageSize: [640, 480]\n", unlike_rig(), R=np.zeros((3, 3)))
    (tmp_path / "s.yml").write_text(text)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(InterchangeError, match=r"s\.yml: R: expected a rotation"):
            read_foreign([tmp_path / "s.yml"])


def messages(folder: Path, small: bool) -> list[Path]:
    """Both cameras' camera_info as `ros topic echo` (ROS 1) or `ros2 topic echo` prints it, two messages each."""
    to_ros(unlike_rig(), folder / "l.yaml", folder / "r.yaml")
    for name in ("l.yaml", "r.yaml"):
        file = yaml.safe_load((folder / name).read_text())
        keys = {
            "D": "distortion_coefficients",
            "K": "camera_matrix",
            "R": "rectification_matrix",
            "P": "projection_matrix",
        }
        stamp = {"sec": 5, "nanosec": 8} if small else {"secs": 1600000000, "nsecs": 7}
        message = {
            "header": {"stamp": stamp, "frame_id": "cam"}, "height": 480, "width": 640,
            "distortion_model": "plumb_bob",
            **{key.lower() if small else key: file[name_]["data"] for key, name_ in keys.items()},
            "binning_x": 0, "roi": {"x_offset": 0, "do_rectify": False},
        }  # fmt: skip
        text = yaml.safe_dump(message, sort_keys=False, default_flow_style=None)
        (folder / name).write_text(text + "---\n" + text + "---\n")
    return [folder / "l.yaml", folder / "r.yaml"]


@pytest.mark.parametrize("small", [False, True], ids=["ros1", "ros2"])
def test_a_camera_info_topic_as_it_is_printed_is_read(tmp_path: Path, small: bool) -> None:
    assert_same(rig_in(messages(tmp_path, small)), unlike_rig())


def test_camera_info_in_opencvs_yaml_is_read(tmp_path: Path) -> None:
    to_ros(unlike_rig(), tmp_path / "l.yaml", tmp_path / "r.yaml")
    for path in (tmp_path / "l.yaml", tmp_path / "r.yaml"):
        file = yaml.safe_load(path.read_text())
        text = "%YAML:1.0\n---\nimage_width: 640\nimage_height: 480\ndistortion_model: plumb_bob\n"
        for name in ("camera_matrix", "distortion_coefficients", "rectification_matrix", "projection_matrix"):
            matrix = np.array(file[name]["data"]).reshape(file[name]["rows"], -1)
            text += rows(name, matrix)
        path.write_text(text)
    assert_same(rig_in([tmp_path / "l.yaml", tmp_path / "r.yaml"]), unlike_rig())


def camchain(rig: StereoRig, model: str = "radtan", coefficients: list[float] | None = None) -> dict[str, object]:
    pose = right_from_left(rig)
    pose[:3, 3] /= 1000
    chain: dict[str, dict[str, object]] = {}
    for name, camera in (("cam0", rig.left), ("cam1", rig.right)):
        m = camera.matrix
        chain[name] = {
            "camera_model": "pinhole", "distortion_model": model,
            "distortion_coeffs": coefficients or camera.distortion[:4].tolist(),
            "intrinsics": [float(m[0, 0]), float(m[1, 1]), float(m[0, 2]), float(m[1, 2])],
            "resolution": [640, 480], "rostopic": f"/{name}/image_raw",
        }  # fmt: skip
    chain["cam1"]["T_cn_cnm1"] = pose.tolist()
    return dict(chain)


def test_a_camchain_of_kalibr_is_read(tmp_path: Path) -> None:
    (tmp_path / "camchain.yaml").write_text(yaml.safe_dump(camchain(unlike_rig())))
    assert_same(rig_in([tmp_path / "camchain.yaml"]), unlike_rig())


@pytest.mark.parametrize("rotation", [[0.1, -0.2, 1.5], [np.pi, 0.0, 0.0], [0.0, 2.9, 1.2]])
def test_a_hand_eye_of_easy_handeye_goes_into_the_calibration_that_is_there(
    rotation: list[float], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Also one turned by half a turn, whose qw is 0."""
    out = tmp_path / "calibration.yaml"
    tool_from_left = frames.rigid(frames.rotation_from_vector(np.array(rotation)), np.array([10.0, 60.0, -90.0]))
    axis = np.array(rotation)
    half = np.linalg.norm(axis) / 2
    x, y, z = (float(v) for v in axis / np.linalg.norm(axis) * np.sin(half))
    quaternion = {"qw": 0.0 if half == np.pi / 2 else float(np.cos(half)), "qx": x, "qy": y, "qz": z}
    result = {
        "parameters": {"eye_on_hand": True, "robot_effector_frame": "tool0"},
        "transformation": {**quaternion, "x": 0.010, "y": 0.060, "z": -0.090},
    }
    (tmp_path / "he.yaml").write_text(yaml.safe_dump(result))
    assert ctl.main(["calibrate", "import", str(tmp_path / "he.yaml"), "--out", str(out)]) == 2
    assert "import or calibrate them into this file first" in capsys.readouterr().err
    save_calibration(Calibration(unlike_rig()), out)
    assert ctl.main(["calibrate", "import", str(tmp_path / "he.yaml"), "--out", str(out)]) == 0
    assert "read as easy_handeye result" in capsys.readouterr().out
    found = load_calibration(out)
    assert found.tool_from_cyclopean is not None
    left = found.tool_from_cyclopean @ found.rig.left.cyclopean_from_camera
    np.testing.assert_allclose(left, tool_from_left, atol=1e-9)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("a: 1\nb: 2\n", "not one of ROS camera_info, .*it has a, b"),
        ("[1, 2]\n", "no keys and values"),
        ("cam0: {camera_model: pinhole}\n", "camchain of one camera"),
        ("cam0: {camera_model: omni}\ncam1: {camera_model: omni}\n", "cam0: a omni camera"),
        ("transformation: {x: 1}\nparameters: {}\n", "lacks a quaternion"),
        ("camera_matrix: [1]\ndistortion_coefficients: [0]\navg_reprojection_error: .2\n", "of one camera.* stereo"),
        ("cameraMatrix: [1]\ndistCoeffs: [0]\n", "of one camera.*`calibrate camera` at the console"),
        ("version: 1\nimage_size: [640, 480]\nleft: {}\n", "facetd's own calibration.yaml: name it in files"),
        ("transformation: {x: .inf, y: 0, z: 0, qw: 1, qx: 0, qy: 0, qz: 0}\nparameters: {}\n", "expected 1"),
        ("transformation: {x: 1, y: 0, z: 0, qw: 1.1, qx: 0, qy: 0, qz: 0}\nparameters: {}\n", "expected 1"),
        ("K: [1, 0, 0]\ndistortion_model: plumb_bob\n", "name two files"),
        ("M1: 3\n", "M1: expected 9 numbers"),
    ],
)
def test_what_cannot_be_read_is_named_for_what_it_is(tmp_path: Path, text: str, told: str) -> None:
    (tmp_path / "f.yaml").write_text(text)
    with pytest.raises(InterchangeError, match=told):
        read_foreign([tmp_path / "f.yaml"])


def test_files_of_one_camera_each_are_told_that_their_poses_are_missing(tmp_path: Path) -> None:
    for name in ("l.yml", "r.yml"):
        (tmp_path / name).write_text("%YAML:1.0\n---\n" + rows("cameraMatrix", np.eye(3)) + rows("dist", np.eye(1, 5)))
    with pytest.raises(InterchangeError, match="no file says how the two cameras lie to each other"):
        read_foreign([tmp_path / "l.yml", tmp_path / "r.yml"])


@pytest.mark.parametrize("parameters", [{"eye_on_hand": False}, {"calibration_type": "eye_on_base"}], ids=str)
def test_an_easy_handeye_result_of_fixed_cameras_is_their_pose_in_the_world(
    parameters: dict[str, object], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """And takes the place of a pose on the hand."""
    out, rig = tmp_path / "calibration.yaml", unlike_rig()
    save_calibration(Calibration(rig, frames.rigid(np.eye(3), np.array([0.0, 60.0, -90.0]))), out)
    turn = {"qw": 0.0, "qx": 1.0, "qy": 0.0, "qz": 0.0}  # looks down
    result = {"parameters": parameters, "transformation": {**turn, "x": 0.5, "y": 0.1, "z": 0.7}}
    (tmp_path / "he.yaml").write_text(yaml.safe_dump(result))
    assert ctl.main(["calibrate", "import", str(tmp_path / "he.yaml"), "--out", str(out)]) == 0
    told = capsys.readouterr().out
    assert "of fixed cameras" in told
    assert "WORLD frame" in told
    found = load_calibration(out)
    assert found.fixed
    assert found.world_from_cyclopean is not None
    left = found.world_from_cyclopean @ rig.left.cyclopean_from_camera
    np.testing.assert_allclose(
        left, frames.rigid(np.diag([1.0, -1.0, -1.0]), np.array([500.0, 100.0, 700.0])), atol=1e-9
    )


def test_a_hand_eye_without_a_turn_is_read(tmp_path: Path) -> None:
    (tmp_path / "f.yaml").write_text("transformation: {x: 1, y: 0, z: 0, qw: 1, qx: 0, qy: 0, qz: 0}\nparameters: {}\n")
    found = read_foreign([tmp_path / "f.yaml"]).left
    np.testing.assert_array_equal(found, frames.rigid(np.eye(3), np.array([1000.0, 0.0, 0.0])))


def import_of(tmp_path: Path, rig: StereoRig, *options: str, t_scale: float = 1.0) -> int:
    text = storage(
        ("M1", "D1", "M2", "D2"), f"imageSize: [{rig.image_size[0]}, {rig.image_size[1]}]\n", rig,
        T=right_from_left(rig)[:3, 3:] * t_scale,
    )  # fmt: skip
    (tmp_path / "s.yml").write_text(text)
    return ctl.main(["calibrate", "import", str(tmp_path / "s.yml"), "--out", str(tmp_path / "c.yaml"), *options])


@pytest.mark.parametrize(
    ("scale", "option", "mended"),
    [
        (1e-3, "--unit m", ["--unit", "m"]),
        (1 / 25.4, "--unit inch", ["--unit", "inch"]),
        (1 / 25, "squares", ["--unit", "25"]),
    ],
)
def test_lengths_in_another_unit_are_told_with_the_option_that_mends_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], scale: float, option: str, mended: list[str]
) -> None:
    assert import_of(tmp_path, unlike_rig(), t_scale=scale) == 2
    told = capsys.readouterr().err
    assert "a baseline of" in told
    assert option in told
    assert not (tmp_path / "c.yaml").exists()
    assert import_of(tmp_path, unlike_rig(), *mended, t_scale=scale) == 0
    assert load_calibration(tmp_path / "c.yaml").rig.baseline_mm == pytest.approx(60.0)


def test_ros_files_in_millimetres_are_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    to_ros(unlike_rig(), tmp_path / "l.yaml", tmp_path / "r.yaml")
    right = yaml.safe_load((tmp_path / "r.yaml").read_text())
    right["projection_matrix"]["data"][3] *= 1000
    (tmp_path / "r.yaml").write_text(yaml.safe_dump(right))
    words = [
        "calibrate",
        "import",
        str(tmp_path / "l.yaml"),
        str(tmp_path / "r.yaml"),
        "--out",
        str(tmp_path / "c.yaml"),
    ]
    assert ctl.main(words) == 2
    assert "mm taken for m (--unit mm)" in capsys.readouterr().err
    assert ctl.main([*words, "--unit", "mm"]) == 0


def test_exchanged_cameras_are_told_and_swap_mends_them(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rig = unlike_rig()
    wrong = StereoRig(rig.right, rig.left, rig.image_size)
    assert import_of(tmp_path, wrong) == 2
    assert "--swap" in capsys.readouterr().err
    assert import_of(tmp_path, wrong, "--swap") == 0
    assert_same(load_calibration(tmp_path / "c.yaml").rig, rig)
    to_ros(rig, tmp_path / "l.yaml", tmp_path / "r.yaml")
    with pytest.raises(InterchangeError, match="--swap"):
        read_foreign([tmp_path / "r.yaml", tmp_path / "l.yaml"])
    assert_same(rig_in([tmp_path / "r.yaml", tmp_path / "l.yaml"], exchanged=True), rig)


def test_an_image_size_with_its_sides_exchanged_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rig = unlike_rig()
    assert import_of(tmp_path, StereoRig(rig.left, rig.right, (480, 640))) == 2
    assert "--size 640x480" in capsys.readouterr().err
    assert import_of(tmp_path, StereoRig(rig.left, rig.right, (480, 640)), "--size", "640x480") == 0


def test_what_cameras_that_stayed_would_not_have_changed_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    save_calibration(Calibration(unlike_rig()), tmp_path / "c.yaml")
    assert import_of(tmp_path, unlike_rig(), t_scale=1.5) == 0
    assert "warning: the baseline is 1.5 times what it was" in capsys.readouterr().out


MATRIX, SIZE = np.array([[700.0, 0, 322.0], [0, 702.0, 238.0], [0, 0, 1]]), (640, 480)


def off_px(lens_matrix: np.ndarray, ours: np.ndarray, theirs: np.ndarray) -> float:
    """Largest distance over the image between two pinhole lenses."""
    grid = np.stack(np.meshgrid(np.linspace(-0.45, 0.45, 31), np.linspace(-0.33, 0.33, 25)), axis=-1).reshape(-1, 2)
    points = np.column_stack([grid, np.ones(len(grid))])
    none = np.zeros(3)
    a, b = (cv2.projectPoints(points, none, none, m, d)[0][:, 0] for m, d in ((lens_matrix, ours), (MATRIX, theirs)))
    return float(np.linalg.norm(a - b, axis=1).max())


def test_a_rational_lens_is_refitted_and_its_error_told() -> None:
    theirs = np.array([0.12, -0.05, 4e-4, -3e-4, 0.01, 0.2, -0.03, 0.004])
    lens = refit_lens(MATRIX, theirs, SIZE)
    assert 3e-5 < lens.off_px < 1e-3
    assert off_px(lens.matrix, lens.distortion, theirs) <= lens.off_px * 1.05 + 1e-3


def test_a_mild_fisheye_lens_is_refitted_and_a_strong_one_refused(tmp_path: Path) -> None:
    lens = refit_lens(MATRIX, np.array([0.25, 0.05, 0.0, 0.0]), SIZE, fisheye=True)
    assert 0 < lens.off_px < 0.1
    with pytest.raises(LensError, match=r"the limit is 0\.1"):
        refit_lens(np.array([[210.0, 0, 322], [0, 210, 238], [0, 0, 1]]), np.array([-0.02, 0.003, 0, 0]), SIZE, True)
    chain = camchain(unlike_rig(), "equidistant", [0.25, 0.05, 0.0, 0.0])
    (tmp_path / "chain.yaml").write_text(yaml.safe_dump(chain))
    assert max(read_foreign([tmp_path / "chain.yaml"]).refit_px) < 0.1


def test_four_coefficients_of_a_file_storage_are_read_as_the_file_says_and_never_guessed(tmp_path: Path) -> None:
    """cv::fisheye's are four as well; taken for k1 k2 p1 p2 they bend the image's corners by pixels."""
    rig, four = unlike_rig(), np.array([0.25, 0.05, 0.0, 0.0])
    rig = replace(rig, left=replace(rig.left, distortion=four), right=replace(rig.right, distortion=four))
    text = storage(("M1", "D1", "M2", "D2"), "size: [640, 480]\n", rig)
    file = tmp_path / "s.yml"
    file.write_text(text)
    with pytest.raises(InterchangeError, match=r"s\.yml: four distortion .*add the line `fisheye_model: 0`"):
        read_foreign([file])
    read = {}
    for model in (0, 1):
        file.write_text(text + f"fisheye_model: {model}\n")
        read[model] = read_foreign([file])
    assert np.array_equal(read[0].rig.left.distortion, [*four, 0.0])
    assert read[0].refit_px == (0.0, 0.0)
    assert 0 < min(read[1].refit_px) < 0.1


def test_a_wide_lens_is_judged_as_far_as_the_corners_of_its_image() -> None:
    """They lie 69 degrees off its axis; over the middle half of the image the lens would fit to a thousandth."""
    wide = np.array([[150.0, 0, 322.0], [0, 150.0, 238.0], [0, 0, 1]])
    with pytest.raises(LensError, match=r"off by 0\.\d+ px near the image's corners"):
        refit_lens(wide, np.array([0.1, 0, 0, 0, 0, 0.12, 0, 0]), SIZE)


def test_a_lens_is_judged_by_rays_up_to_its_fold_and_none_beyond() -> None:
    """r - r**3 / 2 is largest at the root of 2/3, which is nearer than this image's corners."""
    rays = np.linalg.norm(rays_in_view(MATRIX, np.array([-0.5, 0, 0, 0, 0]), SIZE, False), axis=1)
    assert rays.max() == pytest.approx(np.sqrt(2 / 3), abs=0.02)
    assert rays.min() < 0.01


def test_a_lens_that_folds_back_within_its_image_is_refused() -> None:
    with pytest.raises(LensError, match="folds back inside the image"):
        refit_lens(MATRIX, np.array([-3.0, 0, 0, 0, 0, 0.1, 0, 0]), SIZE)


@pytest.mark.parametrize("values", [[], [-0.08], [0.1, 0.0, 0.0, 0.0], [0.1, 0, 0, 0, 0, 0, 0, 0], [0.0] * 14])
def test_a_lens_that_is_ours_already_stays_as_it_is(values: list[float]) -> None:
    if len(values) == 1:
        with pytest.raises(LensError, match="1 distortion coefficients"):
            refit_lens(MATRIX, np.array(values), SIZE)
        return
    lens = refit_lens(MATRIX, np.array(values), SIZE)
    assert lens.off_px == 0
    np.testing.assert_array_equal(lens.distortion, ([*values, *[0.0] * 5])[:5])


def edited(path: Path, change: Callable[[Any], object]) -> None:
    """The first document of a file, changed."""
    values = next(yaml.safe_load_all(path.read_text()))
    change(values)
    path.write_text(yaml.safe_dump(values))


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda info: info.pop("K"), r"r\.yaml: ROS camera_info that lacks camera_matrix \(K of the message\)"),
        (lambda info: info.update(K=[1.0] * 8), "camera_matrix: expected 3x3 numbers, found 8"),
        (lambda info: info.update(K="abc"), "camera_matrix: expected numbers, found 'abc'"),
        (lambda info: info.update(K=[float("nan")] * 9), "camera_matrix: expected finite numbers"),
        (lambda info: info.update(K=[]), "camera_matrix: expected finite numbers"),
        (lambda info: info.update(K={"rows": 3, "cols": 2, "data": [0] * 6}), "expected 3x3 numbers, found 3x2 of 6"),
        (lambda info: info.update(K={"rows": 3, "cols": 3, "data": [0] * 8}), "found 3x3 of 8 numbers"),
        (lambda info: info.update(R=[2.0, 0, 0, 0, 1, 0, 0, 0, 1]), "rectification_matrix: expected a rotation"),
        (lambda info: info.update(distortion_model="omni"), "expected one of plumb_bob, .*fisheye, found omni"),
        (lambda info: info.update(width=320), r"image sizes differ: \[\(320, 480\), \(640, 480\)\]"),
        (lambda info: info.pop("height"), "lacks imageSize; give --size WIDTHxHEIGHT"),
        (lambda info: info["P"].__setitem__(3, 0.0), r"no baseline \(P\[0,3\] = 0\): one camera twice"),
    ],
)
def test_what_is_wrong_with_a_camera_info_is_named(tmp_path: Path, change: Callable[[Any], object], told: str) -> None:
    files = messages(tmp_path, small=False)
    edited(files[1], change)
    with pytest.raises(InterchangeError, match=told):
        read_foreign(files)


def test_camera_infos_are_read_in_the_unit_and_size_that_are_given_and_without_distortion_where_they_have_none(
    tmp_path: Path,
) -> None:
    files = messages(tmp_path, small=False)
    for path in files:
        edited(path, lambda info: info.update(D=[], distortion_model=""))
    found = read_foreign(files, (1280, 960), 10.0)
    assert found.kind == "ROS camera_info (no distortion)"
    assert found.rig is not None
    assert found.rig.image_size == (1280, 960)
    assert found.rig.baseline_mm == pytest.approx(60.0 / 1000 * 10.0)
    assert not found.rig.left.distortion.any()
    assert found.refit_px == (0.0, 0.0)


def test_one_camera_info_and_files_of_two_formats_are_told(tmp_path: Path) -> None:
    files = messages(tmp_path, small=False)
    with pytest.raises(InterchangeError, match=r"l\.yaml: camera_info of one camera; name two files"):
        read_foreign(files[:1])
    (tmp_path / "s.yml").write_text(storage(("M1", "D1", "M2", "D2"), "size: [640, 480]\n", unlike_rig()))
    with pytest.raises(InterchangeError, match=r"different formats: .*l\.yaml: camera_info, .*s\.yml: FileStorage"):
        read_foreign([files[0], tmp_path / "s.yml"])


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda chain: chain["cam1"].update(resolution=[320, 240]), r"sizes differ: \[\(640, 480\), \(320, 240\)\]"),
        (lambda chain: chain["cam1"].update(camera_model="omni"), "cam1: a omni camera with radtan: pinhole"),
        (lambda chain: chain["cam0"].update(distortion_model="fov"), "cam0: a pinhole camera with fov"),
        (lambda chain: chain["cam1"].pop("T_cn_cnm1"), "cam1.T_cn_cnm1: expected"),
        (lambda chain: chain["cam1"]["T_cn_cnm1"][0].__setitem__(0, 3.0), "cam1.T_cn_cnm1: expected a rotation"),
        (lambda chain: chain["cam0"].update(intrinsics=[1.0, 2.0, 3.0]), "cam0.intrinsics: expected 1x4 .*found 3"),
        (
            lambda chain: chain["cam0"].update(distortion_model="equidistant", distortion_coeffs=[-9.0, 9.0, 9.0, 9.0]),
            r"c\.yaml: ",
        ),
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_camchain_is_named(tmp_path: Path, change: Callable[[Any], object], told: str) -> None:
    (tmp_path / "c.yaml").write_text(yaml.safe_dump(camchain(unlike_rig())))
    edited(tmp_path / "c.yaml", change)
    with pytest.raises(InterchangeError, match=told):
        read_foreign([tmp_path / "c.yaml"])


def test_a_camchain_whose_right_camera_is_named_first_is_exchanged_and_read_in_its_unit(tmp_path: Path) -> None:
    rig = unlike_rig()
    (tmp_path / "c.yaml").write_text(yaml.safe_dump(camchain(StereoRig(rig.right, rig.left, rig.image_size))))
    assert_same(rig_in([tmp_path / "c.yaml"], exchanged=True), rig)
    assert rig_in([tmp_path / "c.yaml"], exchanged=True, unit_mm=10.0).baseline_mm == pytest.approx(0.6)


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("T: !!", "gone: !!", "OpenCV FileStorage that lacks T"),
        ("size: [640, 480]", "other: 1", "lacks imageSize; give --size WIDTHxHEIGHT"),
        ("size: [640, 480]", "size: [640]", "lacks imageSize"),
        ("   rows: 3\n   cols: 1", "   rows: 2\n   cols: 1", "T: found 2x1 of 3 numbers"),
    ],
)
def test_what_is_wrong_with_a_file_storage_is_named(tmp_path: Path, old: str, new: str, told: str) -> None:
    text = storage(("M1", "D1", "M2", "D2"), "size: [640, 480]\n", unlike_rig())
    assert old in text
    (tmp_path / "s.yml").write_text(text.replace(old, new))
    with pytest.raises(InterchangeError, match=told):
        read_foreign([tmp_path / "s.yml"])


@pytest.mark.parametrize("content", ["<opencv_storage><M1", "<html></html>"])
def test_xml_that_is_no_file_storage_is_told_in_one_line(tmp_path: Path, content: str) -> None:
    (tmp_path / "s.xml").write_text(content)
    with pytest.raises(InterchangeError, match=r"s\.xml: "):
        read_foreign([tmp_path / "s.xml"])
