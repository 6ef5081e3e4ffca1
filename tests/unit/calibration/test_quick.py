"""The thesis's calibration by ruler, on cameras whose truth is known."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from msgspec import structs

from daemon import ctl
from daemon.calibration.file import load_calibration
from daemon.calibration.quick import Depth, QuickMeasurements, Width, calibrate_quick
from daemon.vision.geometry.rig import Camera
from tests.fakes.rigs import thesis_rig


def measured(baseline_mm: float = 200.0, depths: bool = True) -> QuickMeasurements:
    rig = thesis_rig()

    def px(camera: Camera, at_mm: float) -> tuple[float, float]:
        u, v = camera.project(np.array([[0.0, 0, at_mm]]))[0]
        return float(u), float(v)

    return QuickMeasurements(
        image_size=(512, 480),
        baseline_mm=baseline_mm,
        fixation_mm=567.0,
        pin_left_px=px(rig.left, 567.0),
        pin_right_px=px(rig.right, 567.0),
        widths=[Width(50.0, z, 760.0 * 50 / z) for z in (500.0, 600.0, 700.0)],
        depths=[Depth(z, px(rig.left, z), px(rig.right, z)) for z in range(480, 720, 40)] if depths else [],
    )


def test_perfect_measurements_give_the_true_cameras_and_the_formula_errs_as_the_thesis_says() -> None:
    result = calibrate_quick(measured())
    assert result.focal_px == pytest.approx(760.0)
    np.testing.assert_allclose(result.rays_mm, 0.0, atol=1e-6)
    assert np.abs(result.formula_mm).max() > 3.0
    inner = slice(1, -1)
    assert np.abs(result.compensated_mm[inner]).max() < 0.35 * np.abs(result.formula_mm).max()


@pytest.mark.parametrize("count", [1, 2, 3])
def test_a_depth_is_mended_by_others_where_there_are_two_others(count: int) -> None:
    """One other says nothing of how the error grows with the distance."""
    every = measured()
    result = calibrate_quick(structs.replace(every, depths=every.depths[:count]))
    assert np.array_equal(result.left_out_mm, result.formula_mm) is (count < 3)


def test_a_baseline_two_percent_off_shows_in_the_depths() -> None:
    result = calibrate_quick(measured(baseline_mm=204.0))
    assert np.abs(result.rays_mm).max() > 1.0


def test_the_command_writes_the_same_kind_of_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    m = measured()
    document = {
        **{k: getattr(m, k) for k in ("image_size", "baseline_mm", "fixation_mm", "pin_left_px", "pin_right_px")},
        "widths": [{"mm": w.mm, "at_mm": w.at_mm, "px": w.px} for w in m.widths],
        "depths": [{"at_mm": d.at_mm, "left_px": d.left_px, "right_px": d.right_px} for d in m.depths],
    }
    (tmp_path / "m.yaml").write_text(json.dumps(document))
    out = tmp_path / "calibration.yaml"
    assert ctl.main(["calibrate", "quick", str(tmp_path / "m.yaml"), "--out", str(out), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["rays_rms_mm"] == 0.0
    calibration = load_calibration(out)
    assert calibration.rig.baseline_mm == pytest.approx(200.0)
    assert calibration.quality.method == "quick"


def test_a_missing_measurement_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "m.yaml").write_text("image_size: [512, 480]\nbaseline_mm: 200\nfixation_mm: 0\n")
    assert ctl.main(["calibrate", "quick", str(tmp_path / "m.yaml"), "--out", str(tmp_path / "c.yaml")]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "fixation_mm" in said


def test_one_width_says_nothing_of_how_well_it_is_known_and_nothing_unusable_is_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = (
        "image_size: [512, 480]\nbaseline_mm: 200\nfixation_mm: 567\npin_left_px: [256, 240]\n"
        "pin_right_px: [256, 240]\nwidths: [{mm: 50, at_mm: 500, px: 76}]\n"
    )
    given, out = tmp_path / "measured.yaml", tmp_path / "c.yaml"
    given.write_text(text)
    assert ctl.main(["calibrate", "quick", str(given), "--out", str(out)]) == 0
    assert "focal length 760.0 px" in capsys.readouterr().out
    before = out.read_bytes()
    given.write_text(text.replace("[512, 480]", "[5, 4]"))
    assert ctl.main(["calibrate", "quick", str(given), "--out", str(out)]) == 2
    assert out.read_bytes() == before


def test_the_errors_of_each_depth_are_printed_with_their_means_and_the_line_that_compensates_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    m = measured(baseline_mm=204.0)
    document = {
        **{k: getattr(m, k) for k in ("image_size", "baseline_mm", "fixation_mm", "pin_left_px", "pin_right_px")},
        "widths": [{"mm": w.mm, "at_mm": w.at_mm, "px": w.px} for w in m.widths],
        "depths": [{"at_mm": d.at_mm, "left_px": d.left_px, "right_px": d.right_px} for d in m.depths],
    }
    (tmp_path / "m.yaml").write_text(json.dumps(document))
    words = ["calibrate", "quick", str(tmp_path / "m.yaml"), "--out", str(tmp_path / "calibration.yaml")]
    assert ctl.main(words) == 0
    result, lines = calibrate_quick(m), capsys.readouterr().out.splitlines()
    columns = result.formula_mm, result.compensated_mm, result.left_out_mm, result.rays_mm
    assert lines[0] == f"focal length {result.focal_px:.1f} +- {result.focal_sigma_px:.1f} px over the widths"
    for k, line in enumerate(lines[3:9]):
        assert [float(word) for word in line.split()] == pytest.approx(
            [480.0 + 40.0 * k, *(errors[k] for errors in columns)], abs=0.006
        )
    shares = [f"{100 * np.mean(np.abs(errors) / result.at_mm):.2f}" for errors in columns]
    assert lines[9].split()[1::2] == shares
    readings = ", ".join(f"[{at:.2f}, {off:.2f}]" for at, off in result.readings_mm)
    assert f"depth_readings_mm: [{readings}]" in lines[11]
    assert ctl.main([*words, "--json"]) == 0
    line = json.loads(capsys.readouterr().out)
    names = ("formula_rms_mm", "compensated_rms_mm", "left_out_rms_mm", "rays_rms_mm")
    rms = [float(np.linalg.norm(errors) / np.sqrt(len(errors))) for errors in columns]
    assert [line[name] for name in names] == pytest.approx(rms, abs=6e-4)
    assert (line["depths"], line["focal_px"]) == (6, round(result.focal_px, 3))
    assert len(list(tmp_path.glob("calibration-*.yaml"))) == 1, "the old one is kept"
