"""Pictures of a board on disk: each that cannot serve is named with what is wrong."""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from daemon.calibration import recorded
from daemon.calibration.board import Board, BoardError
from daemon.calibration.file import Calibration, save_calibration
from daemon.calibration.recorded import read_pairs, register, run
from daemon.calibration.stereo import calibrate_stereo
from tests.fakes.boards import BOARD, drawn_board
from tests.unit.calibration.test_stereo import sights


def test_a_picture_of_another_size_is_named_and_left_out(tmp_path: Path) -> None:
    """A glob that names the pictures names a thumbnail among them, too, and perhaps first."""
    files = []
    for number, scale in enumerate((0.5, 1.0, 1.0)):
        pair = tmp_path / f"left{number}.png", tmp_path / f"right{number}.png"
        for path in pair:
            cv2.imwrite(str(path), cv2.resize(drawn_board(), None, fx=scale, fy=scale))
        files.append(pair)
    pairs, unused, size = read_pairs(files, BOARD)
    assert [pair.name for pair in pairs] == ["left1.png, right1.png", "left2.png, right2.png"]
    assert size == drawn_board().shape[1::-1]
    assert "most are" in unused["left0.png, right0.png"]


def test_a_pair_whose_cameras_share_too_few_corners_is_named_and_left_out(tmp_path: Path) -> None:
    """Of a ChArUco board each camera may see another part."""
    board, square_px = Board(9, 6, 16.0, "charuco"), 40
    whole = np.pad(board.charuco().generateImage((10 * square_px, 7 * square_px)), square_px, constant_values=255)
    whole, files = cv2.GaussianBlur(whole, (0, 0), 0.7), []
    for number, hidden in enumerate((slice(0), slice(6 * square_px, None))):
        files.append((tmp_path / f"left{number}.png", tmp_path / f"right{number}.png"))
        for path, columns in zip(files[-1], (hidden, slice(hidden.stop or 0, 5 * square_px)), strict=True):
            image = whole.copy()
            image[:, columns if number else slice(0)] = 60
            cv2.imwrite(str(path), image)
    pairs, unused, _ = read_pairs(files, board)
    assert [pair.name for pair in pairs] == ["left0.png, right0.png"]
    assert "the cameras share 0 of its corners, 8 are needed" in unused["left1.png, right1.png"]


def test_a_picture_that_cannot_be_read_is_named_with_what_is_wrong(tmp_path: Path) -> None:
    left, right = tmp_path / "left.png", tmp_path / "right.png"
    cv2.imwrite(str(left), drawn_board())
    with pytest.raises(BoardError, match=r"right\.png: cannot be read: No such file or directory"):
        read_pairs([(left, right)], BOARD)
    right.write_bytes(left.read_bytes()[:-20])
    with pytest.raises(BoardError, match=r"right\.png: not an image, or cut short"):
        read_pairs([(left, right)], BOARD)


def test_pairs_that_are_named_alike_in_folders_of_their_own_stay_several(tmp_path: Path) -> None:
    """left.png and right.png in a folder a pair: by their names alone they would all be one."""
    files = []
    for number in range(3):
        (tmp_path / str(number)).mkdir()
        files.append((tmp_path / str(number) / "left.png", tmp_path / str(number) / "right.png"))
        for path in files[-1]:
            cv2.imwrite(str(path), drawn_board() if number else np.full_like(drawn_board(), 90))
    pairs, unused, _ = read_pairs(files, BOARD)
    assert [pair.name for pair in pairs] == [f"{left}, {right}" for left, right in files[1:]]
    assert list(unused) == [f"{files[0][0]}, {files[0][1]}"]


@pytest.mark.parametrize("words", [["--legacy"], ["--dictionary", "DICT_4X4_50"]])
def test_what_belongs_to_a_charuco_board_is_refused_for_another(words: list[str]) -> None:
    parser = argparse.ArgumentParser()
    register(parser.add_subparsers())
    usual = ["stereo", "--board", "9x6", "--square-mm", "10", "--left", "none.png", "--right", "none.png", "--out", "c"]
    with pytest.raises(BoardError, match="add --charuco"):
        run(parser.parse_args([*usual, *words]))
    with pytest.raises(BoardError, match=r"--left none\.png: no such picture"):
        run(parser.parse_args([*usual, "--charuco", *words]))


def test_pictures_that_are_no_pairs_are_refused_with_how_many_there_are_of_each(tmp_path: Path) -> None:
    parser = argparse.ArgumentParser()
    register(parser.add_subparsers())
    for name in ("left0", "left1", "right0"):
        (tmp_path / f"{name}.png").touch()
    here = [f"{side}={tmp_path}/{side[2:]}*.png" for side in ("--left", "--right")]
    with pytest.raises(BoardError, match="--left names 2 pictures and --right 1: name the same number of each"):
        run(parser.parse_args(["stereo", "--board", "9x6", "--square-mm", "10", *here, "--out", "c"]))


