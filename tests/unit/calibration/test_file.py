"""calibration.yaml: what is read is what was written, and every fault is one line that names file, line and key."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from daemon.calibration.file import Calibration, Quality, load_calibration, same_geometry, save_calibration
from daemon.store.outside import FileError
from daemon.store.yamlfile import ConfigError
from tests.fakes.rigs import rig


def pose(x_mm: float, angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0, s, x_mm], [0, 1, 0, 0], [-s, 0, c, 0], [0, 0, 0, 1]])


def example(hand_eye: bool = True) -> Calibration:
    cameras = rig(centres_px=((322.7, 241.0), (322.7, 241.0)))
    made = datetime(2026, 11, 21, 10, tzinfo=UTC)
    return Calibration(cameras, pose(-75, 0.3) if hand_eye else None, Quality(reprojection_px=0.11, made=made))


@pytest.fixture
def path(tmp_path: Path) -> Path:
    save_calibration(example(), tmp_path / "calibration.yaml")
    return tmp_path / "calibration.yaml"


def break_it(path: Path, old: str, new: str) -> str:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(ConfigError) as caught:
        load_calibration(path)
    message = str(caught.value)
    assert "\n" not in message
    assert message.startswith(str(path))
    return message


@pytest.mark.parametrize(
    "other",
    [
        example(hand_eye=False),
        replace(example(), tool_from_cyclopean=pose(-75.0, 0.3001)),
        replace(example(), tool_from_cyclopean=None, world_from_cyclopean=example().hand_eye),
        replace(example(), rig=rig(centres_px=((322.7, 241.0), (322.7, 241.1)))),
    ],
)
def test_what_an_arm_would_move_by_differs_where_one_number_does(other: Calibration) -> None:
    """A reload tells by it whether the arm stays enabled."""
    later = replace(example(), quality=Quality(reprojection_px=0.2))
    assert same_geometry(example(), later)
    assert not same_geometry(example(), other)
    assert not same_geometry(other, example())


@pytest.mark.parametrize("hand_eye", [True, False])
def test_what_is_read_is_what_was_written(tmp_path: Path, hand_eye: bool) -> None:
    want = example(hand_eye)
    save_calibration(want, tmp_path / "c.yaml")
    got = load_calibration(tmp_path / "c.yaml")
    for camera in ("left", "right"):
        for name in ("matrix", "distortion", "cyclopean_from_camera"):
            assert np.array_equal(getattr(getattr(got.rig, camera), name), getattr(getattr(want.rig, camera), name))
    assert got.rig.image_size == (640, 480)
    assert got.quality == want.quality
    if hand_eye:
        assert got.tool_from_cyclopean is not None
        assert np.array_equal(got.tool_from_cyclopean, want.tool_from_cyclopean)
    else:
        assert got.tool_from_cyclopean is None


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"none\.yaml: cannot be read: No such file"):
        load_calibration(tmp_path / "none.yaml")


def test_a_file_that_is_not_yaml_names_the_line(tmp_path: Path) -> None:
    (tmp_path / "c.yaml").write_text("version: 1\nleft: [1, 2\n")
    with pytest.raises(ConfigError, match=r"c\.yaml:3: not valid YAML"):
        load_calibration(tmp_path / "c.yaml")


@pytest.mark.parametrize(
    ("old", "new", "want"),
    [
        ("version: 1", "version: 2", ":2: version: expected 1, found 2"),
        ("  - [0.0, 0.0, 1.0]", "", "left.camera_matrix: expected 3x3 numbers, found 2x3"),
        ("[640, 480]", "[640]", "image_size: expected [width, height] px, found [640]"),
        ("[640, 480]", "[640, wide]", "image_size[1]: expected a whole number, found 'wide'"),
        ("  distortion:", "  distorsion:", "left.distorsion: unknown key; did you mean `distortion`?"),
        ("- [700.0,", "- [-700.0,", "left.camera_matrix: expected focal lengths above 0"),
        ("- [700.0,", "- [0.0,", "left.camera_matrix: expected focal lengths above 0"),
        ("  - [0.0, 0.0, 1.0]", "  - [0.0, 0.0, 2.0]", "and a last row [0, 0, 1]"),
        ("distortion: [-0.08, ", "distortion: [", "left.distortion: expected 5 numbers k1 k2 p1 p2 k3, found 4"),
        ("distortion: [-0.08, ", "distortion: [.nan, ", "left.distortion: expected 5 numbers"),
        ("- [0.0, 1.0, 0.0, 0.0]", "- [0.0, 1.1, 0.0, 0.0]", "expected a rotation in the 3x3 block"),
        ("- [0.0, 0.0, 0.0, 1.0]", "- [0.0, 0.0, 0.5, 1.0]", "expected a last row [0, 0, 0, 1]"),
        ("-30.0]", "-.inf]", "left.cyclopean_from_camera: expected finite numbers"),
        ("-30.0]", "130.0]", "exchange the two"),
        ("-30.0]", "30.0]", "less than 1 mm apart"),
        ("version: 1", "version: 1\nversion: 1", ":3: version: the key occurs twice"),
    ],
)
def test_each_fault_is_one_line_that_says_where_and_what(path: Path, old: str, new: str, want: str) -> None:
    assert want in break_it(path, old, new)


def test_a_failed_write_leaves_the_old_file(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = path.read_bytes()

    def no_space(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", no_space)
    with pytest.raises(OSError, match="No space"):
        save_calibration(example(hand_eye=False), path)
    assert path.read_bytes() == before
    assert [p.name for p in path.parent.iterdir()] == [path.name]


def test_a_calibration_of_one_camera_is_written_without_a_right_one_and_read_as_its_usual_pair(tmp_path: Path) -> None:
    both = example()
    save_calibration(replace(both, alone="left"), tmp_path / "one.yaml")
    assert "right" not in (tmp_path / "one.yaml").read_text()
    read = load_calibration(tmp_path / "one.yaml")
    assert read.alone == "left"
    assert np.array_equal(read.rig.left.matrix, both.rig.left.matrix)
    assert read.rig.right.matrix is read.rig.left.matrix
    assert read.rig.baseline_mm == pytest.approx(60.0)
    assert np.array_equal(read.rig.right.cyclopean_from_camera[:3, :3], read.rig.left.cyclopean_from_camera[:3, :3])
    assert load_calibration(tmp_path / "one.yaml").tool_from_cyclopean is not None


def fixed() -> Calibration:
    """That of cameras over a table."""
    quality = Quality(hand_eye_mm=0.2, about_mm=(500.0, 0.0, -280.0), arm_mm=0.1, arm_deg=0.02)
    return Calibration(example().rig, None, quality, world_from_cyclopean=pose(500.0, 3.1))


def test_fixed_cameras_are_written_by_their_pose_in_the_world(tmp_path: Path) -> None:
    save_calibration(fixed(), tmp_path / "c.yaml")
    got = load_calibration(tmp_path / "c.yaml")
    assert got.tool_from_cyclopean is None
    assert np.array_equal(got.hand_eye, fixed().world_from_cyclopean)
    assert got.quality == fixed().quality
    assert same_geometry(got, fixed())


def test_the_same_matrix_on_the_hand_and_in_the_world_is_another_geometry() -> None:
    on_hand = replace(fixed(), tool_from_cyclopean=fixed().world_from_cyclopean, world_from_cyclopean=None)
    assert np.array_equal(on_hand.hand_eye, fixed().hand_eye)
    assert not same_geometry(on_hand, fixed())


@pytest.mark.parametrize("name", ["tool_from_cyclopean", "both"])
def test_cameras_are_on_the_hand_or_in_the_world(tmp_path: Path, name: str) -> None:
    path = tmp_path / "c.yaml"
    save_calibration(fixed(), path)
    text = path.read_text()
    whole = text[text.index("  world_from_cyclopean:") : text.index("quality:")]
    twice = whole + whole.replace("world_from", "tool_from")
    path.write_text(text.replace("hand_eye:\n" + whole, "hand_eye: {}\n" if name != "both" else "hand_eye:\n" + twice))
    with pytest.raises(ConfigError, match=r"hand_eye: expected tool_from_cyclopean .* or world_from_cyclopean"):
        load_calibration(path)
