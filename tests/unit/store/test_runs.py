"""Runs on disk: found, kept within a quota, told how they were left."""

from __future__ import annotations

import errno
import gc
import hashlib
import os
import subprocess
import warnings
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from unittest.mock import patch

import pytest

from daemon.store.runlog import RunLog
from daemon.store.runs import (
    _SCANNED,
    RunError,
    age_key,
    bytes_in,
    check_wire,
    enforce_quota,
    find_run,
    follow,
    has_failure,
    kept_file,
    list_runs,
    new_folder,
    read_run,
    run_bytes,
)

NOW = datetime(2026, 11, 21, 10, tzinfo=UTC)


@pytest.fixture
def log(tmp_path: Path) -> Iterator[RunLog]:
    log = RunLog(tmp_path / "run", wall=lambda: NOW, clock=lambda: 12.5)
    yield log
    log.close()


def run_with(folder: Path, *records: dict[str, object], size: int = 200_000) -> Path:
    log = RunLog(folder)
    for record in records:
        log.record(str(record.pop("kind")), **record)
    log.close()
    (folder / "images" / "fill.png").write_bytes(os.urandom(size))
    return folder


def test_the_quota_removes_the_oldest_first_and_runs_with_failures_last(tmp_path: Path) -> None:
    good = {"kind": "cycle_end", "outcome": "picked"}
    bad = {"kind": "cycle_end", "outcome": "missed"}
    names = ["20260101T000000Z", "20260102T000000Z", "20260103T000000Z", "20260104T000000Z", "20260105T000000Z"]
    for name, record in zip(names, (bad, good, good, bad, good), strict=True):
        run_with(tmp_path / name, dict(record))
    assert [has_failure(f) for f in list_runs(tmp_path)] == [True, False, False, True, False]
    current = tmp_path / names[-1]
    assert enforce_quota(tmp_path, 2_000_000, current) == []
    removed = enforce_quota(tmp_path, 700_000, current)
    assert [f.name for f in removed] == [names[1], names[2]]
    removed = enforce_quota(tmp_path, 0, current)
    assert [f.name for f in removed] == [names[0], names[3]], "the failures go when nothing else is left"
    assert list_runs(tmp_path) == [current], "the run being written stays, whatever the quota"


def test_runs_are_found_by_latest_by_name_and_by_path(tmp_path: Path) -> None:
    with pytest.raises(RunError, match="no run in it yet"):
        find_run(tmp_path, "latest")
    folders = []
    for _ in range(12):
        folders.append(new_folder(tmp_path, NOW))
        RunLog(folders[-1]).close()
    assert list_runs(tmp_path) == folders, "twelve runs of one second keep their order"
    assert find_run(tmp_path, "latest") == folders[-1]
    assert find_run(tmp_path, folders[0].name) == folders[0]
    assert find_run(Path("/nonexistent"), str(folders[1])) == folders[1]
    with pytest.raises(RunError, match="such-a-run: no such run"):
        find_run(tmp_path, "such-a-run")


def test_where_the_clock_was_set_back_a_run_is_still_the_latest(tmp_path: Path) -> None:
    made = []
    for at in (
        NOW,
        NOW.replace(year=2027),
        NOW,
        NOW,
        NOW.replace(year=2027, second=1),
        datetime(1970, 1, 1, tzinfo=UTC),
    ):
        made.append(new_folder(tmp_path, at))
        RunLog(made[-1]).close()
        assert find_run(tmp_path, "latest") == made[-1]
    assert list_runs(tmp_path) == made
    assert [f.name for f in made[1:4]] == ["20271121T100000Z", "20271121T100000Z-1", "20271121T100000Z-2"]
    assert enforce_quota(tmp_path, 0, made[-1]) == made[:-1], "the first made goes first, whatever the clock said"