def test_what_was_found_is_printed_with_its_errors_and_a_baseline_that_changed_is_told_with_the_square_that_would_agree(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out, result = tmp_path / "c.yaml", calibrate_stereo(sights(3), BOARD, (640, 480))
    monkeypatch.setattr(recorded, "read_pairs", lambda *_: ([], {"l9.png, r9.png": "blurred"}, (640, 480)))
    monkeypatch.setattr(recorded, "calibrate_stereo", lambda *_: result)
    for name in ("l.png", "r.png"):
        (tmp_path / name).touch()
    parser = argparse.ArgumentParser()
    register(parser.add_subparsers())
    pictures = ["--left", str(tmp_path / "l.png"), "--right", str(tmp_path / "r.png"), "--out", str(out)]
    args = parser.parse_args(["stereo", "--board", "9x6", "--square-mm", "10", *pictures])
    for factor, warned in ((None, False), (1.02, False), (1.04, True), (0.96, True)):
        if factor is not None:
            place = result.rig.right.cyclopean_from_camera.copy()
            place[:3, 3] = (
                result.rig.left.cyclopean_from_camera[:3, 3]
                + (place[:3, 3] - result.rig.left.cyclopean_from_camera[:3, 3]) / factor
            )
            before = replace(result.rig, right=replace(result.rig.right, cyclopean_from_camera=place))
            save_calibration(Calibration(before), out)
        assert run(args) == 0
        told = capsys.readouterr().out
        assert ("warning: the baseline is" in told) is warned
        assert not warned or f"x {1 / factor:.3f} would agree" in told
        assert ("the old one is c-" in told) is (factor is not None)
    rig, sigmas = result.rig, result.sigmas
    assert "not used: l9.png, r9.png: blurred" in told
    assert f"{len(result.by_pair)} pairs, corners in {100 * result.coverage:.0f} % of the image" in told
    for name, camera in (("left", rig.left), ("right", rig.right)):
        at = camera.matrix
        assert (
            f"{name:5}  f {at[0, 0]:.2f} +- {sigmas[f'{name}.fx']:.2f} px, centre {at[0, 2]:.2f} {at[1, 2]:.2f}" in told
        )
        assert f"k1 {camera.distortion[0]:+.4f} +- {sigmas[f'{name}.k1']:.4f}" in told
    assert f"baseline {rig.baseline_mm:.3f} +- {sigmas['baseline_mm']:.3f} mm" in told
    args.json = True
    assert run(args) == 0
    line = json.loads(capsys.readouterr().out)
    assert (line["pairs"], line["unused"]) == (12, {"l9.png, r9.png": "blurred"})
    assert line["warning"] is None
    assert line["baseline_mm"] == pytest.approx(rig.baseline_mm, abs=1e-4)


def test_every_option_of_the_command_is_taken() -> None:
    parser = argparse.ArgumentParser()
    register(parser.add_subparsers())
    pictures = ["--left", "l1.png", "l2.png", "--right", "r1.png", "r2.png", "--out", "c.yaml"]
    args = parser.parse_args(["stereo", "--board", "9x6", "--square-mm", "10", *pictures])
    assert (args.board, args.square_mm, args.left, args.right) == (
        "9x6",
        10.0,
        ["l1.png", "l2.png"],
        ["r1.png", "r2.png"],
    )
    assert (args.out, args.charuco, args.dictionary, args.legacy, args.json) == (
        Path("c.yaml"),
        False,
        None,
        False,
        False,
    )
    assert args.run is run
    board = ["--board", "9x6", "--square-mm", "10", "--charuco", "--dictionary", "DICT_4X4_50", "--legacy", "--json"]
    args = parser.parse_args(["stereo", *board, *pictures])
    assert (args.charuco, args.dictionary, args.legacy, args.json) == (True, "DICT_4X4_50", True, True)
    for needed in ("--board", "--square-mm", "--left", "--right", "--out"):
        given = {"--board": ["9x6"], "--square-mm": ["10"], "--left": ["l"], "--right": ["r"], "--out": ["c"]}
        words = [word for name, values in given.items() if name != needed for word in (name, *values)]
        with pytest.raises(SystemExit):
            parser.parse_args(["stereo", *words])


def test_the_line_for_machines_has_each_figure_of_the_result_rounded_and_where_it_was_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made = calibrate_stereo(sights(3), BOARD, (640, 480))
    sigmas = {"left.fx": 0.123456, "baseline_mm": 12345.678}
    result = replace(
        made, stereo_rms_px=0.123456, left_rms_px=0.234567, right_rms_px=0.345678, epipolar_px=0.456789,
        coverage=0.567891, by_pair={"a": 0.111119, "b": 0.2}, dropped={"c": "blurred"}, sigmas=sigmas,
    )  # fmt: skip
    args = argparse.Namespace(json=True, out=tmp_path / "c.yaml")
    recorded._print(args, result, {"d": "no board"}, tmp_path / "old.yaml", "look")
    assert json.loads(capsys.readouterr().out) == {
        "pairs": 2, "stereo_rms_px": 0.1235, "left_rms_px": 0.2346, "right_rms_px": 0.3457, "epipolar_px": 0.4568,
        "baseline_mm": round(made.rig.baseline_mm, 4), "coverage": 0.568, "by_pair": {"a": 0.1111, "b": 0.2},
        "sigmas": {"left.fx": 0.1235, "baseline_mm": 12350.0}, "dropped": {"c": "blurred"}, "unused": {"d": "no board"},
        "warning": "look", "kept": str(tmp_path / "old.yaml"), "out": str(tmp_path / "c.yaml"),
    }  # fmt: skip


def test_the_result_is_printed_for_people_line_by_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    made = calibrate_stereo(sights(3), BOARD, (640, 480))
    result = replace(made, stereo_rms_px=0.1236, epipolar_px=0.4568, coverage=0.567, by_pair={"a": 0.1}, dropped={})
    args = argparse.Namespace(json=False, out=tmp_path / "c.yaml")
    recorded._print(args, result, {}, None, None)
    lines = capsys.readouterr().out.splitlines()
    assert lines[:2] == [
        "1 pairs, corners in 57 % of the image",
        "residual: 0.124 px rms, 0.457 px mean to the epipolar line",
    ]
    assert [line[:5] for line in lines[2:5]] == ["left ", "right", "basel"]
    assert lines[5] == f"written: {tmp_path}/c.yaml"
    assert lines[6].startswith("a residual is not an accuracy: calibrate hand-eye next")
    assert len(lines) == 7
