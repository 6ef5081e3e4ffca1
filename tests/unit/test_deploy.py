"""What is installed: a hardened unit, users that systemd accepts, a guide that knows every fault by its words."""

from __future__ import annotations

import os
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


def test_the_install_script_is_plain_shell_and_says_what_it_can_when_asked_nothing() -> None:
    script = DEPLOY / "install.sh"
    assert subprocess.run(["sh", "-n", str(script)], check=False).returncode == 0
    asked = subprocess.run(["sh", str(script)], capture_output=True, text=True, check=False)
    assert asked.returncode == 2
    for word in ("install", "rollback", "remove", "purge"):
        assert f"install.sh {word}" in asked.stdout


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


def installer(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    environment = {"PATH": "/usr/bin:/bin:/usr/sbin:/sbin", "DESTDIR": str(folder), "FACETD_APT": "no"}
    return subprocess.run(
        ["sh", str(DEPLOY / "install.sh"), *words], env=environment, capture_output=True, text=True, check=False
    )


@pytest.mark.parametrize(("edited", "word", "left"), [(False, "remove", 0), (True, "remove", 1), (True, "purge", 0)])
def test_remove_leaves_udev_rules_that_somebody_has_edited(tmp_path: Path, edited: bool, word: str, left: int) -> None:
    release, rules = tmp_path / "opt/facetd/current/deploy", tmp_path / "etc/udev/rules.d"
    release.mkdir(parents=True)
    rules.mkdir(parents=True)
    (tmp_path / "etc/facetd").mkdir()
    for folder in (release, rules):
        shutil.copy(DEPLOY / "60-facetd.rules", folder)
    if edited:
        (rules / "60-facetd.rules").write_text("# mine\n")
    done = installer(tmp_path, word)
    assert done.returncode == 0, done.stderr
    assert len(list(rules.iterdir())) == left
    assert ("kept your" in done.stdout) is bool(left)
    assert not (tmp_path / "opt/facetd").exists()
    assert (tmp_path / "etc/facetd").exists() is (word == "remove")


def test_its_usage_names_every_word_and_shows_no_line_of_the_program(tmp_path: Path) -> None:
    told = installer(tmp_path).stdout
    script = (DEPLOY / "install.sh").read_text()
    for word in re.findall(r"^(\w+)(?: \| \w+)?\) do_", script, re.MULTILINE):
        assert f"install.sh {word}" in told
    code = [line for line in script.splitlines() if line and not line.startswith("#")]
    assert [line for line in code if line.strip() and line in told.splitlines()] == []


def test_what_was_made_below_another_root_names_where_it_will_lie(tmp_path: Path) -> None:
    release = tmp_path / "opt/facetd/releases/1"
    program, path = release / "venv/bin/facetd", release / "venv/lib/python3/site-packages/__editable__.facetd.pth"
    for file, text in ((program, f"#!{release}/venv/bin/python\n"), (path, f"{release}\n")):
        file.parent.mkdir(parents=True)
        file.write_text(text)
    script = (DEPLOY / "install.sh").read_text()
    function = re.search(r"^at_home\(\) \{.*?^\}", script, re.MULTILINE | re.DOTALL)
    assert function
    subprocess.run(["sh", "-euc", f"root={tmp_path}; release={release}\n{function[0]}\nat_home"], check=True)
    assert program.read_text() == "#!/opt/facetd/releases/1/venv/bin/python\n"
    assert path.read_text() == "/opt/facetd/releases/1\n"


def installed(folder: Path, **releases: bool) -> Path:
    """A made installation: each release a program that runs, or nothing but its folder; the last one is in use."""
    for name, runs in releases.items():
        program = folder / "opt/facetd/releases" / name / "venv/bin/facetd"
        program.parent.mkdir(parents=True)
        if runs:
            program.write_text("#!/bin/sh\nexit 0\n")
            program.chmod(0o755)
    (folder / "opt/facetd/current").symlink_to(f"releases/{list(releases)[-1]}")
    return folder / "opt/facetd/current"


def roll_back(folder: Path) -> subprocess.CompletedProcess[str]:
    command = ["sh", str(DEPLOY / "install.sh"), "rollback"]
    return subprocess.run(
        command, capture_output=True, text=True, check=False, env={**os.environ, "DESTDIR": str(folder)}
    )


def test_a_rollback_passes_over_a_release_that_was_half_built_when_the_power_went(tmp_path: Path) -> None:
    current = installed(tmp_path, a=True, b=False, c=True)
    done = roll_back(tmp_path)
    assert done.returncode == 0, done.stderr
    assert os.readlink(current) == "releases/a"
    assert "left out: b" in done.stdout + done.stderr


def test_where_no_release_before_runs_the_one_in_use_stays(tmp_path: Path) -> None:
    current = installed(tmp_path, a=False, b=True)
    assert roll_back(tmp_path).returncode != 0
    assert os.readlink(current) == "releases/b"
