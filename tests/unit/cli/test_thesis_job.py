"""`facetctl thesis silhouettes`: pictures in, categories out."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from daemon import ctl
from tests.fakes.thesis_scenes import OUTLINES, silhouette_picture


def pictures(folder: Path) -> list[str]:
    for name in OUTLINES:
        cv2.imwrite(str(folder / f"{name}.png"), silhouette_picture(name))
    return [str(folder / f"{name}.png") for name in OUTLINES]


def test_objects_are_sorted_and_one_shown_again_keeps_its_category(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = pictures(tmp_path)
    assert ctl.main(["thesis", "silhouettes", *files, files[0], "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {"categories": [1, 2, 3, 4, 1]}


def test_a_pattern_is_shown_as_it_is_learnt(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert ctl.main(["thesis", "silhouettes", pictures(tmp_path)[1], "--show"]) == 0
    first, *rows = capsys.readouterr().out.splitlines()
    assert first.startswith("category 1: ")
    assert len(rows) == 20
    assert all(len(row) == 22 for row in rows)


def test_a_picture_in_which_nothing_stands_out_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    cv2.imwrite(str(tmp_path / "empty.png"), np.full((48, 64), 200, np.uint8))
    assert ctl.main(["thesis", "silhouettes", str(tmp_path / "empty.png")]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "empty.png: silhouette: nothing stands out" in said


@pytest.mark.parametrize("vigilance", ["-0.1", "1.5", "nan", "much"])
def test_a_vigilance_is_a_share(tmp_path: Path, vigilance: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        ctl.main(["thesis", "silhouettes", pictures(tmp_path)[0], f"--vigilance={vigilance}"])
    assert "expected 0 to 1" in capsys.readouterr().err
