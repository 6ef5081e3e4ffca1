"""What a maintainer is sent: what lies in the runs, and nothing that a link in them points to."""

from __future__ import annotations

import os
import shutil
import tarfile
from datetime import datetime
from pathlib import Path
from types import SimpleNamespace

import pytest

from daemon.config import load_config
from daemon.maintenance import bundle
from daemon.store.folders import HOUSE
from tests.fakes.made_run import MadeRun


@pytest.fixture(autouse=True)
def cell(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Settings, and nothing asked of this machine."""
    monkeypatch.setattr(bundle, "COMMANDS", {})
    for name in ("calibration.yaml", "facets.yaml", "parts.yaml"):
        shutil.copy(HOUSE / "etc" / name, tmp_path)
    (tmp_path / "real.yaml").write_text("version: 1\ncell: simulated\nfolders: {state: state, runtime: .}\n")


def test_a_link_where_a_bundle_is_made_is_not_written_through(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In a folder that all may write to somebody could guess the name."""
    monkeypatch.setattr("secrets.token_hex", lambda _: "aa")
    monkeypatch.setattr("tarfile.TarFile.addfile", lambda *_: None)
    (tmp_path / "secret").write_text("secret")
    path = bundle.pack(load_config(tmp_path / "real.yaml"), tmp_path / "out")
    (tmp_path / "out" / f".{path.name}.aa").symlink_to(tmp_path / "secret")
    at = datetime.strptime(path.name.removesuffix(".tar.gz").rpartition("-")[2], "%Y%m%dT%H%M%SZ")
    monkeypatch.setattr(bundle, "datetime", SimpleNamespace(now=lambda _: at))
    with pytest.raises(FileExistsError):
        bundle.pack(load_config(tmp_path / "real.yaml"), tmp_path / "out")
    assert (tmp_path / "secret").read_text() == "secret"


def test_what_says_that_it_is_as_large_as_no_disk_is_cut(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bundle, "MOST_MB", 1)
    for name in ("20260101T000000Z", "20260102T000000Z"):
        run = tmp_path / "state" / "runs" / name
        (run / "kept").mkdir(parents=True)
        for path in (run / "run.jsonl", run / "kept" / "x"):
            path.touch()
            os.truncate(path, 10**12)
    with tarfile.open(bundle.pack(load_config(tmp_path / "real.yaml"), tmp_path / "out")) as archive:
        assert 990_000 < sum(member.size for member in archive) < 1_100_000
        (newest,) = [member.size for member in archive if member.name.endswith("0102T000000Z/run.jsonl")]
    assert newest > 900_000, "the newest first"


@pytest.mark.timeout(60)
def test_links_and_fifos_in_a_run_are_left_out_and_a_linked_configuration_is_packed_as_a_file(tmp_path: Path) -> None:
    (tmp_path / "facetd.yaml").symlink_to("real.yaml")
    (tmp_path / "secret").write_text("secret")
    made = MadeRun(tmp_path / "state" / "runs" / "20260101T000000Z")
    made.pick()
    run = made.close()
    for name in ("images/999999-left.png", "kept/x.yaml"):
        (run / name).symlink_to(tmp_path / "secret")
    os.mkfifo(run / "kept" / "fifo")
    with tarfile.open(bundle.pack(load_config(tmp_path / "facetd.yaml"), tmp_path / "out")) as archive:
        members = {member.name.partition("/")[2]: member for member in archive}
        configuration = archive.extractfile(members["facetd.yaml"])
        assert configuration is not None
        assert configuration.read() == (tmp_path / "real.yaml").read_bytes()
    assert all(member.isreg() for member in members.values())
    assert not [name for name in members if "999999" in name or name.endswith(("x.yaml", "fifo"))]
    assert f"runs/{run.name}/run.jsonl" in members
    assert [name for name in members if "/images/" in name]


def test_the_calibration_in_use_is_packed_be_it_the_configurations_or_one_made_here(tmp_path: Path) -> None:
    made = load_config(tmp_path / "real.yaml").calibrations
    made.keep((tmp_path / "calibration.yaml").read_bytes() + b"# made here\n")
    with tarfile.open(bundle.pack(load_config(tmp_path / "real.yaml"), tmp_path / "out")) as archive:
        (name,) = [member.name for member in archive if member.name.endswith("/calibration.yaml")]
        packed = archive.extractfile(name)
        assert packed is not None
        assert packed.read().endswith(b"# made here\n")
