"""What an older release wrote is read by this one; and after a rollback the older one finds its files, and reads what
this one has added meanwhile, but for the models that this one trained: those it refuses in a line, and goes back to its
own.

The older release is taken from the history of this copy, and runs in a process of its own.
"""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
import tarfile
from pathlib import Path
from typing import Any

import pytest

from daemon.config import load_config
from daemon.store.folders import HOUSE
from tests.fakes.chosen import few

OLDER = {
    "d031436bd5d2bd79ee6ec471417fd900d2a603a6": "the first with a file for what a restart must know",
    "bba350d": "the one that asks of a command's arguments whether it only looks",
}
PROGRAM = """
import inspect, json, sys
from pathlib import Path
import numpy as np
from daemon.store.library import load_facets
from daemon.store.model import ModelError
from daemon.store.model_store import ModelStore
from daemon.store.runlog import RunLog
from daemon.store.runs import check_wire, list_runs, read_run
try:
    from daemon.store.recovery_state import FILE, RecoveryFile, read_interrupted_state
except ImportError:
    try:
        from daemon.store.recovery_state import FILE, RecoveryFile, left_behind as read_interrupted_state
    except ImportError:
        from daemon.store.standing import FILE, StandingFile as RecoveryFile, left_behind as read_interrupted_state
from daemon.vision.model import empty_model

what, folder = sys.argv[1], Path(sys.argv[2])
recovery = "recovery" if "recovery" in inspect.signature(RunLog).parameters else "standing"
store, runs = ModelStore(folder), folder / "runs"
try:
    from daemon.store.named_positions import NamedPositions
    places = NamedPositions(folder)
except ImportError:
    places = None

def labels(version):
    try:
        file = store.load(version)
        return list(getattr(file, "model", file).labels)  # an older one loads the model alone
    except ModelError as error:
        return str(error)

if what == "model before":
    store.rollback()
elif what != "read":
    grey = np.full((8, 8), 7, np.uint8)
    store.add_view("cube", grey, grey, {"who": what, "table": {"up": [0, 0, 1], "level_mm": 3}, "facets": [["square"]]})
    store.put_candidate(empty_model(load_facets()))
    try:
        store.accept(store.candidate)
    except TypeError:  # an older one takes whichever there is
        store.accept()
    log = RunLog(runs / f"2026010{len(list_runs(runs)) + 1}T000000Z", **{recovery: RecoveryFile(folder / FILE)})
    log.record("run_start", config=log.keep(Path(__file__)))
    log.record("cycle_start", cycle=4, target="cube")
    log.record("auto", on=True, count=3, every_s=None)
    log.record("look", cycle=4, images={"left": grey, "right": grey}, purpose="survey")
    log.record("hand", closed=True)
    log.wire({"seq": 1, "way": "out", "bytes": "WHERE"})
    log.wire({"seq": 2, "way": "in", "bytes": "."})
    log.settle()  # and the power goes
    if places is not None:
        places.keep(what, np.eye(4), what)
numbers = sorted(int(path.stem) for path in (folder / "models").glob("*.npz"))
left = read_interrupted_state(folder / FILE, True)
read = [read_run(run) for run in list_runs(runs)]
print(json.dumps({
    "views": [[v.name, v.note.get("who"), v.images()[0].tolist()] for v in store.views()],
    "models": [store.current, list(store.history), [labels(n) for n in numbers]],
    "runs": [[[r["kind"], r["seq"]] for r in run.records] for run in read],
    "skipped": [list(run.skipped) + check_wire(run.folder) for run in read],
    "left": [left.run, left.cycle, left.hand_closed, left.label, left.auto.count],
    "places": None if places is None else sorted(places.now()),
}))
"""


def release(commit: str, folder: Path) -> Path:
    """The tree of a commit; skips where this copy has no such history."""
    archive = subprocess.run(
        ["git", "-C", str(HOUSE), "archive", commit, "daemon", "drivers", "etc"], capture_output=True, check=False
    )
    if archive.returncode != 0:
        pytest.skip("this copy has no history to take an older release from")
    with tarfile.open(fileobj=io.BytesIO(archive.stdout)) as tree:
        tree.extraction_filter = getattr(tarfile, "data_filter", None)  # Debian 12's Python has none
        tree.extractall(folder)
    return folder


def did(tree: Path, what: str, state: Path) -> dict[str, Any]:
    """A release writes some of everything, or only reads; what it finds then."""
    program = state.with_name("program.py")
    program.write_text(PROGRAM)
    done = subprocess.run(
        [sys.executable, str(program), what, str(state)], cwd=state.parent, env={**os.environ, "PYTHONPATH": str(tree)},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    found: dict[str, Any] = json.loads(done.stdout)
    return found


@pytest.mark.slow
@pytest.mark.parametrize("commit", few(OLDER, 1))
def test_files_go_from_an_older_release_to_this_one_and_back(commit: str, tmp_path: Path) -> None:
    old, state = release(commit, tmp_path / "old"), tmp_path / "state"
    state.mkdir()
    by_old = did(old, "old", state)
    by_new = did(HOUSE, "read", state)
    assert {**by_new, "places": None} == {**by_old, "places": None}
    assert by_new["left"] == ["20260101T000000Z", 4, True, "cube", 3]
    assert by_new["skipped"] == [[]]
    added = did(HOUSE, "new", state)
    back = did(old, "read", state)
    ours = f"{state / 'models' / '0002.npz'}: version 2, this facetd reads version 1: train anew or update"
    assert added["models"] == [2, [1], [[], []]]
    assert {**back, "places": None} == {**added, "places": None, "models": [2, [1], [[], ours]]}
    assert [view[:2] for view in back["views"]] == [["cube/1", "old"], ["cube/2", "new"]]
    assert back["runs"][0] == by_old["runs"][0]
    assert back["left"][0] == "20260102T000000Z"
    if back["places"] is not None:
        assert back["places"] == ["new", "old"]
    assert did(old, "model before", state)["models"] == [1, [], [[], ours]]
    assert did(old, "older again", state)["models"] == [3, [1], [[], ours, []]]


@pytest.mark.parametrize("commit", OLDER)
def test_settings_of_an_older_release_are_read_and_what_is_none_any_more_is_told(commit: str, tmp_path: Path) -> None:
    etc = release(commit, tmp_path) / "etc"
    config = load_config(etc / "facetd.yaml", simulated=True)
    assert config.kind == "simulated"
    assert all(str(etc) in note for note in config.notes)
