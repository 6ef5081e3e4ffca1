"""In the guest: the life of the Debian package on a machine with systemd, by apt and without a network.

In the order of a life: install, run the simulated cell as the service, upgrade, lose the power on the way back,
repeat it, remove, purge.
"""

from __future__ import annotations

import hashlib
import os
import signal
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from installed import ETC, SOCKET, run, unit, until, write_down

from daemon.frontends.client import DaemonLink

PACKAGES = Path(os.environ["RIG_PACKAGES"])
NEXT = "99.0.0"
HOME = Path("/usr/lib/facetd")
DROP_INS = Path("/etc/systemd/system/facetd.service.d")
SIMULATED = Path("/var/lib/facetd-simulated")
PATIENCE = "[Service]\nTimeoutStartSec=300\nTimeoutStopSec=60\n"
MINE = "# ours\n"
APT_S = 1200.0
"""So long only on a busy machine; more means that it hangs."""

pytestmark = pytest.mark.timeout(APT_S + 300.0)


def package(version: str) -> str:
    (found,) = (
        path for path in PACKAGES.glob("facetd_*.deb") if (f"_{NEXT}_" in path.name) is (version == NEXT)
    )  # fmt: skip
    return str(found)


def apt(*words: str) -> subprocess.CompletedProcess[str]:
    """Only what lies in files: no list of any index."""
    began_s = time.monotonic()
    quiet = ["-o", "Dir::State::lists=/run/no-lists", "-o", "Dpkg::Options::=--force-confold", "-o", "Dpkg::Use-Pty=0"]
    done = run("apt-get", "-y", "--no-install-recommends", *quiet, *words, timeout_s=APT_S)
    print(done.stdout, done.stderr, f"{time.monotonic() - began_s:.0f} s")
    return done


def installed_version() -> str:
    return run("dpkg-query", "-W", "-f", "${db:Status-Status} ${Version}", "facetd").stdout


