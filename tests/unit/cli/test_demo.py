"""The demo's table, of picks that went otherwise than in the brochure as well."""

from __future__ import annotations

from daemon.cli.demo import _follow_auto, _table


def test_a_pick_that_ended_before_anybody_knew_its_error_is_told_in_the_table_as_well(capsys) -> None:
    picked = {"label": "cube", "outcome": "picked", "held": True, "stops": 3, "seconds": 7.0,
              "predicted": {"mm": 0.6, "deg": 0.1}, "error_mm": 0.5, "error_deg": 0.2}  # fmt: skip
    cut_off = {**picked, "outcome": "fault", "held": False, "stops": 0, "error_mm": None, "error_deg": None,
               "predicted": {"mm": None, "deg": None}}  # fmt: skip
    assert _table([picked, cut_off], 4, ("picked",)) == 1
    told = capsys.readouterr().out.splitlines()
    assert "0.60 mm 0.10 deg" in told[2]
    assert told[3].split()[:5] == ["cube", "fault", "0", "-", "-"]


def test_what_a_pick_tries_again_is_printed_and_its_outcome_once(capsys) -> None:
    def decided(text: str, why: str) -> dict[str, object]:
        return {"kind": "decision", "text": text, "why": why}

    end = {"kind": "cycle_end", "cycle": 1, "outcome": "picked", "why": "in the bin", "mono_s": 9.0}
    begun, over = {"kind": "cycle_start", "cycle": 1, "mono_s": 2.0}, {"kind": "auto", "on": False}
    records = [begun, decided("missed", "it slipped: once more"), decided("picked", "in the bin"), end, over]
    ends, _ = _follow_auto(iter(records))
    assert [one["outcome"] for one in ends] == ["picked"]
    assert capsys.readouterr().out.splitlines() == [
        "  missed: it slipped: once more",
        "  picked: in the bin (7.0 s)",
    ]
