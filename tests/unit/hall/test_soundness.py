"""Whether a run is what its cell wrote, whatever it says."""

from __future__ import annotations

from pathlib import Path

from daemon.hall.soundness import damages
from daemon.store.runs import read_run
from tests.worlds.made_run import MadeRun


def test_a_picture_whose_name_no_disk_takes_is_a_missing_one(tmp_path: Path) -> None:
    """And ends no collection of the cell's other runs."""
    made = MadeRun(tmp_path / "run")
    made.pick()
    made.close()
    run = read_run(made.folder)
    assert damages(made.folder, run) == []
    look = next(record for record in run.records if record["kind"] == "look")
    for name in ("x" * 300, "images/\0"):
        look["images"] = {"left": name}
        assert damages(made.folder, run) == [f"{name}: its look is there, the picture is not"]


def test_a_last_entry_without_its_end_is_what_a_killed_daemon_leaves(tmp_path: Path) -> None:
    made = MadeRun(tmp_path / "run")
    made.log.wire({"seq": 0, "text": "WHERE"})
    made.close()
    with (made.folder / "wire.jsonl").open("ab") as file:
        file.write(b'{"seq": 1, "te')
    assert damages(made.folder, read_run(made.folder)) == []
    with (made.folder / "wire.jsonl").open("ab") as file:
        file.write(b"\n")
    assert damages(made.folder, read_run(made.folder)) == ["wire.jsonl:2: torn or unreadable line"]
