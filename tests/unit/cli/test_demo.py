"""The demo's table, of picks that went otherwise than in the brochure as well."""

from __future__ import annotations

from daemon.cli.demo import _table


def test_a_pick_that_ended_before_anybody_knew_its_error_is_told_in_the_table_as_well(capsys) -> None:
    picked = {"label": "cube", "outcome": "picked", "held": True, "stops": 3, "seconds": 7.0,
              "predicted": {"mm": 0.6, "deg": 0.1}, "error_mm": 0.5, "error_deg": 0.2}  # fmt: skip
    cut_off = {**picked, "outcome": "fault", "held": False, "stops": 0, "error_mm": None, "error_deg": None,
               "predicted": {"mm": None, "deg": None}}  # fmt: skip
    assert _table([picked, cut_off], 4) == 1
    told = capsys.readouterr().out.splitlines()
    assert "0.60 mm 0.10 deg" in told[2]
    assert told[3].split()[:5] == ["cube", "fault", "0", "-", "-"]
