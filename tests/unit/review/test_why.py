"""The likeliest cause of each miss."""

from __future__ import annotations

from daemon.review.page import read_digest
from daemon.review.pagedata import page_data
from daemon.review.why import causes
from tests.worlds.made_run import MadeRun, part


def test_the_likeliest_cause_of_a_miss_comes_first(made: MadeRun) -> None:
    made.pick("missed", chi2=80.0)
    found = causes(read_digest(made.close()).cycles[0])
    assert found[0].stage == "estimate"
    assert "chi-square 80" in found[0].evidence
    assert {c.stage for c in found} >= {"estimate", "grasp"}


def test_a_refused_move_and_a_fault_are_named_with_what_led_to_them(made: MadeRun) -> None:
    made.cycle = 1
    made.write("cycle_start", cycle=1, target="cube")
    made.write("move", cycle=1, how="joint", purpose="stand-off 300 mm", target=None, speed_pct=50.0)
    made.write("refusal", cycle=1, rule="below_table", text="the tool would be 3 mm above the table")
    made.write("fault", cycle=1, code="link", text="no answer within 5 s")
    made.write("cycle_end", cycle=1, outcome="fault", label="cube", why="no answer", stops=0, predicted=None)
    run = read_digest(made.close())
    assert [c.stage for c in causes(run.cycles[0])[:2]] == ["arm", "guard"]
    events = [e for e in page_data(run)["events"] if e["kind"] == "refusal"]
    assert events[0]["after"].endswith("stand-off 300 mm")
    assert events[0]["cycle"] == 1


def test_an_ambiguous_part_is_told_with_its_candidates(made: MadeRun) -> None:
    made.cycle = 1
    made.write("cycle_start", cycle=1, target=None)
    made.look("survey 1", part("unknown", ambiguous=True, candidates=["cube", "pyramid"], reason="one square"))
    made.write("cycle_end", cycle=1, outcome="ambiguous", label=None, why="could be two", stops=0, predicted=None)
    found = causes(read_digest(made.close()).cycles[0])
    assert any("cube or pyramid" in c.evidence for c in found)


def test_what_stood_between_a_part_and_its_name_comes_with_its_own_remedy(made: MadeRun) -> None:
    made.cycle = 1
    made.write("cycle_start", cycle=1, target=None)
    made.look("survey 1", part("unknown", cause="hidden", reason="part of it is hidden (one square)"))
    made.write("cycle_end", cycle=1, outcome="unknown", label=None, why="not named", stops=0, predicted=None)
    found = causes(read_digest(made.close()).cycles[0])
    assert any("hidden" in c.evidence and "move what lies before it" in c.remedy for c in found)


def test_a_picked_part_and_an_empty_table_need_no_cause(made: MadeRun) -> None:
    made.pick()
    made.pick("empty", why="nothing on the table")
    assert [causes(c) for c in read_digest(made.close()).cycles] == [[], []]
