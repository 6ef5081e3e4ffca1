"""What a maintainer is sent: what lies in the runs, and nothing that a link in them points to."""

from __future__ import annotations

import os
import shutil
import tarfile
from pathlib import Path

import pytest

from daemon.config import load_config
from daemon.store.places import HOUSE
from daemon.upkeep import bundle
from tests.worlds.made_run import MadeRun


@pytest.mark.timeout(60)
def test_links_and_fifos_in_a_run_are_left_out_and_a_linked_configuration_is_packed_as_a_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bundle, "COMMANDS", {})
    for name in ("calibration.yaml", "facets.yaml", "parts.yaml"):
        shutil.copy(HOUSE / "etc" / name, tmp_path)
    (tmp_path / "real.yaml").write_text("version: 1\ncell: simulated\nfolders: {state: state, runtime: .}\n")
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
