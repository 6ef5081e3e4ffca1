"""`facetctl train` from drawings: one that cannot be learned keeps no other from being."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from daemon.ctl import main
from daemon.errors import DONE, NOT_UNDERSTOOD
from daemon.store.model import load
from tests.fakes import drawn, rendered

CALIBRATION = rendered.HERE / "calibration-B.yaml"


def trained(folder: Path, *more: str) -> int:
    return main(["train", "--calibration", str(CALIBRATION), "--out", str(folder / "m.npz"), *more])


def test_one_refused_drawing_does_not_end_the_training(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "cube.stl").write_bytes(drawn.binary_stl(*drawn.box()))
    (tmp_path / "gap.obj").write_bytes(drawn.obj(drawn.box()[0], drawn.box()[1][:5]))
    (tmp_path / "inch.obj").write_bytes(drawn.obj(*drawn.box(2, 2, 2)))
    files = (("gap", "gap.obj"), ("inch", "inch.obj"), ("none", "none.stl"), ("cube", "cube.stl"))
    words = [word for label, name in files for word in ("--mesh", f"{label}={tmp_path / name}")]
    assert trained(tmp_path, *words) == NOT_UNDERSTOOD
    assert load(tmp_path / "m.npz").labels == ("cube",)
    out, err = capsys.readouterr()
    assert "1 part from" in out
    refused = err.splitlines()
    assert len(refused) == 3
    assert "gap.obj: not closed" in refused[0]
    assert refused[1].endswith("inch.obj: 2 mm long: is it in mm? give --unit cm, m, inch")
    assert "none.stl: cannot be read" in refused[2]
    assert trained(tmp_path, *words[:6]) == NOT_UNDERSTOOD
    assert "none of 3 drawings can be learned" in capsys.readouterr().err


def test_a_file_whose_name_is_no_utf8_is_learned(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    name = os.fsdecode(os.fsencode(tmp_path) + b"/w\xfcrfel.stl")
    Path(name).write_bytes(drawn.binary_stl(*drawn.box()))
    assert trained(tmp_path, "--mesh", f"cube={name}") == DONE
    assert load(tmp_path / "m.npz").views[0].source.endswith("w?rfel.stl")
    assert capsys.readouterr().err == ""