def test_what_is_no_run_names_none(tmp_path: Path) -> None:
    for name in ("zzz", "99991231T235959Z.part", "20300101T000000Z-", "20300101T000000Z-1234567890"):
        (tmp_path / name).mkdir()
    (tmp_path / "\u0662\u0660\u0662\u0667\u0661\u0662\u0663\u0661T235959Z").mkdir()  # digits, but not ours
    assert new_folder(tmp_path, NOW).name == "20261121T100000Z"


def test_a_name_behind_which_none_can_come_keeps_nobody_from_starting(tmp_path: Path) -> None:
    """A folder of that name made every start but the first fail: the same name came out again each time."""
    (tmp_path / "99991231T235959Z-999999999").mkdir()
    made = [new_folder(tmp_path, NOW)]
    for _ in range(2):
        RunLog(made[-1]).close()
        made.append(new_folder(tmp_path, NOW))
    assert [f.name for f in made] == ["20261121T100000Z", "20261121T100000Z-1", "20261121T100000Z-2"]


def test_a_folder_that_cannot_be_looked_into_keeps_nobody_from_the_other_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A damaged disk says so of one folder, a right that is missing, too; the daemon could not start."""
    runs = [run_with(tmp_path / f"2026010{k}T000000Z", size=0) for k in (1, 2)]
    usual = os.stat

    def failing(path: object, *more: object, **named: object) -> os.stat_result:
        if str(path).startswith(str(runs[0])):
            raise OSError(errno.EIO, "Input/output error", str(path))
        return usual(path, *more, **named)  # type: ignore[arg-type]

    monkeypatch.setattr(os, "stat", failing)
    assert list_runs(tmp_path) == [runs[1]]
    assert find_run(tmp_path, "latest") == runs[1]
    with pytest.raises(RunError, match="no such run"):
        find_run(tmp_path, "x" * 300)


def test_a_copy_that_somebody_named_is_not_the_latest_as_long_as_there_are_others(tmp_path: Path) -> None:
    copy = run_with(tmp_path / "good one", size=0)
    assert find_run(tmp_path, "latest") == copy
    own = [run_with(tmp_path / name, size=0) for name in ("20260101T000000Z", "20260101T000000Z-1")]
    assert find_run(tmp_path, "latest") == own[1]


def test_runs_are_no_more_than_can_be_looked_through_in_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("daemon.store.runs.MAX_RUNS", 3)
    made = [new_folder(tmp_path, NOW.replace(second=k)) for k in range(5)]
    for folder in made[:3]:
        RunLog(folder).close()
    assert enforce_quota(tmp_path, 10**9, made[2]) == []
    for folder in made[3:]:
        RunLog(folder).close()
    assert enforce_quota(tmp_path, 10**9, made[0]) == made[1:3]


def test_pictures_are_looked_through_once_and_again_where_one_was_put_in(tmp_path: Path) -> None:
    old = run_with(tmp_path / "20260101T000000Z", {"kind": "cycle_end", "outcome": "picked"}, size=100_000)
    new = run_with(tmp_path / "20260102T000000Z", size=0)
    os.utime(new / "images", ns=(0, 0))  # long ago, as clocks of file systems tick
    with patch("daemon.store.runs.bytes_in", side_effect=bytes_in) as looked:
        for _ in range(3):
            assert enforce_quota(tmp_path, 500_000, new) == []
        below = [Path(call.args[0]) for call in looked.call_args_list if Path(call.args[0]).parent != tmp_path]
        assert sorted(below) == sorted(run / name for run in (old, new) for name in ("images", "kept"))
        (new / "images" / "000007-left.png").write_bytes(bytes(600_000))
        assert enforce_quota(tmp_path, 500_000, new) == [old]


def test_of_folders_looked_through_before_nothing_is_known_once_they_are_gone(tmp_path: Path) -> None:
    """What the quota remembers grows neither with the pictures of a run nor with the runs there ever were."""
    run = run_with(tmp_path / "20260101T000000Z", size=0)
    _SCANNED.clear()
    for k in range(20):
        os.utime(run / "images", ns=(k, k))
        assert enforce_quota(tmp_path, 10**9, None) == []
    assert sorted(_SCANNED) == [f"{run}/images", f"{run}/kept"]
    other = run_with(tmp_path / "20260101T000000Z-1", size=0)
    assert enforce_quota(tmp_path, 0, other) == [run]
    assert sorted(_SCANNED) == [f"{other}/images", f"{other}/kept"]
    with patch("daemon.store.runs.MAX_RUNS", 1):
        run_with(tmp_path / "20260101T000000Z-2", size=0)
        run_bytes(tmp_path / "20260101T000000Z-2")
    assert len(_SCANNED) <= 2, "whoever else removes runs tells nobody"


@pytest.fixture
def deep(tmp_path: Path) -> Iterator[Path]:
    """A run with a picture in it, deeper than any stack."""
    run = run_with(tmp_path / "20260101T000000Z", {"kind": "rest"}, size=100_000)
    here = os.open(run, os.O_RDONLY)
    for _ in range(1500):
        os.mkdir("d", dir_fd=here)
        below = os.open("d", os.O_RDONLY, dir_fd=here)
        os.close(here)
        here = below
    with os.fdopen(os.open("picture", os.O_CREAT | os.O_WRONLY, dir_fd=here), "wb") as file:
        file.write(bytes(1_000_000))
    os.close(here)
    yield run
    subprocess.run(["rm", "-rf", run], check=True)  # pytest's own way of removing folders has a stack, too


def test_what_lies_deep_in_a_run_is_counted_and_ends_no_quota(deep: Path, tmp_path: Path) -> None:
    """Nor the daemon at its start, where the quota comes first."""
    other, stuck = run_with(tmp_path / "20260102T000000Z", {"kind": "rest"}), list[tuple[Path, str]]()
    assert run_bytes(deep) > 1_000_000
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ResourceWarning)  # shutil's own, at the end of its stack
        removed = enforce_quota(tmp_path, 0, None, stuck=lambda *told: stuck.append(told))
        gc.collect()
    assert sorted([*removed, *(run for run, _ in stuck)]) == [deep, other]


def test_a_run_that_cannot_be_removed_does_not_cost_the_others(tmp_path: Path) -> None:
    heavy = run_with(tmp_path / "20260101T000000Z", {"kind": "rest"}, size=2_000_000)
    others = [run_with(tmp_path / f"2026010{k}T000000Z", {"kind": "rest"}, size=1000) for k in (2, 3)]
    stuck = list[tuple[Path, str]]()
    with patch("shutil.rmtree", side_effect=PermissionError(1, "Operation not permitted")):
        assert enforce_quota(tmp_path, 1_000_000, None, stuck=lambda *told: stuck.append(told)) == []
    assert stuck == [(heavy, "Operation not permitted")]
    assert list_runs(tmp_path) == [heavy, *others]


def test_a_link_to_a_run_elsewhere_is_neither_counted_nor_removed(tmp_path: Path) -> None:
    """Somebody looks at an old run there; all the others went for it."""
    elsewhere = run_with(tmp_path / "archive" / "20250101T000000Z", {"kind": "rest"}, size=5_000_000)
    own = run_with(tmp_path / "runs" / "20260101T000000Z", size=1000)
    (tmp_path / "runs" / elsewhere.name).symlink_to(elsewhere)
    assert enforce_quota(tmp_path / "runs", 1_000_000, None) == []
    assert enforce_quota(tmp_path / "runs", 0, None) == [own]
    assert read_run(tmp_path / "runs" / elsewhere.name).records


def test_a_run_that_goes_on_is_as_large_as_its_lines_are_now(tmp_path: Path) -> None:
    run = run_with(tmp_path / "20260102T000000Z", size=0)
    before = run_bytes(run)
    with (run / "run.jsonl").open("ab") as file:
        file.write(bytes(100_000))
    assert run_bytes(run) - before >= 90_000


def test_scenes_that_nobody_asks_for_are_let_go_while_a_run_is_read(tmp_path: Path) -> None:
    log = RunLog(tmp_path / "run")
    for _ in range(3):
        log.record("look", scene={"parts": []}, purpose="survey")
    log.close()
    looks = [r for r in read_run(tmp_path / "run", frozenset({1})).records if r["kind"] == "look"]
    assert [("scene" in look, look["purpose"]) for look in looks] == [(k == 1, "survey") for k in range(3)]
    assert all("scene" in r for r in read_run(tmp_path / "run").records if r["kind"] == "look")


def ledger(folder: Path, *lines: bytes) -> list[str]:
    (folder / "wire.jsonl").write_bytes(b"".join(line + b"\n" for line in lines))
    return check_wire(folder)


def test_where_the_ledgers_chain_does_not_hold_is_said_line_by_line(tmp_path: Path) -> None:
    assert check_wire(tmp_path) == []
    one = b'{"seq":0,"chain":""}'
    two = b'{"seq":1,"chain":"%s"}' % hashlib.sha256(one).hexdigest().encode()
    three = b'{"seq":2,"chain":"%s"}' % hashlib.sha256(two).hexdigest().encode()
    assert ledger(tmp_path, one, two, three) == []
    assert ledger(tmp_path, one, three) == ["wire.jsonl:2: 1 entries are missing before it"]
    not_from = "does not follow from the line before it"
    assert ledger(tmp_path, two, three) == [f"wire.jsonl:1: {not_from}"]
    assert ledger(tmp_path, one, two.replace(b"1,", b"1, "), three) == [f"wire.jsonl:3: {not_from}"]
    assert ledger(tmp_path, one, b'{"seq":1,"chain":"x"}') == [f"wire.jsonl:2: {not_from}"]
    assert ledger(tmp_path, one, b'{"chain":"x"}') == [f"wire.jsonl:2: {not_from}"]
    assert ledger(tmp_path, one, b'{"seq"', two) == ["wire.jsonl:2: torn or unreadable line"]
    (tmp_path / "wire.jsonl").unlink()
    (tmp_path / "wire.jsonl").mkdir()
    assert "not a regular file" in check_wire(tmp_path)[0]


def test_a_kept_file_must_be_what_its_name_says(tmp_path: Path) -> None:
    (tmp_path / "kept").mkdir()
    name = f"kept/{hashlib.sha256(b'x').hexdigest()}.yaml"
    (tmp_path / name).write_bytes(b"x")
    assert kept_file(tmp_path, name) == tmp_path / name
    (tmp_path / name).write_bytes(b"y")
    with pytest.raises(RunError, match="changed: its content"):
        kept_file(tmp_path, name)


@pytest.mark.parametrize(
    ("lines", "failed"),
    [
        (['{"kind":"run_end"}'], False),
        (['{"kind":"cycle_end","outcome":"picked"}', '{"kind":"run_end"}'], False),
        (['{"kind":"cycle_end","outcome":"picked"}'], True),
        (['{"kind":"cycle_end","outcome":"empty"}', '{"kind":"run_end"}'], True),
        (['{"kind":"fault"}', '{"kind":"run_end"}'], True),
        (['{"kind":"refusal"}', '{"kind":"run_end"}'], True),
        ([], True),
    ],
)
def test_a_run_in_which_something_failed_or_that_has_no_end_is_kept_longer(
    lines: list[str], failed: bool, tmp_path: Path
) -> None:
    (tmp_path / "run.jsonl").write_text("\n".join(lines))
    assert has_failure(tmp_path) is failed
    assert has_failure(tmp_path / "none") is True


def test_a_run_is_followed_past_bad_lines_to_its_end(tmp_path: Path) -> None:
    line = '{"v":1,"seq":%d,"t":"2026-01-01T00:00:00Z","mono_s":1,"kind":"%s"}\n'
    text = line % (0, "rest") + "nothing\n\n" + line % (1, "rest") + "x" * 1_100_000 + "\n" + line % (2, "run_end")
    (tmp_path / "run.jsonl").write_text(text + line % (3, "rest"))
    assert [r["seq"] for r in follow(tmp_path, lambda: True)] == [0, 1, 2]
    (tmp_path / "run.jsonl").write_text(line % (0, "rest") + (line % (1, "rest")).strip())
    going = iter([True, True, False])
    assert [r["seq"] for r in follow(tmp_path, lambda: next(going))] == [0], "half a line is none yet"


def test_what_was_skipped_is_named_by_its_line_and_the_last_may_be_torn(tmp_path: Path) -> None:
    line = b'{"v":1,"seq":0,"t":"2026-01-01T00:00:00Z","mono_s":1,"kind":"rest"}\n'
    (tmp_path / "run.jsonl").write_bytes(line + b"\n[]\n" + line + line[:20])
    run = read_run(tmp_path)
    assert len(run.records) == 2
    at = f"{tmp_path}/run.jsonl"
    assert run.skipped == (
        f"{at}:3: unreadable line (not a record), 2 bytes skipped", f"{at}:5: torn last line, 20 bytes skipped",
    )  # fmt: skip
    (tmp_path / "run.jsonl").write_bytes(line * 2)
    with patch("daemon.store.runs.LARGEST_RUN", len(line)):
        cut = read_run(tmp_path)
    assert len(cut.records) == 1
    assert "too large: only its first 0 MB are read" in cut.skipped[0]
    with patch("daemon.store.runs.LARGEST_RUN", 2 * len(line) + 1):
        assert read_run(tmp_path).skipped == ()


def test_folders_that_are_no_runs_are_none(tmp_path: Path) -> None:
    (tmp_path / "20260101T000000Z").mkdir()
    (tmp_path / "file").touch()
    assert list_runs(tmp_path) == []
    assert list_runs(tmp_path / "none") == []
    assert enforce_quota(tmp_path / "none", 0, None) == []


def test_a_disk_without_room_takes_runs_away_until_there_is(tmp_path: Path) -> None:
    made = [run_with(tmp_path / f"2026010{k}T000000Z", {"kind": "cycle_end", "outcome": "picked"}) for k in (1, 2, 3)]
    free = iter([5, 5, 5, 10])
    with patch("shutil.disk_usage", lambda _: type("Usage", (), {"free": next(free)})):
        assert enforce_quota(tmp_path, 10**12, made[2], 10) == made[:2]
    with patch("shutil.disk_usage", lambda _: type("Usage", (), {"free": 10})):
        assert enforce_quota(tmp_path, 10**12, None, 10) == []
    with patch("shutil.rmtree", side_effect=OSError):
        assert enforce_quota(tmp_path, 0, None) == []


def test_the_number_behind_a_run_s_name_counts_up_to_nine_digits() -> None:
    """Whatever is longer nobody counted."""
    told = [age_key(Path(name)) for name in ("a", "a-7", "a-999999999", "a-1000000000", "a-x")]
    assert told == [("a", 0), ("a", 7), ("a", 999_999_999), ("a", 0), ("a", 0)]


def test_a_line_that_is_too_long_is_one_line_and_not_the_torn_end(tmp_path: Path) -> None:
    line = b'{"v":1,"seq":0,"t":"2026-01-01T00:00:00Z","mono_s":1,"kind":"rest"}\n'
    at = f"{tmp_path}/run.jsonl"
    long = f"{at}:2: unreadable line (too long), more than 1000000 bytes skipped"
    (tmp_path / "run.jsonl").write_bytes(line + b"x" * 2_500_000 + b"\n[]\n" + line)
    assert read_run(tmp_path).skipped == (long, f"{at}:3: unreadable line (not a record), 2 bytes skipped")
    (tmp_path / "run.jsonl").write_bytes(line + b"x" * 2_500_000)
    assert read_run(tmp_path).skipped == (long,)


def test_the_folder_one_stands_in_is_a_run_with_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run = run_with(tmp_path / "20260101T000000Z")
    monkeypatch.chdir(run)
    assert find_run(tmp_path / "elsewhere", ".").name == run.name
