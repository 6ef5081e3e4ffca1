"""A run's records as they are written: in order, whole, and to an end."""

from __future__ import annotations

from pathlib import Path

from daemon.store.runs import follow


def test_records_are_given_as_they_come_and_half_a_line_only_once_it_is_whole(tmp_path: Path) -> None:
    path = tmp_path / "run.jsonl"
    path.write_bytes(b'{"kind":"run_start"}\n{"kind":"lo')
    writing = iter([b'ok"}\nnot a record\n', b'{"kind":"run_end"}\n{"kind":"after"}\n'])

    def going_on() -> bool:
        with path.open("ab") as file:
            file.write(next(writing))
        return True

    assert [record["kind"] for record in follow(path, going_on)] == ["run_start", "look", "run_end"]


def test_where_nothing_goes_on_any_more_all_that_is_there_is_given(tmp_path: Path) -> None:
    path = tmp_path / "run.jsonl"
    path.write_bytes(b'{"kind":"run_start"}\n{"kind":"look"}\n{"kind":"torn')
    assert [record["kind"] for record in follow(path, lambda: False)] == ["run_start", "look"]
