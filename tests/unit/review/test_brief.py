"""A run read without its scenes: the same lines as a whole reading takes, and no other."""

from __future__ import annotations

import json

import numpy as np
import pytest

from daemon.review.brief import read_brief
from daemon.review.page import read_digest
from daemon.review.production import production
from daemon.review.week import run_json
from daemon.store.runs import read_run
from tests.fakes.made_run import MadeRun, part


@pytest.mark.parametrize("missing", ["kind", "seq", "t", "mono_s"])
def test_a_fault_without_what_every_line_has_is_no_line_for_either_reading(made: MadeRun, missing: str) -> None:
    """One without its number was taken by the brief reading alone, and ended the week's page with a KeyError."""
    made.pick()
    for text in ("the cable", "the hand"):
        made.write("fault", cycle=made.cycle, code="link", text=text, **{"while": "moving"})
    folder = made.close()
    lines = [json.loads(line) for line in (folder / "run.jsonl").read_text().splitlines()]
    spoiled = next(line for line in lines if line.get("text") == "the cable")
    del spoiled[missing]
    (folder / "run.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
    whole = [record["seq"] for record in read_run(folder).records]
    assert [record["seq"] for record in read_brief(folder).records] == whole
    assert len(whole) == len(lines) - 1


@pytest.mark.parametrize(("held_back", "uncounted"), [(False, 1), (True, 0)])
def test_a_week_counts_what_the_runs_own_page_does(made: MadeRun, held_back: bool, uncounted: int) -> None:
    """A hand that closes once more before it opens over the bin was taken for one that had opened before; a move to the
    bin that was held back as it was typed is none."""
    made.cycle += 1
    made.write("cycle_start", cycle=1, target=None)
    made.look("survey 1", part("cube"))
    made.write("estimate", cycle=1, stop=1, label="cube", world_from_part=np.eye(4))
    made.write("decision", cycle=1, text="missed", why="cube still lies there", code="still_there")
    made.write("hand", cycle=1, closed=True)
    made.write("move", cycle=1, how="joint", purpose="bin", target=None, speed_pct=100)
    if held_back:
        made.write("held_back", cycle=1, what="move")
    made.write("hand", cycle=1, closed=False)
    made.look("survey 1")
    made.write("cycle_end", cycle=1, outcome="picked", label="cube", stops=2, why="gone", predicted=None)
    folder = made.close()
    whole = production([read_digest(folder)])
    assert (production([read_brief(folder)]), whole["uncounted"]) == (whole, uncounted)


def test_a_measure_that_is_no_number_is_none(made: MadeRun) -> None:
    made.look("survey", pitch_deg=0.5, pitch_sigma_deg="far")
    made.look("survey", pitch_deg=0.25, pitch_sigma_deg=0.1)
    assert run_json(read_brief(made.close()))["drift"]["pitch"] == 0.25
