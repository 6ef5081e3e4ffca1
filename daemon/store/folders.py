"""Default paths of configuration, state, runs and socket, and the environment variables that override them."""

import contextlib
import os
import sys
from collections.abc import Iterator
from pathlib import Path

from daemon.errors import FacetdError

HOUSE = Path(__file__).resolve().parents[2]
"""The checkout or release; for an installed wheel, the site-packages folder."""
ETC = (Path(__file__).resolve().parents[1] / "etc").resolve()
"""The settings that come with the program: etc/ of the checkout, which a wheel has inside the package."""
INSTALLED_PROGRAM = Path("/usr/lib/facetd")
"""Folder of the program where the Debian package has it (debian/rules)."""
INSTALLED_CONFIG = Path("/etc/facetd/facetd.yaml")
INSTALLED_STATE = Path("/var/lib/facetd")
SIMULATED_STATE = Path("/var/lib/facetd-simulated")
"""State folder of the simulated cell as the service (deploy/simulated.conf)."""
INSTALLED_RUNTIME = Path("/run/facetd")
SOCKET_NAME = "facetd.sock"


def config_file() -> Path:
    """The configuration file: $FACETD_CONFIG, else /etc/facetd/facetd.yaml if it exists, else the program's own."""
    named = os.environ.get("FACETD_CONFIG")
    if named:
        return Path(named)
    return INSTALLED_CONFIG if INSTALLED_CONFIG.exists() else ETC / "facetd.yaml"


def own_folder() -> Path:
    """State folder of a person's own simulated cell: its models are not for the real arm."""
    return Path(os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state") / "facetd"


def _uninstalled_folder() -> Path:
    """State folder where no service is installed: var/ of the checkout, or the person's own for an installed wheel."""
    return HOUSE / "var" if _is_checkout() else own_folder()


def _is_checkout() -> bool:
    return (HOUSE / "pyproject.toml").is_file()


def state_folder(simulated: bool = False) -> Path:
    """Folder of runs, models and taught views: $STATE_DIRECTORY (systemd), else /var/lib/facetd if it exists, else var/
    of the checkout, else the person's own."""
    named = os.environ.get("STATE_DIRECTORY")
    if named:
        return Path(named.split(":")[0])
    if not INSTALLED_STATE.is_dir():
        return _uninstalled_folder()
    return own_folder() if simulated else INSTALLED_STATE


def runtime_folder(simulated: bool = False) -> Path:
    """Folder of the daemon's socket."""
    named = os.environ.get("RUNTIME_DIRECTORY")
    if named:
        return Path(named.split(":")[0])
    if simulated and INSTALLED_STATE.is_dir():
        return own_folder()
    return INSTALLED_RUNTIME if INSTALLED_RUNTIME.is_dir() else _uninstalled_folder()


def socket_candidates() -> list[Path]:
    """Paths of the daemon's socket that facetctl tries, in this order."""
    named = os.environ.get("FACETD_SOCKET")
    if named:
        return [Path(named)]
    other = own_folder() if INSTALLED_STATE.is_dir() else _uninstalled_folder()
    return [INSTALLED_RUNTIME / SOCKET_NAME, other / SOCKET_NAME]


def runs_folder(simulated: bool = False) -> Path:
    """Folder of the run folders: $FACETD_RUNS, else runs/ of the state folder."""
    named = os.environ.get("FACETD_RUNS")
    return Path(named) if named else state_folder(simulated) / "runs"


def state_last_used() -> Path:
    """State folder that facetctl reads: as state_folder; but where a service is installed, that of the newest run among
    the service's, the simulated service's and the person's own."""
    if os.environ.get("STATE_DIRECTORY") or not INSTALLED_STATE.is_dir():
        return state_folder()
    return max((INSTALLED_STATE, SIMULATED_STATE, own_folder()), key=_began_s)


def _began_s(state: Path) -> float:
    """Return when the newest run in a state folder began; 0 where that cannot be seen."""
    try:
        return (state / "runs").stat().st_mtime
    except OSError:
        return 0.0


def runs_last_used() -> Path:
    """Folder of the run folders that facetctl reads: $FACETD_RUNS, else runs/ of the state folder last used."""
    named = os.environ.get("FACETD_RUNS")
    return Path(named) if named else state_last_used() / "runs"


def how_to_add(extra: str) -> str:
    """The command that installs one of the program's extras in this installation."""
    if _is_checkout():
        return f"make -C {HOUSE} extra-{extra}"
    if Path(sys.prefix) == INSTALLED_PROGRAM:
        return f"sudo apt install ./facetd-{extra}_*.deb"
    return f"{sys.executable} -m pip install 'facetd[{extra}]'"


@contextlib.contextmanager
def needing(extra: str, what: str, kind: type[FacetdError] = FacetdError) -> Iterator[None]:
    """Import libraries of an extra in this context: a missing one is an error for people, with how to add it."""
    try:
        yield
    except ImportError:
        raise kind(f"{what}: needs an extra: {how_to_add(extra)}") from None
