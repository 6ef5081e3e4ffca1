"""A run read without its scenes: the same lines as a whole reading takes, and no other."""

from __future__ import annotations

import json

import pytest

from daemon.review.brief import read_brief
from daemon.store.runs import read_run
from tests.worlds.made_run import MadeRun


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
