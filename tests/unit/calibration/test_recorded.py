"""Pictures of a board on disk: each that cannot serve is named with what is wrong."""

from __future__ import annotations

import argparse
from pathlib import Path

import cv2
import numpy as np
import pytest

from daemon.calibration.board import BoardError
from daemon.calibration.recorded import read_pairs, register, run
from tests.fakes.boards import BOARD, drawn_board


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
