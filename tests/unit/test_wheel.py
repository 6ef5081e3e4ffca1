"""The wheel: all that lies in the rooms is in it, and what it unpacks to runs by itself, away from any checkout."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from daemon.store.folders import HOUSE
from tests.fakes.waiting import until

SOURCES = ("daemon", "drivers", "etc", "pyproject.toml", "README.md", "LICENSE")
BUILD = "import sys; from setuptools.build_meta import build_wheel; build_wheel(sys.argv[1])"
PROGRAM = "import sys; from daemon.{} import main; sys.exit(main())"


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> zipfile.Path:
    """Built from a copy, in which nothing else lies."""
    pytest.importorskip("setuptools.command.bdist_wheel", reason="setuptools is older than the extra dev asks for")
    copy, out = tmp_path_factory.mktemp("sources"), tmp_path_factory.mktemp("wheel")
    for name in SOURCES:
        if (HOUSE / name).is_dir():
            shutil.copytree(HOUSE / name, copy / name, symlinks=True, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy(HOUSE / name, copy)
    built = subprocess.run([sys.executable, "-c", BUILD, str(out)], cwd=copy, capture_output=True, text=True)
    assert built.returncode == 0, built.stderr
    (made,) = out.glob("*.whl")
    return zipfile.Path(made)


@pytest.fixture
def unpacked(wheel: zipfile.Path) -> Iterator[Path]:
    """As pip leaves it in its folder of packages; with a short path, as a socket lies beside it."""
    folder = Path(tempfile.mkdtemp(prefix="facetd-"))
    with zipfile.ZipFile(
        str(wheel.root.filename)
    ) as whole:  # the root of a Path names folders that Debian 12's has not
        whole.extractall(folder / "packages")
    yield folder
    shutil.rmtree(folder)


def words(program: str, *arguments: str) -> list[str]:
    return [sys.executable, "-c", PROGRAM.format(program), *arguments]


def surroundings(folder: Path) -> dict[str, str]:
    """Those of somebody who has this program and no other, whose home is `folder`."""
    ours = {name: value for name, value in os.environ.items() if not name.startswith(("FACETD_", "XDG_"))}
    return {**ours, "PYTHONPATH": str(folder / "packages"), "HOME": str(folder)}


def ask(folder: Path, program: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        words(program, *arguments), cwd=folder, env=surroundings(folder), capture_output=True, text=True, timeout=60
    )


@pytest.mark.slow
def test_all_that_lies_in_the_rooms_is_in_the_wheel(wheel: zipfile.Path) -> None:
    there = {
        str(file.relative_to(HOUSE))
        for room in ("daemon", "drivers")
        for folder, _, names in os.walk(HOUSE / room, followlinks=True)
        for file in (Path(folder, name) for name in names)
        if file.suffix != ".pyc"
    }
    assert "daemon/etc/facets.yaml" in there
    assert sorted(there - set(wheel.root.namelist())) == []


@pytest.mark.slow
@pytest.mark.skipif(Path("/var/lib/facetd").is_dir(), reason="facetd is installed here: its places come first")
def test_what_a_wheel_unpacks_to_is_a_simulated_cell_by_itself(unpacked: Path) -> None:
    """Files, state and socket; a command of its console, and an end that lets go of all."""
    checked = ask(unpacked, "main", "--sim", "--check")
    assert checked.returncode == 0, checked.stderr
    assert f"{unpacked}/packages/daemon/etc/facetd.yaml is good" in checked.stdout
    daemon = subprocess.Popen(words("main", "--sim"), cwd=unpacked, env=surroundings(unpacked), stderr=subprocess.PIPE)
    try:
        socket = unpacked / ".local/state/facetd/facetd.sock"
        until(lambda: socket.exists() or daemon.poll() is not None, "the socket")
        answer = ask(unpacked, "ctl", "--json", "status")
        assert answer.returncode == 0, answer.stderr
        assert json.loads(answer.stdout)["status"] == 0, answer.stdout
    finally:
        daemon.send_signal(signal.SIGTERM)
        said = daemon.communicate(timeout=60)[1].decode()
    assert daemon.returncode == 0, said
    assert {path.name for path in unpacked.iterdir()} <= {"packages", ".local"}, "nothing is kept anywhere else"
