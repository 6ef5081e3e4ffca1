"""A cell whose cameras are fixed over the table: what its files must say, and what a pick is set to do there."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from daemon.arm import CAMERAS_ON_HAND, InWorld
from daemon.calibration.file import Calibration, load_calibration
from daemon.cell import sections
from daemon.cell.pick_cell import WORST_MM, pick_cell
from daemon.cell.puma_arm import PumaArm
from daemon.config import Config, load_config
from daemon.pick.settings import Settings
from daemon.store import folders
from daemon.store.yamlfile import ConfigError
from drivers.puma560 import PUMA560

ETC = folders.HOUSE / "etc"


def files(folder: Path, facetd: str | None = None, calibration: str | None = None) -> tuple[Config, Calibration]:
    """The cell of etc/fixed, its facetd.yaml or calibration.yaml changed."""
    shutil.copytree(ETC / "fixed", folder / "fixed")
    for name in ("facets.yaml", "parts.yaml", "calibration.yaml"):
        shutil.copy(ETC / name, folder)
    own = folder / "fixed"
    if facetd is not None:
        (own / "facetd.yaml").write_text(facetd)
    if calibration is not None:
        (own / "calibration.yaml").write_text(calibration)
    config = load_config(own / "facetd.yaml", simulated=True)
    return config, load_calibration(config.calibration)


def changed(old: str, new: str, name: str = "facetd.yaml") -> str:
    text = (ETC / "fixed" / name).read_text()
    assert old in text
    return text.replace(old, new)


def built(config: Config, calibration: Calibration) -> Any:
    hardware: Any = SimpleNamespace(
        robot=SimpleNamespace(kinematics=PumaArm(PUMA560)), cameras=SimpleNamespace(alone=None), clock=None
    )
    return pick_cell(config, calibration, hardware, "log", "compute")  # type: ignore[arg-type]


def test_the_cell_that_comes_with_the_program_is_good(tmp_path: Path) -> None:
    config, calibration = files(tmp_path)
    sections.check(config)
    sections.check_hand_eye(config, calibration)
    assert not list(sections.out_of_reach(config))


def test_a_pick_looks_once_from_home_keeps_out_of_the_cameras_and_counts_the_arm_s_accuracy(tmp_path: Path) -> None:
    config, calibration = files(tmp_path)
    workcell, settings = built(config, calibration)
    assert isinstance(workcell.mounting, InWorld)
    assert np.array_equal(workcell.mounting.out_of_view, config.values.pick.home.pose())
    assert np.array_equal(workcell.mounting.pivot, np.array(calibration.quality.about_mm))
    assert (settings.stops.least_looks, settings.stops.most_looks, settings.views_of_doubtful) == (1, 1, 0)
    assert len((*settings.surveys, *settings.last_surveys)) == 1
    assert not set(CAMERAS_ON_HAND) & set(settings.limits.capsules)
    assert all(x > -50.0 for x, _, _ in settings.limits.body_mm), "no camera is behind the fingers"
    box = settings.limits.keep_out[-1]
    for camera in (calibration.rig.left, calibration.rig.right):
        centre = (workcell.mounting.world_from_cyclopean @ camera.cyclopean_from_camera)[:3, 3]
        assert (centre - 50.0 > box.low_mm).all()
        assert (centre + 50.0 < box.high_mm).all()
    assert settings.doubt.arm_mm == calibration.quality.arm_mm
    assert settings.doubt.arm_deg == calibration.quality.arm_deg


def test_a_calibration_that_does_not_say_how_well_the_arm_is_known_counts_as_the_worst(tmp_path: Path) -> None:
    config, calibration = files(tmp_path)
    silent = replace(calibration, quality=type(calibration.quality)())
    workcell, settings = built(config, silent)
    assert settings.doubt.arm_mm == WORST_MM
    assert np.array_equal(workcell.mounting.pivot, calibration.world_from_cyclopean[:3, 3])


def test_the_arm_s_doubt_is_never_less_than_the_configured_one(tmp_path: Path) -> None:
    config, calibration = files(tmp_path, changed("  verify_mm: 150", "  doubt: {arm_mm: 0.9}\n  verify_mm: 150"))
    assert built(config, calibration)[1].doubt.arm_mm == 0.9


def test_with_cameras_on_the_hand_nothing_of_that_is_so() -> None:
    config = load_config(ETC / "facetd.yaml", simulated=True)
    workcell, settings = built(config, load_calibration(config.calibration))
    assert settings.stops == Settings().stops
    assert set(CAMERAS_ON_HAND) <= set(settings.limits.capsules)
    assert not isinstance(workcell.mounting, InWorld)


@pytest.mark.parametrize(
    ("facetd", "said"),
    [
        (
            changed("  mounting: world  ", "  mounting: hand  "),
            "expected `mounting: world`, as .*calibration.yaml is of",
        ),
        (changed("  mounting: world  ", "  mounting: hnad  "), "mounting"),
        (changed("calibration: calibration.yaml", "calibration: ../calibration.yaml"), "expected `mounting: hand`"),
        (changed("  mounting: world ", "  left: a\n  mounting: world "), "expected two cameras"),
        (
            changed("home: {point_mm: [420, 0, 60]", "home: {point_mm: [520, 0, -150]"),
            "pick.home.*out of the fixed",
        ),
    ],
)
def test_what_does_not_fit_fixed_cameras_is_one_line(tmp_path: Path, facetd: str, said: str) -> None:
    with pytest.raises(ConfigError, match=said) as error:
        sections.check_hand_eye(*files(tmp_path, facetd))
    assert str(error.value).count("\n") == 0


def test_the_simulated_cameras_are_where_the_configuration_says(tmp_path: Path) -> None:
    config, _ = files(tmp_path, changed("  mounting: world  ", "  mounting: hand  "))
    with pytest.raises(ConfigError, match=r"expected `mounting: world`, as .*simcell.yaml has the cameras there"):
        sections.check(config)


def test_places_are_refused_as_nothing_measures_a_part_in_the_gripper(tmp_path: Path) -> None:
    config, calibration = files(tmp_path)
    occupied: Any = SimpleNamespace(places=("one",))
    with pytest.raises(ConfigError, match=r"expected no places in .*places\.yaml"):
        sections.check_hand_eye(replace(config, places=occupied), calibration)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (np.diag([1.0, -1.0, -1.0, 1.0]), "cameras that look down"),
        (np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 560], [0, 0, 0, 1.0]]), "cameras above the table"),
        (np.array([[1, 0, 0, 3000.0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]), "where the arm reaches"),
    ],
)
def test_implausible_fixed_cameras_are_refused(tmp_path: Path, change: Any, said: str) -> None:
    config, calibration = files(tmp_path)
    assert calibration.world_from_cyclopean is not None
    wrong = replace(calibration, world_from_cyclopean=calibration.world_from_cyclopean @ change)
    with pytest.raises(ConfigError, match=f"hand_eye.world_from_cyclopean.*{said}"):
        sections.check_hand_eye(config, wrong)
