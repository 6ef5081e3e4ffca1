"""The power goes at every step of an installation, an upgrade, a rollback: the old or the new runs, never neither."""

from __future__ import annotations

import os
import shutil
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from tests.fakes.installer import DEPLOYED, NEW, NEXT, OLD, SETTINGS, Installer, runs

pytestmark = pytest.mark.skipif(not Path("/usr/bin/truncate").exists(), reason="this machine has no GNU coreutils")


@pytest.fixture(scope="module")
def installer(tmp_path_factory: pytest.TempPathFactory) -> Installer:
    return Installer(tmp_path_factory.mktemp("installer") / "houses")


@pytest.fixture(scope="module")
def before(installer: Installer, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A root with the old release in use."""
    root = tmp_path_factory.mktemp("root") / "old"
    installer.installed(root)
    return root


PARTS = 4
"""In so many tests the steps are tried, so that none takes long."""
MINE = {"facetd.yaml": "# ours\n"}


def test_an_upgrade_that_nothing_disturbs(installer: Installer, before: Path, tmp_path: Path) -> None:
    root = tmp_path / "root"
    shutil.copytree(before, root, symlinks=True)
    done = installer.run(root, "install")
    assert done.returncode == 0, done.stderr
    assert runs(root)
    assert os.readlink(root / "opt/facetd/current") == f"releases/{NEW}"
    assert installer.faults(root, MINE) == []
    assert (root / "etc/facetd/facetd.yaml.new").read_text() == "# facetd.yaml of the new release\n"
    for place, name in DEPLOYED.items():
        new = place != "etc/udev/rules.d/60-facetd.rules"  # that one is its people's
        assert (root / place).read_text().endswith("# new\n" if new else "# old\n"), name
    assert installer.run(root, "rollback").returncode == 0
    assert os.readlink(root / "opt/facetd/current") == f"releases/{OLD}"
    assert runs(root)


@pytest.mark.parametrize("enabled", [True, False])
def test_a_dashboard_that_was_enabled_by_its_old_name_stays_enabled(
    installer: Installer, before: Path, tmp_path: Path, enabled: bool
) -> None:
    root = tmp_path / "root"
    shutil.copytree(before, root, symlinks=True)
    units = root / "etc/systemd/system"
    wants = units / "multi-user.target.wants"
    wants.mkdir()
    (units / "facetd-live.service").write_text("# of a release before\n")
    if enabled:
        (wants / "facetd-live.service").symlink_to("/etc/systemd/system/facetd-live.service")
    assert installer.run(root, "install").returncode == 0
    assert os.path.lexists(wants / "facetd-dashboard.service") is enabled
    assert not os.path.lexists(wants / "facetd-live.service")
    assert (units / "facetd-live.service").is_symlink() is enabled
    assert installer.run(root, "remove").returncode == 0
    assert not [path for path in units.rglob("*") if not path.is_dir()]


def cut(installer: Installer, before: Path | None, root: Path, word: str, step: int) -> list[str]:
    """What is wrong after the power went at a step, and after what people do then."""
    if before is None:
        root.mkdir()
    else:
        shutil.copytree(before, root, symlinks=True)
    installer.run(root, word, now=NEW if word == "install" else NEXT, cut=step)
    found = installer.faults(root, MINE if before else {})
    current = root / "opt/facetd/current"
    if before is not None and not runs(root):
        found.append(f"{os.readlink(current)} is in use and does not run")
    if before is None and current.is_symlink() and not runs(root):
        found.append("what is in use does not run")
    copy = root.with_name(f"{root.name}-back")
    shutil.copytree(root, copy, symlinks=True)
    if before is not None:
        went_back = installer.run(copy, "rollback").returncode == 0
        if not runs(copy):
            found.append(f"after a rollback ({'done' if went_back else 'refused'}) nothing runs")
    again = installer.run(root, "install", now=NEXT)
    if again.returncode != 0 or os.readlink(current) != f"releases/{NEXT}" or not runs(root):
        found.append(f"it cannot be installed again: {again.stderr}")
    found += [f"and then {text}" for text in installer.faults(root, MINE if before else {})]
    if missing := [name for name in SETTINGS if not (root / "etc/facetd" / name).exists()]:
        found.append(f"without {missing}")
    shutil.rmtree(root)
    shutil.rmtree(copy)
    return [f"{word}, step {step}: {text}" for text in found]


def cut_everywhere(
    installer: Installer, before: Path | None, tmp_path: Path, word: str, first: int = 1, every: int = 1
) -> int:
    """Cut at every step there is, or every so many, and after the last; gives how many there are."""
    root = tmp_path / "whole"
    if before is not None:
        shutil.copytree(before, root, symlinks=True)
    assert installer.run(root, word).returncode == 0
    steps = range(first, installer.steps(root) + 2, every)
    with ThreadPoolExecutor(2) as pool:
        work = [pool.submit(cut, installer, before, tmp_path / str(step), word, step) for step in steps]
        assert [text for each in work for text in each.result()] == []
    return installer.steps(root)


@pytest.mark.long
@pytest.mark.parametrize("first", range(1, PARTS + 1))
def test_an_upgrade_is_cut_off_at_every_step(installer: Installer, before: Path, first: int, tmp_path: Path) -> None:
    assert cut_everywhere(installer, before, tmp_path, "install", first, PARTS) >= 50


@pytest.mark.long
@pytest.mark.parametrize("first", range(1, PARTS + 1))
def test_a_first_installation_is_cut_off_at_every_step(installer: Installer, first: int, tmp_path: Path) -> None:
    assert cut_everywhere(installer, None, tmp_path, "install", first, PARTS) >= 50


def test_a_rollback_is_cut_off_at_every_step(installer: Installer, before: Path, tmp_path: Path) -> None:
    upgraded = tmp_path / "upgraded"
    shutil.copytree(before, upgraded, symlinks=True)
    assert installer.run(upgraded, "install").returncode == 0
    assert cut_everywhere(installer, upgraded, tmp_path, "rollback") >= 2
