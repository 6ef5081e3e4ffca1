"""facetd.yaml: the one in etc/ is good; every fault is one line with file, line, key path, found and expected."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import msgspec
import pytest

from daemon.arm import ARM, CAMERAS_ON_HAND
from daemon.calibration.file import load_calibration
from daemon.cell import sections
from daemon.cell.puma_arm import PumaArm
from daemon.config import load_config
from daemon.main import main
from daemon.store import folders
from daemon.store.yamlfile import ConfigError
from drivers.puma560 import PUMA560
from tests.fakes.daemon_process import write_own_calibration

ETC = Path(__file__).resolve().parents[2] / "etc"


@pytest.fixture
def path(tmp_path: Path) -> Path:
    for name in ("facetd.yaml", "calibration.yaml", "facets.yaml", "parts.yaml", "simcell.yaml"):
        shutil.copy(ETC / name, tmp_path)
    write_own_calibration(tmp_path)
    return tmp_path / "facetd.yaml"


def refusal(path: Path, text: str) -> str:
    path.write_text(text)
    with pytest.raises(ConfigError) as caught:
        sections.check(load_config(path))
    message = str(caught.value)
    assert "\n" not in message
    assert message.startswith(str(path))
    assert message.count("found") <= 1
    return message.removeprefix(str(path))


def test_the_configuration_that_is_shipped_is_good_and_says_the_defaults(path: Path) -> None:
    config = load_config(path)
    sections.check(config)
    assert config.kind == "real"
    assert load_config(path, simulated=True).kind == "simulated"
    path.write_text("version: 1\ncameras: {left: a, right: b}\n")
    bare = load_config(path)
    room = {name: getattr(config.values.pick.limits, name) for name in ("room_low_mm", "room_high_mm")}
    alike = replace(bare.values.pick, limits=replace(bare.values.pick.limits, **room))  # walls are each cell's own
    assert alike == config.values.pick, "facetd.yaml shows another default than the program has"
    assert bare.values.log == config.values.log
    assert bare.values.health == config.values.health


def test_a_place_that_the_arm_cannot_reach_is_told_before_a_part_is_in_the_hand(
    path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    config = load_config(path)
    assert not list(sections.out_of_reach(config)), "the places that are shipped are reached"
    near = "bin: {point_mm: [250, 410, -150]"
    path.write_text(path.read_text().replace(near, "bin: {point_mm: [880, 640, 900]"))
    assert main(["--check", "--sim", "--config", str(path)]) == 0
    refused = "pick.bin: the arm in its present configuration cannot reach 880, 640, 900 mm at that angle"
    assert refused in capsys.readouterr().err


def test_one_device_for_both_cameras_is_refused_and_pictures_of_another_size_than_calibrated_are_told(
    path: Path,
) -> None:
    """`--check` had called both good, and the first look failed."""
    path.write_text("version: 1\ncameras: {left: /dev/video0, right: /dev/video0}\n")
    with pytest.raises(ConfigError, match=r":2: cameras.right: expected another camera than left's, found the same"):
        sections.check(load_config(path))
    path.write_text("version: 1\ncameras: {left: a, right: b, width: 1280, height: 960}\n")
    config = load_config(path)
    sections.check(config)
    (told,) = sections.of_another_size(config, load_calibration(config.calibration))
    assert "1280x960, cameras.width and height, are not 640x480" in told
    path.write_text("version: 1\ncameras: {left: a, right: b}\n")
    assert not list(sections.of_another_size(load_config(path), load_calibration(config.calibration)))


def test_sections_with_every_key_commented_out_mean_their_defaults(path: Path) -> None:
    path.write_text("version: 1\ncameras: {left: a, right: b}\npick:\n  stops:\nconsole:\nlog:\n")
    assert load_config(path).values.log.quota_mb == 4000


@pytest.mark.parametrize(
    ("text", "want"),
    [
        ("", ": expected keys and values, found an empty file"),
        ("- 1\n", ":1: expected keys and values, found [1]"),
        ("version: 1\nlog: {quota: 3}\n", ":2: log.quota: unknown key; did you mean `quota_mb`?"),
        ("version: 1\nlog:\n  quota_mb: many\n", ":3: log.quota_mb: expected a whole number, found 'many'"),
        ("version: 1\nlog:\n  quota_mb: 0\n", ":3: log.quota_mb: expected a whole number from 1 to 100000000, found 0"),
        ("version: 1\ncell: reel\n", ":2: cell: expected one of real, linuxcnc, recorded, simulated, found 'reel'"),
        ("version: 2\n", ":1: version: expected one of 1, found 2"),
        ("cell: real\n", ":1: the key `version` is missing"),
        ("version: 1\nconsole: {tty: {baud: 9600}}\n", ":2: console.tty: the key `device` is missing"),
        ("version: 1\npick: {order: biggest}\n", ":2: pick.order: expected one of nearest, surest, found 'biggest'"),
        ("version: 1\npick:\n  limits:\n    box_low_mm: [900, 0, 0]\n", ":4: pick.limits.box_low_mm: expected x below"),
        (
            "version: 1\npick:\n  limits:\n    room_high_mm: [9, 9, -2000]\n",
            "limits.room_low_mm: expected z below room_high",
        ),
        ("version: 1\npick: {limits: {max_speed_pct: 200}}\n", "pick.limits.max_speed_pct: expected from 0.1 to 100"),
        ("version: 1\npick: {limits: {table: 3}}\n", ":2: pick.limits.table: unknown key; did you mean `table_z_mm`?"),
        ("version: 1\npick: {home: {point_mm: [1, 2]}}\n", ":2: pick.home.point_mm: expected a list of length 3"),
        ("version: 1\nfiles:\n  calibration: none.yaml\n", ":3: files.calibration: expected a file, found none at"),
        ("version: 1\nmetrics: {port: 80}\n", ":2: metrics.port: expected a whole number from 1024 to 65535, found 80"),
        ("version: 1\ncameras: {fps: 15}\n", ":2: cameras: left: expected a camera, found none"),
        ("version: 1\ncameras: {left: a, right: b, fsp: 15}\n", ":2: cameras.fsp: unknown key; did you mean `fps`?"),
        (
            "version: 1\ncameras: {left: a, right: b, formats: [XYZ]}\n",
            ":2: cameras: formats: expected some of GREY, Y16, YUYV, NV12, MJPEG; found XYZ",
        ),
        ("version: 1\narm:\n  dialect: {boud: 9600}\n", ":3: arm.dialect.boud: unknown key; did you mean `baud`?"),
        ("version: 1\narm: {flange_from_tool: [[1]]}\n", ":2: arm.flange_from_tool: expected a list of length 4"),
        ("version: 1\nversion: 1\n", ":2: version: the key occurs twice"),
        (
            "version: 1\npick:\n  limits: {table_z_mm: -0300}\n",
            ":3: pick.limits.table_z_mm: -0300 is read as -192 (base 8); write the number in plain digits",
        ),
        ("version: 1\nsimulated:\n  time_scale: 1:30\n", ":3: simulated.time_scale: 1:30 is read as 90 (base 60)"),
        ("version: 1\npick: {home: {point_mm: [0100, 0, 0]}}\n", ":2: pick.home.point_mm[0]: 0100 is read as 64"),
        ("version: 1\nlog: [\n", ":3: not valid YAML"),
        ("version: 1\nlog: &a {b: *a}\n", ":2: an anchor that contains itself"),
        ("? [1]\n: 2\n", ":1: expected a word as key"),
        ("a: !!python/object/apply:os.system [ls]\n", "not valid YAML: could not determine a constructor"),
    ],
)
def test_each_fault_names_line_key_found_and_expected(path: Path, text: str, want: str) -> None:
    assert want in refusal(path, text)


def test_numbers_with_zeros_that_mean_what_they_say_are_taken(path: Path) -> None:
    path.write_text("version: 1\nlog: {quota_mb: 1_000, sync_s: 0.50}\nfiles: {parts: 'parts.yaml'}\n")
    log = load_config(path).values.log
    assert (log.quota_mb, log.sync_s) == (1000, 0.5)


def test_a_file_that_is_no_text_is_refused_in_one_line(path: Path) -> None:
    path.write_bytes(b"\xff\xfe\x00version")
    with pytest.raises(ConfigError, match="not a text file"):
        load_config(path)


def test_control_characters_of_the_dialect_are_written_as_in_yaml(path: Path) -> None:
    path.write_text('version: 1\narm: {dialect: {line_end: "\\n\\r"}}\n')
    assert sections.dialect(load_config(path)).line_end == b"\n\r"


def test_check_says_what_is_wrong_in_one_line_and_ends_with_78(
    path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(folders, "INSTALLED_STATE", tmp_path / "none")
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path / "state"))
    assert main(["--config", str(path), "--check"]) == 0
    assert "is good: a real cell" in capsys.readouterr().out
    for name, content in (("calibration.yaml", "version: 1\n"), ("facets.yaml", "{"), ("parts.yaml", "parts: 3\n")):
        good = (tmp_path / name).read_text()
        (tmp_path / name).write_text(content)
        assert main(["--config", str(path), "--check"]) == 78
        error = capsys.readouterr().err
        assert error.count("\n") == 1
        assert f"{tmp_path / name}:" in error
        (tmp_path / name).write_text(good)
    (tmp_path / "state" / "models").mkdir(parents=True)
    (tmp_path / "state" / "models" / "state.json").write_text('{"current": 1}')
    assert main(["--config", str(path), "--check"]) == 78
    assert "0001.npz" in capsys.readouterr().err


def test_check_names_cameras_that_no_rig_could_have(
    path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(folders, "INSTALLED_STATE", tmp_path / "none")
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path / "state"))
    file = tmp_path / "calibration.yaml"
    good = file.read_text()
    for old, new, told in (
        ("image_size: [640, 480]", "image_size: [480, 640]", "--size 640x480"),
        (", 30.0]", ", 3000.0]", "a baseline of 3030 mm"),
    ):
        assert old in good
        file.write_text(good.replace(old, new))
        assert main(["--config", str(path), "--check"]) == 78
        error = capsys.readouterr().err
        assert f"{file}:" in error
        assert told in error


def test_check_tells_of_keys_that_are_gone_and_is_content(path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path.write_text("version: 1\ncameras: {left: a, right: b}\nvision:\n  min_seen: 0.5\n")
    assert main(["--config", str(path), "--check"]) == 0
    told = capsys.readouterr().err
    assert told == f"facetd: {path}:4: vision.min_seen: no longer a key, and ignored: it is fixed now; " + (
        "delete the line\n"
    )


@pytest.mark.parametrize(
    ("section", "camera"), [("{left: a}", "left"), ("{right: a}", "right"), ("{left: a, right: b}", None)]
)
def test_a_cell_with_one_camera_looks_with_that_alone(path: Path, section: str, camera: str | None) -> None:
    path.write_text(f"version: 1\ncameras: {section}\n")
    assert sections.alone(load_config(path)) == camera


def test_a_calibration_of_one_camera_is_refused_where_there_are_two(path: Path) -> None:
    path.write_text("version: 1\ncameras: {left: a, right: b}\n")
    config = load_config(path)
    calibration = replace(load_calibration(config.calibration), alone="left")
    with pytest.raises(ConfigError, match=r":2: cameras: .* is of the left camera alone: name only `left` here"):
        sections.check_hand_eye(config, calibration)


@pytest.mark.parametrize("gripper", ["tip_mm: 60", "opening_mm: 130", "finger_thick_mm: 20"])
def test_a_gripper_longer_or_wider_than_the_hand_that_is_guarded_is_refused_at_the_start(
    path: Path, gripper: str
) -> None:
    usual = [msgspec.to_builtins(capsule) for capsule in ARM[::-1]]
    path.write_text(
        f"version: 1\ncell: recorded\npick: {{gripper: {{{gripper}}}, limits: {{capsules: {json.dumps(usual)}}}}}\n"
    )
    with pytest.raises(ConfigError, match=r"pick\.gripper.*inside the guarded capsules"):
        sections.check(load_config(path))


def test_the_hand_that_is_guarded_is_the_one_that_the_gripper_is_said_to_be(path: Path) -> None:
    path.write_text("version: 1\ncell: simulated\npick: {gripper: {tip_mm: 60, opening_mm: 130}}\n")
    config = load_config(path)
    sections.check(config)
    guard = sections.guarded(config, PumaArm(PUMA560))
    tips = [point for point in guard.body_mm if point[2] == 60.0]
    assert {abs(y) for _, y, _ in tips} == {65.0}
    assert any(capsule.from_mm[1] == 69.0 for capsule in guard.capsules), "as wide as the fingers open"
    assert set(CAMERAS_ON_HAND) <= set(guard.capsules)


@pytest.mark.parametrize(
    ("gripper", "told"),
    [
        ("{kind: suctoin}", ":3: pick.gripper.kind: expected one of fingers, suction, found 'suctoin'"),
        ("{kind: suction, cup_radius_mm: 0}", ":3: pick.gripper.cup_radius_mm: expected above 0 to 5000, found 0"),
        ("{kind: suction, vacuum_bar: 6}", ":3: pick.gripper.vacuum_bar: expected above 0 to 1, found 6"),
        ("{kind: suction, cup_radius: 8}", ":3: pick.gripper.cup_radius: unknown key; did you mean `cup_radius_mm`?"),
        ("{kind: suction, opening_mm: 90}", ":3: pick.gripper.opening_mm: unknown key"),
        ("{cup_radius_mm: 8}", ":3: pick.gripper.cup_radius_mm: unknown key"),
        ("{kind: fingers, opening_mm: wide}", ":3: pick.gripper.opening_mm: expected a number, found 'wide'"),
    ],
)
def test_a_gripper_that_cannot_be_meant_is_refused_in_one_line(path: Path, gripper: str, told: str) -> None:
    assert refusal(path, f"version: 1\ncell: simulated\npick: {{gripper: {gripper}}}\n").startswith(told)


FINGERS, SUCTION = "TwoFingers", "SuctionCup"


@pytest.mark.parametrize(
    ("gripper", "kind"),
    [("", FINGERS), ("{kind: fingers}", FINGERS), ("{friction: 0.3}", FINGERS), ("{kind: suction}", SUCTION)],
)
def test_a_gripper_is_of_the_kind_that_the_file_says_and_has_fingers_where_it_says_none(
    path: Path, gripper: str, kind: str
) -> None:
    path.write_text(f"version: 1\ncell: simulated\npick:\n  gripper: {gripper}\n")
    assert type(load_config(path).values.pick.gripper).__name__ == kind
