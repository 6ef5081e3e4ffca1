"""Tables of a run for a spreadsheet."""

from __future__ import annotations

import csv
from pathlib import Path

from daemon import ctl
from tests.fakes.made_run import MadeRun


def test_csv_tables_have_a_row_a_cycle_and_a_row_a_look(made: MadeRun, tmp_path: Path) -> None:
    made.pick()
    made.pick("missed")
    made.close()
    runs = ["--runs", str(made.folder.parent)]
    assert ctl.main(["export", *runs, "--csv", "--out", str(tmp_path / "csv"), "--cell", "7"]) == 0
    with (tmp_path / "csv" / "cycles.csv").open() as file:
        cycles = list(csv.DictReader(file))
    assert [(c["cell"], c["outcome"]) for c in cycles] == [("7", "picked"), ("7", "missed")]
    with (tmp_path / "csv" / "looks.csv").open() as file:
        assert len(list(csv.DictReader(file))) == 6
