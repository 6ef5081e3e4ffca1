"""What is installed: a hardened unit, users that systemd accepts, a guide that knows every fault by its words."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from daemon.arm.guard import RULES
from daemon.maintenance.journal import MESSAGE_IDS
from daemon.store import folders

DEPLOY = folders.HOUSE / "deploy"


def unit() -> dict[str, list[str]]:
    settings: dict[str, list[str]] = {}
    for line in (DEPLOY / "facetd.service").read_text().splitlines():
        key, equals, value = line.partition("=")
        if equals and not line.startswith("#"):
            settings.setdefault(key, []).append(value)
    return settings


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="this machine has no systemd-analyze")
def test_the_units_exposure_is_at_most_one_and_a_half() -> None:
    asked = subprocess.run(
        ["systemd-analyze", "security", "--offline=true", str(DEPLOY / "facetd.service")],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    found = re.search(r"Overall exposure level for facetd.service: ([\d.]+)", asked.stdout)
    assert found, asked.stderr
    assert float(found[1]) <= 1.5


def test_the_dashboards_unit_has_no_device_and_only_the_loopback_interface() -> None:
    lines = (DEPLOY / "facetd-dashboard.service").read_text().splitlines()
    wanted = {"DynamicUser=yes", "PrivateDevices=yes", "IPAddressDeny=any", "IPAddressAllow=localhost"}
    assert wanted <= set(lines)
    assert not [
        line for line in lines if line.startswith(("Requires=", "BindsTo=", "PartOf="))
    ]  # it outlives the daemon


def test_the_unit_waits_for_ready_feeds_a_watchdog_and_does_not_restart_on_a_bad_configuration() -> None:
    settings = unit()
    assert settings["Type"] == ["notify"]
    assert settings["RestartPreventExitStatus"] == ["78"]
    assert int(settings["WatchdogSec"][0]) >= 20
    assert settings["User"] == ["facetd"]
    assert settings["ExecReload"] == ["/bin/kill -HUP $MAINPID"]


@pytest.mark.skipif(shutil.which("systemd-sysusers") is None, reason="this machine has no systemd-sysusers")
def test_systemd_accepts_the_users_file(tmp_path: Path) -> None:
    (tmp_path / "etc").mkdir()
    done = subprocess.run(
        ["systemd-sysusers", f"--root={tmp_path}", str(DEPLOY / "facetd.sysusers")],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "facetd:" in (tmp_path / "etc" / "passwd").read_text()


def test_the_guide_names_every_rule_of_the_guard_and_every_message_of_the_controller() -> None:
    guide = (DEPLOY.parent / "docs" / "operate" / "trouble.md").read_text()
    missing = [name for name, _ in RULES if name not in guide and name not in ("not_a_location", "arm_lost")]
    assert missing == []
    for message in ("Arm power off", "Not calibrated", "Emergency stop", "Envelope error", "out of range"):
        assert message in guide


def test_the_journals_catalogue_explains_every_kind_of_message() -> None:
    entries = re.findall(
        r"^-- (\w+)\nSubject: (.+)\n(?:[A-Z][\w-]+: .+\n)+\n(.+)", (DEPLOY / "facetd.catalog").read_text(), re.M
    )
    assert sorted(found for found, _, _ in entries) == sorted(MESSAGE_IDS.values())
    assert all(len(found) == 32 for found in MESSAGE_IDS.values())


@pytest.mark.skipif(shutil.which("journalctl") is None, reason="this machine has no journalctl")
def test_journald_takes_the_catalogue(tmp_path: Path) -> None:
    for folder in ("usr/lib/systemd/catalog", "var/lib/systemd/catalog"):
        (tmp_path / folder).mkdir(parents=True)
    shutil.copy(DEPLOY / "facetd.catalog", tmp_path / "usr/lib/systemd/catalog")
    for what in ("--update-catalog", "--list-catalog"):
        done = subprocess.run(["journalctl", what, f"--root={tmp_path}"], capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
    assert done.stdout.count("facetd") >= len(MESSAGE_IDS)
