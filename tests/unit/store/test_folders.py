"""Where things are when nobody says otherwise: what is said wins, then what is installed, then the checkout."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest

from daemon.store import folders

NAMES = ("FACETD_CONFIG", "FACETD_RUNS", "FACETD_SOCKET", "STATE_DIRECTORY", "RUNTIME_DIRECTORY", "XDG_STATE_HOME")


@pytest.fixture(autouse=True)
def nothing_said(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A machine with nothing installed and nothing in the environment."""
    for name in NAMES:
        monkeypatch.delenv(name, raising=False)
    for name in ("INSTALLED_CONFIG", "INSTALLED_STATE", "INSTALLED_RUNTIME", "SIMULATED_STATE"):
        monkeypatch.setattr(folders, name, tmp_path / "installed" / name)
    (tmp_path / "house").mkdir()
    (tmp_path / "house" / "pyproject.toml").touch()
    monkeypatch.setattr(folders, "HOUSE", tmp_path / "house")


def install() -> None:
    for path in (folders.INSTALLED_STATE, folders.INSTALLED_RUNTIME):
        path.mkdir(parents=True)
    folders.INSTALLED_CONFIG.write_text("version: 1\n")


def test_in_a_checkout_all_is_in_the_checkout() -> None:
    assert folders.config_file() == folders.ETC / "facetd.yaml"
    assert folders.state_folder() == folders.runtime_folder() == folders.HOUSE / "var"
    assert folders.state_folder(simulated=True) == folders.HOUSE / "var"
    assert folders.runs_folder() == folders.HOUSE / "var" / "runs"


def test_a_program_from_a_wheel_keeps_nothing_beside_the_packages(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (folders.HOUSE / "pyproject.toml").unlink()
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "mine"))
    assert folders.config_file() == folders.ETC / "facetd.yaml"
    for simulated in (False, True):
        assert folders.state_folder(simulated) == folders.runtime_folder(simulated) == tmp_path / "mine" / "facetd"
    assert folders.how_to_add("dashboard") == f"{sys.executable} -m pip install 'facetd[dashboard]'"


def test_installed_the_real_cell_has_the_installed_places_and_a_simulated_one_a_person_s_own(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    install()
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "mine"))
    assert folders.config_file() == folders.INSTALLED_CONFIG
    assert folders.state_folder() == folders.INSTALLED_STATE
    assert folders.runtime_folder() == folders.INSTALLED_RUNTIME
    assert (
        folders.state_folder(simulated=True) == folders.runtime_folder(simulated=True) == tmp_path / "mine" / "facetd"
    )


def test_what_systemd_or_a_person_says_wins(monkeypatch: pytest.MonkeyPatch) -> None:
    install()
    monkeypatch.setenv("FACETD_CONFIG", "/x/c.yaml")
    monkeypatch.setenv("STATE_DIRECTORY", "/x/state:/x/second")
    monkeypatch.setenv("RUNTIME_DIRECTORY", "/x/run:/x/second")
    assert folders.config_file() == Path("/x/c.yaml")
    assert folders.state_folder() == folders.state_folder(simulated=True) == Path("/x/state")
    assert folders.runtime_folder() == folders.runtime_folder(simulated=True) == Path("/x/run")
    assert folders.runs_folder() == Path("/x/state/runs")
    monkeypatch.setenv("FACETD_RUNS", "/x/runs")
    assert folders.runs_folder() == Path("/x/runs")


def test_the_operator_s_tool_looks_for_the_real_daemon_first_and_then_for_the_simulated_one(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "mine"))
    for simulated in (False, True):
        assert folders.runtime_folder(simulated) / folders.SOCKET_NAME in folders.socket_candidates()
    install()
    for simulated in (False, True):
        assert folders.socket_candidates()[simulated] == folders.runtime_folder(simulated) / folders.SOCKET_NAME
    monkeypatch.setenv("FACETD_SOCKET", "/x/s.sock")
    assert folders.socket_candidates() == [Path("/x/s.sock")]


def begin_run(state: Path, at_s: float) -> None:
    (state / "runs").mkdir(parents=True, exist_ok=True)
    os.utime(state / "runs", (at_s, at_s))


def test_the_latest_run_is_found_whether_the_service_a_simulated_one_or_the_person_made_it(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "mine"))
    assert folders.runs_last_used() == folders.runs_folder()
    install()
    assert folders.runs_last_used() == folders.INSTALLED_STATE / "runs", "none yet"
    for at_s, state in enumerate((folders.INSTALLED_STATE, folders.SIMULATED_STATE, tmp_path / "mine" / "facetd")):
        begin_run(state, 1000.0 + at_s)
        assert folders.state_last_used() == state
        assert folders.runs_last_used() == state / "runs"
    begin_run(folders.INSTALLED_STATE, 2000.0)
    assert folders.state_last_used() == folders.INSTALLED_STATE


def test_what_a_person_says_is_read_whatever_was_used_last(monkeypatch: pytest.MonkeyPatch) -> None:
    install()
    begin_run(folders.SIMULATED_STATE, 1000.0)
    monkeypatch.setenv("STATE_DIRECTORY", "/x/state")
    assert folders.runs_last_used() == Path("/x/state/runs")
    monkeypatch.setenv("FACETD_RUNS", "/x/runs")
    assert folders.runs_last_used() == Path("/x/runs")
