"""The questions, answered; and the page that documents them and the table."""

from __future__ import annotations

import re
from datetime import date
from pathlib import Path

import pytest

from daemon.fleet.layout import rows_of
from daemon.fleet.store import Store, open_store
from daemon.fleet.views import open_views
from daemon.review.page import read_digest
from daemon.store import folders
from tests.fakes.made_run import MadeRun, part
from tests.manuals.data import QUESTIONS, Question, document

pytest.importorskip("fsspec", reason="fsspec is not installed: make extra-fleet")
duckdb = pytest.importorskip("duckdb", reason="duckdb is not installed: make extra-fleet")
parquet = pytest.importorskip("pyarrow.parquet", reason="pyarrow is not installed: make extra-fleet")
made_year = pytest.importorskip("tests.fakes.made_year", reason="pyarrow is not installed: make extra-fleet")

DATA = (folders.HOUSE / "docs" / "DATA.md").read_text()


@pytest.fixture(scope="module")
def year(tmp_path_factory: pytest.TempPathFactory) -> Store:
    """Sixty days of eight cells."""
    folder = tmp_path_factory.mktemp("year")
    made = MadeRun(folder / "20260102T030405Z")
    cameras = {"darkness_left": 200.0, "darkness_right": 190.0, "pitch_deg": 0.01, "pitch_sigma_deg": 0.02}
    look = made.look
    made.look = lambda *args, **more: look(*args, **(cameras | more))
    for label in ("cube", "pyramid", "pentagonal_prism"):
        made.pick(label=label)
    made.cycle += 1
    made.write("cycle_start", cycle=made.cycle)
    made.look("survey 1", part("pyramid", runner_up="cube"))
    made.write("cycle_end", cycle=made.cycle, outcome="missed", label="pyramid", stops=0, why="it lies where it lay")
    made.close()
    store = open_store(str(folder / "store"))
    picks = made_year.picks_of([rows_of(read_digest(made.folder))])
    assert sum(made_year.write_year(store, picks, 8, date(2026, 5, 1), 60, 20)) > 90_000
    return store


NOT_MADE = ("Which part was given a name that the pick then disproved?", "Which place is missed, where?")
"""Questions that the made year has no answer to."""


@pytest.mark.parametrize("question", QUESTIONS, ids=lambda q: q.text)
def test_a_question_is_answered(year: Store, question: Question) -> None:
    answer = open_views(year).execute(question.sql)
    columns = [d[0] for d in answer.description]
    rows = answer.fetchall()
    assert len(columns) == len(set(columns))
    if question.text not in NOT_MADE:
        assert rows
        assert all(row[0] is not None for row in rows)


def test_counts_agree_with_what_was_written(year: Store) -> None:
    """Question two, counted once more by hand."""
    rows = open_views(year).execute("SELECT cell, label, outcome FROM cycles WHERE tried").fetchall()
    top = open_views(year).execute(QUESTIONS[1].sql).fetchone()
    assert top is not None
    of = [outcome for cell, label, outcome in rows if (cell, label) == top[:2]]
    assert (len(of), sum(outcome != "picked" for outcome in of)) == top[2:4]


def test_only_the_months_that_are_asked_for_are_opened(year: Store) -> None:
    (months,) = zip(*open_views(year, ["2026-06"]).execute("SELECT DISTINCT month FROM looks").fetchall(), strict=True)
    assert months == ("2026-06",)


def test_a_store_without_a_row_answers_with_none(tmp_path: Path) -> None:
    asked = open_views(open_store(str(tmp_path)))
    assert [asked.execute(q.sql).fetchall() for q in QUESTIONS] == [[]] * len(QUESTIONS)


def test_the_documented_page_is_what_the_code_says() -> None:
    assert document() == DATA, "`make docs`"


def test_the_documented_lines_of_sql_run_as_they_stand(year: Store) -> None:
    view, *questions = re.findall(r"```sql\n(.*?)```", DATA, re.DOTALL)
    assert len(questions) == len(QUESTIONS)
    connection = duckdb.connect()
    for name in ("runs", "cycles", "looks", "parts", "moves", "health"):
        connection.execute(view.replace("STORE", year.root).replace("cycles", name))
    for question in questions:
        connection.execute(question).fetchall()


def test_the_documented_line_makes_a_folder_a_cell_and_day_of_the_table(year: Store, tmp_path: Path) -> None:
    line = re.search(r"^`(COPY .*)`\.$", DATA, re.MULTILINE)
    assert line
    open_views(year).execute(line[1].replace("'days'", f"'{tmp_path}/days'"))
    assert len(list((tmp_path / "days").glob("cell=*/day=2026-??-??"))) == 8 * 60
    (there,) = duckdb.execute(f"SELECT count(*) FROM '{tmp_path}/days/*/*/*.parquet'").fetchone()
    assert there == open_views(year).execute("SELECT count(*) FROM looks").fetchone()[0]


def test_the_rows_of_a_day_lie_together_in_their_month_s_file(year: Store) -> None:
    for file in Path(year.root).glob("tables/*/*/*/rows.parquet"):
        days = parquet.ParquetFile(file).read(["day"])["day"].to_pylist()
        assert days == sorted(days)