def models() -> dict[str, str]:
    """What the simulated cell knows: a digest of each file of its models and views."""
    files = (path for name in ("models", "views") for path in (SIMULATED / name).rglob("*") if path.is_file())
    return {str(path): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


def say(text: str) -> dict[str, Any]:
    """A command at the daemon's socket, every question answered by yes; its data."""
    with DaemonLink(SOCKET) as link:
        done = link.do(text, "one-shot", print, lambda _: "y")
    assert done["status"] == 0, done
    data: dict[str, Any] = done["data"]
    return data


@pytest.fixture(scope="module", autouse=True)
def no_index_and_no_disk() -> Iterator[None]:
    """apt has only files; dpkg does not wait for the disk at every file, which is memory here; and
    the machine's own manual pages are not indexed anew at each step."""
    Path("/run/no-lists/partial").mkdir(parents=True)
    Path("/etc/dpkg/dpkg.cfg.d/rig").write_text("force-unsafe-io\n")
    Path("/var/lib/man-db/auto-update").unlink(missing_ok=True)
    yield
    print(run("journalctl", "-u", "facetd", "--no-pager", "-o", "short-monotonic").stdout)


def test_apt_installs_it_and_starts_nothing() -> None:
    began_s = time.monotonic()
    done = apt("install", *map(str, PACKAGES.glob("python3-systemd*.deb")), package("this"))
    assert done.returncode == 0, done.stderr
    write_down(f"the package installed in {time.monotonic() - began_s:.0f} s, emulated")
    assert run("facetd", "--check").returncode == 0
    assert unit("ActiveState") == "inactive"
    assert unit("UnitFileState") == "disabled"
    assert "facetd" in run("id", "facetd").stdout
    assert run("udevadm", "--version").returncode == 0
    assert Path("/etc/udev/rules.d/60-facetd.rules").is_file()
    assert "facetd" in run("journalctl", "--list-catalog").stdout
    assert not (HOME / "incomplete").exists()


def test_nothing_is_compiled_at_the_first_start() -> None:
    """Byte code of the package is used as it is, whoever runs it: nothing beside it is newer."""
    stale = run("find", str(HOME), "-newer", "/var/lib/dpkg/info/facetd.postinst", "-name", "*.pyc").stdout
    assert stale == ""


def test_the_simulated_cell_as_the_service_answers_and_is_taught() -> None:
    DROP_INS.mkdir(parents=True)
    (DROP_INS / "simulated.conf").write_text(Path("/usr/share/doc/facetd/deploy/simulated.conf").read_text())
    (DROP_INS / "patience.conf").write_text(PATIENCE)
    run("systemctl", "daemon-reload")
    began_s = time.monotonic()
    started = run("systemctl", "start", "facetd", timeout_s=300.0)
    assert started.returncode == 0, started.stderr
    write_down(f"the package's simulated cell READY {time.monotonic() - began_s:.1f} s after systemctl start, emulated")
    assert run("facetctl", "status").returncode == 0
    assert unit("User") == "facetd"
    say("teach bracket --mesh /usr/share/doc/facetd/docs/bracket.obj")
    trained = say("train")
    if not trained.get("accepted"):
        say("accept")
    assert say("status")["model"]["labels"] == ["bracket"]
    assert {Path(path).parent.name for path in models()} >= {"models"}


def test_an_upgrade_keeps_settings_and_models_and_goes_on() -> None:
    parts = ETC / "parts.yaml"
    parts.write_text(parts.read_text() + MINE)
    before, known = unit("MainPID"), models()
    done = apt("install", package(NEXT))
    assert done.returncode == 0, done.stderr
    assert installed_version() == f"installed {NEXT}"
    assert parts.read_text().endswith(MINE)
    assert (ETC / "parts.yaml.dpkg-dist").read_text().endswith(f"{NEXT}\n")
    assert (ETC / "facets.yaml").read_text().endswith(f"{NEXT}\n")
    assert unit("ActiveState") == "active"
    assert unit("MainPID") != before
    assert say("status")["model"]["labels"] == ["bracket"]
    assert models() == known


def test_where_the_power_goes_on_the_way_back_the_daemon_does_not_start() -> None:
    run("systemctl", "stop", "facetd")
    halves = subprocess.Popen(["dpkg", "--force-downgrade", "--force-confold", "-i", package("this")],
                              start_new_session=True)  # fmt: skip
    until(lambda: next(HOME.rglob("*.dpkg-new"), None), every_s=0.02)
    os.killpg(halves.pid, signal.SIGKILL)
    halves.wait()
    assert run("systemctl", "start", "facetd").returncode != 0
    assert "asserts failed" in run("journalctl", "-u", "facetd", "--no-pager").stdout


def test_repeated_the_release_before_comes_back_with_settings_and_models() -> None:
    known = models()
    done = run("dpkg", "--force-confold", "-i", package("this"), timeout_s=APT_S)
    assert done.returncode == 0, done.stderr
    assert installed_version().startswith("installed")
    assert NEXT not in installed_version()
    assert run("systemctl", "start", "facetd", timeout_s=300.0).returncode == 0
    assert (ETC / "parts.yaml").read_text().endswith(MINE)
    assert models() == known


def test_removed_it_leaves_settings_and_models() -> None:
    known = models()
    assert apt("remove", "facetd").returncode == 0
    assert unit("ActiveState") != "active"
    assert not list(HOME.rglob("*.py*"))
    assert run("sh", "-c", "command -v facetctl").returncode != 0
    assert (ETC / "parts.yaml").read_text().endswith(MINE)
    assert models() == known


def test_purged_it_leaves_nothing() -> None:
    print(run("find", str(HOME)).stdout)
    assert apt("purge", "facetd").returncode == 0
    left = [path for path in (ETC, HOME, SIMULATED, Path("/var/lib/facetd")) if path.exists()]
    assert left == []
    assert not Path("/etc/udev/rules.d/60-facetd.rules").exists()
