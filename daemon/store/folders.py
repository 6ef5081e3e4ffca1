"""Where things are when nobody says otherwise: configuration, state, the socket. Paths only; nothing is opened here."""

from __future__ import annotations

import os
import sys
from pathlib import Path

HOUSE = Path(__file__).resolve().parents[2]
"""The checkout or release; where a wheel was installed, the folder of everybody's packages."""
ETC = (Path(__file__).resolve().parents[1] / "etc").resolve()
"""The settings that came with the program: HOUSE's etc/, which a wheel has among its packages."""
INSTALLED_CONFIG = Path("/etc/facetd/facetd.yaml")
INSTALLED_STATE = Path("/var/lib/facetd")
INSTALLED_RUNTIME = Path("/run/facetd")
SOCKET_NAME = "facetd.sock"


def config_file() -> Path:
    """$FACETD_CONFIG, else the installed one where there is one, else the program's own."""
    named = os.environ.get("FACETD_CONFIG")
    if named:
        return Path(named)
    return INSTALLED_CONFIG if INSTALLED_CONFIG.exists() else ETC / "facetd.yaml"


def own_folder() -> Path:
    """What a person's own simulated cell keeps, away from the real one's: nothing taught there is for the real arm."""
    return Path(os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state") / "facetd"


def _beside() -> Path:
    """What is kept where nothing is installed for all: var/ of the checkout; a program from a wheel has none."""
    return HOUSE / "var" if _whole_house() else own_folder()


def _whole_house() -> bool:
    return (HOUSE / "pyproject.toml").is_file()


def state_folder(simulated: bool = False) -> Path:
    """Runs, models and taught views: what systemd says, else the installed place, else var/ of the checkout, else a
    person's own."""
    named = os.environ.get("STATE_DIRECTORY")
    if named:
        return Path(named.split(":")[0])
    if not INSTALLED_STATE.is_dir():
        return _beside()
    return own_folder() if simulated else INSTALLED_STATE


def runtime_folder(simulated: bool = False) -> Path:
    """Where the daemon puts its socket."""
    named = os.environ.get("RUNTIME_DIRECTORY")
    if named:
        return Path(named.split(":")[0])
    if simulated and INSTALLED_STATE.is_dir():
        return own_folder()
    return INSTALLED_RUNTIME if INSTALLED_RUNTIME.is_dir() else _beside()


def socket_candidates() -> list[Path]:
    """Where the operator's tool looks for the daemon, first to last."""
    named = os.environ.get("FACETD_SOCKET")
    if named:
        return [Path(named)]
    other = own_folder() if INSTALLED_STATE.is_dir() else _beside()
    return [INSTALLED_RUNTIME / SOCKET_NAME, other / SOCKET_NAME]


def runs_folder(simulated: bool = False) -> Path:
    """Run folders: $FACETD_RUNS, else runs/ of the state folder."""
    named = os.environ.get("FACETD_RUNS")
    return Path(named) if named else state_folder(simulated) / "runs"


def how_to_add(extra: str) -> str:
    """The command that installs one of the program's extras, here."""
    if not _whole_house():
        return f"{sys.executable} -m pip install 'facetd[{extra}]'"
    if HOUSE.parent.name == "releases":
        return f"sudo {HOUSE.parent.parent}/current/deploy/install.sh extra {extra}"
    return f"make -C {HOUSE} extra-{extra}"
