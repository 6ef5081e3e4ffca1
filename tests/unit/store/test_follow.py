"""A run's records as they are written: in order, whole, and to an end."""

from __future__ import annotations

from pathlib import Path

from daemon.store.runs import follow


def line(kind: str) -> bytes:
    return b'{"v":1,"seq":0,"t":"2026-01-01T00:00:00.000Z","mono_s":1.5,"kind":"%s"}\n' % kind.encode()


def test_records_are_given_as_they_come_and_half_a_line_only_once_it_is_whole(tmp_path: Path) -> None:
    path = tmp_path / "run.jsonl"
    look = line("look")
    path.write_bytes(line("run_start") + look[:30])
    writing = iter([look[30:] + b"not a record\n", line("run_end") + line("after")])

    def going_on() -> bool:
        with path.open("ab") as file:
            file.write(next(writing))
        return True

    assert [record["kind"] for record in follow(tmp_path, going_on)] == ["run_start", "look", "run_end"]


def test_where_nothing_goes_on_any_more_all_that_is_there_is_given(tmp_path: Path) -> None:
    path = tmp_path / "run.jsonl"
    path.write_bytes(line("run_start") + line("look") + b'{"kind":"torn')
    assert [record["kind"] for record in follow(tmp_path, lambda: False)] == ["run_start", "look"]
